// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// State of the tracer, shared by tracer.c (forward pass) and tracer_backward.c.

#include "base/arena.h"
#include "base/threads.h"
#include "trace/tracer.h"

enum { MAX_THREADS = SGSI_THREADS_MAX };

// Sums of one cell and bucket of primitives, in order of their first slot: a sparse set.
typedef struct sgsi_cell_sums {
    uint32_t *where; // [capacity]: entry of a primitive of the bucket, if ids[entry] is its id
    uint32_t *ids;   // [count]
    float *sums;     // [count][16]
    size_t capacity; // primitives of a bucket
    uint32_t count;
} sgsi_cell_sums;

// Per-thread state.
typedef struct thread_state {
    sgsi_scratch scratch;
    sgsi_gather_list gathered;
    uint64_t *keys, *keys_spare; // [key_capacity]
    size_t key_capacity;
    sgsi_cell_sums cell;
    sgsi_arena arena;
    sgs_status status;
    double gather_seconds, blend_seconds;
    sgsi_trace_counts counts;
} thread_state;

struct sgsi_tracer {
    sgsi_bvh *bvh;
    size_t capacity, count, built_count;
    float *projected;
    sgsi_bounds *bounds;
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
    size_t list_words;     // size of each thread's list arena
    bool abs_grad;         // backward passes also sum absolute gradients
    thread_state *threads[MAX_THREADS];
    sgsi_trace_seconds seconds;
    sgsi_trace_counts counts;
};

void sgsi_cell_sums_free(sgsi_cell_sums *sums);
