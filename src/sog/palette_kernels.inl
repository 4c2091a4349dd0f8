// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Distances of several vectors to 16 entries at a time. Every distance is one sum over the
// dimensions in their order, without fused operations, so that the bits do not depend on the
// instruction set. Each lane keeps its first minimum; the lanes are compared at the end.

#include <math.h>

#include "sog/palette_kernels.h"

#if SGSI_ISA == 2
enum { ROWS = 8 };
#elif SGSI_ISA == 1
enum { ROWS = 4 };
#else
enum { ROWS = 2 };
#endif

// Vectors begin ... begin + ROWS - 1; those from `end` on repeat the last one.
static void nearest_of_rows(const sgsi_nearest *job, size_t begin, size_t end)
{
    const size_t dimensions = job->dimensions;
    const float *vectors[ROWS];
    vf best[ROWS], winner[ROWS];
    for (size_t r = 0; r < ROWS; ++r) {
        const size_t i = begin + r < end ? begin + r : end - 1;
        vectors[r] = job->vectors + job->rows[i] * dimensions;
        best[r] = vf_set1(INFINITY);
        winner[r] = vf_zero();
    }
    for (size_t g = 0; g < job->group_count; ++g) {
        const float *group = job->groups + g * dimensions * SGSI_PALETTE_GROUP;
        vf sums[ROWS];
        for (size_t r = 0; r < ROWS; ++r)
            sums[r] = vf_zero();
        for (size_t d = 0; d < dimensions; ++d) {
            const vf entries = vf_load(group + d * SGSI_PALETTE_GROUP);
            for (size_t r = 0; r < ROWS; ++r) {
                const vf difference = vf_sub(vf_set1(vectors[r][d]), entries);
                sums[r] = vf_add(sums[r], vf_mul(difference, difference));
            }
        }
        const vf number = vf_set1((float)g); // exact: at most 4096 groups
        for (size_t r = 0; r < ROWS; ++r) {
            const vm nearer = vf_lt(sums[r], best[r]);
            best[r] = vf_select(nearer, sums[r], best[r]);
            winner[r] = vf_select(nearer, number, winner[r]);
        }
    }
    for (size_t r = 0; r < ROWS && begin + r < end; ++r) {
        float distances[SGSI_PALETTE_GROUP], numbers[SGSI_PALETTE_GROUP];
        vf_store_u(distances, best[r]);
        vf_store_u(numbers, winner[r]);
        uint32_t label = 0;
        float least = INFINITY;
        for (uint32_t lane = 0; lane < SGSI_PALETTE_GROUP; ++lane) {
            const uint32_t entry = SGSI_PALETTE_GROUP * (uint32_t)numbers[lane] + lane;
            if (distances[lane] < least || (distances[lane] == least && entry < label)) {
                least = distances[lane];
                label = entry;
            }
        }
        job->labels[begin + r] = label;
        job->errors[begin + r] = least;
    }
}

void SGSI_KERNEL(sgsi_palette_nearest)(const sgsi_nearest *job, size_t begin, size_t end)
{
    for (size_t i = begin; i < end; i += ROWS)
        nearest_of_rows(job, i, end);
}
