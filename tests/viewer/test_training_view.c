// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A pause ends if its pages do not come back.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "viewer/training_view.h"

static void a_pause_ends_after_its_time_without_pages(void **state)
{
    (void)state;
    const double limit = PAUSE_SECONDS_ALONE, start = 1e6;
    pause_watch watch = {0};
    assert_false(pause_watch_expires(&watch, 2, start));
    assert_false(pause_watch_expires(&watch, 1, start + 10 * limit));
    const double gone = start + 11 * limit;
    assert_false(pause_watch_expires(&watch, 0, gone));
    assert_false(pause_watch_expires(&watch, 0, gone + 0.99 * limit));
    assert_true(pause_watch_expires(&watch, 0, gone + limit));
}

static void a_page_that_returns_starts_the_time_again(void **state)
{
    (void)state;
    const double limit = PAUSE_SECONDS_ALONE;
    pause_watch watch = {0};
    assert_false(pause_watch_expires(&watch, 0, 0)); // it had gone before the first call
    assert_false(pause_watch_expires(&watch, 0, 0.9 * limit));
    assert_false(pause_watch_expires(&watch, 1, 0.95 * limit));
    assert_false(pause_watch_expires(&watch, 0, 1.5 * limit));
    assert_false(pause_watch_expires(&watch, 0, 2.4 * limit));
    assert_true(pause_watch_expires(&watch, 0, 2.5 * limit));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_pause_ends_after_its_time_without_pages),
        cmocka_unit_test(a_page_that_returns_starts_the_time_again),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
