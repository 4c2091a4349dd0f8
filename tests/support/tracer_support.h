// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A model traced by the tracer, and by the same kernels without a BVH: every primitive is a
// candidate of every tile, in the tracer's order (distance, id). All later steps are the same code,
// so images and lists must agree to the bit. Any difference is a primitive lost by the BVH, its
// bounds or a depth bound. Include after cmocka.h.

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "support/oracle_support.h"
#include "optimize/optimize.h"
#include "rays/rays.h"
#include "sparegs/runtime.h"
#include "base/threads.h"
#include "trace/tracer.h"

enum { TRACED_PLANES = 8 };

// The larger of two errors; NaN is kept.
static inline double traced_worse(double worst, double error)
{
    return isnan(worst) || error <= worst ? worst : error;
}

// ---- Settings ----

// The default instruction set of the machine.
static inline sgs_isa *traced_best_isa(void)
{
    static sgs_isa best;
    return &best;
}

// Group set-up: one thread.
static inline int traced_prepare(void **state)
{
    (void)state;
    *traced_best_isa() = sgs_isa_get();
    sgsi_threads_set(1);
    return 0;
}

// Tear-down of tests that change the settings.
static inline int traced_restore(void **state)
{
    (void)state;
    sgsi_threads_set(1);
    return sgs_isa_set(*traced_best_isa()) != SGS_STATUS_OK;
}

// ---- Images ----

// Planes filled with a sentinel, to detect unwritten pixels and writes to the padding.
#define TRACED_SENTINEL (-12345.5f)

static inline sgsi_planes traced_planes_create(int width, int height)
{
    const size_t stride = ((size_t)width + 15) / 16 * 16, floats = stride * (size_t)height;
    float *block = sgsi_alloc(floats, TRACED_PLANES * sizeof *block);
    assert_non_null(block);
    for (size_t i = 0; i < TRACED_PLANES * floats; ++i)
        block[i] = TRACED_SENTINEL;
    return (sgsi_planes){.width = width,
                         .height = height,
                         .stride = stride,
                         .color = {block, block + floats, block + 2 * floats},
                         .transmittance = block + 3 * floats,
                         .depth_mean = block + 4 * floats,
                         .depth_median = block + 5 * floats,
                         .depth_first = block + 6 * floats,
                         .hits = block + 7 * floats};
}

static inline void traced_planes_free(sgsi_planes *planes)
{
    sgsi_free(planes->color[0]); // one allocation
    *planes = (sgsi_planes){0};
}

static inline const float *traced_plane(const sgsi_planes *planes, int k)
{
    const float *const all[TRACED_PLANES] = {
        planes->color[0],   planes->color[1],     planes->color[2],    planes->transmittance,
        planes->depth_mean, planes->depth_median, planes->depth_first, planes->hits};
    return all[k];
}

static inline const char *traced_plane_name(int k)
{
    static const char *const names[TRACED_PLANES] = {"red",           "green",      "blue",
                                                     "transmittance", "depth_mean", "depth_median",
                                                     "depth_first",   "hits"};
    return names[k];
}

static inline void traced_assert_same_image(const sgsi_planes *a, const sgsi_planes *b,
                                            const char *what)
{
    for (int k = 0; k < TRACED_PLANES; ++k)
        for (int y = 0; y < a->height; ++y)
            for (size_t x = 0; x < a->stride; ++x) {
                const size_t i = (size_t)y * a->stride + x;
                // NOLINTNEXTLINE(bugprone-suspicious-memory-comparison,cert-*): bits
                if (memcmp(traced_plane(a, k) + i, traced_plane(b, k) + i, sizeof(float)))
                    fail_msg("%s: %s of pixel (%zu, %d) is %.9g, not %.9g", what,
                             traced_plane_name(k), x, y, traced_plane(b, k)[i],
                             traced_plane(a, k)[i]);
            }
}

// Asserts that every pixel has a finite value and the padding is untouched.
static inline void traced_assert_complete(const sgsi_planes *planes)
{
    for (int k = 0; k < TRACED_PLANES; ++k)
        for (int y = 0; y < planes->height; ++y)
            for (size_t x = 0; x < planes->stride; ++x) {
                const float value = traced_plane(planes, k)[(size_t)y * planes->stride + x];
                const bool inside = x < (size_t)planes->width;
                if (inside ? !isfinite(value) || value == TRACED_SENTINEL
                           : value != TRACED_SENTINEL)
                    fail_msg("%s of pixel (%zu, %d) is %g", traced_plane_name(k), x, y, value);
            }
}

// ---- Lists: primitive ids of every block of every tile, in the block's order ----

typedef struct traced_lists {
    size_t blocks; // tiles * SGSI_BLOCKS
    size_t *begin; // [blocks + 1]
    uint32_t *ids;
    size_t capacity;
} traced_lists;

static inline void traced_lists_free(traced_lists *lists)
{
    free(lists->begin);
    free(lists->ids);
    *lists = (traced_lists){0};
}

static inline void traced_lists_append(traced_lists *lists, size_t block, uint32_t id)
{
    if (lists->begin[block + 1] == lists->capacity) {
        lists->capacity = lists->capacity ? 2 * lists->capacity : 4096;
        lists->ids = realloc(lists->ids, lists->capacity * sizeof *lists->ids);
        assert_non_null(lists->ids);
    }
    lists->ids[lists->begin[block + 1]++] = id;
}

static inline traced_lists traced_lists_create(const sgsi_rays *rays)
{
    traced_lists lists = {.blocks = (size_t)rays->tiles_x * (size_t)rays->tiles_y * SGSI_BLOCKS};
    lists.begin = oracle_memory(lists.blocks + 1, sizeof *lists.begin);
    return lists;
}

static inline traced_lists traced_lists_of(const sgsi_tracer *tracer, const sgsi_rays *rays)
{
    traced_lists lists = traced_lists_create(rays);
    for (size_t block = 0; block < lists.blocks; ++block) {
        const sgsi_tile_list *list = &sgsi_tracer_lists(tracer)[block / SGSI_BLOCKS];
        const size_t b = block % SGSI_BLOCKS;
        lists.begin[block + 1] = lists.begin[block];
        for (uint32_t i = list->count ? list->block_begin[b] : 0;
             list->count && i < list->block_begin[b + 1]; ++i)
            traced_lists_append(&lists, block, list->ids[list->block_hits[i]]);
    }
    return lists;
}

static inline void traced_assert_same_lists(const traced_lists *a, const traced_lists *b,
                                            const char *what)
{
    assert_int_equal(a->blocks, b->blocks);
    for (size_t block = 0; block < a->blocks; ++block) {
        const size_t count = a->begin[block + 1] - a->begin[block];
        if (count != b->begin[block + 1] - b->begin[block] ||
            (count &&
             memcmp(a->ids + a->begin[block], b->ids + b->begin[block], count * sizeof *a->ids)))
            fail_msg("%s: block %zu of tile %zu has another list", what, block % SGSI_BLOCKS,
                     block / SGSI_BLOCKS);
    }
}

// ---- A traced view ----

typedef struct traced_view {
    sgs_camera camera;
    sgs_pose pose;
    sgs_render_options options;
    sgsi_rays *rays;
    sgsi_view view;
    sgsi_tracer *tracer;
    sgsi_planes planes;
} traced_view;

static inline void traced_forward(traced_view *traced, float *depth_bound)
{
    traced_planes_free(&traced->planes);
    traced->planes = traced_planes_create(traced->camera.width, traced->camera.height);
    if (sgsi_tracer_forward(traced->tracer, &traced->view, &traced->planes, depth_bound, true))
        fail_msg("%s", sgs_last_error());
    traced_assert_complete(&traced->planes);
}

static inline void traced_project(traced_view *traced, const sgs_gaussians *model, bool rebuild,
                                  sgsi_bvh_quality quality)
{
    if (sgsi_tracer_project(traced->tracer, model, &traced->view, NULL, NULL) ||
        sgsi_tracer_commit(traced->tracer, rebuild, quality))
        fail_msg("%s", sgs_last_error());
}

// Changes the view without tracing; macrotile_side 0 keeps the size.
static inline void traced_aim(traced_view *traced, const sgs_camera *camera, const sgs_pose *pose,
                              int macrotile_side)
{
    if (!macrotile_side)
        macrotile_side = traced->rays->macrotile_side;
    sgsi_rays_destroy(traced->rays);
    traced->camera = *camera;
    traced->pose = *pose;
    if (sgsi_rays_create(camera, macrotile_side, &traced->rays))
        fail_msg("%s", sgs_last_error());
    sgsi_view_set(&traced->view, traced->rays, pose, &traced->options);
}

// A 3D filter for any test model, about as large as the primitives.
static inline const float *traced_filter_3d(size_t count)
{
    enum { MAX_VALUES = 1 << 16 };
    static _Alignas(64) float values[MAX_VALUES];
    assert_true(count <= MAX_VALUES);
    for (size_t i = 0; i < MAX_VALUES && values[MAX_VALUES - 1] == 0; ++i)
        values[i] = (float)(0.001 + 0.1 * sgsi_random_uniform(77, i));
    return values;
}

// Projects, builds and traces with lists.
static inline traced_view traced_create(const sgs_gaussians *model, const sgs_camera *camera,
                                        const sgs_pose *pose, sgs_filter filter, int macrotile_side,
                                        sgsi_bvh_quality quality)
{
    traced_view traced = {.options = sgs_render_options_default()};
    traced.options.filter = filter;
    traced.options.filter_3d = filter == SGS_FILTER_MIP ? traced_filter_3d(model->count) : NULL;
    assert_int_equal(sgsi_tracer_create(&traced.tracer), SGS_STATUS_OK);
    traced_aim(&traced, camera, pose, macrotile_side);
    traced_project(&traced, model, true, quality);
    traced_forward(&traced, NULL);
    return traced;
}

static inline void traced_destroy(traced_view *traced)
{
    sgsi_rays_destroy(traced->rays);
    sgsi_tracer_destroy(traced->tracer);
    traced_planes_free(&traced->planes);
}

// ---- The same kernels without a BVH ----

static const float *brute_projected;

static inline int brute_compare(const void *a, const void *b)
{
    const uint32_t i = *(const uint32_t *)a, j = *(const uint32_t *)b;
    const float x = brute_projected[(size_t)i * SGSI_PROJECTED_FLOATS + SGSI_PROJECTED_DISTANCE];
    const float y = brute_projected[(size_t)j * SGSI_PROJECTED_FLOATS + SGSI_PROJECTED_DISTANCE];
    return x < y ? -1 : x > y ? 1 : (i > j) - (i < j);
}

// Uses the projected records of traced->tracer.
static inline void brute_forward(const traced_view *traced, size_t count, sgsi_planes *planes,
                                 traced_lists *lists)
{
    sgsi_scratch scratch = {0};
    assert_true(sgsi_scratch_reserve(&scratch, count + 16));
    brute_projected = sgsi_tracer_projected(traced->tracer);
    size_t candidates = 0;
    uint32_t *ids = calloc(count + 16, sizeof *ids);
    assert_non_null(ids);
    for (size_t i = 0; i < count; ++i)
        if (brute_projected[i * SGSI_PROJECTED_FLOATS + SGSI_PROJECTED_LOG_OPACITY] > SGSI_UNTRACED)
            ids[candidates++] = (uint32_t)i;
    qsort(ids, candidates, sizeof *ids, brute_compare);
    const sgsi_kernels *kernels = sgsi_kernels_get();
    *planes = traced_planes_create(traced->camera.width, traced->camera.height);
    *lists = traced_lists_create(traced->rays);
    for (size_t tile = 0; tile < lists->blocks / SGSI_BLOCKS; ++tile) {
        const sgsi_tile_rays *rays = &traced->rays->tiles[tile];
        const sgsi_macrotile alone = {{rays}, {INFINITY}, 1, false, traced->view.compact_box};
        const size_t met =
            kernels->macrotile_filter(&scratch, brute_projected, ids, candidates, &alone);
        for (size_t i = 0; i < met; ++i)
            scratch.macrotile_order[i] = (uint32_t)i;
        const size_t kept = kernels->tile_take(&scratch, met, SGSI_IN_BOUND);
        assert_int_equal(kept, met);
        kernels->tile_sort(&scratch, rays, kept);
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
                                   .near_distance = traced->view.near_distance};
        kernels->tile_forward(&scratch, &target);
        for (size_t b = 0; b < SGSI_BLOCKS; ++b) {
            const size_t block = tile * SGSI_BLOCKS + b;
            lists->begin[block + 1] = lists->begin[block];
            for (uint32_t i = 0; i < scratch.entry_count[b]; ++i)
                traced_lists_append(lists, block,
                                    scratch.tile_ids[scratch.order[b * scratch.capacity + i]]);
        }
    }
    free(ids);
    sgsi_scratch_free(&scratch);
}

// Compares images and lists of a traced view with those without a BVH.
static inline void traced_assert_matches_brute_force(const traced_view *traced, size_t count,
                                                     const char *what)
{
    sgsi_planes planes;
    traced_lists expected, lists = traced_lists_of(traced->tracer, traced->rays);
    brute_forward(traced, count, &planes, &expected);
    traced_assert_same_image(&planes, &traced->planes, what);
    traced_assert_same_lists(&expected, &lists, what);
    traced_planes_free(&planes);
    traced_lists_free(&expected);
    traced_lists_free(&lists);
}

// ---- Scenes by number: random ones, then the adversarial ones ----

enum {
    TRACED_RANDOM_SCENES = 2,
    TRACED_SCENE_COUNT = TRACED_RANDOM_SCENES + ORACLE_ADVERSARY_COUNT
};

static inline oracle_scene traced_scene(int number)
{
    if (number < TRACED_RANDOM_SCENES)
        return oracle_random_model(7 + (uint64_t)number, number ? 1200 : 300, NULL);
    return oracle_adversarial_model((oracle_adversary)(number - TRACED_RANDOM_SCENES), 11, 120);
}

static inline const char *traced_scene_name(int number)
{
    static const char *const random[TRACED_RANDOM_SCENES] = {"random", "crowd"};
    return number < TRACED_RANDOM_SCENES
               ? random[number]
               : oracle_adversary_name((oracle_adversary)(number - TRACED_RANDOM_SCENES));
}

static const sgs_camera_model traced_lenses[] = {SGS_CAMERA_PINHOLE, SGS_CAMERA_OPENCV,
                                                 SGS_CAMERA_OPENCV_FISHEYE};
enum { TRACED_LENS_COUNT = 3 };
