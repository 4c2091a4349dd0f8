// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Pictures of numbers: a plane of floats as an 8-bit image for people. The exact values belong in
// an EXR.

#include "sparegs/image.h"
#include "sparegs/render.h"

typedef struct value_range {
    float low, high;
} value_range;

// The 1 % and 99 % quantiles of the positive values; {0, 1} if there are none.
value_range plane_range(const float *plane, size_t count);

// Colours the positive values from dark (low) to light (high); zero and below become black.
// out->pixels is allocated. False when out of memory.
bool plane_colored(const float *plane, int width, int height, value_range range, sgs_image8 *out);

// Grey, 0 black and 1 white. False when out of memory.
bool plane_grey(const float *plane, int width, int height, sgs_image8 *out);

// Unit vectors: each axis from -1 to 1 as red, green and blue from dark to light; zero vectors
// become black.
bool normals_colored(const float *const normal[3], int width, int height, sgs_image8 *out);

// Points: each axis from the 1 % to the 99 % quantile of the points seen; pixels that see nothing
// (transmittance 1) become black.
bool positions_colored(const float *const position[3], const float *transmittance, int width,
                       int height, sgs_image8 *out);

// A colour per number; SGS_NO_PRIMITIVE becomes black.
bool ids_colored(const uint32_t *ids, int width, int height, sgs_image8 *out);

// A signed plane through tanh, as SPARE-GS's weight is: -1 and less towards red (over budget), 0
// light grey, 1 blue (room to grow); black where `ids` says SGS_NO_PRIMITIVE.
bool slack_colored(const float *slack, const uint32_t *ids, int width, int height, sgs_image8 *out);
