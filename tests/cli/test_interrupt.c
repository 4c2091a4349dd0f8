// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Requests to stop that arrive several times: from a batch system, its launcher and other processes
// of the run. Each case runs in its own process, because a second request may end it.

#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "processes/interrupt.h"

// FOLLOW + n: another process of the run has received signal n. REQUEST: the program stops itself.
enum { REQUEST = -2000, FOLLOW = -1000, END = 0, WORK_COMPLETE = 7, MAX_STEPS = 5 };

// The status of a process in which these signals arrive, and whether they stop it at once.
static int status_after(const int steps[MAX_STEPS], bool *stopped_at_once)
{
    const pid_t child = fork();
    assert_true(child >= 0);
    if (!child) {
        interrupt_watch();
        for (size_t i = 0; i < MAX_STEPS && steps[i] != END; ++i)
            if (steps[i] == REQUEST)
                interrupt_request();
            else if (steps[i] < 0)
                interrupt_follow(steps[i] - FOLLOW);
            else
                raise(steps[i]);
        _exit(interrupt_signal() ? WORK_COMPLETE + interrupt_signal() : WORK_COMPLETE);
    }
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    *stopped_at_once = WEXITSTATUS(status) > 128;
    return WEXITSTATUS(status) - (*stopped_at_once ? 128 : WORK_COMPLETE);
}

static void one_request_that_arrives_several_times_lets_the_work_end(void **state)
{
    (void)state;
    static const int cases[][MAX_STEPS] = {
        {SIGTERM},
        {SIGTERM, SIGTERM},
        {INTERRUPT_PASSED_ON, SIGTERM, SIGTERM},
        {SIGTERM, INTERRUPT_PASSED_ON, SIGTERM},
        {INTERRUPT_PASSED_ON, INTERRUPT_PASSED_ON, SIGTERM},
        {FOLLOW + SIGTERM, SIGTERM},
        {FOLLOW + SIGTERM, SIGTERM, SIGTERM},
        {FOLLOW + SIGTERM, SIGTERM, SIGTERM, INTERRUPT_PASSED_ON},
        {FOLLOW + SIGTERM, INTERRUPT_PASSED_ON, SIGTERM},
        {SIGTERM, FOLLOW + SIGINT, SIGTERM},
        {REQUEST, SIGTERM},
        {REQUEST, SIGTERM, SIGTERM},
        {REQUEST, REQUEST, INTERRUPT_PASSED_ON, SIGTERM, SIGTERM},
        {REQUEST, FOLLOW + SIGTERM, SIGTERM, SIGTERM},
        {SIGTERM, REQUEST, SIGTERM},
        {SIGXCPU},
        {SIGXCPU, SIGXCPU, SIGXCPU, SIGXCPU, SIGTERM},
        {SIGTERM, SIGXCPU, SIGXCPU},
        {INTERRUPT_PASSED_ON, SIGXCPU, SIGTERM},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        bool stopped;
        assert_int_equal(status_after(cases[i], &stopped), SIGTERM);
        assert_false(stopped);
    }
}

static void a_second_request_of_the_user_ends_at_once(void **state)
{
    (void)state;
    static const int cases[][MAX_STEPS] = {
        {SIGINT, SIGINT},          {SIGTERM, SIGINT},
        {SIGHUP, SIGINT},          {FOLLOW + SIGTERM, SIGINT, SIGINT},
        {REQUEST, SIGINT, SIGINT}, {SIGINT, REQUEST, SIGINT}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        bool stopped;
        assert_int_equal(status_after(cases[i], &stopped), SIGINT);
        assert_true(stopped);
    }
}

static void a_stop_of_the_program_is_an_interrupt_and_no_first_signal(void **state)
{
    (void)state;
    static const int cases[][MAX_STEPS] = {{REQUEST}, {REQUEST, REQUEST}, {REQUEST, SIGINT}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        bool stopped;
        assert_int_equal(status_after(cases[i], &stopped), SIGINT);
        assert_false(stopped);
    }
}

static void a_stop_of_the_program_is_known_as_one_until_a_signal(void **state)
{
    (void)state;
    const pid_t child = fork();
    assert_true(child >= 0);
    if (!child) {
        interrupt_watch();
        const bool before = interrupt_is_request();
        interrupt_request();
        interrupt_follow(SIGINT); // the same request, from the other ranks
        const bool requested = interrupt_is_request();
        raise(SIGINT);
        _exit(!before && requested && !interrupt_is_request() ? 0 : 1);
    }
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_int_equal(status, 0);
}

static void a_process_ends_with_the_signal_that_another_one_received(void **state)
{
    (void)state;
    static const int signals[] = {SIGINT, SIGTERM, SIGHUP};
    for (size_t i = 0; i < sizeof signals / sizeof *signals; ++i) {
        bool stopped;
        const int steps[MAX_STEPS] = {FOLLOW + signals[i]};
        assert_int_equal(status_after(steps, &stopped), signals[i]);
        assert_false(stopped);
    }
}

static void no_request_is_no_signal(void **state)
{
    (void)state;
    bool stopped;
    assert_int_equal(status_after((const int[MAX_STEPS]){SIGUSR1}, &stopped), 0);
    assert_false(stopped);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_request_that_arrives_several_times_lets_the_work_end),
        cmocka_unit_test(a_second_request_of_the_user_ends_at_once),
        cmocka_unit_test(a_stop_of_the_program_is_an_interrupt_and_no_first_signal),
        cmocka_unit_test(a_stop_of_the_program_is_known_as_one_until_a_signal),
        cmocka_unit_test(a_process_ends_with_the_signal_that_another_one_received),
        cmocka_unit_test(no_request_is_no_signal),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
