// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Writes a rendered frame as one EXR file with a layer per AOV, or as one PNG file per AOV.

#include <stdbool.h>

#include "draw/picture_ranges.h"
#include "draw/region_map.h"
#include "sparegs/image.h"
#include "sparegs/render.h"

typedef enum exr_encoding { EXR_LINEAR = 0, EXR_SRGB = 1 } exr_encoding;

typedef struct frame_files {
    const char *folder, *stem; // see file_stems.h
    const char *name;          // of the view, with its extension
    const sgs_camera *camera;  // with the overscan
    const sgs_pose *pose;
    int overscan; // EXR only: pixels of the camera around the display window
    unsigned aovs;
    bool axis_depth;                 // distances are along the camera axis
    exr_encoding encoding;           // EXR only
    sgs_exr_compression compression; // EXR only
    bool half;                       // EXR only: half floats where aov_row.half, and in deep files
    double frame_rate;               // EXR only: frames per second, 0 = unknown
    float background[3];             // PNG only
    sgs_space space;                 // of the frame's colours
    float white_point;               // scene-linear value of colour 1
    double near_distance;            // near clipping distance of the render
    const region_map *regions;       // of the model; for AOV_REGION and AOV_SLACK only
    const picture_ranges *ranges;    // PNG only
    bool is_silent;                  // EXR only: the path is not printed
} frame_files;

// The camera of an image with `pixels` more on each side, or less if negative.
sgs_camera camera_with_border(const sgs_camera *camera, int pixels);

// Opens FOLDER/STEM.deep.exr. NULL after printing the error.
typedef struct deep_file deep_file;
deep_file *deep_file_open(const frame_files *files, const sgs_frame *frame, int max_samples);
// A sgs_deep_rows_fn whose context is the deep_file. The frame must still contain the model's
// colours.
sgs_status deep_file_rows(void *context, int y, int rows, const uint32_t *counts,
                          const sgs_deep_sample *samples);
// True if deep_file_rows has failed and printed the error, which the library then does not know.
bool deep_file_failed(const deep_file *file);
// Completes the file and prints its path, or discards it if `complete` is false. False after
// printing the error.
bool deep_file_close(deep_file *file, bool complete);

// The colours as a display image over the background. False after printing the error.
bool frame_picture(const frame_files *files, const sgs_frame *frame, sgs_image8 *image);

// The picture of AOV k (a row of aov_rows) as in its PNG file. False after printing the error.
bool frame_aov_picture(const frame_files *files, const sgs_frame *frame, int k, sgs_image8 *image);

// Writes FOLDER/STEM.exr and prints the path. May overwrite the frame's colour planes. False after
// printing the error.
bool frame_write_exr(const frame_files *files, sgs_frame *frame);

// Writes FOLDER/STEM.png and FOLDER/STEM.AOV.png.
bool frame_write_png(const frame_files *files, const sgs_frame *frame);

// Memory that writing a frame takes beside its planes, bytes per pixel: derived planes of an EXR
// file (`exr`), the picture of a PNG file or of a video (`pictures`). Without buffers of encoders.
double frame_writing_bytes(unsigned aovs, sgs_space space, bool exr, bool pictures);

// Calls `visit` with the path of each file that frame_write_png, or else frame_write_exr, and with
// `deep` deep_file_close would write, until it returns false. True if it never did.
typedef bool (*frame_files_fn)(const char *path, void *context);
bool frame_files_each(const char *folder, const char *stem, unsigned aovs, bool png, bool deep,
                      frame_files_fn visit, void *context);

// True if all these files exist and none is empty. They are complete then: each is written as a
// whole.
bool frame_files_exist(const char *folder, const char *stem, unsigned aovs, bool png, bool deep);
