// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Backward pass. It visits the tiles of the forward pass through their lists and writes one slot, a
// cache line of gradient sums, per (tile, primitive). The slots are then added per primitive: first
// those of a cell of the image, in raster order of its tiles, then the sums of the cells in the
// order of their curve (base/image_cells.h). The result depends neither on the number of threads
// nor on a division of the curve. Primitives are divided into buckets, and each tile sorts its
// slots by bucket, so that a thread reduces whole buckets without reading other slots. Cells are
// processed in chunks whose slots fit in the caches.

#include <string.h>

#include "base/core.h"
#include "trace/tracer_state.h"

enum {
    CHUNK_SLOTS = 1 << 18,
    CHUNK_TILES = 1 << 12,
    THREAD_SLOTS = 1 << 14, // of a chunk, with many threads: 1 MB
    THREAD_TILES = 1 << 8,
    REDUCE_AHEAD = 12
};

typedef struct backward_pass {
    sgsi_tracer *tracer;
    const sgsi_view *view;
    const sgsi_planes *planes;
    const float *d_color[3], *d_transmittance;
    const sgsi_score_planes *score;  // replaces the gradients, or NULL
    size_t first_tile, last_tile;    // chunk [first_tile, last_tile) of rays->cells.tile_order
    size_t first_cell, last_cell;    // of the chunk
    size_t end_cell;                 // of the piece
    size_t chunk_slots, chunk_tiles; // most of a chunk
    int bucket_shift;                // bucket of primitive id: id >> bucket_shift
    size_t bucket_count;
} backward_pass;

// First slot of each bucket of a tile, in slot_order. One extra entry for the end, one for the
// sort.
static uint32_t *tile_buckets(const backward_pass *pass, size_t tile)
{
    return pass->tracer->buckets + (tile - pass->first_tile) * (pass->bucket_count + 2);
}

// The list of a tile by its position in the order of the cells.
static const sgsi_tile_list *tile_list(const backward_pass *pass, size_t tile)
{
    return &pass->tracer->lists[pass->view->rays->cells.tile_order[tile]];
}

// Sorts the slots of a tile by bucket.
static void sort_slots(const backward_pass *pass, size_t tile)
{
    const sgsi_tile_list *list = tile_list(pass, tile);
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
    const sgsi_tile_list *list = tile_list(pass, tile);
    thread_state *state = tracer->threads[thread];
    sort_slots(pass, tile);
    if (!list->count || state->status)
        return;
    if (!sgsi_thread_reserve(tracer, state, list->count + 16)) {
        sgsi_thread_release(tracer, state);
        state->status = SGS_STATUS_OUT_OF_MEMORY;
        return;
    }
    sgsi_scratch *s = state->scratch;
    const sgsi_kernels *kernels = sgsi_kernels_get();
    const sgsi_rays *rays = pass->view->rays;
    sgsi_tile_target target = {.rays = &rays->tiles[rays->cells.tile_order[tile]],
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
    sgsi_thread_release(tracer, state);
}

// Prefetches the first slots of one tile and bucket.
static void prefetch_tile(const backward_pass *pass, size_t tile, size_t bucket)
{
    const sgsi_tracer *tracer = pass->tracer;
    const uint32_t *begin = tile_buckets(pass, tile) + bucket;
    const size_t slot = tracer->slot_begin[tile] - tracer->slot_begin[pass->first_tile];
    for (uint32_t i = begin[0]; i < begin[1] && i < begin[0] + REDUCE_AHEAD; ++i)
        __builtin_prefetch(tracer->slot_sums +
                           (slot + tracer->slot_order[slot + i]) * SGSI_PROJECTED_FLOATS);
}

// Adds the slots of one tile and bucket to the sums of its cell.
static void merge_tile(const backward_pass *pass, size_t tile, size_t bucket, sgsi_cell_sums *sums)
{
    const sgsi_tracer *tracer = pass->tracer;
    const uint32_t *begin = tile_buckets(pass, tile) + bucket, *ids = tile_list(pass, tile)->ids;
    const size_t slot = tracer->slot_begin[tile] - tracer->slot_begin[pass->first_tile];
    const uint32_t *order = tracer->slot_order + slot;
    const uint32_t base = (uint32_t)(bucket << pass->bucket_shift);
    for (uint32_t i = begin[0]; i < begin[1]; ++i) {
        const uint32_t id = ids[order[i]];
        const float *added = tracer->slot_sums + (slot + order[i]) * SGSI_PROJECTED_FLOATS;
        if (i + REDUCE_AHEAD < begin[1]) {
            const uint32_t ahead = order[i + REDUCE_AHEAD];
            __builtin_prefetch(tracer->slot_sums + (slot + ahead) * SGSI_PROJECTED_FLOATS);
            __builtin_prefetch(sums->where + (ids[ahead] - base), 1);
        }
        const uint32_t entry = sums->where[id - base];
        if (entry < sums->count && sums->ids[entry] == id) {
            sgsi_add_sums(sums->sums + (size_t)entry * SGSI_PROJECTED_FLOATS, added);
            continue;
        }
        sums->where[id - base] = sums->count;
        sums->ids[sums->count] = id;
        sgsi_begin_sums(sums->sums + (size_t)sums->count++ * SGSI_PROJECTED_FLOATS, added);
    }
}

// Adds the sums of a cell to the primitives.
static void add_cell(sgsi_tracer *tracer, const sgsi_cell_sums *sums)
{
    for (uint32_t i = 0; i < sums->count; ++i) {
        const uint32_t id = sums->ids[i];
        if (i + REDUCE_AHEAD < sums->count)
            __builtin_prefetch(
                tracer->sums + (size_t)sums->ids[i + REDUCE_AHEAD] * SGSI_PROJECTED_FLOATS, 1);
        sgsi_add_to_primitive(tracer, id, sums->sums + (size_t)i * SGSI_PROJECTED_FLOATS);
    }
}

// Adds the chunk's slots to the primitives of one bucket, cell by cell.
static void reduce_bucket(void *context, size_t bucket, int thread)
{
    const backward_pass *pass = context;
    const sgsi_cells *cells = &pass->view->rays->cells;
    sgsi_cell_sums *sums = &pass->tracer->threads[thread]->cell;
    for (size_t cell = pass->first_cell; cell < pass->last_cell; ++cell) {
        sums->count = 0;
        for (size_t tile = cells->tile_begin[cell]; tile < cells->tile_begin[cell + 1]; ++tile) {
            if (tile + 1 < pass->last_tile)
                prefetch_tile(pass, tile + 1, bucket);
            merge_tile(pass, tile, bucket, sums);
        }
        if (!pass->tracer->has_piece)
            add_cell(pass->tracer, sums);
        else if (!sgsi_records_add(&pass->tracer->records[bucket], sums))
            pass->tracer->threads[thread]->status = SGS_STATUS_OUT_OF_MEMORY;
    }
}

static void choose_buckets(backward_pass *pass)
{
    const size_t count = pass->tracer->count;
    pass->bucket_shift = sgsi_bucket_shift(count);
    pass->bucket_count = count ? ((count - 1) >> pass->bucket_shift) + 1 : 0;
}

// Room for the largest bucket in all threads, so that later views allocate nothing.
static sgs_status reserve_cell_sums(sgsi_tracer *tracer)
{
    const size_t rows =
        tracer->capacity < 1 << SGSI_BUCKET_SHIFT ? tracer->capacity : 1 << SGSI_BUCKET_SHIFT;
    for (int i = 0; i < sgsi_threads(); ++i) {
        sgsi_cell_sums *sums = &tracer->threads[i]->cell;
        if (rows <= sums->capacity)
            continue;
        sgsi_cell_sums_free(sums);
        sums->where = sgsi_calloc(rows, sizeof *sums->where);
        sums->ids = sgsi_calloc(rows, sizeof *sums->ids);
        sums->sums = sgsi_alloc(rows, SGSI_PROJECTED_FLOATS * sizeof *sums->sums);
        if (!sums->where || !sums->ids || !sums->sums)
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                             "not enough memory to add the gradients of a view");
        sums->capacity = rows;
    }
    return SGS_STATUS_OK;
}

static sgs_status reserve_buckets(sgsi_tracer *tracer, size_t required)
{
    if (required <= tracer->bucket_capacity)
        return SGS_STATUS_OK;
    if (!sgsi_grow((void **)&tracer->buckets, 0, required, sizeof *tracer->buckets))
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory to sort the gradients of a view");
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
    return tracer->slot_capacity ? SGS_STATUS_OK
                                 : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                             "not enough memory for %zu gradient slots", slots);
}

// Where each tile's slots begin, in the order of the cells.
static void place_slots(const backward_pass *pass)
{
    sgsi_tracer *tracer = pass->tracer;
    const sgsi_cells *cells = &pass->view->rays->cells;
    const size_t first = cells->tile_begin[pass->first_cell],
                 last = cells->tile_begin[pass->end_cell];
    tracer->slot_begin[first] = 0;
    for (size_t i = first; i < last; ++i)
        tracer->slot_begin[i + 1] = tracer->slot_begin[i] + tile_list(pass, i)->count;
}

// Every chunk ends with two waits for the last thread, on its tiles and on its buckets; with many
// threads it is therefore larger. No sum depends on it.
static void size_chunks(backward_pass *pass)
{
    const size_t threads = (size_t)sgsi_threads();
    pass->chunk_slots = threads * THREAD_SLOTS > CHUNK_SLOTS ? threads * THREAD_SLOTS : CHUNK_SLOTS;
    pass->chunk_tiles = threads * THREAD_TILES > CHUNK_TILES ? threads * THREAD_TILES : CHUNK_TILES;
}

// Extends the chunk that begins at first_cell by whole cells.
static void choose_chunk(backward_pass *pass)
{
    const size_t *slot_begin = pass->tracer->slot_begin;
    const sgsi_cells *cells = &pass->view->rays->cells;
    pass->first_tile = cells->tile_begin[pass->first_cell];
    size_t last = pass->first_cell + 1;
    while (last < pass->end_cell &&
           cells->tile_begin[last + 1] - pass->first_tile <= pass->chunk_tiles &&
           slot_begin[cells->tile_begin[last + 1]] - slot_begin[pass->first_tile] <=
               pass->chunk_slots)
        ++last;
    pass->last_cell = last;
    pass->last_tile = cells->tile_begin[last];
}

// For each chunk of cells: sums per (tile, primitive), then per primitive.
static sgs_status run_backward(sgsi_tracer *tracer, backward_pass *pass)
{
    const double start = sgsi_seconds();
    const sgsi_cells *cells = &pass->view->rays->cells;
    double reducing = 0.0;
    pass->first_cell = tracer->has_piece ? tracer->piece.first : 0;
    pass->end_cell = tracer->has_piece ? tracer->piece.last : cells->count;
    memset(tracer->touched, 0, tracer->capacity / SGS_LANES);
    choose_buckets(pass);
    size_chunks(pass);
    const size_t tiles = cells->tiles < pass->chunk_tiles ? cells->tiles : pass->chunk_tiles,
                 own_tiles =
                     cells->tile_begin[pass->end_cell] - cells->tile_begin[pass->first_cell];
    sgs_status status = sgsi_tracer_prepare_threads(tracer);
    if (!status)
        status = reserve_buckets(tracer, tiles * (pass->bucket_count + 2));
    if (!status)
        status = reserve_cell_sums(tracer);
    if (!status && tracer->has_piece)
        status = sgsi_records_begin(tracer, pass->bucket_count);
    if (status)
        return status;
    place_slots(pass);
    for (; pass->first_cell < pass->end_cell; pass->first_cell = pass->last_cell) {
        choose_chunk(pass);
        const size_t slots =
            tracer->slot_begin[pass->last_tile] - tracer->slot_begin[pass->first_tile];
        status = reserve_slots(tracer, slots > pass->chunk_slots ? slots : pass->chunk_slots);
        if (status)
            return status;
        sgsi_parallel_parts(pass->last_tile - pass->first_tile, own_tiles, backward_tile, pass);
        const double reduce_start = sgsi_seconds();
        sgsi_parallel_parts(pass->bucket_count, sgsi_tracer_buckets_max(tracer), reduce_bucket,
                            pass);
        reducing += sgsi_seconds() - reduce_start;
    }
    tracer->seconds.reduce = reducing;
    tracer->seconds.backward = sgsi_seconds() - start - reducing;
    for (int i = 0; i < sgsi_threads(); ++i)
        if (tracer->threads[i]->status)
            return sgsi_fail(tracer->threads[i]->status,
                             "not enough memory for the gradients of a tile");
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
