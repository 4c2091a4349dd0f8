// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The periodic checkpoints of a run without --checkpoint-every, with steps and checkpoints that
// take given times.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "run/checkpoint_pace.h"

typedef struct outcome {
    int saved, most_intervals; // the longest distance between two checkpoints
    double share, oldest;      // of the time; seconds without a checkpoint
} outcome;

// A run of `count` intervals of `interval` seconds with checkpoints of `save` seconds.
static outcome simulate(int count, double interval, double save)
{
    outcome made = {0};
    checkpoint_pace pace = {0};
    for (int k = 0; k < count; ++k) {
        pace.elapsed += interval;
        pace.age += interval;
        ++pace.intervals;
        made.oldest = pace.age > made.oldest ? pace.age : made.oldest;
        if (pace.intervals > made.most_intervals)
            made.most_intervals = pace.intervals;
        if (!checkpoint_pace_allows(&pace))
            continue;
        ++made.saved;
        pace.elapsed += save;
        pace.spent += save;
        pace.age = 0;
        pace.intervals = 0;
    }
    made.share = pace.spent / pace.elapsed;
    return made;
}

static void fast_checkpoints_are_all_saved(void **state)
{
    (void)state;
    assert_int_equal(simulate(100, 60, 3).saved, 100);
}

static void slow_checkpoints_take_about_a_twentieth_of_the_time(void **state)
{
    (void)state;
    const outcome made = simulate(1000, 60, 12); // 20 % if all were saved
    assert_true(made.share > 0.04 && made.share < 0.055);
    assert_true(made.most_intervals < 10);
}

static void a_run_is_never_long_without_a_checkpoint(void **state)
{
    (void)state;
    const outcome slow = simulate(1000, 60, 600);
    assert_int_equal(slow.most_intervals, 10);
    assert_int_equal(slow.saved, 100);
    const outcome rare = simulate(100, 1000, 1000);
    assert_true(rare.oldest <= 2000);
    assert_int_equal(simulate(100, 1800, 1800).saved, 100);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(fast_checkpoints_are_all_saved),
        cmocka_unit_test(slow_checkpoints_take_about_a_twentieth_of_the_time),
        cmocka_unit_test(a_run_is_never_long_without_a_checkpoint),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
