// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Boxes that divide space among the blocks of a large scene. A box is half-open, so that a point on
// a face belongs to one of two neighbours only, and its outer faces are infinite, so that boxes can
// fill space.
//
// Threads: pure functions.

#include <math.h>
#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

// The points with low <= x < high on each axis, world units. Bounds may be infinite.
typedef struct sgs_box {
    float low[3], high[3];
} sgs_box;

static inline sgs_box sgs_box_infinite(void)
{
    const sgs_box box = {{-INFINITY, -INFINITY, -INFINITY}, {INFINITY, INFINITY, INFINITY}};
    return box;
}

static inline bool sgs_box_is_infinite(const sgs_box *box)
{
    bool infinite = true;
    for (int k = 0; k < 3; ++k)
        infinite = infinite && box->low[k] == -INFINITY && box->high[k] == INFINITY;
    return infinite;
}

static inline bool sgs_box_contains(const sgs_box *box, const float point[3])
{
    bool inside = true;
    for (int k = 0; k < 3; ++k)
        inside = inside && box->low[k] <= point[k] && point[k] < box->high[k];
    return inside;
}

// Distance of a point in the box to the nearest face that is not infinite; INFINITY without one.
static inline float sgs_box_face_distance(const sgs_box *box, const float point[3])
{
    float least = INFINITY;
    for (int k = 0; k < 3; ++k) {
        const float low = point[k] - box->low[k], high = box->high[k] - point[k];
        least = low < least ? low : least;
        least = high < least ? high : least;
    }
    return least;
}

#ifdef __cplusplus
}
#endif
