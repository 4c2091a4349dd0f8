// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// SSIM on flat areas of HDR photos far above white, where the rounding of the moments exceeds its
// constants: it stays in its range, and its gradient points from the photo to the image.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "base/core.h"
#include "image/half.h"
#include "loss/loss.h"

enum { WIDTH = 48, HEIGHT = 40, PIXELS = WIDTH * HEIGHT, CHANNELS = 3 };

typedef struct flat_scene {
    float color[CHANNELS][PIXELS], d_color[CHANNELS][PIXELS];
    float transmittance[PIXELS], d_transmittance[PIXELS];
    uint16_t halves[CHANNELS * PIXELS];
} flat_scene;

// A photo of one brightness; the image differs from it by up to the relative `error`.
static void fill(flat_scene *s, float level, double error, uint64_t seed)
{
    for (size_t c = 0; c < CHANNELS; ++c)
        for (size_t i = 0; i < PIXELS; ++i) {
            s->halves[c * PIXELS + i] = sgsi_half_from_float(level);
            const double noise = 2.0 * sgsi_random_uniform(seed + c, i) - 1.0;
            s->color[c][i] = (float)((double)level * (1.0 + error * noise));
        }
    for (size_t i = 0; i < PIXELS; ++i)
        s->transmittance[i] = 0.0f;
}

// Loss 1 - SSIM.
static sgsi_loss_output evaluate(sgsi_loss_workspace *workspace, flat_scene *s)
{
    const sgs_photo target = {.width = WIDTH,
                              .height = HEIGHT,
                              .channels = CHANNELS,
                              .kept = PIXELS,
                              .halves = s->halves,
                              .is_hdr = true};
    const sgsi_loss_input input = {.width = WIDTH,
                                   .height = HEIGHT,
                                   .stride = WIDTH,
                                   .color = {s->color[0], s->color[1], s->color[2]},
                                   .transmittance = s->transmittance,
                                   .target = &target,
                                   .ssim_weight = 1.0f};
    sgsi_loss_output output = {.d_color = {s->d_color[0], s->d_color[1], s->d_color[2]},
                               .d_transmittance = s->d_transmittance};
    assert_int_equal(sgsi_loss_evaluate(workspace, &input, &output), SGS_STATUS_OK);
    return output;
}

static void ssim_of_bright_flat_areas_is_in_range_and_descends(void **state)
{
    (void)state;
    static flat_scene s;
    static const float levels[] = {1.0f, 10.0f, 100.0f, 300.0f, 1000.0f, 30000.0f};
    static const double errors[] = {0.0, 1e-6, 1e-4, 1e-2, 0.5};
    sgsi_loss_workspace *workspace = NULL;
    assert_int_equal(sgsi_loss_create(&workspace), SGS_STATUS_OK);
    assert_int_equal(sgsi_loss_reserve(workspace, WIDTH, HEIGHT), SGS_STATUS_OK);
    for (size_t k = 0; k < sizeof levels / sizeof *levels; ++k)
        for (size_t e = 0; e < sizeof errors / sizeof *errors; ++e) {
            fill(&s, levels[k], errors[e], 17 * k + e);
            const sgsi_loss_output output = evaluate(workspace, &s);
            assert_true(output.ssim <= 1.0 + 2e-3 && output.ssim >= -1.0);
            double along = 0.0, size = 0.0;
            for (size_t c = 0; c < CHANNELS; ++c)
                for (size_t i = 0; i < PIXELS; ++i) {
                    const double g = (double)s.d_color[c][i];
                    assert_true(isfinite(g));
                    along += g * ((double)s.color[c][i] - (double)levels[k]);
                    size += fabs(g * ((double)s.color[c][i] - (double)levels[k]));
                }
            // Gradients of smaller errors are rounding errors.
            if (errors[e] >= (levels[k] > 300.0f ? 1e-2 : 1e-4))
                assert_true(along > 0.1 * size);
        }
    sgsi_loss_destroy(workspace);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ssim_of_bright_flat_areas_is_in_range_and_descends),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
