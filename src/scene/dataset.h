// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Result of a camera file reader (colmap.c, transforms.c), passed to scene.c: frames without
// pixels, and the sparse point cloud. Frames are unsorted, and options for the split are not
// applied.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/path_sandbox.h"
#include "sparegs/scene.h"

// A registered photo. A camera of width 0 takes its size from the image file; a positive
// angle_x or angle_y is then the horizontal or vertical field of view (radians), and a NaN
// principal point is the image centre.
typedef struct sgsi_frame {
    char *name; // relative to the image folder, '/' separators; also the view's name
    char *mask; // mask named by the camera file, relative to the image folder, or NULL
    sgs_camera camera;
    sgs_pose pose;
    double angle_x, angle_y;
    double circle;    // radius of the image circle in the camera's pixels, 0 = no circle
    sgs_split split;  // if the files define it (dataset.has_split)
    uint64_t place;   // byte, line or frame in the file, for errors
    const char *file; // static name of the second file if `place` is in it, or NULL
} sgsi_frame;

typedef struct sgsi_dataset {
    sgs_scene_format format;
    size_t frame_count;
    sgsi_frame *frames;
    size_t point_count;
    float *points;         // [point_count][3], finite
    uint8_t *colors;       // [point_count][3]
    bool has_split;        // the files define the held-out frames
    bool white_background; // NeRF synthetic: composite RGBA images over white
} sgsi_dataset;

// Frees the contents and zeroes the struct. Accepts an empty one.
void sgsi_dataset_free(sgsi_dataset *dataset);

// Normalises an image name in place ('\' to '/', without "./" and "//"). Returns NULL, or the
// reason if the name is empty, too long, has control characters or leaves its folder (absolute,
// "..").
const char *sgsi_image_name_clean(char *name);

// True if the name ends with the extension of an image format, in lower or upper case. Cannot fail.
bool sgsi_image_name_has_format(const char *name);

// Length, with its '/', of the top folder that the names of all frames share; 0 if there is none.
// Cannot fail.
size_t sgsi_dataset_top_folder(const sgsi_dataset *dataset);

// Adds the top-level folders of the names, which are relative to image_folder, as roots: they may
// be links, like COLMAP's image folder. The frames are sorted by name. Fails with OUT_OF_MEMORY.
sgs_status sgsi_dataset_add_roots(const sgsi_dataset *dataset, const char *image_folder,
                                  sgsi_roots *roots);

// Fails if two frames have the same name. `path` and `unit` ("byte", "line") are used in the error.
sgs_status sgsi_dataset_check_names(const sgsi_dataset *dataset, const char *path,
                                    const char *unit);
