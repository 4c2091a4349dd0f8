// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What a reader of camera files (colmap.c, transforms.c) hands to scene.c: frames without their
// pixels and the sparse cloud. Not sorted, not split by --test-every, image files not looked at.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/scene.h"

// One registered photograph. A camera of width 0 takes its size from the image file; then a
// positive angle_x gives the horizontal field of view (radians) and a NaN principal point means the
// image centre.
typedef struct sgsi_frame {
    char *name; // relative to the image folder, '/' separators; also the view's name
    char *mask; // that the files name for it, likewise relative, or NULL
    sgs_camera camera;
    sgs_pose pose;
    double angle_x;
    sgs_split split; // where the files say so (dataset.has_split)
    uint64_t place;  // byte or line in the file, for messages
} sgsi_frame;

typedef struct sgsi_dataset {
    sgs_scene_format format;
    size_t frame_count;
    sgsi_frame *frames;
    size_t point_count;
    float *points;         // [point_count][3], finite
    uint8_t *colors;       // [point_count][3]
    bool has_split;        // the files name the held-out frames
    bool white_background; // NeRF synthetic: RGBA images are meant over white
} sgsi_dataset;

// Frees the contents and zeroes the struct; accepts an empty one.
void sgsi_dataset_free(sgsi_dataset *dataset);

// Cleans an image name in place ('\' becomes '/', "./" and "//" go) and refuses names that are
// empty, too long, hold control characters or leave their folder (absolute, ".."). NULL when fine,
// else the reason.
const char *sgsi_image_name_clean(char *name);

// Fails when two frames have the same name; `path` and `unit` ("byte", "line") are for the message.
sgs_status sgsi_dataset_check_names(const sgsi_dataset *dataset, const char *path,
                                    const char *unit);
