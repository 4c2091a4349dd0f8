// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A thin lens is sampled as pinholes at points of the lens, with the image shifted so that the
// focal plane stays fixed: the centre moves by (x, y) in camera axes, the principal point by f (x,
// y) / focus. A sample position within the pixel moves the principal point in the opposite
// direction. So every sample is an ordinary view for the renderer.
//
// Points come from the additive recurrence of M. Roberts, "The Unreasonable Effectiveness of
// Quasirandom Sequences" (2018) in four dimensions. Scene-linear values are averaged, so that
// bright points out of focus become bright discs.

#include "cameras/lens_samples.h"

#include <math.h>
#include <stdlib.h>

#include "cameras/lens_scale.h"
#include "sparegs/image.h"

// Component i of point k: frac(0.5 + k g^-(i + 1)), g^5 = g + 1.
static double recurrence(int k, int i)
{
    const double g = 1.1673039782614187, value = 0.5 + k * pow(g, -(i + 1));
    return value - floor(value);
}

void lens_sample(int k, double aperture, double focus, sgs_camera *camera, sgs_pose *pose)
{
    double fx, fy, cx, cy;
    camera_paraxial(camera, &fx, &fy, &cx, &cy);
    const double radius = 0.5 * aperture * sqrt(recurrence(k, 2)),
                 turn = 2 * 3.141592653589793 * recurrence(k, 3);
    const double x = radius * cos(turn), y = radius * sin(turn);
    const double scale = aperture > 0 ? 1 / focus : 0;
    pose->translation[0] -= x;
    pose->translation[1] -= y;
    *camera = sgs_camera_shifted(camera, fx * x * scale - (recurrence(k, 0) - 0.5),
                                 fy * y * scale - (recurrence(k, 1) - 0.5));
}

bool light_sum_begin(light_sum *sum, int width, int height, bool light)
{
    const size_t pixels = (size_t)width * (size_t)height;
    *sum = (light_sum){.width = width, .height = height, .light = light};
    float **const planes[] = {&sum->color[0], &sum->color[1], &sum->color[2], &sum->transmittance};
    for (size_t k = 0; k < 4; ++k) {
        *planes[k] = calloc(pixels, sizeof(float));
        if (!*planes[k]) {
            light_sum_free(sum);
            return false;
        }
    }
    return true;
}

void light_sum_add(light_sum *sum, const sgs_frame *frame)
{
    const size_t pixels = (size_t)sum->width * (size_t)sum->height;
    for (size_t i = 0; i < pixels; ++i) {
        const float alpha = 1 - frame->transmittance[i];
        sum->transmittance[i] += frame->transmittance[i];
        for (int c = 0; c < 3; ++c)
            if (alpha > 0) // unpremultiply before applying the curve
                sum->color[c][i] += sum->light
                                        ? frame->color[c][i]
                                        : alpha * sgs_srgb_decode(frame->color[c][i] / alpha);
    }
    ++sum->count;
}

void light_sum_mean(const light_sum *sum, sgs_frame *frame)
{
    const size_t pixels = (size_t)sum->width * (size_t)sum->height;
    const float share = 1 / (float)sum->count;
    for (size_t i = 0; i < pixels; ++i) {
        frame->transmittance[i] = sum->transmittance[i] * share;
        const float alpha = 1 - frame->transmittance[i];
        for (int c = 0; c < 3; ++c)
            frame->color[c][i] = !(alpha > 0) ? 0
                                 : sum->light
                                     ? sum->color[c][i] * share
                                     : alpha * sgs_srgb_encode(sum->color[c][i] * share / alpha);
    }
}

void light_sum_free(light_sum *sum)
{
    for (int c = 0; c < 3; ++c)
        free(sum->color[c]);
    free(sum->transmittance);
    *sum = (light_sum){0};
}
