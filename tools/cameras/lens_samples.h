// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Multisampling: sample positions within the pixel for antialiasing, and on the lens for depth of
// field. Independent of the renderer.

#include <stdbool.h>

#include "sparegs/render.h"

// Moves the camera to sample k = 0, 1, ... of the pixel and of a lens with diameter `aperture`
// (world units), focused at distance `focus` along the axis. Any number of first samples covers
// pixel and lens evenly.
void lens_sample(int k, double aperture, double focus, sgs_camera *camera, sgs_pose *pose);

// Accumulated scene-linear colour, premultiplied.
typedef struct light_sum {
    float *color[3], *transmittance; // [pixels]
    int width, height, count;
    bool light; // the frames are scene-linear, not display-encoded
} light_sum;

// False if out of memory. light_sum_free accepts a zero-initialised sum.
bool light_sum_begin(light_sum *sum, int width, int height, bool light);
void light_sum_add(light_sum *sum, const sgs_frame *frame);
// Writes the mean to a frame's colour (encoded as the frames are) and transmittance.
void light_sum_mean(const light_sum *sum, sgs_frame *frame);
void light_sum_free(light_sum *sum);
