// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "density/plane_range.h"

#include <math.h>

#include "base/threads.h"

enum { BLOCKS = 256 }; // of rows, at most

typedef struct range_job {
    const float *plane;
    size_t width, stride, grain;
    sgsi_plane_range ranges[BLOCKS];
} range_job;

static void find_block(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    range_job *job = context;
    float least = INFINITY, most = -INFINITY;
    for (size_t y = begin; y < end; ++y)
        for (size_t x = 0; x < job->width; ++x) {
            const float value = job->plane[y * job->stride + x];
            least = value < least ? value : least;
            most = value > most ? value : most;
        }
    job->ranges[begin / job->grain] = (sgsi_plane_range){least, most};
}

sgsi_plane_range sgsi_plane_range_find(const float *plane, int width, int height, size_t stride)
{
    const size_t rows = (size_t)height, grain = rows / BLOCKS + 1;
    range_job job = {.plane = plane, .width = (size_t)width, .stride = stride, .grain = grain};
    sgsi_parallel_ranges(rows, grain, find_block, &job);
    sgsi_plane_range range = {INFINITY, -INFINITY};
    for (size_t k = 0; k * grain < rows; ++k) {
        range.least = fminf(range.least, job.ranges[k].least);
        range.most = fmaxf(range.most, job.ranges[k].most);
    }
    return range;
}
