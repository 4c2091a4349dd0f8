// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Many pictures for one: points in the pixel against jagged edges, points on the lens for depth of
// field. Knows no renderer.

#include <stdbool.h>

#include "sparegs/render.h"

// The camera of sample k: a point of the pixel and of a lens of diameter `aperture` (world units),
// the plane at distance `focus` along the axis being sharp. k = 0, 1, ...: any number of the first
// samples covers pixel and lens evenly.
void lens_sample(int k, double aperture, double focus, sgs_camera *camera, sgs_pose *pose);

// Sums of light: scene-linear, premultiplied.
typedef struct light_sum {
    float *color[3], *transmittance; // [pixels]
    int width, height, count;
    bool light; // the frames hold light, not display values
} light_sum;

// False when out of memory. light_sum_free accepts a zeroed one.
bool light_sum_begin(light_sum *sum, int width, int height, bool light);
void light_sum_add(light_sum *sum, const sgs_frame *frame);
// Writes the mean to a frame's colour (what the frames hold) and transmittance.
void light_sum_mean(const light_sum *sum, sgs_frame *frame);
void light_sum_free(light_sum *sum);
