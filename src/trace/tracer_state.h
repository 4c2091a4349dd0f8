// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What the files of the tracer share: tracer.c, which goes forward, and tracer_backward.c.

#include "base/arena.h"
#include "base/threads.h"
#include "trace/tracer.h"

enum { MAX_THREADS = SGSI_THREADS_MAX };

// What one thread works with.
typedef struct thread_state {
    sgsi_scratch scratch;
    sgsi_gather_list gathered;
    uint64_t *keys, *keys_spare; // [key_capacity]
    size_t key_capacity;
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
    float *slot_sums;     // backward: [slot_capacity][16], a slot per (tile, primitive) of a chunk
    uint32_t *slot_order; // [slot_capacity]: per tile its slots by bucket
    size_t *slot_begin;   // [list_capacity + 1]
    size_t slot_capacity;
    uint32_t *buckets; // [bucket_capacity]: per tile of a chunk where its buckets begin
    size_t bucket_capacity;
    sgsi_tile_cost *costs; // [tiles] or NULL
    size_t list_words;     // room for lists in every thread's arena
    bool abs_grad;         // backward passes sum absolute gradients, too
    thread_state *threads[MAX_THREADS];
    sgsi_trace_seconds seconds;
    sgsi_trace_counts counts;
};
