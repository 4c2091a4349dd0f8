// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Gradient of the opacity's logit against double precision, for logits from -30 to 30. 1 - o
// cancels for opaque primitives: as a difference of floats it is 0 from 16.6 on.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "support/tracer_support.h"

enum { COUNT = 241 }; // steps of 0.25

static double logit_of(size_t i)
{
    return -30.0 + 0.25 * (double)i;
}

// Relative error of dL/dlogit = v (1 - o) + weight o (1 - o), the largest of all logits.
static double worst_error(const traced_view *traced, const sgs_gaussians *model, float v,
                          float weight)
{
    float *sums = sgsi_calloc(model->capacity, SGSI_PROJECTED_FLOATS * sizeof *sums),
          *out = sgsi_calloc(model->capacity, SGS_PARAM_COUNT * sizeof *out);
    uint8_t *touched = oracle_memory(model->capacity / SGS_LANES, 1);
    assert_non_null(sums);
    assert_non_null(out);
    memset(touched, 1, model->capacity / SGS_LANES);
    for (size_t i = 0; i < COUNT; ++i)
        sums[i * SGSI_PROJECTED_FLOATS + SGSI_GRAD_SUM_V] = v;
    const sgsi_optimize input = {.params = model->data,
                                 .count = COUNT,
                                 .view = traced->view,
                                 .sums = sums,
                                 .touched = touched,
                                 .opacity_loss = weight,
                                 .gradients = out};
    sgsi_optimize_blocks(&input, 0, (COUNT + SGS_LANES - 1) / SGS_LANES);
    double worst = 0;
    for (size_t i = 0; i < COUNT; ++i) {
        const double e = exp(-logit_of(i)), o = 1 / (1 + e), rest = e / (1 + e),
                     expected = (double)v * rest + (double)weight * o * rest;
        const size_t at =
            ((i / SGS_LANES) * SGS_PARAM_COUNT + SGS_PARAM_OPACITY) * SGS_LANES + i % SGS_LANES;
        worst = traced_worse(worst, oracle_error((double)out[at], expected, 0));
    }
    sgsi_free(sums);
    sgsi_free(out);
    free(touched);
    return worst;
}

static void the_gradient_of_the_logit_is_that_of_double_precision(void **state)
{
    (void)state;
    oracle_scene scene = oracle_scene_create(COUNT);
    for (size_t i = 0; i < COUNT; ++i) {
        oracle_set_ball(oracle_primitive(&scene, i), 0, 0, 0, 0.1, 0.5);
        oracle_primitive(&scene, i)[SGS_PARAM_OPACITY] = logit_of(i);
    }
    oracle_scene_round(&scene);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 16, 16);
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    for (int isa = 0; isa < SGS_ISA_COUNT; ++isa) {
        if (!sgs_isa_supported((sgs_isa)isa))
            continue;
        sgs_isa_set((sgs_isa)isa);
        traced_view traced =
            traced_create(scene.model, &camera, &pose, SGS_FILTER_NONE, 1, SGSI_BVH_REFIT);
        const double image = worst_error(&traced, scene.model, 1.5f, 0.0f),
                     loss = worst_error(&traced, scene.model, 0.0f, 0.25f),
                     both = worst_error(&traced, scene.model, 1.5f, 0.25f);
        print_message("%s: %.1e of the image, %.1e of the regulariser, %.1e of both\n",
                      sgs_isa_name((sgs_isa)isa), image, loss, both);
        // The exponential of the baseline, without FMA, has an error of 2e-6 at 30.
        assert_true(image <= 4e-6 && loss <= 4e-6 && both <= 4e-6);
        traced_destroy(&traced);
    }
    oracle_scene_free(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(the_gradient_of_the_logit_is_that_of_double_precision,
                                  traced_restore),
    };
    return cmocka_run_group_tests(tests, traced_prepare, NULL);
}
