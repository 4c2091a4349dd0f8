// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Parallel loops: every item runs exactly once, with any number of threads, after any pause, from
// inside items and from several threads at once. A member that is not scheduled does not delay the
// loop.

#include <pthread.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "base/core.h"
#include "support/rest.h"
#include "support/skip_support.h"
#include "base/threads.h"
#include "sparegs/runtime.h"

enum { ITEMS = 5000 };

typedef struct tally {
    unsigned char runs[ITEMS]; // per item
    atomic_int strangers;      // items with an invalid thread number
} tally;

static void count_item(void *context, size_t item, int thread)
{
    tally *t = context;
    ++t->runs[item];
    if (thread < 0 || thread >= sgsi_threads())
        atomic_fetch_add(&t->strangers, 1);
}

// Number of items that did not run exactly once.
static size_t run_tally(size_t count, size_t chunk)
{
    static _Thread_local tally t;
    memset(&t, 0, sizeof t);
    sgsi_parallel_for(count, chunk, count_item, &t);
    size_t wrong = (size_t)t.strangers;
    for (size_t i = 0; i < ITEMS; ++i)
        wrong += t.runs[i] != (i < count);
    return wrong;
}

static void every_item_runs_once(void **state)
{
    (void)state;
    static const int threads[] = {1, 2, 3, 8, 2, 100, 1, 4};
    static const size_t counts[] = {0, 1, 2, 7, 64, 999, ITEMS}, chunks[] = {0, 1, 3, 64, 4999};
    for (size_t t = 0; t < sizeof threads / sizeof *threads; ++t) {
        sgsi_threads_set(threads[t]);
        for (size_t n = 0; n < sizeof counts / sizeof *counts; ++n)
            for (size_t c = 0; c < sizeof chunks / sizeof *chunks; ++c)
                assert_int_equal(run_tally(counts[n], chunks[c]), 0);
        rest(0.02); // the members fall asleep
        assert_int_equal(run_tally(ITEMS, 1), 0);
    }
}

static void short_loops_follow_each_other(void **state)
{
    (void)state;
    sgsi_threads_set(4);
    for (int k = 0; k < 20000; ++k)
        assert_int_equal(run_tally((size_t)k % 9, 1), 0);
}

static void add_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    atomic_fetch_add((atomic_size_t *)context, end - begin);
}

static void loop_again(void *context, size_t item, int thread)
{
    (void)item;
    (void)thread;
    sgsi_parallel_ranges(100, 7, add_range, context);
}

static void items_may_run_loops(void **state)
{
    (void)state;
    sgsi_threads_set(4);
    atomic_size_t sum = 0;
    sgsi_parallel_for(50, 1, loop_again, &sum);
    assert_int_equal(sum, 5000);
    assert_int_equal(run_tally(ITEMS, 1), 0);
}

enum { RANGES = 1001 };

typedef struct range_tally {
    unsigned char runs[RANGES];
    size_t grain;
    atomic_int wrong;
} range_tally;

static void tally_range(void *context, size_t begin, size_t end)
{
    range_tally *t = context;
    const size_t last = begin + t->grain < RANGES ? begin + t->grain : RANGES;
    atomic_fetch_add(&t->wrong, begin % t->grain || end != last);
    for (size_t i = begin; i < end; ++i)
        ++t->runs[i];
}

static void public_ranges_depend_on_count_and_grain_only(void **state)
{
    (void)state;
    for (int threads = 1; threads <= 3; ++threads)
        for (size_t grain = 0; grain <= 2000; grain = 3 * grain + 1) {
            range_tally t = {.grain = grain ? grain : 1};
            sgsi_threads_set(threads);
            sgs_parallel_ranges(RANGES, grain, tally_range, &t);
            assert_int_equal(t.wrong, 0);
            for (size_t i = 0; i < RANGES; ++i)
                assert_int_equal(t.runs[i], 1);
        }
    sgs_parallel_ranges(0, 5, tally_range, NULL);
}

typedef struct seen_range {
    size_t begin, end;
} seen_range;

static void note_range(void *context, size_t begin, size_t end)
{
    seen_range *seen = context;
    seen[begin != 0] = (seen_range){begin, end};
}

static void ranges_of_any_grain_cover_the_count(void **state)
{
    (void)state;
    sgsi_threads_set(1);
    for (size_t less = 0; less < 6; ++less) {
        seen_range one[2] = {{7, 7}, {7, 7}};
        sgs_parallel_ranges(5, SIZE_MAX - less, note_range, one);
        assert_int_equal(one[0].begin, 0);
        assert_int_equal(one[0].end, 5);
        assert_int_equal(one[1].begin, 7);
    }
    const size_t half = SIZE_MAX / 2 + 3;
    seen_range two[2] = {{0, 0}, {0, 0}};
    sgs_parallel_ranges(SIZE_MAX, half, note_range, two);
    assert_true(two[0].end == half && two[1].begin == half && two[1].end == SIZE_MAX);
}

static void *run_loops(void *wrong)
{
    for (int k = 0; k < 300; ++k)
        atomic_fetch_add((atomic_size_t *)wrong, run_tally(500, 3));
    return NULL;
}

static void several_threads_have_loops_at_once(void **state)
{
    (void)state;
    sgsi_threads_set(3);
    atomic_size_t wrong = 0;
    for (int round = 0; round < 3; ++round) {
        pthread_t threads[4];
        for (int i = 0; i < 4; ++i)
            assert_int_equal(pthread_create(&threads[i], NULL, run_loops, &wrong), 0);
        for (int i = 0; i < 4; ++i)
            assert_int_equal(pthread_join(threads[i], NULL), 0);
    }
    assert_int_equal(wrong, 0);
}

typedef struct held_loop {
    atomic_int held;  // a member is inside an item
    atomic_int items; // other items that ran
    atomic_int waits; // wait for a member, milliseconds
} held_loop;

// The first member that arrives keeps its item until all other items are done.
static void hold_one(void *context, size_t item, int thread)
{
    (void)item;
    held_loop *loop = context;
    int free_yet = 0;
    if (thread && atomic_compare_exchange_strong(&loop->held, &free_yet, 1)) {
        while (atomic_load(&loop->items) < ITEMS - 1)
            rest(0.001);
        return;
    }
    while (!atomic_load(&loop->held) && atomic_fetch_add(&loop->waits, 1) < 60000)
        rest(0.001);
    atomic_fetch_add(&loop->items, 1);
}

static void a_slow_item_leaves_the_others_to_the_rest(void **state)
{
    (void)state;
    sgsi_threads_set(2);
    held_loop loop = {0};
    sgsi_parallel_for(ITEMS, 1, hold_one, &loop);
    assert_int_equal(loop.held, 1);
    assert_int_equal(loop.items, ITEMS - 1);
}

static atomic_int handled, handled_elsewhere;
static pthread_t test_thread;

static void note_thread(int signal_number)
{
    (void)signal_number;
    atomic_store(&handled, 1);
    if (!pthread_equal(pthread_self(), test_thread))
        atomic_store(&handled_elsewhere, 1);
}

static void signal_process(void *context, size_t item, int thread)
{
    (void)context;
    (void)item;
    (void)thread;
    kill(getpid(), SIGUSR1);
}

static void signals_come_to_threads_of_the_caller(void **state)
{
    (void)state;
    test_thread = pthread_self();
    struct sigaction action = {.sa_handler = note_thread}, before;
    sigemptyset(&action.sa_mask);
    assert_int_equal(sigaction(SIGUSR1, &action, &before), 0);
    sgsi_threads_set(4);
    for (int k = 0; k < 50; ++k)
        sgsi_parallel_for(64, 1, signal_process, NULL);
    rest(0.01); // the last one arrives
    assert_int_equal(sigaction(SIGUSR1, &before, NULL), 0);
    assert_int_equal(handled, 1);
    assert_int_equal(handled_elsewhere, 0);
}

static pthread_key_t late_key;

static void loop_at_the_end(void *wrong)
{
    atomic_fetch_add((atomic_size_t *)wrong, run_tally(ITEMS, 1));
}

static void *loop_and_end(void *wrong)
{
    loop_at_the_end(wrong);
    return pthread_setspecific(late_key, wrong) ? wrong : NULL;
}

// The key of this destructor was created after the key of the team.
static void destructors_of_a_thread_may_run_loops(void **state)
{
    (void)state;
    sgsi_threads_set(3);
    assert_int_equal(run_tally(ITEMS, 1), 0);
    assert_int_equal(pthread_key_create(&late_key, loop_at_the_end), 0);
    atomic_size_t wrong = 0;
    pthread_t thread;
    void *failed = &wrong;
    assert_int_equal(pthread_create(&thread, NULL, loop_and_end, &wrong), 0);
    assert_int_equal(pthread_join(thread, &failed), 0);
    assert_null(failed);
    assert_int_equal(wrong, 0);
    assert_int_equal(pthread_key_delete(late_key), 0);
}

#if defined(__has_feature)
#if __has_feature(thread_sanitizer)
#define NO_THREADS_AFTER_FORK // the sanitizer ends such a process
#endif
#endif

static void a_forked_process_has_loops_of_its_own(void **state)
{
    (void)state;
#ifdef NO_THREADS_AFTER_FORK
    skip_because("the thread sanitizer ends a process that starts threads after fork");
#endif
    sgsi_threads_set(4);
    assert_int_equal(run_tally(ITEMS, 1), 0);
    const pid_t child = fork();
    assert_true(child >= 0);
    if (!child) {
        size_t wrong = run_tally(ITEMS, 1);
        sgsi_threads_set(2);
        wrong += run_tally(ITEMS, 1);
        _exit(wrong ? 1 : 0);
    }
    int status;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_int_equal(status, 0);
    assert_int_equal(run_tally(ITEMS, 1), 0);
}

// Runs after the thread that forked has ended: its process must still be able to run loops.
static void *await_end(void *forking)
{
    if (pthread_join(*(pthread_t *)forking, NULL))
        _exit(2);
    for (int threads = 2; threads <= 8; ++threads) {
        sgsi_threads_set(threads);
        if (run_tally(ITEMS, 1))
            _exit(3);
    }
    _exit(0);
}

static void *fork_and_end(void *result)
{
    static pthread_t forking;
    atomic_size_t wrong = run_tally(ITEMS, 1);
    const pid_t child = fork();
    if (!child) {
        pthread_t watcher;
        alarm(60); // a join of a thread that does not exist may never return
        forking = pthread_self();
        if (pthread_create(&watcher, NULL, await_end, &forking))
            _exit(4);
        pthread_exit(NULL); // runs the destructors, unlike _exit
    }
    int status = -1;
    wrong += child < 0 || waitpid(child, &status, 0) != child || status;
    atomic_store((atomic_size_t *)result, wrong);
    return NULL;
}

static void a_thread_may_end_in_the_process_it_forked(void **state)
{
    (void)state;
#ifdef NO_THREADS_AFTER_FORK
    skip_because("the thread sanitizer ends a process that starts threads after fork");
#endif
    sgsi_threads_set(4);
    atomic_size_t wrong = 1;
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, fork_and_end, &wrong), 0);
    assert_int_equal(pthread_join(thread, NULL), 0);
    assert_int_equal(wrong, 0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_item_runs_once),
        cmocka_unit_test(short_loops_follow_each_other),
        cmocka_unit_test(items_may_run_loops),
        cmocka_unit_test(public_ranges_depend_on_count_and_grain_only),
        cmocka_unit_test(ranges_of_any_grain_cover_the_count),
        cmocka_unit_test(several_threads_have_loops_at_once),
        cmocka_unit_test(a_slow_item_leaves_the_others_to_the_rest),
        cmocka_unit_test(signals_come_to_threads_of_the_caller),
        cmocka_unit_test(destructors_of_a_thread_may_run_loops),
        cmocka_unit_test(a_forked_process_has_loops_of_its_own),
        cmocka_unit_test(a_thread_may_end_in_the_process_it_forked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
