// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Learning rates, loss and statistics of a trainer are those of its schedule. The first step of
// Adam without bias correction is proportional to the rate, whatever the gradient.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "sparegs/trainer.h"
#include "support/trainer_support.h"
#include "train/trainer_state.h"

static sgs_scene *scene;

static int load(void **state)
{
    (void)state;
    return room_load(8, &scene);
}

static int unload(void **state)
{
    (void)state;
    sgs_scene_destroy(scene);
    return 0;
}

typedef struct step {
    double rotation, scale, opacity, rest; // factors on the rates
} step;

// Rotations of spheres, with which training begins, have no gradient.
static void stretch(sgs_gaussians *model)
{
    const float rotation[4] = {0.8f, 0.2f, 0.4f, 0.4f};
    float params[SGS_PARAM_COUNT];
    for (size_t i = 0; i < model->count; ++i) {
        sgs_gaussians_get(model, i, params);
        memcpy(params + SGS_PARAM_ROTATION, rotation, sizeof rotation);
        params[SGS_PARAM_SCALE] -= 0.5f;
        params[SGS_PARAM_SCALE + 1] -= 0.2f;
        sgs_gaussians_set(model, i, params);
    }
}

// Sums over the primitives of the absolute change of each parameter in the first iteration.
static void first_step(const step *factors, double change[SGS_PARAM_COUNT])
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 100;
    sgs_trainer *trainer = trainer_create(scene, &options);
    trainer->schedule.sh_interval = 0; // all bands at once
    trainer->schedule.lr_shape *= factors->scale;
    trainer->schedule.lr_opacity *= factors->opacity;
    trainer->schedule.lr_sh *= factors->rest;
    stretch(trainer->model);
    const sgs_gaussians *model = sgs_trainer_model(trainer);
    const size_t count = model->count;
    float(*before)[SGS_PARAM_COUNT] = malloc(count * sizeof *before), after[SGS_PARAM_COUNT];
    for (size_t i = 0; i < count; ++i)
        sgs_gaussians_get(model, i, before[i]);
    trainer_run(trainer, 1);
    model = sgs_trainer_model(trainer);
    assert_int_equal(model->count, count);
    memset(change, 0, SGS_PARAM_COUNT * sizeof *change);
    for (size_t i = 0; i < count; ++i) {
        sgs_gaussians_get(model, i, after);
        for (int k = 0; k < SGS_PARAM_COUNT; ++k)
            change[k] += fabs((double)after[k] - (double)before[i][k]);
    }
    free(before);
    sgs_trainer_destroy(trainer);
}

static double expected_ratio(const step *factors, int param)
{
    return param < SGS_PARAM_ROTATION  ? 1.0
           : param < SGS_PARAM_SCALE   ? factors->rotation
           : param < SGS_PARAM_OPACITY ? factors->scale
           : param < SGS_PARAM_SH_DC   ? factors->opacity
           : param < SGS_PARAM_SH_REST ? 1.0
                                       : factors->rest;
}

static void factors_of_the_schedule_scale_the_first_step(void **state)
{
    (void)state;
    const step cases[] = {{1, 1, 1, 1}, {2, 2, 1, 1}, {1, 1, 2, 1}, {1, 1, 1, 0.5}};
    double published[SGS_PARAM_COUNT], change[SGS_PARAM_COUNT];
    first_step(&cases[0], published);
    for (size_t c = 1; c < sizeof cases / sizeof *cases; ++c) {
        first_step(&cases[c], change);
        for (int k = 0; k < SGS_PARAM_COUNT; ++k) {
            assert_true(published[k] > 0.0);
            assert_true(fabs(change[k] / published[k] / expected_ratio(&cases[c], k) - 1.0) < 0.01);
        }
    }
}

static void model_after(double weight, double sigma, char hash[17])
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 100;
    options.ssim_weight = weight;
    options.ssim_sigma = sigma;
    sgs_trainer *trainer = trainer_create(scene, &options);
    trainer_run(trainer, 3);
    sgs_gaussians_hash(sgs_trainer_model(trainer), hash);
    sgs_trainer_destroy(trainer);
}

// The published loss by default and if it is requested; another one otherwise.
static void the_loss_has_the_given_ssim(void **state)
{
    (void)state;
    char published[17], same[17], weight[17], sigma[17];
    model_after(-1, 0, published);
    model_after(0.2, 1.5, same);
    model_after(0.4, 1.5, weight);
    model_after(0.2, 1.0, sigma);
    assert_string_equal(published, same);
    assert_string_not_equal(published, weight);
    assert_string_not_equal(published, sigma);
    assert_string_not_equal(weight, sigma);
}

// 3DGS collects absolute gradients if its schedule uses them, and only then. A sum of absolute
// values is not below that of the signed ones, up to rounding.
static void absolute_gradients_are_collected_for_schedules_that_use_them(void **state)
{
    (void)state;
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 100;
    for (int used = 0; used < 2; ++used) {
        sgs_trainer *trainer = trainer_create(scene, &options);
        trainer->schedule.abs_share = used ? 0.5 : 0.0;
        trainer_run(trainer, 3);
        size_t positive = 0;
        for (size_t i = 0; i < sgs_trainer_model(trainer)->count; ++i) {
            const float sum = trainer->statistics.abs_grad_sum[i];
            positive += sum > 0.0f;
            assert_true(!used || sum >= 0.999f * trainer->statistics.gradient_sum[i]);
        }
        assert_int_equal(positive > 0, used);
        sgs_trainer_destroy(trainer);
    }
}

static void set_faint(sgs_gaussians *model)
{
    for (size_t i = 0; i < model->count; i += 2)
        *sgs_gaussians_at(model, i, SGS_PARAM_OPACITY) = -7.0f - 1e-4f * (float)i;
}

// Half of the primitives are faint at the first update and at one in the second half of the
// densification.
static void late_updates_remove_what_the_schedule_permits(void **state)
{
    (void)state;
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 1000;
    options.spare = 0;
    sgs_trainer *trainer = trainer_create(scene, &options);
    trainer->schedule.lr_opacity = 0.0;
    trainer->schedule.threshold_factor = 1e9; // no growth
    const int interval = trainer->schedule.densify_interval,
              early = sgsi_schedule_first_update(&trainer->schedule),
              late = (trainer->schedule.densify_until - 1) / interval * interval;
    assert_true(late > trainer->schedule.densify_until / 2 && early < late);
    trainer_run(trainer, early - 1);
    size_t before = trainer->model->count;
    set_faint(trainer->model);
    assert_int_equal(trainer_run(trainer, 2).pruned, (before + 1) / 2);
    trainer_run(trainer, late - early - 2);
    before = trainer->model->count;
    set_faint(trainer->model);
    assert_int_equal(trainer_run(trainer, 2).pruned, before / 20);
    sgs_trainer_destroy(trainer);
}

// All primitives have a gradient above the threshold, half are faint: none grows, 5 % are removed.
static void check_thinning(sgs_pipeline pipeline)
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 1000;
    options.pipeline = pipeline;
    sgs_trainer *trainer = trainer_create(scene, &options);
    sgsi_schedule *schedule = &trainer->schedule;
    const int interval = schedule->densify_interval, until = schedule->densify_until,
              first = (until + interval - 1) / interval * interval, second = first + interval;
    schedule->thin_until = second;
    schedule->abs_share = 0.5;
    schedule->lr_opacity = 0.0;
    schedule->threshold_factor = 1e9;
    assert_int_equal(sgs_trainer_milestones(trainer).thin_until, second);
    trainer_run(trainer, first - 1);
    schedule->threshold_factor = 1e-9;
    for (int update = first; update <= second; update += interval) {
        const size_t before = trainer->model->count;
        double gradient = 0.0, absolute = 0.0;
        set_faint(trainer->model);
        for (size_t i = 0; i < before; ++i) {
            gradient += (double)trainer->statistics.gradient_sum[i];
            absolute += (double)trainer->statistics.abs_grad_sum[i];
        }
        assert_true(gradient > 0.0 && (update == first || absolute == 0.0));
        const sgs_step_info info = trainer_run(trainer, 2);
        assert_true(info.structural && info.densified == 0 && info.regions > 0);
        assert_int_equal(info.pruned, before / 20);
        assert_int_equal(trainer->model->count, before - before / 20);
        trainer_run(trainer, interval - 2);
    }
    assert_true(!trainer_run(trainer, interval).structural);
    double gradient = 0.0;
    for (size_t i = 0; i < trainer->model->count; ++i)
        gradient += (double)trainer->statistics.gradient_sum[i];
    assert_true(gradient == 0.0);
    sgs_trainer_destroy(trainer);
}

static void thinning_removes_after_densification(void **state)
{
    (void)state;
    check_thinning(SGS_PIPELINE_3DGS);
    check_thinning(SGS_PIPELINE_MIP);
}

// Large primitives are pruned by the last update of the densification, after a reset, and kept by
// thinning, which adds none.
static void thinning_keeps_large_primitives(void **state)
{
    (void)state;
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 1000;
    options.spare = 0;
    sgs_trainer *trainer = trainer_create(scene, &options);
    sgsi_schedule *schedule = &trainer->schedule;
    const int interval = schedule->densify_interval,
              last = (schedule->densify_until - 1) / interval * interval;
    schedule->thin_until = last + interval;
    schedule->reset_interval = 2 * options.iterations; // no reset but this one
    trainer->progress.last_reset = schedule->reset_interval;
    schedule->prunes_large = true;
    schedule->threshold_factor = 1e9; // no growth
    trainer_run(trainer, last - 1);
    for (int update = last; update <= last + interval; update += interval) {
        for (size_t i = 0; i < trainer->model->count; ++i) {
            const float size = (i < 3 ? 0.2f : 0.01f) * (float)trainer->scene->extent;
            *sgs_gaussians_at(trainer->model, i, SGS_PARAM_OPACITY) = 0.0f;
            for (int k = 0; k < 3; ++k)
                *sgs_gaussians_at(trainer->model, i, SGS_PARAM_SCALE + k) = logf(size);
        }
        const sgs_step_info info = trainer_run(trainer, 2);
        assert_true(info.structural);
        assert_int_equal(info.pruned, update == last ? 3 : 0);
        trainer_run(trainer, interval - 2);
    }
    sgs_trainer_destroy(trainer);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(factors_of_the_schedule_scale_the_first_step),
        cmocka_unit_test(the_loss_has_the_given_ssim),
        cmocka_unit_test(absolute_gradients_are_collected_for_schedules_that_use_them),
        cmocka_unit_test(late_updates_remove_what_the_schedule_permits),
        cmocka_unit_test(thinning_removes_after_densification),
        cmocka_unit_test(thinning_keeps_large_primitives),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
