// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Parallel loops. Results never depend on the number of threads: callers divide work into items
// that write disjoint memory, and reduce in item order.

#include <stddef.h>

enum { SGSI_THREADS_MAX = 4096 };

// Number of threads of subsequent loops, at most SGSI_THREADS_MAX. Default: sgs_cores.
void sgsi_threads_set(int count);
int sgsi_threads(void);

// Processors in the affinity mask of the calling thread; 0 when it is not available.
int sgsi_affine_cores(void);

// Runs body(context, item, thread) once for every item in [0, count), in any order; `thread` is in
// [0, sgsi_threads()). Items are scheduled in chunks of `chunk` (0 counts as 1). Returns when all
// are done. A nested call runs its items in sequence on the calling thread, with `thread` 0.
typedef void (*sgsi_item_fn)(void *context, size_t item, int thread);
void sgsi_parallel_for(size_t count, size_t chunk, sgsi_item_fn body, void *context);

// The same in chunks of 1, for a loop over parts whose number depends on the number of threads.
// With enough threads there are `most` parts. Unless that is 1, a single part counts as parallel
// work in sgsi_threads_seconds, for which the other threads wait.
void sgsi_parallel_parts(size_t count, size_t most, sgsi_item_fn body, void *context);

// Accumulated wall-clock time of the loops of the calling thread, in seconds: inside loops, and the
// mean over the threads of their wait for the last one. A loop with a single chunk is outside.
typedef struct sgsi_loop_seconds {
    double inside, waiting;
} sgsi_loop_seconds;
sgsi_loop_seconds sgsi_threads_seconds(void);

// Loop over index ranges: body(context, begin, end, thread) with end - begin <= grain and begin a
// multiple of grain. The partition depends on grain only, never on the number of threads.
typedef void (*sgsi_range_fn)(void *context, size_t begin, size_t end, int thread);
void sgsi_parallel_ranges(size_t count, size_t grain, sgsi_range_fn body, void *context);

// sgsi_calloc for memory that all threads use. The threads zero it in parallel, which is faster and
// distributes its pages over the NUMA nodes.
void *sgsi_calloc_shared(size_t count, size_t size);
