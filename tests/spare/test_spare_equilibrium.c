// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Termination and the cooldown of pruning: small state machines, checked step by step.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "base/core.h"
#include "spare/spare.h"

static void pruning_rests_after_a_reset_for_one_interval(void **state)
{
    (void)state;
    assert_false(spare_pruning_rests(600, -1, 100));
    assert_false(spare_pruning_rests(3000, 3000, 100));
    assert_true(spare_pruning_rests(3001, 3000, 100));
    assert_true(spare_pruning_rests(3100, 3000, 100));
    assert_false(spare_pruning_rests(3101, 3000, 100));
    assert_true(spare_pruning_rests(100, 0, 100));
}

// With decay 0 the average equals the last loss, so the expected result of every check is known.
static bool feed(spare_equilibrium *e, double loss, size_t count, bool disturbed)
{
    spare_equilibrium_observe(e, loss, 0.0);
    return spare_equilibrium_check(e, count, disturbed, 0.008, 0.01, 2);
}

static void equilibrium_stops_after_patience(void **state)
{
    (void)state;
    spare_equilibrium e;
    spare_equilibrium_begin(&e);
    assert_false(spare_equilibrium_check(&e, 1000, false, 0.008, 0.01, 2)); // nothing observed yet
    assert_false(feed(&e, 1.000, 1000, false)); // nothing to compare with
    assert_false(feed(&e, 0.995, 1005, false));
    assert_int_equal(e.held, 1);
    assert_true(fabs(e.last_loss_change - 0.005) < 1e-12 &&
                fabs(e.last_count_change - 0.005) < 1e-12);
    assert_true(feed(&e, 0.995, 1000, false)); // no change passes as well
    spare_equilibrium_begin(&e);
    assert_false(feed(&e, 1.0, 7, false));
    spare_equilibrium_observe(&e, 1.0, 0.0);
    assert_true(spare_equilibrium_check(&e, 7, false, 0.008, 0.01, 1));
}

static void equilibrium_starts_again_when_disturbed_or_moving(void **state)
{
    (void)state;
    const struct {
        double loss;
        size_t count;
        bool disturbed;
    } breaks[] = {
        {0.996, 1000, false}, // rising loss
        {0.950, 1000, false}, // still falling fast
        {0.995, 1020, false}, // growing
        {0.995, 980, false},  // shrinking
        {0.995, 1000, true},  // opacity reset inside the window
    };
    for (size_t k = 0; k < sizeof breaks / sizeof *breaks; ++k) {
        spare_equilibrium e;
        spare_equilibrium_begin(&e);
        assert_false(feed(&e, 1.0, 1000, false));
        assert_false(feed(&e, 0.995, 1000, false));
        assert_int_equal(e.held, 1);
        assert_false(feed(&e, breaks[k].loss, breaks[k].count, breaks[k].disturbed));
        assert_int_equal(e.held, 0);
        assert_false(feed(&e, breaks[k].loss, breaks[k].count, false));
        assert_true(feed(&e, breaks[k].loss, breaks[k].count, false));
    }
    // Bounds are strict: exactly eps does not pass.
    spare_equilibrium e;
    spare_equilibrium_begin(&e);
    feed(&e, 1.0, 1000, false);
    spare_equilibrium_observe(&e, 0.75, 0.0);
    assert_false(spare_equilibrium_check(&e, 1000, false, 0.25, 0.01, 1));
    spare_equilibrium_observe(&e, 0.75, 0.0);
    assert_false(spare_equilibrium_check(&e, 1250, false, 0.25, 0.25, 1));
}

static void equilibrium_average_is_unbiased_and_ignores_non_finite(void **state)
{
    (void)state;
    spare_equilibrium e;
    spare_equilibrium_begin(&e);
    double weighted = 0.0, weight = 0.0;
    for (int i = 0; i < 300; ++i) {
        const double loss = 0.1 + 0.01 * sgsi_random_uniform(1, (uint64_t)i);
        spare_equilibrium_observe(&e, loss, 0.995);
        spare_equilibrium_observe(&e, i % 2 ? NAN : INFINITY, 0.995);
        weighted += loss * pow(0.995, 299 - i);
        weight += pow(0.995, 299 - i);
    }
    assert_true(fabs(e.loss_average / e.loss_weight - weighted / weight) < 1e-12);
    spare_equilibrium_begin(&e);
    spare_equilibrium_observe(&e, 0.25, 0.995);
    assert_true(fabs(e.loss_average / e.loss_weight - 0.25) < 1e-12);
    // A constant loss gives a constant average from the first iteration on, while its weight still
    // grows.
    spare_equilibrium_begin(&e);
    for (int check = 0; check < 3; ++check) {
        spare_equilibrium_observe(&e, 0.25, 0.995);
        spare_equilibrium_check(&e, 10, false, 0.008, 0.01, 2);
        assert_true(fabs(e.last_loss_change) < 1e-12 && fabs(e.previous_loss - 0.25) < 1e-12);
    }
    // A loss of exactly 0 neither divides by zero nor prevents the stop.
    spare_equilibrium_begin(&e);
    assert_false(feed(&e, 0.0, 10, false));
    assert_false(feed(&e, 0.0, 10, false));
    assert_true(feed(&e, 0.0, 10, false));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pruning_rests_after_a_reset_for_one_interval),
        cmocka_unit_test(equilibrium_stops_after_patience),
        cmocka_unit_test(equilibrium_starts_again_when_disturbed_or_moving),
        cmocka_unit_test(equilibrium_average_is_unbiased_and_ignores_non_finite),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
