// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Forward pass of one view. A work item is a macrotile, a square of tiles. Its packet of cone rays
// queries the BVH; the candidates are tested against its tiles and sorted by distance of the mean,
// then by id, so that the result does not depend on the traversal. The kernels then sort and blend
// each tile of the macrotile.
//
// Depth bounds. The distance at which each tile became opaque is remembered from the previous visit
// of the view. Candidates behind it are culled, by the BVH (far of the rays) and by the test
// against the tile, which is exact and independent of the tree. If a pixel of the tile does not
// become opaque in front of the depth bound, the macrotile is gathered again without bounds and the
// tile is redone (fallback gather).

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/radix.h"
#include "rays/rays.h"
#include "trace/tracer_state.h"

sgs_status sgsi_tracer_create(sgsi_tracer **tracer)
{
    *tracer = NULL;
    sgsi_tracer *made = sgsi_calloc(1, sizeof *made);
    if (!made)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the tracer");
    const sgs_status status = sgsi_bvh_create(&made->bvh);
    if (status) {
        sgsi_free(made);
        return status;
    }
    pthread_mutex_init(&made->shared_lock, NULL);
    *tracer = made;
    return SGS_STATUS_OK;
}

void sgsi_cell_sums_free(sgsi_cell_sums *sums)
{
    sgsi_free(sums->where);
    sgsi_free(sums->ids);
    sgsi_free(sums->sums);
    *sums = (sgsi_cell_sums){0};
}

static void free_thread(thread_state *thread)
{
    if (!thread)
        return;
    sgsi_scratch_free(&thread->own);
    sgsi_scratch_free(&thread->shared.scratch);
    sgsi_free(thread->gathered.ids);
    sgsi_cell_sums_free(&thread->cell);
    sgsi_arena_free(&thread->arena);
    sgsi_free(thread);
}

void sgsi_tracer_forget(sgsi_tracer *tracer)
{
    void **const arrays[] = {
        (void **)&tracer->projected,  (void **)&tracer->bounds,    (void **)&tracer->sums,
        (void **)&tracer->touched,    (void **)&tracer->visible,   (void **)&tracer->rows,
        (void **)&tracer->slot_order, (void **)&tracer->slot_sums, (void **)&tracer->fold_order};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; ++i) {
        sgsi_free(*arrays[i]);
        *arrays[i] = NULL;
    }
    sgsi_records_free(tracer);
    tracer->capacity = tracer->count = tracer->built_count = 0;
    tracer->row_capacity = tracer->slot_capacity = tracer->fold_capacity = 0;
}

void sgsi_tracer_destroy(sgsi_tracer *tracer)
{
    if (!tracer)
        return;
    for (int i = 0; i < MAX_THREADS; ++i)
        free_thread(tracer->threads[i]);
    pthread_mutex_destroy(&tracer->shared_lock);
    sgsi_bvh_destroy(tracer->bvh);
    sgsi_tracer_forget(tracer);
    void *const arrays[] = {tracer->lists, tracer->slot_begin, tracer->buckets, tracer->macrotiles};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; ++i)
        sgsi_free(arrays[i]);
    sgsi_free(tracer);
}

// List memory for the whole view for every thread. If that is too much, none reserves: the address
// space of some would be missing to the others, and arenas grow on demand.
static void reserve_arenas(sgsi_tracer *tracer)
{
    bool reserved = true;
    for (int i = 0; i < sgsi_threads(); ++i)
        reserved = reserved && sgsi_arena_reserve(&tracer->threads[i]->arena, tracer->list_words);
    for (int i = 0; i < sgsi_threads() && !reserved; ++i)
        sgsi_arena_free(&tracer->threads[i]->arena);
}

// Macrotiles are scheduled dynamically, and one thread may process all of them. Every thread
// therefore gets the capacities of the largest, and list memory for the whole view. Later passes
// over the same views then allocate nothing. Without enough memory for that, threads allocate what
// they use.
static void equalize_threads(sgsi_tracer *tracer)
{
    size_t rows = 0, gathered = 0, words = 0;
    for (int i = 0; i < sgsi_threads(); ++i) {
        const thread_state *state = tracer->threads[i];
        rows = state->own.capacity > rows ? state->own.capacity : rows;
        gathered = state->gathered.capacity > gathered ? state->gathered.capacity : gathered;
        words += sgsi_arena_used(&state->arena);
    }
    if (words > tracer->list_words)
        tracer->list_words = words + words / 4;
    reserve_arenas(tracer);
    for (int i = 0; i < sgsi_threads(); ++i) {
        thread_state *state = tracer->threads[i];
        if (sgsi_scratch_grow(&state->own, rows) && gathered > state->gathered.capacity &&
            sgsi_grow((void **)&state->gathered.ids, 0, gathered, sizeof *state->gathered.ids))
            state->gathered.capacity = gathered;
    }
}

// Frees what a pass with very many candidates per macrotile left.
static void trim_threads(sgsi_tracer *tracer)
{
    sgsi_large_scratches_trim(tracer);
    for (int i = 0; i < sgsi_threads(); ++i) {
        sgsi_gather_list *gathered = &tracer->threads[i]->gathered;
        if (gathered->capacity <= SGSI_OWN_IDS)
            continue;
        sgsi_free(gathered->ids);
        *gathered = (sgsi_gather_list){0};
    }
}

sgs_status sgsi_tracer_prepare_threads(sgsi_tracer *tracer)
{
    for (int i = 0; i < sgsi_threads(); ++i) {
        if (!tracer->threads[i])
            tracer->threads[i] = sgsi_calloc(1, sizeof *tracer->threads[i]);
        if (!tracer->threads[i])
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                             "not enough memory for the tracer's threads");
        tracer->threads[i]->scratch = &tracer->threads[i]->own;
        tracer->threads[i]->status = SGS_STATUS_OK;
    }
    return SGS_STATUS_OK;
}

static sgs_status reserve_primitives(sgsi_tracer *tracer, size_t capacity)
{
    if (capacity <= tracer->capacity)
        return SGS_STATUS_OK;
    const size_t row = SGSI_PROJECTED_FLOATS * sizeof(float), blocks = capacity / SGS_LANES + 1;
    const struct {
        void **block;
        size_t count, size;
    } arrays[] = {{(void **)&tracer->projected, capacity, row},
                  {(void **)&tracer->bounds, capacity, sizeof *tracer->bounds},
                  {(void **)&tracer->sums, capacity, row},
                  {(void **)&tracer->touched, blocks, sizeof *tracer->touched},
                  {(void **)&tracer->visible, blocks, sizeof *tracer->visible}};
    bool complete = true;
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; ++i) {
        sgsi_free(*arrays[i].block);
        *arrays[i].block = sgsi_alloc(arrays[i].count, arrays[i].size);
        complete = complete && *arrays[i].block;
    }
    tracer->built_count = 0;
    tracer->capacity = capacity;
    if (complete) {
        memset(tracer->touched, 0, blocks * sizeof *tracer->touched);
        memset(tracer->visible, 0, blocks * sizeof *tracer->visible);
        return SGS_STATUS_OK;
    }
    tracer->capacity = 0;
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to trace %zu primitives",
                     capacity);
}

sgs_status sgsi_render_options_check(const sgs_render_options *options)
{
    if (options->filter != SGS_FILTER_3DGS && options->filter != SGS_FILTER_NONE &&
        options->filter != SGS_FILTER_MIP)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "unknown pixel filter %d",
                         (int)options->filter);
    if (options->sh_degree < 0 || options->sh_degree > 3 || !(options->near_distance >= 0.0))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "SH degree %d or near distance %g is out of range", options->sh_degree,
                         options->near_distance);
    if (!(options->compact_box > 0.0 && options->compact_box <= 1.0))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "compact box %g is not in (0, 1]",
                         options->compact_box);
    return SGS_STATUS_OK;
}

void sgsi_view_set(sgsi_view *view, const sgsi_rays *rays, const sgs_pose *pose,
                   const sgs_render_options *options)
{
    double center[3];
    const float pixel = options->filter == SGS_FILTER_3DGS  ? 0.3f
                        : options->filter == SGS_FILTER_MIP ? 0.1f
                                                            : 0.0f;
    sgs_pose exact = *pose;
    sgs_pose_orthonormalize(&exact);
    sgs_pose_center(&exact, center);
    *view = (sgsi_view){.rays = rays,
                        .near_distance = (float)options->near_distance + 0.0f, // no -0
                        .dilation = pixel / (rays->focal * rays->focal),
                        .mip = options->filter == SGS_FILTER_MIP,
                        .filter_3d = options->filter == SGS_FILTER_MIP ? options->filter_3d : NULL,
                        .sh_degree = options->sh_degree,
                        .compact_box = (float)options->compact_box};
    for (int k = 0; k < 9; ++k)
        view->rotation[k] = (float)exact.rotation[k];
    for (int k = 0; k < 3; ++k) {
        view->center[k] = (float)center[k];
        const volatile float rounded = view->center[k]; // GCC 12 takes (double)(float)x for x
        view->center_low[k] = (float)(center[k] - (double)rounded);
    }
}

sgs_status sgsi_tracer_receive(sgsi_tracer *tracer, size_t count, sgsi_received *received)
{
    const size_t larger = count + count / 4 + SGS_LANES;
    if (count + SGS_LANES > tracer->capacity) {
        const sgs_status status = reserve_primitives(tracer, larger);
        if (status)
            return status;
    }
    if (count > tracer->row_capacity) {
        if (!sgsi_grow((void **)&tracer->rows, 0, larger, sizeof *tracer->rows))
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                             "not enough memory to receive %zu primitives", count);
        tracer->row_capacity = larger;
    }
    tracer->count = count;
    tracer->received = true;
    *received = (sgsi_received){tracer->projected, tracer->bounds, tracer->rows};
    return SGS_STATUS_OK;
}

static void project_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    sgsi_kernels_get()->project(context, begin, end);
}

sgs_status sgsi_tracer_project(sgsi_tracer *tracer, const sgs_gaussians *model,
                               const sgsi_view *view, uint32_t *visible_count, float *radius_max)
{
    const double start = sgsi_seconds();
    for (int k = 0; k < 3; ++k)
        if (!(fabs((double)view->center[k]) < SGSI_FARTHEST_CAMERA))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                             "camera position %g on axis %d is out of range",
                             (double)view->center[k], k);
    const sgs_status status = reserve_primitives(tracer, model->capacity);
    if (status)
        return status;
    tracer->count = model->count;
    tracer->received = false;
    sgsi_project input = {.params = model->data,
                          .count = model->count,
                          .view = *view,
                          .projected = tracer->projected,
                          .bounds = tracer->bounds,
                          .visible_count = visible_count,
                          .radius_max = radius_max,
                          .visible = tracer->visible};
    input.view.linear_opacity = model->linear_opacity;
    sgsi_parallel_ranges((model->count + SGS_LANES - 1) / SGS_LANES, 32, project_range, &input);
    tracer->seconds.project = sgsi_seconds() - start;
    return SGS_STATUS_OK;
}

sgs_status sgsi_tracer_commit(sgsi_tracer *tracer, bool rebuild, sgsi_bvh_quality quality)
{
    const double start = sgsi_seconds();
    tracer->seconds.bvh_build = tracer->seconds.bvh_refit = 0.0;
    rebuild = rebuild || tracer->built_count != tracer->count || !tracer->count;
    const sgs_status status =
        rebuild ? sgsi_bvh_build(tracer->bvh, tracer->bounds, tracer->count, quality)
                : sgsi_bvh_refit(tracer->bvh);
    tracer->built_count = status ? 0 : tracer->count; // after a failure only a build may follow
    if (status)
        return status;
    *(rebuild ? &tracer->seconds.bvh_build : &tracer->seconds.bvh_refit) = sgsi_seconds() - start;
    return SGS_STATUS_OK;
}

typedef struct forward_pass {
    sgsi_tracer *tracer;
    const sgsi_view *view;
    sgsi_planes *planes;
    float *depth_bound;
    bool keep_lists;
    size_t first_macrotile;
} forward_pass;

// The tiles of a macrotile, their numbers in the image and their depth bounds.
static sgsi_macrotile open_macrotile(const forward_pass *pass, int macrotile,
                                     int numbers[SGSI_MACROTILE_SIDE * SGSI_MACROTILE_SIDE])
{
    const sgsi_rays *rays = pass->view->rays;
    sgsi_macrotile tiles = {.compact_box = pass->view->compact_box};
    for (int k = 0; k < rays->macrotile_side * rays->macrotile_side; ++k) {
        const int tile = sgsi_macrotile_tile(rays, macrotile, k);
        if (tile < 0)
            continue;
        numbers[tiles.count] = tile;
        tiles.tiles[tiles.count] = &rays->tiles[tile];
        tiles.far[tiles.count++] = pass->depth_bound ? pass->depth_bound[tile] : INFINITY;
    }
    return tiles;
}

// Sorts candidates of equal distance by their row in the model, which is the id unless the
// primitives are received; the keys become (row, index).
static void sort_by_row(const sgsi_scratch *s, const uint32_t *rows, uint64_t *keys,
                        uint64_t *spare, size_t count)
{
    enum { FEW = 32 };
    for (size_t i = 0; i < count; ++i) {
        const uint32_t id = s->macrotile_ids[(uint32_t)keys[i]];
        keys[i] = (uint64_t)(rows ? rows[id] : id) << 32 | (uint32_t)keys[i];
    }
    if (count > FEW)
        sgsi_radix_sort_exact(keys, spare, count);
    else
        sgsi_insertion_sort(keys, count, SIZE_MAX);
}

// Sorts the candidates of a macrotile by distance, then by row, and removes duplicates: if the rays
// of a packet diverge, Embree traverses them separately and reports a primitive more than once.
// Returns the number left.
static size_t order_macrotile(thread_state *state, const uint32_t *rows, size_t count)
{
    sgsi_scratch *s = state->scratch;
    uint64_t *keys = s->sort_spare, *spare = keys + s->capacity; // not in use yet
    uint32_t min_bits = UINT32_MAX, max_bits = 0;
    for (size_t i = 0; i < count; ++i) {
        const uint32_t bits = s->macrotile_distance[i];
        keys[i] = (uint64_t)bits << 32 | i;
        min_bits = bits < min_bits ? bits : min_bits;
        max_bits = bits > max_bits ? bits : max_bits;
    }
    sgsi_sort_keys(keys, spare, count, min_bits, max_bits);
    size_t unique = 0, end = 0;
    for (size_t begin = 0; begin < count; begin = end) {
        for (end = begin + 1; end < count && keys[end] >> 32 == keys[begin] >> 32;)
            ++end;
        if (end - begin > 1)
            sort_by_row(s, rows, keys + begin, spare, end - begin);
        for (size_t i = begin; i < end; ++i)
            if (i == begin || keys[i] >> 32 != keys[i - 1] >> 32)
                s->macrotile_order[unique++] = (uint32_t)keys[i];
    }
    return unique;
}

sgsi_packet sgsi_macrotile_packet(const sgsi_view *view, int macrotile, float far)
{
    const sgsi_rays *rays = view->rays;
    // The padding of the bounds covers the rounding of the origin.
    sgsi_packet packet = {.origin = {view->center[0], view->center[1], view->center[2]},
                          .valid = rays->macrotile_valid[macrotile]};
    for (int i = 0; i < 16; ++i) {
        for (int k = 0; k < 3; ++k) // camera to world
            packet.direction[k][i] =
                view->rotation[k] * rays->macrotile_directions[macrotile][0][i] +
                view->rotation[3 + k] * rays->macrotile_directions[macrotile][1][i] +
                view->rotation[6 + k] * rays->macrotile_directions[macrotile][2][i];
        packet.far[i] = far;
    }
    return packet;
}

// Queries the BVH for the candidates of a macrotile, filters and sorts them. Returns their number,
// or sets state->status.
static size_t gather_macrotile(const forward_pass *pass, thread_state *state, int macrotile,
                               const sgsi_macrotile *tiles)
{
    float far = tiles->complete ? INFINITY : 0.0f;
    for (int k = 0; k < tiles->count; ++k)
        far = fmaxf(far, tiles->far[k]);
    const sgsi_packet packet =
        sgsi_macrotile_packet(pass->view, macrotile, far * SGSI_DEPTH_MARGIN);
    state->gathered.count = 0;
    // The traversal prefetches these rows.
    state->gathered.rows = pass->tracer->projected;
    state->gathered.row_bytes = SGSI_PROJECTED_FLOATS * sizeof(float);
    state->status = sgsi_bvh_gather(pass->tracer->bvh, &packet, &state->gathered);
    const size_t gathered = state->gathered.count;
    state->counts.callbacks += gathered;
    if (!state->status && !sgsi_thread_reserve(pass->tracer, state, gathered + 16))
        state->status =
            sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                      "not enough memory for the %zu candidates of a macrotile", gathered);
    if (state->status)
        return 0;
    const size_t kept = sgsi_kernels_get()->macrotile_filter(
        state->scratch, pass->tracer->projected, state->gathered.ids, gathered, tiles);
    const uint32_t *rows = pass->tracer->received ? pass->tracer->rows : NULL;
    const size_t count = order_macrotile(state, rows, kept);
    state->counts.gathered += count;
    return count;
}

// Number of different primitives among those that the BVH reported.
static uint64_t count_distinct(thread_state *state)
{
    const sgsi_gather_list *list = &state->gathered;
    uint64_t *keys = state->scratch->sort_spare, *spare = keys + state->scratch->capacity;
    uint32_t max = 0;
    uint64_t distinct = 0;
    for (size_t i = 0; i < list->count; ++i) {
        keys[i] = (uint64_t)list->ids[i] << 32;
        max = list->ids[i] > max ? list->ids[i] : max;
    }
    sgsi_sort_keys(keys, spare, list->count, 0, max);
    for (size_t i = 0; i < list->count; ++i)
        distinct += !i || keys[i] != keys[i - 1];
    return distinct;
}

static double pass_seconds(const sgsi_tracer *tracer)
{
    return tracer->profiled ? sgsi_thread_seconds() : sgsi_seconds();
}

// Removes the primitives of a tile that are in no block list. Returns the number left; map[count]
// receives their new indices.
static size_t compact_tile(sgsi_scratch *s, size_t count, uint32_t *map)
{
    memset(map, 0, count * sizeof *map);
    for (int b = 0; b < SGSI_BLOCKS; ++b)
        for (uint32_t i = 0; i < s->entry_count[b]; ++i)
            map[s->order[(size_t)b * s->capacity + i]] = 1;
    size_t kept = 0;
    for (size_t i = 0; i < count; ++i) {
        const uint32_t marked = map[i]; // too hard to predict for a branch
        s->tile_ids[kept] = s->tile_ids[i];
        map[i] = (uint32_t)kept;
        kept += marked;
    }
    return kept;
}

static void keep_list(thread_state *state, sgsi_tile_list *list, size_t count)
{
    sgsi_scratch *s = state->scratch;
    uint32_t *map = s->entries; // free after the blocks are sorted
    count = compact_tile(s, count, map);
    size_t block_hits = 0;
    for (int b = 0; b < SGSI_BLOCKS; ++b) {
        list->block_begin[b] = (uint32_t)block_hits;
        block_hits += s->entry_count[b];
    }
    list->block_begin[SGSI_BLOCKS] = (uint32_t)block_hits;
    list->count = (uint32_t)count;
    uint32_t *words = sgsi_arena_take(&state->arena, count + block_hits);
    if (!words) {
        list->count = 0;
        state->status =
            sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the lists of a tile");
        return;
    }
    list->ids = words;
    list->block_hits = words + count;
    memcpy(list->ids, s->tile_ids, count * sizeof *words);
    for (int b = 0; b < SGSI_BLOCKS; ++b) {
        const uint32_t *order = s->order + (size_t)b * s->capacity;
        for (uint32_t i = 0; i < s->entry_count[b]; ++i)
            list->block_hits[list->block_begin[b] + i] = map[order[i]];
    }
}

static void store_candidates(const sgsi_planes *planes, const sgsi_tile_rays *rays, size_t count)
{
    const int right = rays->x + SGSI_TILE < planes->width ? rays->x + SGSI_TILE : planes->width;
    for (int y = rays->y; y < rays->y + SGSI_TILE && y < planes->height; ++y)
        for (int x = rays->x; x < right; ++x)
            planes->candidates[(size_t)y * planes->stride + (size_t)x] = (float)count;
}

// Blends tile k of the macrotile, number `tile` of the image, from the candidates in front of its
// depth bound or from all. Returns false if the depth bound was too near.
static bool blend_tile(const forward_pass *pass, thread_state *state,
                       const sgsi_macrotile *macrotile, int k, int tile, size_t candidates,
                       bool everything)
{
    const sgsi_kernels *kernels = sgsi_kernels_get();
    const sgsi_tile_rays *rays = macrotile->tiles[k];
    const sgsi_planes *planes = pass->planes;
    const float far = everything ? INFINITY : macrotile->far[k];
    sgsi_tile_cost *cost = pass->tracer->costs ? &pass->tracer->costs[tile] : NULL;
    const double start = cost ? pass_seconds(pass->tracer) : 0.0;
    const size_t count = kernels->tile_take(state->scratch, candidates,
                                            (everything ? SGSI_OVERLAPS : SGSI_IN_BOUND) << k);
    kernels->tile_sort(state->scratch, rays, count);
    sgsi_tile_target target = {.rays = rays,
                               .width = planes->width,
                               .height = planes->height,
                               .stride = planes->stride,
                               .color = {planes->color[0], planes->color[1], planes->color[2]},
                               .transmittance = planes->transmittance,
                               .depth_mean = planes->depth_mean,
                               .depth_median = planes->depth_median,
                               .depth_first = planes->depth_first,
                               .hits = planes->hits,
                               .aov = planes->aov,
                               .near_distance = pass->view->near_distance};
    kernels->tile_forward(state->scratch, &target);
    if (!(target.stop_distance <= far))
        return false;
    if (pass->depth_bound)
        pass->depth_bound[tile] = target.stop_distance * 1.05f;
    if (cost)
        *cost = (sgsi_tile_cost){(float)(pass_seconds(pass->tracer) - start), (uint32_t)count,
                                 (uint32_t)target.evaluations};
    if (planes->candidates)
        store_candidates(planes, rays, count);
    state->counts.candidates += count;
    state->counts.evaluations += target.evaluations;
    for (int b = 0; b < SGSI_BLOCKS; ++b)
        state->counts.block_hits += state->scratch->entry_count[b];
    if (pass->keep_lists)
        keep_list(state, &pass->tracer->lists[tile], count);
    return true;
}

static void forward_macrotile(void *context, size_t item, int thread)
{
    const forward_pass *pass = context;
    thread_state *state = pass->tracer->threads[thread];
    const int macrotile = (int)(pass->tracer->has_piece ? pass->tracer->macrotiles[item]
                                                        : pass->first_macrotile + item);
    if (state->status)
        return;
    const double start = pass_seconds(pass->tracer);
    int numbers[SGSI_MACROTILE_SIDE * SGSI_MACROTILE_SIDE];
    sgsi_macrotile tiles = open_macrotile(pass, macrotile, numbers);
    size_t candidates = gather_macrotile(pass, state, macrotile, &tiles);
    const double gathered = pass_seconds(pass->tracer);
    if (pass->tracer->profiled && !state->status)
        state->counts.distinct += count_distinct(state);
    const double blended = pass->tracer->profiled ? pass_seconds(pass->tracer) : gathered;
    double again = 0.0;
    for (int k = 0; k < tiles.count && !state->status; ++k) {
        if (blend_tile(pass, state, &tiles, k, numbers[k], candidates, false))
            continue;
        if (!tiles.complete) {
            const double back = pass_seconds(pass->tracer);
            tiles.complete = true;
            candidates = gather_macrotile(pass, state, macrotile, &tiles);
            ++state->counts.fallback_gathers;
            again += pass_seconds(pass->tracer) - back;
        }
        if (!state->status)
            blend_tile(pass, state, &tiles, k, numbers[k], candidates, true);
    }
    sgsi_thread_release(pass->tracer, state);
    state->gather_seconds += gathered - start + again;
    state->blend_seconds += pass_seconds(pass->tracer) - blended - again;
}

static sgs_status reserve_lists(sgsi_tracer *tracer, size_t tiles)
{
    if (tiles <= tracer->list_capacity)
        return SGS_STATUS_OK;
    sgsi_free(tracer->lists);
    sgsi_free(tracer->slot_begin);
    sgsi_free(tracer->macrotiles);
    tracer->macrotiles = sgsi_alloc(tiles, sizeof *tracer->macrotiles);
    tracer->lists = sgsi_calloc(tiles, sizeof *tracer->lists);
    tracer->slot_begin = sgsi_calloc(tiles + 1, sizeof *tracer->slot_begin);
    tracer->list_capacity = tracer->lists && tracer->slot_begin && tracer->macrotiles ? tiles : 0;
    return tracer->list_capacity ? SGS_STATUS_OK
                                 : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                             "not enough memory for the lists of %zu tiles", tiles);
}

static sgs_status collect_threads(sgsi_tracer *tracer, double wall, double *gather, double *blend)
{
    double gather_seconds = 0.0, blend_seconds = 0.0;
    sgs_status status = SGS_STATUS_OK;
    for (int i = 0; i < sgsi_threads(); ++i) {
        thread_state *state = tracer->threads[i];
        gather_seconds += state->gather_seconds;
        blend_seconds += state->blend_seconds;
        tracer->counts.callbacks += state->counts.callbacks;
        tracer->counts.distinct += state->counts.distinct;
        tracer->counts.gathered += state->counts.gathered;
        tracer->counts.candidates += state->counts.candidates;
        tracer->counts.evaluations += state->counts.evaluations;
        tracer->counts.block_hits += state->counts.block_hits;
        tracer->counts.fallback_gathers += state->counts.fallback_gathers;
        status = status ? status : state->status;
    }
    const double total = gather_seconds + blend_seconds;
    *gather = total > 0.0 ? wall * gather_seconds / total : 0.0;
    *blend = wall - *gather;
    tracer->seconds.gather_cpu = tracer->profiled ? gather_seconds : 0.0;
    tracer->seconds.forward_cpu = tracer->profiled ? blend_seconds : 0.0;
    return status == SGS_STATUS_OUT_OF_MEMORY
               ? sgsi_fail(status, "not enough memory for the candidates of a tile")
               : status;
}

// Lists the macrotiles of the piece; a cell consists of whole macrotiles. Empties the lists of the
// other tiles. Returns the number of macrotiles.
static size_t list_piece(sgsi_tracer *tracer, const sgsi_rays *rays)
{
    const sgsi_cells *cells = &rays->cells;
    size_t count = 0;
    for (size_t i = 0; i < cells->tiles; ++i)
        tracer->lists[i] = (sgsi_tile_list){0};
    for (size_t i = cells->tile_begin[tracer->piece.first];
         i < cells->tile_begin[tracer->piece.last]; ++i) {
        const int x = (int)cells->tile_order[i] % rays->tiles_x,
                  y = (int)cells->tile_order[i] / rays->tiles_x;
        if (x % rays->macrotile_side == 0 && y % rays->macrotile_side == 0)
            tracer->macrotiles[count++] = (uint32_t)(y / rays->macrotile_side * rays->macrotiles_x +
                                                     x / rays->macrotile_side);
    }
    return count;
}

static sgs_status forward_macrotiles(sgsi_tracer *tracer, forward_pass *pass,
                                     size_t macrotile_count)
{
    const double start = sgsi_seconds();
    const sgsi_rays *rays = pass->view->rays;
    sgs_status status = sgsi_tracer_prepare_threads(tracer);
    if (!status)
        status = reserve_lists(tracer, (size_t)rays->tiles_x * (size_t)rays->tiles_y);
    if (status)
        return status;
    equalize_threads(tracer);
    if (tracer->has_piece)
        macrotile_count = list_piece(tracer, rays);
    tracer->counts = (sgsi_trace_counts){0};
    for (int i = 0; i < sgsi_threads(); ++i) {
        thread_state *state = tracer->threads[i];
        state->gather_seconds = state->blend_seconds = 0.0;
        state->counts = (sgsi_trace_counts){0};
    }
    sgsi_parallel_for(macrotile_count, 1, forward_macrotile, pass);
    trim_threads(tracer);
    return collect_threads(tracer, sgsi_seconds() - start, &tracer->seconds.gather,
                           &tracer->seconds.forward);
}

sgs_status sgsi_tracer_forward(sgsi_tracer *tracer, const sgsi_view *view, sgsi_planes *planes,
                               float *depth_bound, bool keep_lists)
{
    forward_pass pass = {tracer, view, planes, depth_bound, keep_lists, 0};
    return forward_macrotiles(tracer, &pass,
                              (size_t)view->rays->macrotiles_x * (size_t)view->rays->macrotiles_y);
}

sgs_status sgsi_tracer_forward_rows(sgsi_tracer *tracer, const sgsi_view *view, sgsi_planes *planes,
                                    int first, int last)
{
    const sgsi_rays *rays = view->rays;
    const size_t macrotiles_x = (size_t)rays->macrotiles_x,
                 first_row = (size_t)(first / rays->macrotile_side);
    const size_t last_row = (size_t)((last + rays->macrotile_side - 1) / rays->macrotile_side);
    forward_pass pass = {tracer, view, planes, NULL, false, first_row * macrotiles_x};
    return forward_macrotiles(tracer, &pass, (last_row - first_row) * macrotiles_x);
}

void sgsi_tracer_watch_tiles(sgsi_tracer *tracer, sgsi_tile_cost *costs)
{
    tracer->costs = costs;
}

void sgsi_tracer_set_profiled(sgsi_tracer *tracer, bool profiled)
{
    tracer->profiled = profiled;
}

void sgsi_tracer_collect_abs_grad(sgsi_tracer *tracer, bool wanted)
{
    tracer->abs_grad = wanted;
}

const float *sgsi_tracer_grad_sums(const sgsi_tracer *tracer)
{
    return tracer->sums;
}

const uint8_t *sgsi_tracer_touched(const sgsi_tracer *tracer)
{
    return tracer->touched;
}

const uint16_t *sgsi_tracer_visible(const sgsi_tracer *tracer)
{
    return tracer->visible;
}

const sgsi_bounds *sgsi_tracer_bounds(const sgsi_tracer *tracer)
{
    return tracer->bounds;
}

const float *sgsi_tracer_projected(const sgsi_tracer *tracer)
{
    return tracer->projected;
}

sgsi_trace_seconds sgsi_tracer_seconds(const sgsi_tracer *tracer)
{
    return tracer->seconds;
}

sgsi_trace_counts sgsi_tracer_counts(const sgsi_tracer *tracer)
{
    return tracer->counts;
}

const sgsi_tile_list *sgsi_tracer_lists(const sgsi_tracer *tracer)
{
    return tracer->lists;
}
