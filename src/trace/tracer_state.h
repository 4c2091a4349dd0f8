// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// State of the tracer, shared by tracer.c (forward pass) and tracer_backward.c.

#include <pthread.h>
#include <string.h>

#include "base/arena.h"
#include "base/threads.h"
#include "trace/tracer.h"

enum {
    MAX_THREADS = SGSI_THREADS_MAX,
    SGSI_BUCKET_SHIFT = 16, // maximum: log2 of the primitives of a bucket
    // Candidates of a macrotile up to which every thread has memory of its own: 64 MB of scratch
    // and 4 MB of ids.
    SGSI_OWN_ROWS = 1 << 16,
    SGSI_OWN_IDS = 1 << 20
};

// Sums of one cell and bucket of primitives, in order of their first slot: a sparse set.
typedef struct sgsi_cell_sums {
    uint32_t *where; // [capacity]: entry of a primitive of the bucket, if ids[entry] is its id
    uint32_t *ids;   // [count]
    float *sums;     // [count][16]
    size_t capacity; // primitives of a bucket
    uint32_t count;
} sgsi_cell_sums;

// Records of a bucket of primitives in the cells of a piece, in the order of the cells.
typedef struct sgsi_bucket_records {
    uint32_t *ids; // [capacity]
    float *sums;   // [capacity][16]
    size_t count, capacity;
} sgsi_bucket_records;

// A scratch for more than SGSI_OWN_ROWS rows. Any thread may take it, so there are only as many as
// threads that needed one at the same time.
typedef struct sgsi_large_scratch {
    sgsi_scratch scratch;
    size_t used; // most rows required since sgsi_large_scratches_trim last looked
    bool taken;
} sgsi_large_scratch;

// Per-thread state.
typedef struct thread_state {
    sgsi_scratch own;
    sgsi_scratch *scratch;     // of the current item: `own` or that of `held`
    sgsi_large_scratch *held;  // taken by this thread, or NULL
    sgsi_large_scratch shared; // taken by any thread
    sgsi_gather_list gathered;
    sgsi_cell_sums cell;
    sgsi_arena arena;
    sgs_status status;
    double gather_seconds, blend_seconds;
    sgsi_trace_counts counts;
} thread_state;

struct sgsi_tracer {
    sgsi_bvh *bvh;
    bool profiled;
    size_t capacity, count, built_count;
    float *projected;
    sgsi_bounds *bounds;
    uint32_t *rows; // [row_capacity]: of received primitives in the whole model
    size_t row_capacity;
    bool received; // `rows` is valid
    float *sums;
    uint8_t *touched;
    uint16_t *visible;
    sgsi_tile_list *lists;
    size_t list_capacity;
    // Backward pass: a slot of sums per (tile, primitive) of a chunk of tiles.
    float *slot_sums;     // [slot_capacity][16]
    uint32_t *slot_order; // [slot_capacity]: the slots of each tile, sorted by bucket
    size_t *slot_begin;   // [list_capacity + 1]: first slot of each tile, in the order of the cells
    size_t slot_capacity;
    uint32_t *buckets; // [bucket_capacity]: per tile of a chunk, where its buckets begin
    size_t bucket_capacity;
    sgsi_tile_cost *costs; // [tiles] or NULL
    // A piece of the cells, for one of several processes.
    bool has_piece;
    sgsi_tracer_piece piece;
    uint32_t *macrotiles;         // [list_capacity]: the macrotiles of the piece
    sgsi_bucket_records *records; // [record_capacity]: by bucket
    size_t record_capacity, record_buckets;
    uint32_t *fold_order; // [fold_capacity]: records of other processes, sorted by bucket
    size_t fold_capacity;
    size_t list_words; // size of each thread's list arena
    bool abs_grad;     // backward passes also sum absolute gradients
    thread_state *threads[MAX_THREADS];
    pthread_mutex_t shared_lock; // of the threads' `shared`
    unsigned passes;             // forward passes
    sgsi_trace_seconds seconds;
    sgsi_trace_counts counts;
};

void sgsi_cell_sums_free(sgsi_cell_sums *sums);
// Creates the missing states of the present threads and clears the status of all. Both passes call
// it: the number of threads may change between them. Lists of the forward pass are kept. Fails with
// OUT_OF_MEMORY.
sgs_status sgsi_tracer_prepare_threads(sgsi_tracer *tracer);

// ---- scratch.c ----

// Makes room for `rows` in state->scratch, whose contents it may discard. False if out of memory.
bool sgsi_thread_reserve(sgsi_tracer *tracer, thread_state *state, size_t rows);
// Ends an item: leaves a large scratch to other threads.
void sgsi_thread_release(sgsi_tracer *tracer, thread_state *state);
// After a forward pass. Every few passes frees the large scratches that were too large for them.
void sgsi_large_scratches_trim(sgsi_tracer *tracer);

// ---- tracer_records.c ----

// log2 of the primitives of a bucket.
int sgsi_bucket_shift(size_t primitives);
// Empties the records of `buckets` buckets.
sgs_status sgsi_records_begin(sgsi_tracer *tracer, size_t buckets);
// Appends the sums of a cell to a bucket. False if out of memory.
bool sgsi_records_add(sgsi_bucket_records *records, const sgsi_cell_sums *sums);
void sgsi_records_free(sgsi_tracer *tracer);
// sums[16] += added[16]; both 16-byte aligned.
typedef float sgsi_four __attribute__((vector_size(16), may_alias));
static inline void sgsi_add_sums(float *sums, const float *added)
{
    sgsi_four *to = (sgsi_four *)sums;
    const sgsi_four *from = (const sgsi_four *)added;
    for (int k = 0; k < SGSI_PROJECTED_FLOATS / 4; ++k)
        to[k] += from[k]; // the compiler does not vectorise the loop over floats
}
// sums[16] = 0 + added[16], which turns -0 into +0 as a sum does.
static inline void sgsi_begin_sums(float *sums, const float *added)
{
    sgsi_four *to = (sgsi_four *)sums;
    const sgsi_four *from = (const sgsi_four *)added, zero = {0};
    for (int k = 0; k < SGSI_PROJECTED_FLOATS / 4; ++k)
        to[k] = zero + from[k];
}
// Adds sums of a cell to a primitive; the first ones of its block set those of the block to 0.
static inline void sgsi_add_to_primitive(sgsi_tracer *tracer, uint32_t id, const float *added)
{
    const size_t block = id / SGS_LANES;
    if (!tracer->touched[block]) {
        tracer->touched[block] = 1;
        memset(tracer->sums + block * SGS_LANES * SGSI_PROJECTED_FLOATS, 0,
               SGS_LANES * SGSI_PROJECTED_FLOATS * sizeof(float));
    }
    sgsi_add_sums(tracer->sums + (size_t)id * SGSI_PROJECTED_FLOATS, added);
}
