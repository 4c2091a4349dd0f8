// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The end of a run in equilibrium (SPARE-GS, Eq. 26) in the trainer; the test itself is that of
// tests/spare/test_spare_equilibrium.c.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "sparegs/trainer.h"
#include "support/trainer_support.h"
#include "train/trainer_state.h"

static sgs_scene *scene;

static int load(void **state)
{
    (void)state;
    return room_load_split(8, 8, &scene);
}

static int unload(void **state)
{
    (void)state;
    sgs_scene_destroy(scene);
    return 0;
}

// Ends at the first check in which the loss has not grown.
static sgs_train_options edt_run(int iterations)
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = iterations;
    options.spare = SGS_SPARE_EDT;
    options.spare_eps_loss = 1;
    options.spare_eps_count = 1;
    options.spare_patience = 1;
    return options;
}

// Steps until the end. *pruned: primitives removed by updates, or NULL.
static int run_to_end(sgs_trainer *trainer, size_t *pruned)
{
    sgs_step_info info = {0};
    int steps = 0;
    for (; !info.stop; ++steps) {
        info = trainer_run(trainer, 1);
        if (pruned)
            *pruned += info.pruned;
    }
    return info.stop == SGS_STOP_EQUILIBRIUM ? steps : 0;
}

static void equilibrium_ends_a_run(void **state)
{
    (void)state;
    enum { LENGTH = 600 };
    sgs_train_options options = edt_run(LENGTH);
    options.spare_interval = 500; // 10 iterations of this run
    sgs_trainer *trainer = trainer_create(scene, &options);
    sgs_step_info info = {0};
    int steps = 0;
    while (!info.stop && steps < LENGTH) {
        info = trainer_run(trainer, 1);
        ++steps;
    }
    assert_int_equal(info.stop, SGS_STOP_EQUILIBRIUM);
    assert_true(steps < LENGTH && steps % 10 == 0);
    assert_true(steps > trainer->schedule.densify_until);
    assert_non_null(strstr(sgs_trainer_stop_text(trainer), "stopped at"));
    sgs_trainer_destroy(trainer);
}

// No end before densification is over, nor before two passes over the views with comparable losses;
// a shorter run completes its schedule.
static void equilibrium_waits_for_comparable_losses(void **state)
{
    (void)state;
    sgs_train_options options = edt_run(200);
    options.spare_patience = 2;
    options.spare_interval = 100; // every iteration of this run
    sgs_trainer *trainer = trainer_create(scene, &options);
    const int views = (int)trainer->views.count;
    trainer->schedule.densify_until = 30;
    trainer->schedule.densify_interval = 20;
    sgs_step_info info = {0};
    int steps = 0;
    for (; !info.stop; ++steps)
        info = trainer_run(trainer, 1);
    assert_int_equal(info.stop, SGS_STOP_EQUILIBRIUM);
    assert_in_range(steps, 30 + 2 * views, 200 - 1);
    assert_int_equal((steps - 30) % views, 0);
    sgs_trainer_destroy(trainer);
    trainer = trainer_create(scene, &options);
    trainer->schedule.densify_until = 200 - 2 * views;
    info = trainer_run(trainer, 200);
    assert_int_equal(info.stop, SGS_STOP_SCHEDULE);
    sgs_trainer_destroy(trainer);
}

// Densification ends at the check at 80. The interval up to 160 covers two passes over the views
// and is compared at once, its number of primitives with that at 80.
static void the_first_interval_after_densification_suffices(void **state)
{
    (void)state;
    const sgs_train_options options = edt_run(400);
    sgs_trainer *trainer = trainer_create(scene, &options);
    assert_true(2 * trainer->views.count <= 80);
    trainer->schedule.densify_until = 80;
    trainer->schedule.densify_interval = 30;
    trainer->schedule.thin_until = 0;
    trainer->schedule.check_interval = 80;
    assert_int_equal(run_to_end(trainer, NULL), 160);
    sgs_trainer_destroy(trainer);
}

// Updates that only remove primitives are due at the checks at 80 and 160. The run does not end
// there but at 240, or where the number of primitives may not change, at 320.
static void a_run_does_not_end_before_a_due_update(void **state)
{
    (void)state;
    for (int strict = 0; strict < 2; ++strict) {
        sgs_train_options options = edt_run(400);
        options.spare_eps_count = strict ? 1e-9 : 1;
        sgs_trainer *trainer = trainer_create(scene, &options);
        trainer->schedule.densify_from = 400;
        trainer->schedule.densify_until = 20;
        trainer->schedule.densify_interval = trainer->schedule.check_interval = 80;
        trainer->schedule.thin_until = 160;
        assert_true(sgsi_schedule_is_update(&trainer->schedule, 160));
        assert_false(sgsi_schedule_is_update(&trainer->schedule, 240));
        size_t pruned = 0;
        // Row 0 is removed by the update at 160 only.
        trainer_run(trainer, 100);
        *sgs_gaussians_at(trainer->model, 0, SGS_PARAM_OPACITY) = -9;
        assert_int_equal(100 + run_to_end(trainer, &pruned), strict ? 320 : 240);
        assert_true(pruned > 0);
        sgs_trainer_destroy(trainer);
    }
}

// A reset discards the losses before it.
static void a_reset_restarts_the_comparison_of_losses(void **state)
{
    (void)state;
    sgs_train_options options = edt_run(400);
    options.spare_patience = 1000;
    sgs_trainer *trainer = trainer_create(scene, &options);
    trainer->schedule.check_interval = 40; // more than the training views
    trainer->schedule.reset_interval = 120;
    trainer->schedule.reset_until = 200;
    trainer->schedule.densify_from = 1000;
    trainer->schedule.densify_until = 0;
    const spare_equilibrium *equilibrium = &trainer->progress.equilibrium;
    trainer_run(trainer, 40);
    assert_true(equilibrium->last_loss_change == 0); // no earlier check
    trainer_run(trainer, 80);
    const double before = equilibrium->last_loss_change;
    assert_true(before > 0); // of iterations 40 to 120; the reset follows
    trainer_run(trainer, 40);
    assert_true(equilibrium->last_loss_change == before); // the first interval after it
    trainer_run(trainer, 40);
    assert_true(equilibrium->last_loss_change != before);
    sgs_trainer_destroy(trainer);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equilibrium_ends_a_run),
        cmocka_unit_test(equilibrium_waits_for_comparable_losses),
        cmocka_unit_test(the_first_interval_after_densification_suffices),
        cmocka_unit_test(a_run_does_not_end_before_a_due_update),
        cmocka_unit_test(a_reset_restarts_the_comparison_of_losses),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
