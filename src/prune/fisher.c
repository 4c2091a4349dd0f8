// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// PUP 3D-GS (Hanson et al., "PUP 3D-GS: Principled Uncertainty Pruning for 3D Gaussian Splatting",
// CVPR 2025, section 4): the Fisher information of the images about position and log scale of each
// primitive, equation 5, and its log determinant as score, equation 6. The tracer finds the hits;
// the derivatives of each hit are computed again in double precision, without BVH and without
// approximation (fisher_kernel.inl).
//
// Each tile writes one slot per primitive; the slots are added to the sums in tile order, so that
// the bits do not depend on the number of threads. Tiles are processed in chunks of slots.

#include "prune/fisher.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "prune/fisher_primitive.h"
#include "prune/scores.h"
#include "simd/kernel_variants.h"

enum { CHUNK_SLOTS = 1 << 16, BUCKETS = 64 };

// Scratch of one thread, for the largest tile and block so far.
typedef struct fisher_scratch {
    sgsi_fisher_primitive *primitives; // [tile_capacity]
    bool *prepared;                    // [tile_capacity]
    size_t tile_capacity;
    sgsi_fisher_block block;
    double *rows;
    uint32_t *order;
    size_t block_capacity;
    bool failed;
} fisher_scratch;

typedef struct fisher_job {
    double (*sums)[SGSI_FISHER_ENTRIES]; // [model->count]
    const sgs_gaussians *model;
    sgsi_fisher_kernel kernel;
    const float *background;
    fisher_scratch *scratch; // [threads]
    // Of the view.
    const sgsi_traced_view *traced;
    const sgsi_tile_list *lists;
    sgsi_fisher_camera camera;
    size_t first_tile, last_tile;         // of the chunk
    double (*slots)[SGSI_FISHER_ENTRIES]; // of the chunk
    size_t *slot_begin;                   // [tiles + 1]
    size_t slot_capacity, tile_capacity;
} fisher_job;

static bool reserve_tile(fisher_scratch *s, size_t count)
{
    if (count <= s->tile_capacity)
        return true;
    const size_t capacity = count + count / 2;
    s->tile_capacity = 0;
    sgsi_free(s->primitives);
    sgsi_free(s->prepared);
    s->primitives = sgsi_alloc(capacity, sizeof *s->primitives);
    s->prepared = sgsi_alloc(capacity, sizeof *s->prepared);
    s->tile_capacity = s->primitives && s->prepared ? capacity : 0;
    return s->tile_capacity > 0;
}

static bool reserve_block(fisher_scratch *s, size_t count)
{
    if (count <= s->block_capacity)
        return true;
    const size_t capacity = count + count / 2;
    s->block_capacity = 0;
    sgsi_free(s->rows);
    sgsi_free(s->order);
    s->rows = sgsi_alloc(capacity, 16 * 9 * sizeof *s->rows);
    s->order = sgsi_alloc(capacity, sizeof *s->order);
    if (!s->rows || !s->order)
        return false;
    s->block_capacity = capacity;
    s->block.response = s->rows;
    s->block.t = s->rows + 16 * capacity;
    s->block.weight = s->rows + 32 * capacity;
    s->block.v = s->rows + 48 * capacity;
    s->block.m = s->rows + 96 * capacity;
    s->block.order = s->order;
    return true;
}

// The rays of block b of a tile, world axes.
static void set_directions(const fisher_job *job, const sgsi_tile_rays *rays, int b,
                           sgsi_fisher_block *block)
{
    const double *r = job->traced->pose->rotation;
    for (int lane = 0; lane < 16; ++lane) {
        const int x = rays->x + 4 * (b % 4) + lane % 4, y = rays->y + 4 * (b / 4) + lane / 4;
        const double pixel[2] = {x + 0.5, y + 0.5};
        double d[3] = {0, 0, 0};
        const bool found = x < job->traced->camera->width && y < job->traced->camera->height &&
                           sgs_camera_unproject(job->traced->camera, pixel, d);
        for (int k = 0; k < 3; ++k)
            block->direction[k][lane] = found ? r[k] * d[0] + r[3 + k] * d[1] + r[6 + k] * d[2] : 0;
    }
}

static void visit_tile(void *context, size_t item, int thread)
{
    fisher_job *job = context;
    fisher_scratch *s = &job->scratch[thread];
    const size_t tile = job->first_tile + item;
    const sgsi_tile_list *list = &job->lists[tile];
    double(*slots)[SGSI_FISHER_ENTRIES] =
        job->slots + (job->slot_begin[tile] - job->slot_begin[job->first_tile]);
    if (!list->count || s->failed)
        return;
    memset(slots, 0, list->count * sizeof *slots);
    if (!reserve_tile(s, list->count)) {
        s->failed = true;
        return;
    }
    memset(s->prepared, 0, list->count * sizeof *s->prepared);
    for (int b = 0; b < SGSI_BLOCKS; ++b) {
        const uint32_t *entries = list->block_hits + list->block_begin[b];
        const uint32_t count = list->block_begin[b + 1] - list->block_begin[b];
        if (!count)
            continue;
        if (!reserve_block(s, count)) {
            s->failed = true;
            return;
        }
        for (uint32_t i = 0; i < count; ++i)
            if (!s->prepared[entries[i]]) {
                s->prepared[entries[i]] = true;
                sgsi_fisher_primitive_set(&job->camera, job->model, list->ids[entries[i]],
                                          &s->primitives[entries[i]]);
            }
        set_directions(job, &job->traced->view->rays->tiles[tile], b, &s->block);
        s->block.near_distance = job->camera.near_distance;
        for (int c = 0; c < 3; ++c)
            s->block.background[c] = (double)job->background[c];
        s->block.count = count;
        s->block.entries = entries;
        s->block.primitives = s->primitives;
        s->block.ids = list->ids;
        s->block.sums = slots;
        job->kernel(&s->block);
    }
}

// Adds the slots of the primitives of one bucket, a range of rows, in tile order.
static void add_bucket(void *context, size_t bucket, int thread)
{
    (void)thread;
    const fisher_job *job = context;
    const size_t n = job->model->count;
    const size_t low = n * bucket / BUCKETS, high = n * (bucket + 1) / BUCKETS;
    for (size_t tile = job->first_tile; tile < job->last_tile; ++tile) {
        const sgsi_tile_list *list = &job->lists[tile];
        double(*slots)[SGSI_FISHER_ENTRIES] =
            job->slots + (job->slot_begin[tile] - job->slot_begin[job->first_tile]);
        for (uint32_t i = 0; i < list->count; ++i)
            if (list->ids[i] >= low && list->ids[i] < high)
                for (int k = 0; k < SGSI_FISHER_ENTRIES; ++k)
                    job->sums[list->ids[i]][k] += slots[i][k];
    }
}

static sgs_status reserve_view(fisher_job *job, size_t tiles)
{
    if (tiles > job->tile_capacity) {
        sgsi_free(job->slot_begin);
        job->slot_begin = sgsi_alloc(tiles + 1, sizeof *job->slot_begin);
        job->tile_capacity = job->slot_begin ? tiles : 0;
    }
    size_t largest = CHUNK_SLOTS;
    for (size_t tile = 0; tile < tiles; ++tile)
        largest = job->lists[tile].count > largest ? job->lists[tile].count : largest;
    if (largest > job->slot_capacity) {
        sgsi_free(job->slots);
        job->slots = sgsi_alloc(largest, sizeof *job->slots);
        job->slot_capacity = job->slots ? largest : 0;
    }
    return job->slot_begin && job->slots
               ? SGS_STATUS_OK
               : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                           "not enough memory for the Fisher matrices of a view");
}

static sgs_status visit_view(void *context, const sgsi_traced_view *traced)
{
    fisher_job *job = context;
    const sgsi_rays *rays = traced->view->rays;
    const size_t tiles = (size_t)rays->tiles_x * (size_t)rays->tiles_y;
    job->traced = traced;
    job->lists = sgsi_tracer_lists(traced->tracer);
    sgsi_fisher_camera_set(&job->camera, traced);
    const sgs_status status = reserve_view(job, tiles);
    if (status)
        return status;
    job->slot_begin[0] = 0;
    for (size_t tile = 0; tile < tiles; ++tile)
        job->slot_begin[tile + 1] = job->slot_begin[tile] + job->lists[tile].count;
    for (size_t first = 0; first < tiles; first = job->last_tile) {
        size_t last = first + 1;
        while (last < tiles &&
               job->slot_begin[last + 1] - job->slot_begin[first] <= job->slot_capacity)
            ++last;
        job->first_tile = first;
        job->last_tile = last;
        sgsi_parallel_for(last - first, 1, visit_tile, job);
        sgsi_parallel_for(BUCKETS, 1, add_bucket, job);
    }
    for (int t = 0; t < sgsi_threads(); ++t)
        if (job->scratch[t].failed)
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the hits of a tile");
    return SGS_STATUS_OK;
}

static const sgsi_fisher_kernel kernels[SGS_ISA_COUNT] = SGSI_VARIANTS(sgsi_fisher_block);

sgs_status sgsi_fisher_sums(const sgs_gaussians *model, const sgs_scene *scene,
                            const sgs_view_pass_options *options, const float background[3],
                            double (*sums)[SGSI_FISHER_ENTRIES])
{
    const int threads = sgsi_threads();
    fisher_job job = {
        .sums = sums, .model = model, .kernel = kernels[sgs_isa_get()], .background = background};
    memset(sums, 0, model->count * sizeof *sums);
    job.scratch = sgsi_calloc((size_t)threads, sizeof *job.scratch);
    if (!job.scratch)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %d threads", threads);
    const sgs_status status = sgsi_view_pass(model, scene, options, visit_view, &job);
    for (int t = 0; t < threads; ++t) {
        sgsi_free(job.scratch[t].primitives);
        sgsi_free(job.scratch[t].prepared);
        sgsi_free(job.scratch[t].rows);
        sgsi_free(job.scratch[t].order);
    }
    sgsi_free(job.scratch);
    sgsi_free(job.slots);
    sgsi_free(job.slot_begin);
    return status;
}

// Cholesky factors of the matrix scaled to a unit diagonal, which is positive semidefinite: the
// product of its singular values is that of the squared pivots.
double sgsi_fisher_log_det(const double sums[SGSI_FISHER_ENTRIES])
{
    static const int diagonal[6] = {0, 6, 11, 15, 18, 20};
    double a[6][6], scale[6], sum = 0;
    for (int i = 0; i < 6; ++i) {
        const double entry = fmax(sums[diagonal[i]], 1e-300);
        scale[i] = 1 / sqrt(entry);
        sum += log(entry);
    }
    for (int i = 0, at = 0; i < 6; ++i)
        for (int j = i; j < 6; ++j, ++at)
            a[j][i] = i == j ? 1 : sums[at] * scale[i] * scale[j];
    for (int k = 0; k < 6; ++k) {
        const double pivot = fmax(a[k][k], 1e-15);
        sum += log(pivot);
        for (int i = k + 1; i < 6; ++i)
            for (int j = k + 1; j <= i; ++j)
                a[i][j] -= a[i][k] * a[j][k] / pivot;
    }
    return sum;
}

sgs_status sgsi_pup_scores(const sgs_gaussians *model, const sgs_prune_options *options,
                           double *scores)
{
    sgs_view_pass_options views = sgs_view_pass_options_default();
    sgs_status status =
        sgsi_options_read(options->views, "sgs_view_pass_options", &views, sizeof views);
    if (status)
        return status;
    views.downscale = options->fisher_downscale;
    double(*sums)[SGSI_FISHER_ENTRIES] = sgsi_alloc(model->count, sizeof *sums);
    if (!sums)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for the Fisher matrices of %zu primitives",
                         model->count);
    status = sgsi_fisher_sums(model, options->scene, &views, options->background, sums);
    for (size_t i = 0; i < model->count && !status; ++i)
        scores[i] = sgsi_fisher_log_det((const double *)sums[i]);
    sgsi_free(sums);
    return status;
}
