// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Fine-tuning of a stored model: the bits of a trainer with that schedule, with the 3D filter
// applied once; the opacities of Taming 3DGS; an end by the caller.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "support/compress_support.h"
#include "support/prune_support.h"
#include "support/trainer_support.h"

enum { STEPS = 3 };

static void result_is_that_of_a_trainer(void **state)
{
    (void)state;
    sgs_gaussians *model = pack_model(200, 1, 3), *tuned, *fused;
    sgs_scene *scene = prune_scene(48, 32);
    for (int mip = 0; mip < 2; ++mip) {
        sgs_finetune_options options = sgs_finetune_options_default();
        options.iterations = STEPS;
        options.filter = mip ? SGS_FILTER_MIP : SGS_FILTER_3DGS;
        options.seed = 5;
        assert_int_equal(sgs_finetune(model, scene, &options, &tuned), SGS_STATUS_OK);
        sgs_train_options training = sgs_train_options_default();
        training.iterations = STEPS;
        training.schedule = SGS_SCHEDULE_FINETUNE;
        training.filter = options.filter;
        training.sh_degree = 1;
        training.spare = 0;
        training.seed = 5;
        training.init = model;
        sgs_trainer *trainer = trainer_create(scene, &training);
        trainer_run(trainer, STEPS);
        const sgs_gaussians *trained = sgs_trainer_model(trainer);
        char hex[2][17];
        if (mip) {
            assert_int_equal(
                sgs_gaussians_fuse_filter_3d(trained, sgs_trainer_filter_3d(trainer), &fused), 0);
            sgs_gaussians_hash(fused, hex[0]);
            sgs_gaussians_destroy(fused);
        } else {
            sgs_gaussians_hash(trained, hex[0]);
        }
        sgs_gaussians_hash(tuned, hex[1]);
        assert_int_equal(tuned->sh_degree, 1);
        assert_string_equal(hex[0], hex[1]);
        sgs_gaussians_destroy(tuned);
        sgs_trainer_destroy(trainer);
    }
    sgs_gaussians_destroy(model);
    sgs_scene_destroy(scene);
}

// The opacities of Taming 3DGS are frozen when the densification ends; fine-tuning has none.
static void taming_trains_the_opacities(void **state)
{
    (void)state;
    sgs_gaussians *model = pack_model(200, 1, 3);
    sgs_scene *scene = prune_scene(48, 32);
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 20;
    options.schedule = SGS_SCHEDULE_FINETUNE;
    options.pipeline = SGS_PIPELINE_TAMING;
    options.sh_degree = 1;
    options.spare = 0;
    options.init = model;
    sgs_trainer *trainer = trainer_create(scene, &options);
    float before[200], change = 0;
    for (size_t i = 0; i < 200; ++i)
        before[i] =
            *sgs_gaussians_at((sgs_gaussians *)sgs_trainer_model(trainer), i, SGS_PARAM_OPACITY);
    trainer_run(trainer, 20);
    assert_int_equal(sgs_trainer_model(trainer)->count, 200);
    for (size_t i = 0; i < 200; ++i) {
        const float after =
            *sgs_gaussians_at((sgs_gaussians *)sgs_trainer_model(trainer), i, SGS_PARAM_OPACITY);
        change = fmaxf(change, fabsf(after - before[i]));
    }
    assert_true(change > 0.05f); // the learning rate is 0.025 per step
    sgs_trainer_destroy(trainer);
    sgs_gaussians_destroy(model);
    sgs_scene_destroy(scene);
}

// Sum of the logarithms of the volumes, and of the opacities.
static void measure(const sgs_gaussians *model, double *volume, double *opacity)
{
    *volume = *opacity = 0;
    for (size_t i = 0; i < model->count; ++i) {
        for (int k = 0; k < 3; ++k)
            *volume += (double)*sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k);
        *opacity += 1 / (1 + exp(-(double)*sgs_gaussians_at(model, i, SGS_PARAM_OPACITY)));
    }
}

// A step changes a parameter by its learning rate: 0.005 for scales, 0.05 for logits. The filter
// would make the volumes larger by a third or more, and the opacities smaller.
static void the_filter_of_a_stored_model_is_not_applied_again(void **state)
{
    (void)state;
    enum { COUNT = 200 };
    sgs_gaussians *model = pack_model(COUNT, 1, 3), *stored, *tuned;
    sgs_scene *scene = prune_scene(48, 32);
    sgs_finetune_options options = sgs_finetune_options_default();
    options.iterations = 1;
    options.filter = SGS_FILTER_MIP;
    assert_int_equal(sgs_finetune(model, scene, &options, &stored), SGS_STATUS_OK);
    assert_int_equal(sgs_finetune(stored, scene, &options, &tuned), SGS_STATUS_OK);
    double volume[2], opacity[2];
    measure(stored, &volume[0], &opacity[0]);
    measure(tuned, &volume[1], &opacity[1]);
    print_message("log volume %+.4f, opacity %+.4f\n", (volume[1] - volume[0]) / COUNT,
                  (opacity[1] - opacity[0]) / COUNT);
    assert_true(fabs(volume[1] - volume[0]) <= COUNT * (3 * 0.005 + 0.001));
    assert_true(fabs(opacity[1] - opacity[0]) <= COUNT * (0.05 / 4 + 0.001));
    sgs_gaussians_destroy(tuned);
    sgs_gaussians_destroy(stored);
    sgs_gaussians_destroy(model);
    sgs_scene_destroy(scene);
}

static bool stop_at_2(void *user, const sgs_step_info *info)
{
    *(int *)user = info->iteration;
    return info->iteration < 2;
}

static void caller_can_cancel(void **state)
{
    (void)state;
    sgs_gaussians *model = pack_model(100, 0, 3), *tuned = model;
    sgs_scene *scene = prune_scene(48, 32);
    int last = 0;
    sgs_finetune_options options = sgs_finetune_options_default();
    options.progress = stop_at_2;
    options.progress_user = &last;
    assert_int_equal(sgs_finetune(model, scene, &options, &tuned), SGS_STATUS_CANCELLED);
    assert_null(tuned);
    assert_int_equal(last, 2);
    options.iterations = 0;
    assert_int_equal(sgs_finetune(model, scene, &options, &tuned), SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "iterations"));
    sgs_gaussians_destroy(model);
    sgs_scene_destroy(scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(result_is_that_of_a_trainer),
        cmocka_unit_test(taming_trains_the_opacities),
        cmocka_unit_test(the_filter_of_a_stored_model_is_not_applied_again),
        cmocka_unit_test(caller_can_cancel),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
