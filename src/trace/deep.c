// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Deep samples. A hit is a point sample: it adds w = T alpha times its colour to the pixel, where T
// is the transmittance in front of it. Consecutive hits merge into one sample if the last is within
// the tolerance, a fraction of the distance, of the first. With T in front of the first hit and W
// the sum of the weights, the sample has
//     alpha = W / T,    colour = sum(w c) / T    (premultiplied).
// Composited with `over`, it contributes and occludes exactly as its hits do, so flattening the
// file gives the flat image for any tolerance. If a pixel still exceeds max_samples, its tolerance
// grows until the samples fit.

#include "trace/deep.h"

#include <string.h>

#include "base/core.h"

void sgs_deep_options_init(sgs_deep_options *options, size_t size)
{
    const sgs_deep_options defaults = {.tolerance = 0.01, .max_samples = 32};
    sgsi_options_init(options, size, &defaults, sizeof defaults);
}

sgs_status sgsi_deep_reserve(sgsi_deep *deep, const sgs_deep_options *options, int width, int rows)
{
    const bool fits = deep->width == width && deep->options.max_samples == options->max_samples;
    deep->options = *options;
    if (fits && (size_t)rows <= deep->row_capacity)
        return SGS_STATUS_OK;
    sgsi_free(deep->counts);
    sgsi_free(deep->samples);
    const size_t pixels = (size_t)width * (size_t)rows;
    deep->width = width;
    deep->row_capacity = (size_t)rows;
    deep->counts = sgsi_alloc(pixels, sizeof *deep->counts);
    deep->samples = sgsi_alloc(pixels, (size_t)options->max_samples * sizeof *deep->samples);
    if (deep->counts && deep->samples)
        return SGS_STATUS_OK;
    sgsi_deep_free(deep);
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                     "not enough memory for %d deep samples in each of %d x %d pixels",
                     options->max_samples, width, rows);
}

void sgsi_deep_free(sgsi_deep *deep)
{
    sgsi_free(deep->counts);
    sgsi_free(deep->samples);
    *deep = (sgsi_deep){0};
}

void sgsi_deep_begin(sgsi_deep *deep, int first_row, int rows)
{
    deep->first_row = first_row;
    deep->rows = rows;
    memset(deep->counts, 0, (size_t)rows * (size_t)deep->width * sizeof *deep->counts);
}

// Sorts the counted hits of a lane by t. A key holds the bits of t, which order like positive
// floats, above the row index.
static size_t sort_hits(const sgsi_block_hits *hits, int lane, uint64_t *sorted)
{
    size_t count = 0;
    for (uint32_t i = 0; i < hits->count; ++i) {
        const float alpha = hits->alpha[16 * i + (size_t)lane],
                    front = hits->transmittance[16 * i + (size_t)lane];
        if (!(alpha > 0.0f) || !(front * (1.0f - alpha) >= hits->transmittance_min))
            continue;
        uint32_t bits;
        memcpy(&bits, &hits->t[16 * i + (size_t)lane], sizeof bits);
        const uint64_t key = (uint64_t)bits << 32 | i;
        size_t at = count++;
        for (; at && sorted[at - 1] > key; --at)
            sorted[at] = sorted[at - 1];
        sorted[at] = key;
    }
    return count;
}

static float key_distance(uint64_t key)
{
    const uint32_t bits = (uint32_t)(key >> 32);
    float t;
    memcpy(&t, &bits, sizeof t);
    return t;
}

// End of the run of hits that merge with the hit at `begin`.
static size_t run_end(const uint64_t *sorted, size_t begin, size_t count, double tolerance)
{
    const double limit = (double)key_distance(sorted[begin]) * (1 + tolerance);
    size_t end = begin + 1;
    while (end < count && ((double)key_distance(sorted[end]) <= limit))
        ++end;
    return end;
}

static double fitting_tolerance(const uint64_t *sorted, size_t count,
                                const sgs_deep_options *options)
{
    double tolerance = options->tolerance;
    for (;;) {
        size_t runs = 0;
        for (size_t i = 0; i < count; i = run_end(sorted, i, count, tolerance))
            ++runs;
        if (runs <= (size_t)options->max_samples)
            return tolerance;
        tolerance = tolerance < 1e-4 ? 1e-4 : 1.25 * tolerance;
    }
}

static sgs_deep_sample merge(const sgsi_block_hits *hits, int lane, const uint64_t *run,
                             size_t count)
{
    const float unit = hits->unit[lane];
    double front = 0, weights = 0, color[3] = {0, 0, 0};
    for (size_t k = 0; k < count; ++k) {
        const size_t i = (uint32_t)run[k];
        const float *shade =
            hits->projected + SGSI_PROJECTED_FLOATS * (size_t)hits->order[i] + SGSI_PROJECTED_COLOR;
        const double through = (double)hits->transmittance[16 * i + (size_t)lane];
        const double w = through * (double)hits->alpha[16 * i + (size_t)lane];
        // Equal distances are ordered by id, so the largest T need not be the first hit's.
        front = through > front ? through : front;
        weights += w;
        for (int c = 0; c < 3; ++c)
            color[c] += w * (double)shade[c];
    }
    const double scale = 1 / front;
    return (sgs_deep_sample){
        .z = key_distance(run[0]) * unit,
        .z_back = key_distance(run[count - 1]) * unit,
        .alpha = (float)(weights * scale < 1 ? weights * scale : 1),
        .color = {(float)(color[0] * scale), (float)(color[1] * scale), (float)(color[2] * scale)}};
}

void sgsi_deep_visit(void *context, const sgsi_block_hits *hits)
{
    sgsi_deep *deep = context;
    uint64_t *sorted = hits->spare;
    for (int lane = 0; lane < 16; ++lane) {
        const int x = hits->x + lane % 4, y = hits->y + lane / 4 - deep->first_row;
        if (x >= deep->width || y < 0 || y >= deep->rows || !(hits->valid >> lane & 1))
            continue;
        const size_t pixel = (size_t)y * (size_t)deep->width + (size_t)x;
        sgs_deep_sample *samples = deep->samples + pixel * (size_t)deep->options.max_samples;
        const size_t count = sort_hits(hits, lane, sorted);
        const double tolerance = fitting_tolerance(sorted, count, &deep->options);
        uint32_t made = 0;
        for (size_t i = 0; i < count;) {
            const size_t end = run_end(sorted, i, count, tolerance);
            samples[made++] = merge(hits, lane, sorted + i, end - i);
            i = end;
        }
        deep->counts[pixel] = made;
    }
}

size_t sgsi_deep_pack(sgsi_deep *deep)
{
    const size_t pixels = (size_t)deep->rows * (size_t)deep->width;
    size_t total = 0;
    for (size_t i = 0; i < pixels; ++i) {
        memmove(deep->samples + total, deep->samples + i * (size_t)deep->options.max_samples,
                deep->counts[i] * sizeof *deep->samples);
        total += deep->counts[i];
    }
    return total;
}
