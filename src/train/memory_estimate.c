// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Estimate of the memory of a training run before it starts. Photos, rays, parameters, moments,
// statistics and projected records are counted exactly. Candidates of the fullest tile, gradient
// records per tile and primitive, and the copies of a structural update depend on the scene; their
// constants were fitted to the peak RSS of 37 training runs of five scenes with up to 67 000
// primitives, 8-bit images of 480 to 376 000 pixels and all pipelines, within 20 %. For small
// images the estimate exceeds the peak, because the memory limit of a trainer relies on it.

#include "sparegs/trainer.h"
#include "base/core.h"
#include "base/threads.h"
#include "density/pipeline.h"
#include "image/photo_cache.h"
#include "train/train_view.h"

enum {
    PROGRAM_BYTES = 134000000, // code and libraries
    THREAD_BYTES = 6000000,    // stack, allocator, buffers
    // Per primitive: 708 parameters and moments, 180 tracing and statistics, BVH, structural
    // update.
    ROW_BYTES = 1700,
    // Of several ranks, per primitive of all: columns and plan of a structural update; the initial
    // model with the distances of neighbours.
    COLUMN_BYTES = 150,
    INITIAL_BYTES = 300,
    SCORE_BYTES = 93, // of pipelines that score views (view_scores.c)
    TILE_BYTES = 4, // per tile of each view: depth bound; of several ranks also the cost of a cell
    VOXEL_BYTES = 44, // of the grid of SPARE-GS
    // Per pixel of the largest view: image and gradient, loss, lists of hits, gradient records.
    PIXEL_BYTES = 120,
    DIRECTION_BYTES = 14, // per pixel of the largest camera, while its ray table is made
    // After training, per primitive: parameters, tracing, BVH.
    EVALUATED_BYTES = 420,
    SSIM_BYTES = 1080,      // per thread and column of the widest image: scratch of sgs_ssim_masked
    CANDIDATE_BYTES = 1560, // per thread and candidate of the fullest tile
    LIST_BYTES = 2800,      // per candidate of the fullest tile of an image of one tile
    CROWDING = 16,          // primitives in the fullest tile relative to the mean
    TILE_PIXELS = SGSI_TILE * SGSI_TILE,
    MAX_CAMERAS = 256 // number of cameras compared with each other
};

// Sums and products of untrusted counts saturate.
static size_t plus(size_t a, size_t b)
{
    size_t sum;
    return __builtin_add_overflow(a, b, &sum) ? SIZE_MAX : sum;
}

static size_t times(size_t a, size_t b)
{
    size_t product;
    return __builtin_mul_overflow(a, b, &product) ? SIZE_MAX : product;
}

// Bytes of the ray tables of all different cameras.
static size_t table_bytes(const sgs_scene *scene)
{
    const sgs_camera *distinct[MAX_CAMERAS];
    size_t count = 0, bytes = 0;
    for (size_t i = 0; i < scene->view_count; ++i) {
        const sgs_camera *camera = &scene->views[i].camera;
        size_t k = 0;
        while (k < count && !sgs_camera_equal(distinct[k], camera))
            ++k;
        if (k < count)
            continue;
        bytes += sgsi_ray_table_bytes(camera->width, camera->height);
        if (count < MAX_CAMERAS)
            distinct[count++] = camera;
    }
    return bytes;
}

size_t sgs_train_memory(const sgs_scene *scene, const sgs_train_options *options,
                        size_t image_cache, size_t gaussians)
{
    return sgs_train_memory_per_rank(scene, options, image_cache, gaussians, 1,
                                     sgs_train_ray_limit(0));
}

// Bytes of SPARE-GS in a structural update that do not depend on the primitives.
static size_t grid_bytes(const sgs_train_options *options)
{
    const size_t grid = options->spare_grid > 0 ? (size_t)options->spare_grid : 0;
    return options->spare & (SGS_SPARE_BMD | SGS_SPARE_RAP)
               ? times(times(grid, grid), times(grid, VOXEL_BYTES))
               : 0;
}

// Bytes of the ray tables, of which there is at least one. pixels, one: of the largest camera, and
// the bytes of its table.
static size_t ray_bytes(const sgs_scene *scene, size_t pixels, size_t one, bool reduces,
                        size_t limit)
{
    const size_t tables = table_bytes(scene) * (reduces ? 5 : 4) / 4,
                 kept = tables < limit ? tables : limit;
    return (kept > one ? kept : one) + pixels * DIRECTION_BYTES;
}

// Bytes for the primitives of a rank: its own ones, and what depends on all.
static size_t row_bytes(size_t rows, size_t own_bytes, bool scores, int ranks)
{
    const size_t columns = COLUMN_BYTES + (scores ? SCORE_BYTES : 0),
                 trained = plus(times(rows / (size_t)ranks, own_bytes), times(rows, columns)),
                 initial = times(rows, INITIAL_BYTES);
    if (ranks < 2)
        return times(rows, own_bytes);
    return trained > initial ? trained : initial;
}

// Bytes for `count` photos that are decoded at the same time.
static size_t decoding_bytes(const sgs_scene *scene, size_t count)
{
    const size_t one = scene->decode_bytes, limit = scene->decode_limit;
    return limit <= one ? one : count <= limit / (one ? one : 1) ? count * one : limit;
}

static size_t larger(size_t a, size_t b)
{
    return a > b ? a : b;
}

size_t sgs_train_memory_per_rank(const sgs_scene *scene, const sgs_train_options *options,
                                 size_t image_cache, size_t gaussians, int ranks, size_t ray_limit)
{
    sgs_train_options own = sgs_train_options_default();
    sgsi_errors_suspend();
    const sgs_status status = sgsi_options_read(options, "sgs_train_options", &own, sizeof own);
    sgsi_errors_resume();
    if (status)
        return 0;
    size_t largest = TILE_PIXELS, widest = 0, table = 0, tiles = 0;
    for (size_t i = 0; i < scene->view_count; ++i) {
        const sgs_view *view = &scene->views[i];
        const size_t pixels = (size_t)view->camera.width * (size_t)view->camera.height;
        largest = larger(largest, pixels);
        widest = larger(widest, (size_t)view->camera.width);
        table = larger(table, sgsi_ray_table_bytes(view->camera.width, view->camera.height));
        tiles += sgsi_tile_count(view->camera.width, view->camera.height);
    }
    const bool cached = image_cache && scene->photo_bytes > image_cache;
    size_t photos = cached ? image_cache : scene->photo_bytes;
    if (!sgs_box_is_infinite(&own.region)) // the targets of a region
        photos = plus(photos, scene->photo_bytes);
    const size_t cap = own.max_gaussians, threads = (size_t)sgsi_threads(),
                 decoders = (size_t)sgsi_photo_decoders((int)threads) + 1; // and the caller
    // The cap does not count the primitives outside of a region.
    const size_t rows =
        cap && cap < gaussians && sgs_box_is_infinite(&own.region) ? cap : gaussians;
    const bool known = (unsigned)own.pipeline < SGS_PIPELINE_COUNT;
    const int shrinks = known ? sgsi_pipeline_get(own.pipeline)->small_images : 0;
    const bool scores = known && sgsi_pipeline_get(own.pipeline)->score_views;
    const size_t shrinking = shrinks ? (size_t)shrinks : 1;
    const bool reduces = (shrinks || (known && !own.init &&
                                      sgsi_train_schedule(scene, &own, false).half_size_until)) &&
                         !scene->float_images;
    if (reduces && !cached)
        photos = plus(photos, scene->photo_bytes / 4); // at half the size or less
    const size_t crowd = times(CROWDING * shrinking, rows) / (largest / TILE_PIXELS),
                 fullest = crowd < rows ? crowd : rows;
    const size_t batch_bytes = own.batch > 1 ? (SGS_PARAM_COUNT + 1) * sizeof(float) : 0;
    // With fewer tiles per image, a ray hits a larger part of the candidates of its tile.
    const size_t lists = times(fullest, LIST_BYTES) / (largest / TILE_PIXELS);
    // Loading, training and evaluation follow each other.
    const size_t both = largest * PIXEL_BYTES +
                        ray_bytes(scene, largest, table, reduces, ray_limit) +
                        (cached ? decoding_bytes(scene, decoders) : 0),
                 own_rows = rows / (size_t)(ranks < 1 ? 1 : ranks),
                 candidates = plus(times(threads * CANDIDATE_BYTES, fullest), lists),
                 trained = row_bytes(rows, ROW_BYTES + batch_bytes, scores, ranks < 1 ? 1 : ranks),
                 training = plus(plus(candidates, trained),
                                 plus(tiles * TILE_BYTES * (ranks > 1 ? 2 : 1), grid_bytes(&own))),
                 evaluation = plus(threads * widest * SSIM_BYTES, times(own_rows, EVALUATED_BYTES));
    return plus(plus(PROGRAM_BYTES + threads * THREAD_BYTES, photos),
                larger(decoding_bytes(scene, threads), plus(both, larger(training, evaluation))));
}
