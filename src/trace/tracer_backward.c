// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Backward pass. It visits the tiles of the forward pass through their lists and writes one slot, a
// cache line of gradient sums, per (tile, primitive). The slots are then added per primitive: the
// tiles of a cell of the image in raster order, and the sums of the cells in the order of their
// curve (base/image_cells.h). The result depends neither on the number of threads nor on a division
// of the curve. Primitives are divided into buckets, and each tile sorts its slots by bucket, so
// that a thread reduces whole buckets without reading other slots. Tiles are processed in chunks
// whose slots fit in the caches.
//
// A primitive is mostly seen by one cell. `sums` holds the sums of the present cell; when another
// cell reaches the primitive they move to `earlier`, which is added at the end.

#include <string.h>

#include "base/core.h"
#include "trace/tracer_state.h"

enum { CHUNK_SLOTS = 1 << 18, CHUNK_TILES = 1 << 12, REDUCE_AHEAD = 12, BUCKETS_PER_THREAD = 4 };
#define NO_CELL UINT32_MAX

typedef struct backward_pass {
    sgsi_tracer *tracer;
    const sgsi_view *view;
    const sgsi_planes *planes;
    const float *d_color[3], *d_transmittance;
    const sgsi_score_planes *score; // replaces the gradients, or NULL
    size_t first_tile, last_tile;   // chunk [first_tile, last_tile) of rays->cells.tile_order
    size_t first_cell;              // the cell of first_tile
    bool is_last;                   // no chunk follows
    int bucket_shift;               // bucket of primitive id: id >> bucket_shift
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
    sgsi_scratch *s = &state->scratch;
    if (!sgsi_scratch_reserve(s, list->count + 16)) {
        state->status = SGS_STATUS_OUT_OF_MEMORY;
        return;
    }
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
}

static void add_sums(float *sums, const float *added)
{
    for (int k = 0; k < SGSI_PROJECTED_FLOATS; ++k)
        sums[k] += added[k];
}

// First gradient of a block of primitives in this pass.
static void open_block(sgsi_tracer *tracer, size_t block)
{
    tracer->touched[block] = 1;
    tracer->spread[block] = 0;
    for (size_t i = 0; i < SGS_LANES; ++i)
        tracer->cell[block * SGS_LANES + i] = NO_CELL;
    memset(tracer->sums + block * SGS_LANES * SGSI_PROJECTED_FLOATS, 0,
           SGS_LANES * SGSI_PROJECTED_FLOATS * sizeof(float));
}

// Moves the sums of a finished cell to those of earlier cells.
static void set_aside(sgsi_tracer *tracer, uint32_t id)
{
    float *sums = tracer->sums + (size_t)id * SGSI_PROJECTED_FLOATS;
    float *earlier = tracer->earlier + (size_t)id * SGSI_PROJECTED_FLOATS;
    const uint16_t lane = (uint16_t)(1u << id % SGS_LANES);
    if (tracer->spread[id / SGS_LANES] & lane)
        add_sums(earlier, sums);
    else
        memcpy(earlier, sums, SGSI_PROJECTED_FLOATS * sizeof *sums);
    tracer->spread[id / SGS_LANES] |= lane;
    memset(sums, 0, SGSI_PROJECTED_FLOATS * sizeof *sums);
}

// Adds the sums of the last cell of each primitive to those of earlier cells.
static void finish_bucket(const backward_pass *pass, size_t bucket)
{
    sgsi_tracer *tracer = pass->tracer;
    const size_t blocks = (tracer->count + SGS_LANES - 1) / SGS_LANES,
                 per_bucket = ((size_t)1 << pass->bucket_shift) / SGS_LANES;
    const size_t end = (bucket + 1) * per_bucket < blocks ? (bucket + 1) * per_bucket : blocks;
    for (size_t block = bucket * per_bucket; block < end; ++block) {
        if (!tracer->touched[block] || !tracer->spread[block])
            continue;
        for (size_t i = 0; i < SGS_LANES; ++i) {
            if (!(tracer->spread[block] >> i & 1))
                continue;
            const size_t at = (block * SGS_LANES + i) * SGSI_PROJECTED_FLOATS;
            add_sums(tracer->sums + at, tracer->earlier + at);
        }
    }
}

// Adds the slots of one tile to the primitives of one bucket.
static void reduce_tile(const backward_pass *pass, size_t tile, size_t bucket, uint32_t cell)
{
    sgsi_tracer *tracer = pass->tracer;
    const uint32_t *begin = tile_buckets(pass, tile) + bucket, *ids = tile_list(pass, tile)->ids;
    const size_t slot = tracer->slot_begin[tile] - tracer->slot_begin[pass->first_tile];
    const uint32_t *order = tracer->slot_order + slot;
    for (uint32_t i = begin[0]; i < begin[1]; ++i) {
        const uint32_t id = ids[order[i]];
        if (i + REDUCE_AHEAD < begin[1]) {
            const uint32_t ahead = order[i + REDUCE_AHEAD];
            __builtin_prefetch(tracer->sums + (size_t)ids[ahead] * SGSI_PROJECTED_FLOATS, 1);
            __builtin_prefetch(tracer->cell + ids[ahead], 1);
            __builtin_prefetch(tracer->slot_sums + (slot + ahead) * SGSI_PROJECTED_FLOATS);
        }
        if (!tracer->touched[id / SGS_LANES])
            open_block(tracer, id / SGS_LANES);
        if (tracer->cell[id] != cell) {
            if (tracer->cell[id] != NO_CELL)
                set_aside(tracer, id);
            tracer->cell[id] = cell;
        }
        add_sums(tracer->sums + (size_t)id * SGSI_PROJECTED_FLOATS,
                 tracer->slot_sums + (slot + order[i]) * SGSI_PROJECTED_FLOATS);
    }
}

// Adds the chunk's slots to the primitives of one bucket.
static void reduce_bucket(void *context, size_t bucket, int thread)
{
    (void)thread;
    const backward_pass *pass = context;
    const sgsi_cells *cells = &pass->view->rays->cells;
    size_t cell = pass->first_cell;
    for (size_t tile = pass->first_tile; tile < pass->last_tile; ++tile) {
        while (tile >= cells->tile_begin[cell + 1])
            ++cell;
        reduce_tile(pass, tile, bucket, (uint32_t)cell);
    }
    if (pass->is_last)
        finish_bucket(pass, bucket);
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
    const sgsi_cells *cells = &pass->view->rays->cells;
    const size_t tiles = cells->tiles;
    double reducing = 0.0;
    memset(tracer->touched, 0, tracer->capacity / SGS_LANES);
    choose_buckets(pass);
    const sgs_status reserved = reserve_buckets(
        tracer, (tiles < CHUNK_TILES ? tiles : CHUNK_TILES) * (pass->bucket_count + 2));
    if (reserved)
        return reserved;
    tracer->slot_begin[0] = 0;
    for (size_t i = 0; i < tiles; ++i)
        tracer->slot_begin[i + 1] = tracer->slot_begin[i] + tile_list(pass, i)->count;
    for (size_t first = 0; first < tiles; first = pass->last_tile) {
        size_t last = first + 1;
        while (last < tiles && last - first < CHUNK_TILES &&
               tracer->slot_begin[last + 1] - tracer->slot_begin[first] <= CHUNK_SLOTS)
            ++last;
        pass->first_tile = first;
        pass->last_tile = last;
        pass->is_last = last == tiles;
        while (first >= cells->tile_begin[pass->first_cell + 1])
            ++pass->first_cell;
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
