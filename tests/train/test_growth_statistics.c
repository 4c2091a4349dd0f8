// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The statistics that growth is decided by, as a trainer collects them on the bundled scene.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "sparegs/trainer.h"
#include "support/trainer_support.h"
#include "train/trainer_state.h"

static sgs_scene *scene;

static int load(void **state)
{
    (void)state;
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 8;
    return sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene) != SGS_STATUS_OK;
}

static int unload(void **state)
{
    (void)state;
    sgs_scene_destroy(scene);
    return 0;
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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(absolute_gradients_are_collected_for_schedules_that_use_them),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
