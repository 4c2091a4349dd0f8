// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The cameras of `render` and `profile`: views of a scene, a camera file or a path around the
// scene, optionally at another size or as panoramas, and ranges of them.

#include "cameras/camera_file.h"
#include "sparegs/scene.h"

enum { PROJECTION_VIEW = 0, PROJECTION_EQUIRECTANGULAR = 1 };

// The frame numbers first, first + step, ... up to last, which a list need not all have.
typedef struct frame_range {
    int first, last, step; // step 0: all frames
} frame_range;

typedef struct camera_choice {
    const char *view, *file; // or NULL
    sgs_split split;
    bool split_given;
    int orbit, spiral;  // frames, 0 = none
    double arc;         // of an orbit, degrees; 0 = as photographed
    bool keep_lens;     // paths keep the distortion of the first view
    bool pinhole;       // of all views: without distortion
    frame_range frames; // numbers, see first_frame
    int first_frame;    // number of the first camera, unless the file has frame numbers
    int width, height;  // 0 = the camera's own
    int projection;
} camera_choice;

// "FIRST", "FIRST-LAST" or "FIRST-LAST:STEP", where FIRST and LAST may be negative; false if it is
// none of these.
bool frame_range_parse(const char *text, frame_range *range);
// "WIDTHxHEIGHT", each from 1 to 65536.
bool size_parse(const char *text, int *width, int *height);

// Selects cameras and assigns their file stems and frame numbers; includes those outside of
// `frames`, which must have a camera in the list. scene may be NULL with a file. False after
// printing the error.
bool cameras_choose(const camera_choice *choice, const sgs_scene *scene, camera_list *list);
// Reduces the list to the cameras of `range`.
void cameras_keep_frames(const frame_range *range, camera_list *list);
