// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Parallel loops on OpenMP.

#include "threads.h"

#include <math.h>
#include <omp.h>
#include <sched.h>
#include <stdatomic.h>
#include <string.h>

#include "control_groups.h"
#include "core.h"
#include "sparegs/runtime.h"

static atomic_int thread_count; // 0 = not asked for yet

void sgsi_threads_set(int count)
{
    thread_count = count < 0 ? 0 : count > SGSI_THREADS_MAX ? SGSI_THREADS_MAX : count;
}

void sgs_set_threads(int count)
{
    sgsi_threads_set(count);
}

int sgs_threads(void)
{
    return sgsi_threads();
}

int sgs_cores(void)
{
    cpu_set_t mask;
    const int cores =
        sched_getaffinity(0, sizeof mask, &mask) ? omp_get_num_procs() : CPU_COUNT(&mask);
    const double allowed = sgsi_group_limits_read("/proc/self/cgroup", "/sys/fs/cgroup").cores;
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
        // Another thread may have set it meanwhile: then count becomes that number.
        if (atomic_compare_exchange_strong(&thread_count, &count, cores))
            count = cores;
    }
    return count;
}

// Denormals are flushed inside parallel loops (Embree asks for it, and they would cost hundreds of
// cycles each); the caller's mode comes back afterwards.
#ifdef SGSI_X86
#include <xmmintrin.h>
typedef unsigned float_mode;
static float_mode enter_float_mode(void)
{
    const unsigned mode = _mm_getcsr();
    _mm_setcsr(mode | 0x8040u); // flush to zero, denormals are zero
    return mode;
}
static void leave_float_mode(float_mode mode)
{
    _mm_setcsr(mode);
}
#else
typedef int float_mode;
static float_mode enter_float_mode(void)
{
    return 0;
}
static void leave_float_mode(float_mode mode)
{
    (void)mode;
}
#endif

static _Thread_local sgsi_loop_seconds loop_seconds;

sgsi_loop_seconds sgsi_threads_seconds(void)
{
    return loop_seconds;
}

void sgsi_parallel_for(size_t count, size_t chunk, sgsi_item_fn body, void *context)
{
    if (!chunk)
        chunk = 1;
    const int threads = sgsi_threads();
    const double start = sgsi_seconds();
    if (threads == 1 || count <= chunk) {
        const float_mode mode = enter_float_mode();
        for (size_t item = 0; item < count; ++item)
            body(context, item, 0);
        leave_float_mode(mode);
        if (threads == 1) // else a single item is serial work
            loop_seconds.inside += sgsi_seconds() - start;
        return;
    }
    double finished = 0.0; // sum over the threads
#pragma omp parallel num_threads(threads) reduction(+ : finished)
    {
        const int thread = omp_get_thread_num();
        const float_mode mode = enter_float_mode();
#pragma omp for schedule(dynamic, chunk) nowait
        for (size_t item = 0; item < count; ++item)
            body(context, item, thread);
        leave_float_mode(mode);
        finished = sgsi_seconds() - start;
    }
    const double wall = sgsi_seconds() - start;
    loop_seconds.inside += wall;
    loop_seconds.waiting += wall - finished / threads;
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
    const size_t end = begin + loop->grain < loop->count ? begin + loop->grain : loop->count;
    loop->body(loop->context, begin, end, thread);
}

void sgsi_parallel_ranges(size_t count, size_t grain, sgsi_range_fn body, void *context)
{
    range_loop loop = {count, grain, body, context};
    sgsi_parallel_for((count + grain - 1) / grain, 1, run_range, &loop);
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
