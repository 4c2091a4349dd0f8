// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Range of the values of an image plane, for scores that are normalised per view.

#include <stddef.h>

typedef struct sgsi_plane_range {
    float least, most; // INFINITY and -INFINITY without a value; NaN does not count
} sgsi_plane_range;

// plane [height][stride], of which width columns count. Uses all threads.
sgsi_plane_range sgsi_plane_range_find(const float *plane, int width, int height, size_t stride);
