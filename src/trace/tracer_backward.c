// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Backward pass. It visits the tiles of the forward pass through their lists and writes one slot, a
// cache line of gradient sums, per (tile, primitive). The slots are then added per primitive in
// tile order, so the result does not depend on the number of threads. Primitives are divided into
// buckets, and each tile sorts its slots by bucket, so that a thread reduces whole buckets without
// reading other slots. Tiles are processed in chunks whose slots fit in the caches.

#include <string.h>

#include "base/core.h"
#include "trace/tracer_state.h"

enum { CHUNK_SLOTS = 1 << 18, CHUNK_TILES = 1 << 12, REDUCE_AHEAD = 12, BUCKETS_PER_THREAD = 4 };

typedef struct backward_pass {
    sgsi_tracer *tracer;
    const sgsi_view *view;
    const sgsi_planes *planes;
    const float *d_color[3], *d_transmittance;
    const sgsi_score_planes *score; // replaces the gradients, or NULL
    size_t first_tile, last_tile;   // chunk [first_tile, last_tile)
    int bucket_shift;               // bucket of primitive id: id >> bucket_shift
    size_t bucket_count;
} backward_pass;

// First slot of each bucket of a tile, in slot_order. One extra entry for the end, one for the
// sort.
static uint32_t *tile_buckets(const backward_pass *pass, size_t tile)
{
    return pass->tracer->buckets + (tile - pass->first_tile) * (pass->bucket_count + 2);
}

// Sorts the slots of a tile by bucket.
static void sort_slots(const backward_pass *pass, size_t tile)
{
    const sgsi_tile_list *list = &pass->tracer->lists[tile];
    const size_t first = pass->tracer->slot_begin[pass->first_tile];
    uint32_t *order = pass->tracer->slot_order + pass->tracer->slot_begin[tile] - first;
    uint32_t *begin = tile_buckets(pass, tile);
    memset(begin, 0, (pass->bucket_count + 2) * sizeof *begin);
    for (uint32_t i = 0; i < list->count; ++i)
        ++begin[(list->ids[i] >> pass->bucket_shift) + 2];
    for (size_t k = 2; k <= pass->bucket_count; ++k)
        begin[k + 1] += begin[k];
    for (uint32_t i = 0; i < list->count; ++i)
        order[begin[(list->ids[i] >> pass->bucket_shift) + 1]++] = i;
}

static void backward_tile(void *context, size_t item, int thread)
{
    const backward_pass *pass = context;
    sgsi_tracer *tracer = pass->tracer;
    const size_t tile = pass->first_tile + item;
    const sgsi_tile_list *list = &tracer->lists[tile];
    thread_state *state = tracer->threads[thread];
    sort_slots(pass, tile);
    if (!list->count || state->status)
        return;
    sgsi_scratch *s = &state->scratch;
    if (!sgsi_scratch_reserve(s, list->count + 16)) {
        state->status = SGS_STATUS_OUT_OF_MEMORY;
        return;
    }
    const sgsi_kernels *kernels = sgsi_kernels_get();
    sgsi_tile_target target = {.rays = &pass->view->rays->tiles[tile],
                               .width = pass->planes->width,
                               .height = pass->planes->height,
                               .stride = pass->planes->stride,
                               .d_color = {pass->d_color[0], pass->d_color[1], pass->d_color[2]},
                               .d_transmittance = pass->d_transmittance,
                               .projected = tracer->projected,
                               .near_distance = pass->view->near_distance};
    const size_t slot = tracer->slot_begin[tile] - tracer->slot_begin[pass->first_tile];
    s->sums = tracer->slot_sums + slot * SGSI_PROJECTED_FLOATS;
    if (pass->score)
        kernels->tile_score(s, list, &target, pass->score);
    else if (tracer->abs_grad)
        kernels->tile_backward_abs_grad(s, list, &target);
    else
        kernels->tile_backward(s, list, &target);
}

// Adds the chunk's slots to the primitives of one bucket, in tile order.
static void reduce_bucket(void *context, size_t bucket, int thread)
{
    (void)thread;
    const backward_pass *pass = context;
    sgsi_tracer *tracer = pass->tracer;
    const size_t first = tracer->slot_begin[pass->first_tile];
    for (size_t tile = pass->first_tile; tile < pass->last_tile; ++tile) {
        const uint32_t *begin = tile_buckets(pass, tile) + bucket, *ids = tracer->lists[tile].ids;
        const size_t slot = tracer->slot_begin[tile] - first;
        const uint32_t *order = tracer->slot_order + slot;
        for (uint32_t i = begin[0]; i < begin[1]; ++i) {
            const uint32_t id = ids[order[i]];
            if (i + REDUCE_AHEAD < begin[1]) {
                const uint32_t ahead = order[i + REDUCE_AHEAD];
                __builtin_prefetch(tracer->sums + (size_t)ids[ahead] * SGSI_PROJECTED_FLOATS, 1);
                __builtin_prefetch(tracer->slot_sums + (slot + ahead) * SGSI_PROJECTED_FLOATS);
            }
            const size_t block = id / SGS_LANES;
            if (!tracer->touched[block]) {
                tracer->touched[block] = 1;
                memset(tracer->sums + block * SGS_LANES * SGSI_PROJECTED_FLOATS, 0,
                       SGS_LANES * SGSI_PROJECTED_FLOATS * sizeof(float));
            }
            float *sum = tracer->sums + (size_t)id * SGSI_PROJECTED_FLOATS;
            const float *add = tracer->slot_sums + (slot + order[i]) * SGSI_PROJECTED_FLOATS;
            for (int k = 0; k < SGSI_PROJECTED_FLOATS; ++k)
                sum[k] += add[k];
        }
    }
}

// Buckets are whole blocks of primitives, several per thread to balance the load.
static void choose_buckets(backward_pass *pass)
{
    const size_t count = pass->tracer->count, threads = (size_t)sgsi_threads();
    const size_t max_buckets = threads > 1 ? BUCKETS_PER_THREAD * threads : 1;
    pass->bucket_shift = 4; // log2 of SGS_LANES: each `touched` flag belongs to one bucket
    while (count && (count - 1) >> pass->bucket_shift >= max_buckets)
        ++pass->bucket_shift;
    pass->bucket_count = count ? ((count - 1) >> pass->bucket_shift) + 1 : 0;
}

static sgs_status reserve_buckets(sgsi_tracer *tracer, size_t required)
{
    if (required <= tracer->bucket_capacity)
        return SGS_STATUS_OK;
    if (!sgsi_grow((void **)&tracer->buckets, 0, required, sizeof *tracer->buckets))
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory to sort the gradients of a view");
    tracer->bucket_capacity = required;
    return SGS_STATUS_OK;
}

static sgs_status reserve_slots(sgsi_tracer *tracer, size_t slots)
{
    if (slots <= tracer->slot_capacity)
        return SGS_STATUS_OK;
    sgsi_free(tracer->slot_order);
    sgsi_free(tracer->slot_sums);
    tracer->slot_order = sgsi_alloc(slots, sizeof *tracer->slot_order);
    tracer->slot_sums = sgsi_alloc(slots, SGSI_PROJECTED_FLOATS * sizeof *tracer->slot_sums);
    tracer->slot_capacity = tracer->slot_order && tracer->slot_sums ? slots : 0;
    return tracer->slot_capacity
               ? SGS_STATUS_OK
               : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for %zu gradient slots", slots);
}

// For each chunk of tiles: sums per (tile, primitive), then per primitive.
static sgs_status run_backward(sgsi_tracer *tracer, backward_pass *pass)
{
    const double start = sgsi_seconds();
    const size_t tiles = (size_t)pass->view->rays->tiles_x * (size_t)pass->view->rays->tiles_y;
    double reducing = 0.0;
    memset(tracer->touched, 0, tracer->capacity / SGS_LANES);
    choose_buckets(pass);
    const sgs_status reserved = reserve_buckets(
        tracer, (tiles < CHUNK_TILES ? tiles : CHUNK_TILES) * (pass->bucket_count + 2));
    if (reserved)
        return reserved;
    tracer->slot_begin[0] = 0;
    for (size_t i = 0; i < tiles; ++i)
        tracer->slot_begin[i + 1] = tracer->slot_begin[i] + tracer->lists[i].count;
    for (size_t first = 0; first < tiles; first = pass->last_tile) {
        size_t last = first + 1;
        while (last < tiles && last - first < CHUNK_TILES &&
               tracer->slot_begin[last + 1] - tracer->slot_begin[first] <= CHUNK_SLOTS)
            ++last;
        pass->first_tile = first;
        pass->last_tile = last;
        const size_t slots = tracer->slot_begin[last] - tracer->slot_begin[first];
        const sgs_status status = reserve_slots(tracer, slots > CHUNK_SLOTS ? slots : CHUNK_SLOTS);
        if (status)
            return status;
        sgsi_parallel_for(last - first, 1, backward_tile, pass);
        const double reduce_start = sgsi_seconds();
        sgsi_parallel_for(pass->bucket_count, 1, reduce_bucket, pass);
        reducing += sgsi_seconds() - reduce_start;
    }
    tracer->seconds.reduce = reducing;
    tracer->seconds.backward = sgsi_seconds() - start - reducing;
    for (int i = 0; i < sgsi_threads(); ++i)
        if (tracer->threads[i]->status)
            return sgsi_fail(tracer->threads[i]->status, "no memory for the gradients of a tile");
    return SGS_STATUS_OK;
}

sgs_status sgsi_tracer_backward(sgsi_tracer *tracer, const sgsi_view *view,
                                const sgsi_planes *planes, float *const d_color[3],
                                float *d_transmittance)
{
    backward_pass pass = {.tracer = tracer,
                          .view = view,
                          .planes = planes,
                          .d_color = {d_color[0], d_color[1], d_color[2]},
                          .d_transmittance = d_transmittance};
    return run_backward(tracer, &pass);
}

sgs_status sgsi_tracer_score(sgsi_tracer *tracer, const sgsi_view *view, const sgsi_planes *planes,
                             const sgsi_score_planes *score)
{
    backward_pass pass = {.tracer = tracer, .view = view, .planes = planes, .score = score};
    return run_backward(tracer, &pass);
}
