// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/display_planes.h"

#include <stdlib.h>

#include "sparegs/metrics.h"
#include "sparegs/runtime.h"

typedef struct flatten_job {
    const sgs_photo *photo;
    const float *background;
    float *planes;
} flatten_job;

static void flatten_range(void *context, size_t begin, size_t end)
{
    const flatten_job *job = context;
    const sgs_photo *photo = job->photo;
    const size_t pixels = (size_t)photo->width * (size_t)photo->height;
    for (size_t i = begin; i < end; ++i) {
        const float alpha = photo->channels > 3 ? sgs_photo_value(photo, 3 * pixels + i) : 1.0F;
        for (size_t c = 0; c < 3; ++c)
            job->planes[c * pixels + i] = alpha * sgs_photo_value(photo, c * pixels + i) +
                                          (1.0F - alpha) * job->background[c];
    }
}

float *photo_flatten(const sgs_photo *photo, const float background[3])
{
    const size_t pixels = (size_t)photo->width * (size_t)photo->height;
    flatten_job job = {photo, background, malloc(3 * pixels * sizeof *job.planes)};
    if (job.planes)
        sgs_parallel_ranges(pixels, PIXELS_AT_ONCE, flatten_range, &job);
    return job.planes;
}

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

static void encode_range(void *context, size_t begin, size_t end)
{
    float *const *color = context;
    for (size_t c = 0; c < 3; ++c)
        for (size_t i = begin; i < end; ++i)
            color[c][i] = sgs_srgb_encode(color[c][i]);
}

sgs_status planes_quantise(float *const color[3], sgs_space space, int width, int height,
                           sgs_image8 *out)
{
    const size_t pixels = (size_t)width * (size_t)height;
    if (space == SGS_SPACE_LINEAR)
        sgs_parallel_ranges(pixels, PIXELS_AT_ONCE, encode_range, (void *)color);
    return sgs_image8_from_planes((const float *const *)color, NULL, NULL, width, height, out);
}
