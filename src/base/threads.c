// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Parallel loops and the number of threads.

#include "base/threads.h"

#include <math.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <string.h>
#include <unistd.h>

#include "base/cgroup_limits.h"
#include "base/core.h"
#include "base/float_mode.h"
#include "sparegs/runtime.h"
#include "base/thread_team.h"

static atomic_int thread_count; // 0 = default

void sgsi_threads_set(int count)
{
    thread_count = count < 0 ? 0 : count > SGSI_THREADS_MAX ? SGSI_THREADS_MAX : count;
}

void sgs_threads_set(int count)
{
    sgsi_threads_set(count);
}

int sgs_threads_get(void)
{
    return sgsi_threads();
}

// For any size of machine.
int sgsi_affine_cores(void)
{
    for (int most = 1024; most <= 1 << 20; most *= 4) {
        cpu_set_t *mask = CPU_ALLOC((size_t)most);
        if (!mask)
            return 0;
        const size_t size = CPU_ALLOC_SIZE((size_t)most);
        const int cores = sched_getaffinity(0, size, mask) ? 0 : CPU_COUNT_S(size, mask);
        CPU_FREE(mask);
        if (cores)
            return cores;
    }
    return 0;
}

int sgs_cores(void)
{
    int cores = sgsi_affine_cores();
    if (cores < 1)
        cores = (int)sysconf(_SC_NPROCESSORS_ONLN);
    const double allowed = sgsi_group_limits_own().cores;
    if (allowed > 0.0 && allowed < (double)cores)
        return (int)ceil(allowed);
    return cores < 1 ? 1 : cores;
}

int sgsi_threads(void)
{
    int count = atomic_load_explicit(&thread_count, memory_order_relaxed);
    if (!count) {
        int cores = sgs_cores();
        if (cores > SGSI_THREADS_MAX)
            cores = SGSI_THREADS_MAX;
        // On failure another thread has set it; count then holds that number.
        if (atomic_compare_exchange_strong(&thread_count, &count, cores))
            count = cores;
    }
    return count;
}

static _Thread_local sgsi_loop_seconds loop_seconds;

sgsi_loop_seconds sgsi_threads_seconds(void)
{
    return loop_seconds;
}

// parallel: whether the loop counts as parallel work if this thread runs all items.
static void run_loop(size_t count, size_t chunk, bool parallel, sgsi_item_fn body, void *context)
{
    const int threads = sgsi_threads();
    const bool nested = sgsi_team_is_inside(); // the other threads are busy
    const double start = sgsi_seconds();
    const sgsi_float_mode mode = sgsi_float_mode_enter();
    sgsi_loop_seconds seconds = loop_seconds;
    if (threads == 1 || count <= chunk || nested) {
        for (size_t item = 0; item < count; ++item)
            body(context, item, 0);
        if (parallel && !nested) { // with the loops in its items, which have added their time
            const double wall = sgsi_seconds() - start;
            seconds.inside += wall;
            seconds.waiting += wall * (threads - 1) / threads;
            loop_seconds = seconds;
        }
    } else {
        const double finished = sgsi_team_run(threads, count, chunk, body, context, start);
        const double wall = sgsi_seconds() - start;
        loop_seconds.inside += wall;
        loop_seconds.waiting += wall - finished / threads;
    }
    sgsi_float_mode_set(mode);
}

void sgsi_parallel_for(size_t count, size_t chunk, sgsi_item_fn body, void *context)
{
    if (!chunk)
        chunk = 1;
    run_loop(count, chunk, count > chunk, body, context);
}

void sgsi_parallel_parts(size_t count, size_t most, sgsi_item_fn body, void *context)
{
    run_loop(count, 1, most > 1, body, context);
}

typedef struct range_loop {
    size_t count, grain;
    sgsi_range_fn body;
    void *context;
} range_loop;

static void run_range(void *context, size_t item, int thread)
{
    const range_loop *loop = context;
    const size_t begin = item * loop->grain;
    const size_t left = loop->count - begin;
    const size_t end = begin + (loop->grain < left ? loop->grain : left);
    loop->body(loop->context, begin, end, thread);
}

void sgsi_parallel_ranges(size_t count, size_t grain, sgsi_range_fn body, void *context)
{
    range_loop loop = {count, grain, body, context};
    sgsi_parallel_for(count / grain + (count % grain != 0), 1, run_range, &loop);
}

typedef struct public_loop {
    sgs_range_fn body;
    void *context;
} public_loop;

static void run_public_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const public_loop *loop = context;
    loop->body(loop->context, begin, end);
}

void sgs_parallel_ranges(size_t count, size_t grain, sgs_range_fn body, void *context)
{
    public_loop loop = {body, context};
    sgsi_parallel_ranges(count, grain ? grain : 1, run_public_range, &loop);
}

enum { ZEROED_AT_ONCE = 2 << 20 }; // a huge page

static void zero_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    memset((char *)context + begin, 0, end - begin);
}

void *sgsi_calloc_shared(size_t count, size_t size)
{
    void *block = sgsi_alloc(count, size);
    if (block)
        sgsi_parallel_ranges(count * size, ZEROED_AT_ONCE, zero_range, block);
    return block;
}
