// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Visualisation: planes of numbers as 8-bit images. Exact values are written to EXR files.

#include "sparegs/image.h"
#include "sparegs/render.h"

typedef struct value_range {
    float low, high;
} value_range;

// The 1 % and 99 % quantiles of the positive values; {0, 1} if there are none.
value_range plane_range(const float *plane, size_t count);
// The same quantiles of all values, which are sorted.
value_range sorted_range(float *values, size_t count);

// Maps positive values to colours from dark (low) to light (high); other values become black.
// Allocates out->pixels. False if out of memory.
bool plane_colored(const float *plane, int width, int height, value_range range, sgs_image8 *out);

// Errors from 0 (black) to 1 (pale yellow) in the colours of magma, in 256 steps, as the maps of
// FLIP's authors. Allocates out->pixels. False if out of memory.
bool errors_colored(const float *plane, int width, int height, sgs_image8 *out);

// Greyscale from 0 (black) to 1 (white). False if out of memory.
bool plane_grey(const float *plane, int width, int height, sgs_image8 *out);

// Unit vectors: x, y, z from -1 to 1 as red, green, blue from dark to light. Zero vectors become
// black.
bool normals_colored(const float *const normal[3], int width, int height, sgs_image8 *out);

// Points: each axis over its range. Empty pixels (0, 0, 0) become black.
bool positions_colored(const float *const position[3], const value_range ranges[3], int width,
                       int height, sgs_image8 *out);

// One colour per id; SGS_NO_PRIMITIVE becomes black.
bool ids_colored(const uint32_t *ids, int width, int height, sgs_image8 *out);

// Slack through tanh, as in SPARE-GS's weight: negative towards red (over quota), 0 light grey,
// positive towards blue (under quota). Black where `ids` is SGS_NO_PRIMITIVE.
bool slack_colored(const float *slack, const uint32_t *ids, int width, int height, sgs_image8 *out);
