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
    assert_false(spare_pruning_in_cooldown(600, -1, 100));
    assert_false(spare_pruning_in_cooldown(3000, 3000, 100));
    assert_true(spare_pruning_in_cooldown(3001, 3000, 100));
    assert_true(spare_pruning_in_cooldown(3100, 3000, 100));
    assert_false(spare_pruning_in_cooldown(3101, 3000, 100));
    assert_true(spare_pruning_in_cooldown(100, 0, 100));
}

enum { VIEWS = 5, MAX_VIEWS = 200 };

static const spare_tolerance defaults = {.loss = 0.008, .count = 0.01, .patience = 2};

typedef struct run {
    spare_equilibrium state;
    spare_view_fit fits[2 * MAX_VIEWS];
    long iteration;
} run;

static run *begin(void)
{
    static run r;
    r = (run){0};
    spare_equilibrium_begin(&r.state);
    return &r;
}

// One interval of iterations in turn over the views: ln L_v(t) = -v - rate t, then a check.
static bool interval(run *r, double rate, size_t count, const spare_tolerance *tolerance)
{
    enum { LENGTH = 20 };
    for (int k = 0; k < LENGTH; ++k) {
        const size_t view = (size_t)(r->iteration++ % VIEWS);
        spare_equilibrium_observe(&r->state, r->fits, view, r->iteration,
                                  exp(-(double)view - rate * (double)r->iteration));
    }
    return spare_equilibrium_check(&r->state, r->fits, VIEWS, LENGTH, count, tolerance);
}

static void equilibrium_stops_after_patience(void **state)
{
    (void)state;
    run *r = begin();
    assert_false(
        spare_equilibrium_check(&r->state, r->fits, VIEWS, 20, 1000, &defaults)); // no loss
    assert_false(interval(r, 1e-4, 1000, &defaults)); // no earlier interval
    assert_false(interval(r, 1e-4, 1005, &defaults));
    assert_int_equal(r->state.held, 1);
    assert_true(fabs(r->state.last_loss_change - (1.0 - exp(-0.002))) < 1e-9);
    assert_true(r->state.last_loss_error < 1e-6);
    assert_true(fabs(r->state.last_count_change - 0.005) < 1e-12);
    assert_true(interval(r, 1e-4, 1000, &defaults));
    r = begin();
    const spare_tolerance once = {.loss = 0.008, .count = 0.01, .patience = 1};
    assert_false(interval(r, 1e-4, 7, &once));
    assert_true(interval(r, 1e-4, 7, &once));
}

static void equilibrium_starts_again_when_moving(void **state)
{
    (void)state;
    const struct {
        double rate;
        size_t count;
    } breaks[] = {
        {-1e-3, 1000}, // rising loss
        {1e-2, 1000},  // still falling fast
        {1e-4, 1020},  // growing
        {1e-4, 980},   // shrinking
    };
    for (size_t k = 0; k < sizeof breaks / sizeof *breaks; ++k) {
        run *r = begin();
        interval(r, 1e-4, 1000, &defaults);
        interval(r, 1e-4, 1000, &defaults);
        assert_int_equal(r->state.held, 1);
        assert_false(interval(r, breaks[k].rate, breaks[k].count, &defaults));
        assert_int_equal(r->state.held, 0);
    }
    // Bounds are strict.
    const spare_tolerance count = {.loss = 0.008, .count = 0.25, .patience = 1};
    run *r = begin();
    interval(r, 1e-4, 1000, &count);
    assert_false(interval(r, 1e-4, 1250, &count));
}

// After a disturbance a fit requires two losses per view; the count is compared with that before.
static void disturbances_and_short_intervals_wait(void **state)
{
    (void)state;
    run *r = begin();
    interval(r, 1e-4, 1000, &defaults);
    interval(r, 1e-4, 1000, &defaults);
    assert_int_equal(r->state.held, 1);
    spare_equilibrium_disturb(&r->state, r->fits, VIEWS);
    assert_int_equal(r->state.held, 0);
    assert_false(interval(r, 1e-4, 1000, &defaults));
    assert_int_equal(r->state.held, 1);
    assert_true(interval(r, 1e-4, 1000, &defaults));
    spare_equilibrium_disturb(&r->state, r->fits, VIEWS);
    assert_false(interval(r, 1e-4, 950, &defaults)); // the update removed 5 %
    assert_true(fabs(r->state.last_count_change + 0.05) < 1e-12);
    assert_int_equal(r->state.held, 0);
    const spare_tolerance wide = {.loss = 0.008, .count = 0.06, .patience = 1};
    spare_equilibrium_disturb(&r->state, r->fits, VIEWS);
    assert_true(interval(r, 1e-4, 900, &wide));
    spare_equilibrium_disturb(&r->state, r->fits, VIEWS);
    for (int k = 0; k < 2 * VIEWS - 1; ++k)
        spare_equilibrium_observe(&r->state, r->fits, (size_t)(k % VIEWS), k, 0.25);
    assert_false(spare_equilibrium_check(&r->state, r->fits, VIEWS, 9, 900, &wide));
    assert_int_equal(r->state.held, 0);
    // Checks every iteration: an interval lasts one pass over the views.
    r = begin();
    int stop = 0;
    for (int t = 1; !stop && t < 100; ++t) {
        spare_equilibrium_observe(&r->state, r->fits, (size_t)(t % VIEWS), t, 0.25);
        if (spare_equilibrium_check(&r->state, r->fits, VIEWS, 1, 10, &defaults))
            stop = t;
    }
    assert_int_equal(stop, 3 * VIEWS);
}

static void non_finite_losses_are_ignored_and_zero_is_no_change(void **state)
{
    (void)state;
    run *r = begin();
    for (int check = 0; check < 3; ++check) {
        for (int k = 0; k < 10; ++k) {
            spare_equilibrium_observe(&r->state, r->fits, 0, 10 * check + k, 0.0);
            spare_equilibrium_observe(&r->state, r->fits, 0, 10 * check + k,
                                      k % 2 ? NAN : INFINITY);
        }
        assert_true(spare_equilibrium_check(&r->state, r->fits, 1, 10, 10, &defaults) ==
                    (check == 2));
        assert_true(fabs(r->state.last_loss_change) < 1e-9);
    }
}

static double normal(uint64_t seed, uint64_t *counter)
{
    const double u = 1.0 - sgsi_random_uniform(seed, (*counter)++),
                 v = sgsi_random_uniform(seed, (*counter)++);
    return sqrt(-2.0 * log(u)) * cos(6.283185307179586 * v);
}

// Iterations until the stop, or 0, of a run whose losses spread by 0.2 between views and by `noise`
// around each view's trend (banana at 375x250: 0.20 and 0.014), and fall by `fall` per interval.
static long simulate(uint64_t seed, int views, int length, int checks, double fall, double noise)
{
    run *r = begin();
    r->state.previous_count = 1000; // as at the end of densification
    uint64_t counter = 0;
    double levels[MAX_VIEWS] = {0.0};
    int order[MAX_VIEWS] = {0};
    for (int v = 0; v < views; ++v) {
        levels[v] = 0.2 * normal(seed, &counter);
        order[v] = v;
    }
    for (long t = 0; t < (long)length * checks; ++t) {
        const int at = (int)(t % views);
        for (int v = views - 1; v > 0 && !at; --v) { // each pass in another order
            const int other = (int)(sgsi_random_uniform(seed, counter++) * (v + 1)),
                      kept = order[v];
            order[v] = order[other];
            order[other] = kept;
        }
        const double trend = log(1.0 - fall) * (double)t / length;
        spare_equilibrium_observe(&r->state, r->fits, (size_t)order[at], t,
                                  exp(levels[order[at]] + trend + noise * normal(seed, &counter)));
        if ((t + 1) % length == 0 &&
            spare_equilibrium_check(&r->state, r->fits, (size_t)views, length, 1000, &defaults))
            return t + 1;
    }
    return 0;
}

// Whole runs of 15 checks: while the loss falls by 1 % per check at most 1 % of the runs stop, and
// when it no longer falls nearly all do.
static void stops_by_chance_are_rare_and_true_ones_happen(void **state)
{
    (void)state;
    enum { RUNS = 400, CHECKS = 15 };
    const struct {
        int views, length;
        double noise;
    } cases[] = {{13, 233, 0.014}, {13, 233, 0.03},  {35, 233, 0.014},   {97, 233, 0.014},
                 {97, 233, 0.03},  {15, 100, 0.014}, {200, 1000, 0.014}, {200, 1000, 0.05}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        int by_chance = 0, truly = 0;
        for (uint64_t n = 0; n < RUNS; ++n) {
            const uint64_t seed = 1000 * k + n;
            by_chance +=
                simulate(seed, cases[k].views, cases[k].length, CHECKS, 0.01, cases[k].noise) > 0;
            truly +=
                simulate(seed, cases[k].views, cases[k].length, CHECKS, 0.0, cases[k].noise) > 0;
        }
        print_message("%d views, check every %d, noise %.3f: %.2f %% stop at -1 %%, %.1f %% at 0\n",
                      cases[k].views, cases[k].length, cases[k].noise, 100.0 * by_chance / RUNS,
                      100.0 * truly / RUNS);
        assert_true(by_chance * 100 <= RUNS);
        assert_true(truly * 10 >= RUNS * 8);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pruning_rests_after_a_reset_for_one_interval),
        cmocka_unit_test(equilibrium_stops_after_patience),
        cmocka_unit_test(equilibrium_starts_again_when_moving),
        cmocka_unit_test(disturbances_and_short_intervals_wait),
        cmocka_unit_test(non_finite_losses_are_ignored_and_zero_is_no_change),
        cmocka_unit_test(stops_by_chance_are_rare_and_true_ones_happen),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
