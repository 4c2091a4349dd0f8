// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Parallel loops. Results never depend on the number of threads: callers cut work into items that
// write disjoint memory, and reduce in item order.

#include <stddef.h>

enum { SGSI_THREADS_MAX = 4096 };

// Number of threads of the coming loops, at most SGSI_THREADS_MAX. Default: sgs_cores.
void sgsi_threads_set(int count);
int sgsi_threads(void);

// Runs body(context, item, thread) for every item in [0, count), each once, in any order; `thread`
// is in [0, sgsi_threads()). Items are handed out `chunk` at a time (0 = pick one). Returns when
// all are done. Inside of an item it runs its own items one after another, with `thread` 0.
typedef void (*sgsi_item_fn)(void *context, size_t item, int thread);
void sgsi_parallel_for(size_t count, size_t chunk, sgsi_item_fn body, void *context);

// Time of the calling thread's loops so far, wall clock in seconds: inside loops, and of that the
// mean over their threads of the wait for the last thread.
typedef struct sgsi_loop_seconds {
    double inside, waiting;
} sgsi_loop_seconds;
sgsi_loop_seconds sgsi_threads_seconds(void);

// The same over index ranges: body(context, begin, end, thread) with end - begin <= grain, begin a
// multiple of grain. The cutting depends on grain only, never on the number of threads.
typedef void (*sgsi_range_fn)(void *context, size_t begin, size_t end, int thread);
void sgsi_parallel_ranges(size_t count, size_t grain, sgsi_range_fn body, void *context);

// sgsi_calloc for what all threads work on: they zero it together, which is faster, and as a page
// lies with the processor that first writes to it, spreads it over the memory of all (NUMA).
void *sgsi_calloc_shared(size_t count, size_t size);
