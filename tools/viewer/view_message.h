// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Messages from the viewer's page: JSON objects with a "type", checked and converted. Everything
// that arrives is untrusted.

#include "cameras/camera_file.h"
#include "draw/aov_list.h"
#include "draw/colormap.h"

enum {
    MESSAGE_BYTES = 65536, // longer messages are refused
    VIEW_SIDE = 8192,      // pixels
    VIEW_PIXELS = 16 << 20,
    VIEW_SAMPLES = 64
};

typedef enum view_message_type {
    MESSAGE_INVALID = 0,
    MESSAGE_CAMERA,  // draw this
    MESSAGE_ACK,     // frame `number` was displayed
    MESSAGE_PROBE,   // values of the AOVs at pixel (x, y)
    MESSAGE_RAY,     // primitives along the ray through pixel (x, y)
    MESSAGE_REGION,  // records of region `number`
    MESSAGE_HISTORY, // tables of the run
    MESSAGE_RUN,     // `action`
    MESSAGE_EXR,     // write the view into the run's folder
    MESSAGE_CROP     // write the primitives that the crop keeps
} view_message_type;

typedef enum run_action { RUN_PAUSE = 0, RUN_CONTINUE, RUN_CHECKPOINT, RUN_STOP } run_action;

typedef enum crop_show { CROP_OFF = 0, CROP_MARK, CROP_HIDE } crop_show;

// Filters of `convert`, and how the picture shows what they remove.
typedef struct view_crop {
    crop_show preview;
    bool has_box, has_sphere, floaters;
    double box[6];    // low, high; infinite = no limit
    double sphere[4]; // centre, radius
    double opacity;   // smallest one kept; 0 = all
    double size;      // largest scale kept, world units; 0 = all
    double slack;     // smallest slack of the region kept; -INFINITY = all
    int64_t region;   // the only region kept; -1 = all
} view_crop;

bool view_crop_equal(const view_crop *a, const view_crop *b);

// What a page shows.
typedef struct view_request {
    uint32_t serial; // of the page, returned with the frames
    sgs_camera camera;
    sgs_pose pose;
    int aov;           // row of aov_rows
    value_range range; // of the colours; {0, 0}: measured
    bool is_log;       // colours by the logarithm of the value
    bool moving;       // more messages follow at once: speed before quality
    int samples;       // per pixel at rest, 1 to VIEW_SAMPLES
    view_crop crop;
} view_request;

// True if both show the same picture at rest.
bool view_request_same(const view_request *a, const view_request *b);

typedef struct view_message {
    view_message_type type;
    view_request request; // of MESSAGE_CAMERA; of others, set by the hub
    const char *refused;  // of MESSAGE_CAMERA: why colours or crop are not used, or NULL
    bool has_crop;        // of MESSAGE_CROP: request.crop; otherwise that of the last camera
    int x, y;
    uint32_t number;
    run_action action;
} view_message;

// Parses a message of `size` bytes. views: the cameras that "view" and "lens" are numbers of.
// Returns NULL, or a description of the error; then message->type is MESSAGE_INVALID. A camera
// whose colours or crop are wrong is drawn without them.
const char *view_message_parse(const char *text, size_t size, const camera_list *views,
                               view_message *message);
