// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/display_planes.h"

#include "sparegs/runtime.h"

typedef struct background_job {
    sgs_frame *frame;
    const float *background;
} background_job;

static void background_range(void *context, size_t begin, size_t end)
{
    const background_job *job = context;
    for (size_t c = 0; c < 3; ++c)
        for (size_t i = begin; i < end; ++i)
            job->frame->color[c][i] += job->frame->transmittance[i] * job->background[c];
}

void frame_add_background(sgs_frame *frame, const float background[3])
{
    const size_t pixels = (size_t)frame->width * (size_t)frame->height;
    background_job job = {frame, background};
    sgs_parallel_ranges(pixels, PIXELS_AT_ONCE, background_range, &job);
}
