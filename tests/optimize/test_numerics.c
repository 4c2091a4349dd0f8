// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Non-finite numbers never reach the parameters: the step or the primitive is skipped, counted and
// reported. Degenerate Gaussians are drawn as documented and removed at the next structural update.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "base/core.h"
#include "density/density.h"
#include "rays/rays.h"
#include "sparegs/trainer.h"
#include "support/warning_support.h"
#include "train/trainer_state.h"

static sgs_scene *scene;

static int load(void **state)
{
    (void)state;
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 16;
    return sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene) != SGS_STATUS_OK;
}

static int unload(void **state)
{
    (void)state;
    sgs_scene_destroy(scene);
    return 0;
}

static sgs_trainer *start(int iterations)
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = iterations;
    options.spare = SGS_SPARE_BMD | SGS_SPARE_RAP;
    sgs_trainer *trainer;
    assert_int_equal(sgs_trainer_create(scene, &options, &trainer), SGS_STATUS_OK);
    warnings_begin(NULL);
    return trainer;
}

static void end(sgs_trainer *trainer)
{
    warnings_end();
    sgs_trainer_destroy(trainer);
}

static void step(sgs_trainer *trainer)
{
    sgs_step_info info;
    assert_int_equal(sgs_trainer_step(trainer, &info), SGS_STATUS_OK);
}

// Appends a copy of the last plane as alpha, or removes the alpha.
static void set_channels(sgs_photo *photo, int channels)
{
    const size_t plane = (size_t)photo->width * (size_t)photo->height;
    uint8_t *pixels = sgsi_alloc(4 * plane, 1);
    assert_non_null(pixels);
    memcpy(pixels, photo->pixels, 3 * plane);
    memcpy(pixels + 3 * plane, photo->pixels, plane);
    sgsi_free(photo->pixels);
    photo->pixels = pixels;
    photo->channels = channels;
}

static void expect_finite_model(const sgs_trainer *trainer)
{
    const sgs_gaussians *model = sgs_trainer_model(trainer);
    for (size_t i = 0; i < model->capacity * SGS_PARAM_COUNT; ++i) {
        assert_true(isfinite(model->data[i]));
        assert_true(isfinite(trainer->m[i]) && isfinite(trainer->v[i]));
    }
}

static void nonfinite_loss_skips_the_step_and_is_reported(void **state)
{
    (void)state;
    sgs_trainer *trainer = start(1000);
    char before[17], after[17];
    step(trainer);
    sgs_gaussians_hash(sgs_trainer_model(trainer), before);
    // Images are clamped, so the loss itself can only become non-finite through a weight: the one
    // of the alpha channel.
    for (size_t i = 0; i < scene->view_count; ++i)
        set_channels(&scene->views[i].image, 4);
    trainer->options.alpha_loss = NAN;
    step(trainer);
    trainer->options.alpha_loss = 0;
    for (size_t i = 0; i < scene->view_count; ++i)
        set_channels(&scene->views[i].image, 3);
    sgs_gaussians_hash(sgs_trainer_model(trainer), after);
    assert_string_equal(before, after);
    expect_finite_model(trainer);
    assert_int_equal(sgs_trainer_skipped(trainer).steps, 1);
    assert_int_equal(sgs_trainer_skipped(trainer).gradients, 0);
    assert_non_null(strstr(warnings, "iteration 2, view 00"));
    assert_non_null(strstr(warnings, "step skipped"));
    step(trainer); // training continues
    sgs_gaussians_hash(sgs_trainer_model(trainer), after);
    assert_string_not_equal(before, after);
    assert_int_equal(sgs_trainer_skipped(trainer).steps, 1);
    end(trainer);
}

static void nonfinite_gradient_skips_its_primitive_and_is_reported(void **state)
{
    (void)state;
    sgs_trainer *trainer = start(1000);
    step(trainer);
    // Clamped in the image, but not in the gradient of the transmittance.
    trainer->options.background[0] = NAN;
    step(trainer);
    trainer->options.background[0] = 0;
    expect_finite_model(trainer);
    assert_true(sgs_trainer_skipped(trainer).gradients > 0);
    assert_int_equal(sgs_trainer_skipped(trainer).steps, 0);
    assert_non_null(strstr(warnings, "iteration 2, view 00"));
    const char *named = strstr(warnings, "first primitive ");
    assert_non_null(named);
    assert_true(strtoul(named + strlen("first primitive "), NULL, 10) <
                sgs_trainer_model(trainer)->count);
    end(trainer);
}

// Row 25 has a 3D filter that is not finite. The filter of row 4 is not finite either, but no view
// sees the row; row 20 has its lane.
static void the_rejected_row_is_found_by_its_own_3d_filter(void **state)
{
    (void)state;
    enum { ROWS = 40, FULL_BLOCKS = 48 };
    static _Alignas(64) float sums[FULL_BLOCKS * SGSI_PROJECTED_FLOATS], filter[FULL_BLOCKS];
    static const uint8_t touched[FULL_BLOCKS / SGS_LANES] = {0, 1, 1};
    const sgs_view *photographed = &scene->views[0];
    sgs_render_options options = sgs_render_options_default();
    sgs_gaussians *model;
    sgsi_rays *rays;
    sgsi_view view;
    assert_int_equal(sgs_gaussians_create(FULL_BLOCKS, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, ROWS), SGS_STATUS_OK);
    double center[3];
    sgs_pose_center(&photographed->pose, center);
    for (size_t i = 0; i < ROWS; ++i) {
        for (int k = 0; k < 3; ++k) {
            *sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k) =
                (float)center[k] + 1.0f + 0.01f * (float)i;
            *sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k) = -2.0f;
        }
        *sgs_gaussians_at(model, i, SGS_PARAM_OPACITY) = 1.0f;
        filter[i] = i == 4 || i == 25 ? NAN : 0.01f;
        for (size_t k = 0; k < SGSI_PROJECTED_FLOATS && i >= SGS_LANES; ++k)
            sums[i * SGSI_PROJECTED_FLOATS + k] = 0.001f;
    }
    options.filter = SGS_FILTER_MIP;
    options.filter_3d = filter;
    assert_int_equal(sgsi_rays_create(&photographed->camera, 1, &rays), SGS_STATUS_OK);
    sgsi_view_set(&view, rays, &photographed->pose, &options);
    const sgsi_optimize input = {
        .params = model->data, .count = ROWS, .view = view, .sums = sums, .touched = touched};
    assert_int_equal(sgsi_optimize_blocks(&input, 1, 3).seen, ROWS - SGS_LANES);
    assert_int_equal(sgsi_optimize_blocks(&input, 1, 3).broken, 1);
    sgsi_rejected rejected = {0};
    sgsi_find_rejected(&input, &rejected);
    assert_int_equal(rejected.first, 25);
    assert_true(rejected.mean[0] == *sgs_gaussians_at(model, 25, SGS_PARAM_MEAN));
    sgsi_rays_destroy(rays);
    sgs_gaussians_destroy(model);
}

static void warnings_are_rate_limited(void **state)
{
    (void)state;
    sgsi_skipped skipped = {0};
    warnings_begin(NULL);
    for (int i = 1; i <= 1000; ++i)
        sgsi_skip_step(&skipped, i, "a.jpg", NAN);
    warnings_end();
    assert_int_equal(skipped.steps, 1000);
    assert_int_equal(warning_count, 5 + 7); // 8, 16, ..., 512
}

// Degenerate rows in a model during training: the image and all other primitives are unaffected.
static void degenerate_gaussians_are_harmless_and_get_pruned(void **state)
{
    (void)state;
    sgs_trainer *trainer = start(1000);
    sgs_gaussians *model = trainer->model;
    const size_t before = model->count;
    *sgs_gaussians_at(model, 1, SGS_PARAM_MEAN) = NAN;
    *sgs_gaussians_at(model, 20, SGS_PARAM_SCALE + 1) = INFINITY;
    *sgs_gaussians_at(model, 300, SGS_PARAM_OPACITY) = NAN;
    *sgs_gaussians_at(model, 301, SGS_PARAM_SH_REST + 7) = NAN;
    *sgs_gaussians_at(model, 302, SGS_PARAM_SH_DC) = INFINITY;
    for (int k = 0; k < 4; ++k)
        *sgs_gaussians_at(model, 40, SGS_PARAM_ROTATION + k) = 0;
    for (int k = 0; k < 3; ++k) {
        *sgs_gaussians_at(model, 50, SGS_PARAM_SCALE + k) = -INFINITY;
        *sgs_gaussians_at(model, 60, SGS_PARAM_SCALE + k) = 80; // e^80 is clamped
        *sgs_gaussians_at(model, 70, SGS_PARAM_SCALE + k) = -80;
    }
    for (int i = 0; i < 10; ++i) {
        step(trainer);
        assert_true(isfinite(trainer->progress.loss_average));
    }
    for (size_t i = 0; i < before; ++i) {
        if (i == 1 || i == 20 || i == 50 || (i >= 300 && i <= 302))
            continue;
        for (int k = 0; k < SGS_PARAM_COUNT; ++k)
            assert_true(isfinite(*sgs_gaussians_at(model, i, k)));
    }
    sgs_step_info info = {0};
    assert_int_equal(sgsi_trainer_update_structure(trainer, 11, NULL, &info), SGS_STATUS_OK);
    assert_true(info.pruned >= 6);
    expect_finite_model(trainer);
    end(trainer);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nonfinite_loss_skips_the_step_and_is_reported),
        cmocka_unit_test(nonfinite_gradient_skips_its_primitive_and_is_reported),
        cmocka_unit_test(the_rejected_row_is_found_by_its_own_3d_filter),
        cmocka_unit_test(warnings_are_rate_limited),
        cmocka_unit_test(degenerate_gaussians_are_harmless_and_get_pruned),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
