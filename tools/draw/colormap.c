// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The cubehelix colour map, with uniformly increasing brightness, so that it is also readable in
// greyscale: D. A. Green, "A colour scheme for the display of astronomical intensity images", Bull.
// Astr. Soc. India 39 (2011), equation 2.
//
// Errors use magma, one of matplotlib's perceptually uniform colour maps (S. van der Walt and N. J.
// Smith, public domain), as a polynomial in t = 2 x - 1 that was fitted to its 256 colours: every
// 8-bit value is at most 1 from the published one.

#include "draw/colormap.h"

#include <math.h>
#include <stdlib.h>

#include "cli/value_order.h"

value_range sorted_range(float *values, size_t count)
{
    if (!count)
        return (value_range){0, 1};
    qsort(values, count, sizeof *values, compare_floats);
    return (value_range){values[count / 100], values[count - 1 - count / 100]};
}

value_range plane_range(const float *plane, size_t count)
{
    float *positive = malloc(count * sizeof *positive);
    size_t kept = 0;
    for (size_t i = 0; positive && i < count; ++i)
        if (plane[i] > 0 && isfinite(plane[i]))
            positive[kept++] = plane[i];
    const value_range range = sorted_range(positive, kept);
    free(positive);
    return range;
}

static uint8_t quantised(double value)
{
    return (uint8_t)fmin(fmax(255 * value + 0.5, 0), 255);
}

static bool allocate(int width, int height, sgs_image8 *out)
{
    *out = (sgs_image8){width, height, 3, NULL};
    const size_t bytes = 3 * (size_t)width * (size_t)height;
    out->pixels = aligned_alloc(64, (bytes + 63) / 64 * 64);
    return out->pixels != NULL;
}

bool plane_colored(const float *plane, int width, int height, value_range range, sgs_image8 *out)
{
    if (!allocate(width, height, out))
        return false;
    static const double cosine[3] = {-0.14861, -0.29227, 1.97294}, sine[3] = {1.78277, -0.90649, 0};
    const double start = 0.5, turns = -1.2, hue = 1;
    const size_t pixels = (size_t)width * (size_t)height;
    const double scale = range.high > range.low ? 1 / ((double)range.high - (double)range.low) : 0;
    for (size_t i = 0; i < pixels; ++i) {
        const bool shown = plane[i] > 0;
        const double x =
            0.12 + 0.85 * fmin(fmax(((double)plane[i] - (double)range.low) * scale, 0), 1);
        const double angle = 2 * 3.141592653589793 * (start / 3 + 1 + turns * x),
                     radius = hue * x * (1 - x) / 2;
        for (size_t c = 0; c < 3; ++c)
            out->pixels[c * pixels + i] =
                shown ? quantised(x + radius * (cosine[c] * cos(angle) + sine[c] * sin(angle))) : 0;
    }
    return true;
}

bool errors_colored(const float *plane, int width, int height, sgs_image8 *out)
{
    enum { STEPS = 256, TERMS = 12 };
    static const double terms[3][TERMS] = {
        {0.71335, 0.83907, -0.05772, -1.07035, -1.23613, 2.25452, 2.24995, -2.99392, -1.59226,
         2.02022, 0.41553, -0.55675},
        {0.21154, 0.24060, 0.39708, 1.94599, -0.63172, -6.40280, 2.69389, 9.87962, -4.05311,
         -7.06030, 1.88209, 1.89238},
        {0.47970, -0.23133, -0.77894, -0.34001, 4.37941, 5.20779, -10.52953, -9.22922, 10.66660,
         6.98286, -3.83913, -2.02226}};
    if (!allocate(width, height, out))
        return false;
    uint8_t colors[3][STEPS];
    for (int c = 0; c < 3; ++c)
        for (int i = 0; i < STEPS; ++i) {
            const double t = 2.0 * i / (STEPS - 1) - 1;
            double value = 0;
            for (int k = TERMS - 1; k >= 0; --k)
                value = value * t + terms[c][k];
            colors[c][i] = quantised(value);
        }
    const size_t pixels = (size_t)width * (size_t)height;
    for (size_t i = 0; i < pixels; ++i)
        for (size_t c = 0; c < 3; ++c)
            out->pixels[c * pixels + i] = colors[c][quantised((double)plane[i])];
    return true;
}

bool plane_grey(const float *plane, int width, int height, sgs_image8 *out)
{
    if (!allocate(width, height, out))
        return false;
    const size_t pixels = (size_t)width * (size_t)height;
    for (size_t i = 0; i < 3 * pixels; ++i)
        out->pixels[i] = quantised((double)plane[i % pixels]);
    return true;
}

bool normals_colored(const float *const normal[3], int width, int height, sgs_image8 *out)
{
    if (!allocate(width, height, out))
        return false;
    const size_t pixels = (size_t)width * (size_t)height;
    for (size_t i = 0; i < pixels; ++i) {
        const bool any = normal[0][i] != 0 || normal[1][i] != 0 || normal[2][i] != 0;
        for (size_t c = 0; c < 3; ++c)
            out->pixels[c * pixels + i] = any ? quantised(0.5 + 0.5 * (double)normal[c][i]) : 0;
    }
    return true;
}

bool positions_colored(const float *const position[3], const value_range ranges[3], int width,
                       int height, sgs_image8 *out)
{
    const size_t pixels = (size_t)width * (size_t)height;
    if (!allocate(width, height, out))
        return false;
    for (size_t c = 0; c < 3; ++c) {
        const double low = (double)ranges[c].low, high = (double)ranges[c].high;
        const double scale = high > low ? 1 / (high - low) : 0;
        for (size_t i = 0; i < pixels; ++i)
            out->pixels[c * pixels + i] =
                position[0][i] != 0 || position[1][i] != 0 || position[2][i] != 0
                    ? quantised(0.1 + 0.9 * fmax(scale * ((double)position[c][i] - low), 0))
                    : 0;
    }
    return true;
}

bool ids_colored(const uint32_t *ids, int width, int height, sgs_image8 *out)
{
    if (!allocate(width, height, out))
        return false;
    const size_t pixels = (size_t)width * (size_t)height;
    for (size_t i = 0; i < pixels; ++i)
        for (size_t c = 0; c < 3; ++c) { // multiplicative hashing separates neighbouring ids
            const uint32_t mixed = (ids[i] + 1) * 2654435761U;
            out->pixels[c * pixels + i] =
                ids[i] == SGS_NO_PRIMITIVE ? 0
                                           : (uint8_t)(64 + (mixed >> (8 * c + 8) & 255) * 3 / 4);
        }
    return true;
}

bool slack_colored(const float *slack, const uint32_t *ids, int width, int height, sgs_image8 *out)
{
    static const double grey = 0.9, over[3] = {0.7, 0.1, 0.1}, room[3] = {0.1, 0.3, 0.75};
    if (!allocate(width, height, out))
        return false;
    const size_t pixels = (size_t)width * (size_t)height;
    for (size_t i = 0; i < pixels; ++i) {
        const double x = tanh((double)slack[i]), *const end = x < 0 ? over : room;
        for (size_t c = 0; c < 3; ++c)
            out->pixels[c * pixels + i] =
                ids[i] == SGS_NO_PRIMITIVE ? 0 : quantised(grey + fabs(x) * (end[c] - grey));
    }
    return true;
}
