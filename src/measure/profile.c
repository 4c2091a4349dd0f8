// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Profiles one view with every kind of BVH. The kinds alternate, so that slow phases of the machine
// affect all of them. Costs come from clocks and Embree's memory monitor, counts from the tracer,
// and the number of useful candidates from the hit lists of the forward pass. Hits beyond early
// termination are sampled by brute force over the projected records.

#include "sparegs/profile.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bvh/bvh.h"
#include "bvh/bvh_cost.h"
#include "base/core.h"
#include "rays/rays.h"
#include "base/threads.h"
#include "trace/tracer.h"

enum { SAMPLES_MAX = 4096 };

const char *sgs_profile_kind_name(sgs_profile_kind kind)
{
    static const char *const names[SGS_PROFILE_KIND_COUNT] = {"low", "medium", "high", "refit",
                                                              "aged"};
    return (unsigned)kind < SGS_PROFILE_KIND_COUNT ? names[kind] : NULL;
}

void sgs_profile_options_init(sgs_profile_options *options, size_t size)
{
    const sgs_profile_options defaults = {.refits = 100, .repeat = 3, .samples = 64};
    sgsi_options_init(options, size, &defaults, sizeof defaults);
}

static sgsi_bvh_quality quality_of(sgs_profile_kind kind)
{
    static const sgsi_bvh_quality qualities[SGS_PROFILE_KIND_COUNT] = {
        SGSI_BVH_LOW, SGSI_BVH_MEDIUM, SGSI_BVH_HIGH, SGSI_BVH_REFIT, SGSI_BVH_REFIT};
    return qualities[kind];
}

typedef struct profile_job {
    const sgs_gaussians *model;
    sgs_gaussians *young; // the model before `refits` refits
    sgs_profile_options options;
    sgs_render_options render;
    sgsi_rays *rays;
    sgsi_view view, built_for;
    sgsi_planes planes;
    sgsi_tile_cost *costs;                 // [tiles]
    float *block;                          // memory of the planes and of `hits`
    float *hits;                           // a plane
    float *depth_bounds;                   // [tiles], input of the gather with depth bounds
    double second[SGS_PROFILE_KIND_COUNT]; // second best gather time
    sgs_profile *out;
} profile_job;

static sgs_status copy_young(profile_job *job)
{
    const sgs_gaussians *model = job->model;
    sgs_status status = sgs_gaussians_create(model->capacity, &job->young);
    if (!status)
        status = sgs_gaussians_resize(job->young, model->count);
    if (status)
        return status;
    memcpy(job->young->data, model->data,
           (model->count + SGS_LANES - 1) / SGS_LANES * SGS_LANES * SGS_PARAM_COUNT *
               sizeof(float));
    job->young->linear_opacity = model->linear_opacity;
    const double distance = job->options.step * sqrt((double)job->options.refits);
    for (size_t i = 0; distance > 0 && i < model->count; ++i)
        for (int k = 0; k < 3; ++k)
            *sgs_gaussians_at(job->young, i, SGS_PARAM_MEAN + k) +=
                (float)(distance *
                        sgsi_random_normal(job->options.seed, 6 * (uint64_t)i + 2 * (uint64_t)k));
    return SGS_STATUS_OK;
}

// Builds the tracer's tree as one of the kind, refitted to the view if the kind requires it.
static sgs_status make_tree(const profile_job *job, sgsi_tracer *tracer, sgs_profile_kind kind,
                            sgs_profile_tree *tree)
{
    const sgs_gaussians *built = kind == SGS_PROFILE_AGED ? job->young : job->model;
    sgs_status status = sgsi_tracer_project(
        tracer, built, kind < SGS_PROFILE_REFIT ? &job->view : &job->built_for, NULL, NULL);
    if (!status)
        status = sgsi_tracer_commit(tracer, true, quality_of(kind));
    tree->build = fmin(tree->build, sgsi_tracer_seconds(tracer).bvh_build);
    if (kind < SGS_PROFILE_REFIT || status)
        return status;
    status = sgsi_tracer_project(tracer, job->model, &job->view, NULL, NULL);
    if (!status)
        status = sgsi_tracer_commit(tracer, false, quality_of(kind));
    tree->refit = fmin(tree->refit, sgsi_tracer_seconds(tracer).bvh_refit);
    return status;
}

// The boxes of the view, and those that the refitted and the aged tree are built over, in one
// array. NULL without memory.
static sgsi_bounds *copy_boxes(const profile_job *job, sgsi_tracer *tracer, sgs_status *status)
{
    const size_t count = job->model->count;
    const sgs_gaussians *const models[3] = {job->model, job->model, job->young};
    const sgsi_view *const views[3] = {&job->view, &job->built_for, &job->built_for};
    sgsi_bounds *boxes = sgsi_alloc(count ? count : 1, 3 * sizeof *boxes);
    *status = boxes ? SGS_STATUS_OK
                    : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                "not enough memory for the boxes of %zu primitives", count);
    for (size_t m = 0; m < 3 && !*status; ++m) {
        *status = sgsi_tracer_project(tracer, models[m], views[m], NULL, NULL);
        if (!*status && count)
            memcpy(boxes + m * count, sgsi_tracer_bounds(tracer), count * sizeof *boxes);
    }
    return boxes;
}

static sgs_status measure_cost(const profile_job *job, sgs_profile_kind kind,
                               const sgsi_bounds *built, const sgsi_bounds *now,
                               sgsi_bvh_visits *visits)
{
    sgs_profile_tree *tree = &job->out->trees[kind];
    sgsi_bvh_cost cost = {0};
    const sgs_status status =
        sgsi_bvh_cost_measure(built, now, job->model->count, quality_of(kind), visits, &cost);
    tree->cost = cost.cost;
    tree->overlap = cost.overlap;
    tree->nodes = (double)cost.nodes;
    tree->leaves = (double)cost.leaves;
    tree->depth = cost.depth;
    for (int n = 0; n <= SGSI_BVH_LEAF_MAX; ++n)
        tree->leaf_sizes[n] = (double)cost.leaf_sizes[n];
    tree->node_visits = (double)visits->nodes;
    tree->box_tests = (double)visits->boxes;
    return status;
}

// Shape, cost and visits of all kinds of tree. No tracer exists: its Embree device would let the
// builder of this one run on all cores.
static sgs_status measure_costs(const profile_job *job, const sgsi_bounds *boxes)
{
    const sgsi_rays *rays = job->rays;
    const size_t count = job->model->count,
                 macrotiles = (size_t)rays->macrotiles_x * (size_t)rays->macrotiles_y;
    sgsi_packet *packets = sgsi_alloc(macrotiles, sizeof *packets);
    if (!packets)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu packets", macrotiles);
    for (size_t m = 0; m < macrotiles; ++m)
        packets[m] = sgsi_macrotile_packet(&job->view, (int)m, INFINITY);
    sgsi_bvh_visits visits = {.packets = packets, .count = macrotiles};
    sgs_status status = SGS_STATUS_OK;
    for (int k = 0; !status && k < SGS_PROFILE_KIND_COUNT; ++k) {
        const size_t built = k == SGS_PROFILE_AGED ? 2 : k == SGS_PROFILE_REFIT;
        status = measure_cost(job, (sgs_profile_kind)k, boxes + built * count, boxes, &visits);
    }
    sgsi_free(packets);
    return status;
}

static void fill_maps(const profile_job *job, const sgsi_tracer *tracer)
{
    sgs_profile *out = job->out;
    const sgsi_tile_list *lists = sgsi_tracer_lists(tracer);
    const float *projected = sgsi_tracer_projected(tracer);
    for (size_t i = 0; i < job->model->count; ++i)
        out->traced +=
            projected[i * SGSI_PROJECTED_FLOATS + SGSI_PROJECTED_LOG_OPACITY] > SGSI_UNTRACED;
    for (int y = 0; y < out->height; ++y)
        for (int x = 0; x < out->width; ++x) {
            const size_t pixel = (size_t)y * (size_t)out->width + (size_t)x;
            const sgsi_tile_list *list = &lists[y / SGSI_TILE * out->tiles_x + x / SGSI_TILE];
            const int b = y % SGSI_TILE / 4 * 4 + x % SGSI_TILE / 4;
            out->pixel_block_hits[pixel] = (float)(list->block_begin[b + 1] - list->block_begin[b]);
        }
    for (int t = 0; t < out->tiles_x * out->tiles_y; ++t) {
        out->tile_candidates[t] = (float)job->costs[t].candidates;
        out->tile_evaluations[t] = (float)job->costs[t].evaluations;
        out->tile_hits += lists[t].count;
        for (int b = 0; b < SGSI_BLOCKS; ++b)
            out->rays += __builtin_popcount(job->rays->tiles[t].valid[b]);
    }
}

// Counts the distinct primitives with a hit in each macrotile.
static sgs_status count_macrotile_hits(const profile_job *job, const sgsi_tracer *tracer)
{
    const sgsi_rays *rays = job->rays;
    const sgsi_tile_list *lists = sgsi_tracer_lists(tracer);
    // Number of the last macrotile with a hit, plus one.
    uint32_t *last = sgsi_calloc(job->model->count + 1, sizeof *last);
    if (!last)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory to count the hits of %zu primitives",
                         job->model->count);
    for (int macrotile = 0; macrotile < rays->macrotiles_x * rays->macrotiles_y; ++macrotile)
        for (int k = 0; k < rays->macrotile_side * rays->macrotile_side; ++k) {
            const int tile = sgsi_macrotile_tile(rays, macrotile, k);
            if (tile < 0)
                continue;
            const sgsi_tile_list *list = &lists[tile];
            for (uint32_t i = 0; i < list->count; ++i) {
                job->out->macrotile_hits += last[list->ids[i]] != (uint32_t)macrotile + 1;
                last[list->ids[i]] = (uint32_t)macrotile + 1;
            }
        }
    sgsi_free(last);
    return SGS_STATUS_OK;
}

// Records counts and maps of the forward pass over the refitted tree. Hits of pixels come from a
// second pass: counting them takes time, and any hit then makes a block hit.
static sgs_status record_pass(const profile_job *job, sgsi_tracer *tracer)
{
    sgs_profile *out = job->out;
    const sgsi_trace_counts counts = sgsi_tracer_counts(tracer);
    out->callbacks = (double)counts.callbacks;
    out->distinct = (double)counts.distinct;
    out->gathered = (double)counts.gathered;
    out->candidates = (double)counts.candidates;
    out->block_tests = SGSI_BLOCKS * out->candidates;
    out->evaluations = (double)counts.evaluations;
    out->block_hits = (double)counts.block_hits;
    fill_maps(job, tracer);
    sgs_status status = count_macrotile_hits(job, tracer);
    if (status)
        return status;
    sgsi_planes planes = job->planes;
    planes.hits = job->hits;
    status = sgsi_tracer_forward(tracer, &job->view, &planes, NULL, false);
    for (int y = 0; !status && y < out->height; ++y)
        for (int x = 0; x < out->width; ++x) {
            const float hits = planes.hits[(size_t)y * planes.stride + (size_t)x];
            out->pixel_hits[(size_t)y * (size_t)out->width + (size_t)x] = hits;
            out->hits += (double)hits;
        }
    return status;
}

static void record_gather(profile_job *job, sgs_profile_kind kind, double seconds)
{
    double *best = &job->out->trees[kind].gather, *second = &job->second[kind];
    *second = fmin(*second, fmax(seconds, *best));
    *best = fmin(*best, seconds);
}

// One repetition of a kind: builds its tree, traces the view without and with depth bounds.
static sgs_status measure_kind(profile_job *job, sgsi_tracer *tracer, sgs_profile_kind kind,
                               bool last)
{
    sgs_profile *out = job->out;
    sgs_profile_tree *tree = &out->trees[kind];
    const bool main_kind = kind == SGS_PROFILE_REFIT;
    const size_t tiles = (size_t)out->tiles_x * (size_t)out->tiles_y;
    sgs_status status = make_tree(job, tracer, kind, tree);
    if (status)
        return status;
    tree->bytes = (double)sgsi_bvh_bytes();
    for (size_t t = 0; t < tiles; ++t)
        job->depth_bounds[t] = INFINITY;
    sgsi_tracer_watch_tiles(tracer, main_kind ? job->costs : NULL);
    status = sgsi_tracer_forward(tracer, &job->view, &job->planes, job->depth_bounds, main_kind);
    sgsi_tracer_watch_tiles(tracer, NULL);
    const sgsi_trace_seconds seconds = sgsi_tracer_seconds(tracer);
    record_gather(job, kind, seconds.gather_cpu);
    tree->callbacks = (double)sgsi_tracer_counts(tracer).callbacks;
    tree->distinct = (double)sgsi_tracer_counts(tracer).distinct;
    if (main_kind) {
        out->forward = fmin(out->forward, seconds.forward_cpu);
        for (size_t t = 0; t < tiles; ++t)
            out->tile_seconds[t] = fminf(out->tile_seconds[t], job->costs[t].seconds);
    }
    if (!status && main_kind && last)
        status = record_pass(job, tracer);
    if (!status)
        status = sgsi_tracer_forward(tracer, &job->view, &job->planes, job->depth_bounds, false);
    tree->gather_with_depth_bound =
        fmin(tree->gather_with_depth_bound, sgsi_tracer_seconds(tracer).gather_cpu);
    return status;
}

// Resets all times; later measurements keep the minimum.
static void reset_times(profile_job *job)
{
    sgs_profile *out = job->out;
    out->forward = INFINITY;
    for (int t = 0; t < out->tiles_x * out->tiles_y; ++t)
        out->tile_seconds[t] = INFINITY;
    for (int k = 0; k < SGS_PROFILE_KIND_COUNT; ++k) {
        sgs_profile_tree *tree = &out->trees[k];
        tree->build = tree->gather = tree->gather_with_depth_bound = job->second[k] = INFINITY;
        tree->refit = k < SGS_PROFILE_REFIT ? 0 : INFINITY;
    }
}

static sgs_status measure_kinds(profile_job *job)
{
    sgs_profile *out = job->out;
    sgsi_tracer *tracer;
    sgs_status status = sgsi_tracer_create(&tracer);
    if (status)
        return status;
    sgsi_tracer_set_profiled(tracer, true);
    const double before = (double)sgsi_bvh_bytes();
    status = measure_kind(job, tracer, SGS_PROFILE_LOW, false); // warms up memory and caches
    reset_times(job);
    for (int round = 1; round <= job->options.repeat; ++round)
        for (int k = 0; !status && k < SGS_PROFILE_KIND_COUNT; ++k)
            status = measure_kind(job, tracer, (sgs_profile_kind)k, round == job->options.repeat);
    for (int k = 0; k < SGS_PROFILE_KIND_COUNT; ++k) {
        out->trees[k].bytes -= before;
        out->noise = fmax(out->noise, job->second[k] / out->trees[k].gather - 1);
    }
    if (job->options.repeat == 1)
        out->noise = NAN;
    sgsi_bounds *boxes = status ? NULL : copy_boxes(job, tracer, &status);
    sgsi_tracer_destroy(tracer);
    if (!status)
        status = measure_costs(job, boxes);
    sgsi_free(boxes);
    return status;
}

// ---- Single rays ----

typedef struct ray_hit {
    double t, alpha;
} ray_hit;

static int compare_hits(const void *a, const void *b)
{
    const double x = ((const ray_hit *)a)->t, y = ((const ray_hit *)b)->t;
    return (x > y) - (x < y);
}

typedef struct sample_job {
    const profile_job *profile;
    const float *projected;
    // -1: no ray at that pixel, or out of memory.
    int counted[SAMPLES_MAX], all[SAMPLES_MAX];
    bool terminated[SAMPLES_MAX];
} sample_job;

// Direction in camera axes of the ray through a pixel. False if the pixel has no ray.
static bool pixel_direction(const profile_job *job, int x, int y, double d[3])
{
    const sgsi_tile_rays *tile =
        &job->rays->tiles[y / SGSI_TILE * job->rays->tiles_x + x / SGSI_TILE];
    const int b = y % SGSI_TILE / 4 * 4 + x % SGSI_TILE / 4, lane = y % 4 * 4 + x % 4;
    for (int k = 0; k < 3; ++k)
        d[k] = (double)tile->frame[k] + (double)(tile->u[b][lane] * tile->frame[3 + k]) +
               (double)(tile->v[b][lane] * tile->frame[6 + k]);
    return tile->valid[b] >> lane & 1;
}

// All hits of one ray by the formulas of trace.h, then early termination over the sorted hits.
static void follow_ray(void *context, size_t item, int thread)
{
    (void)thread;
    sample_job *job = context;
    const profile_job *profile = job->profile;
    // Additive recurrence of the plastic number: evenly spread for any number of samples.
    const int x = (int)(fmod(0.5 + 0.7548776662466927 * (double)item, 1.0) * profile->out->width);
    const int y = (int)(fmod(0.5 + 0.5698402909980532 * (double)item, 1.0) * profile->out->height);
    double d[3];
    job->all[item] = -1;
    if (!pixel_direction(profile, x, y, d))
        return;
    const double near_distance =
        profile->render.near_distance / sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    ray_hit *hits = NULL;
    size_t count = 0, capacity = 0;
    for (size_t i = 0; i < profile->model->count; ++i) {
        const float *r = job->projected + i * SGSI_PROJECTED_FLOATS;
        if (!(r[SGSI_PROJECTED_LOG_OPACITY] > SGSI_UNTRACED))
            continue;
        double row[3];
        for (int k = 0; k < 3; ++k)
            row[k] =
                (double)r[3 * k] * d[0] + (double)r[3 * k + 1] * d[1] + (double)r[3 * k + 2] * d[2];
        const double n2 = row[0] * row[0] + row[1] * row[1];
        const double g = n2 * (double)r[SGSI_PROJECTED_INV_KAPPA] + row[2] * row[2];
        const double exponent = (double)r[SGSI_PROJECTED_LOG_OPACITY] - n2 / g,
                     t = (double)r[SGSI_PROJECTED_DISTANCE] * row[2] / g;
        if (!(exponent >= -(double)SGSI_LOG2_255 && t > near_distance))
            continue;
        if (count == capacity) {
            const size_t more = capacity ? 2 * capacity : 256;
            if (!sgsi_grow((void **)&hits, count, more, sizeof *hits)) {
                sgsi_free(hits);
                return;
            }
            capacity = more;
        }
        hits[count++] = (ray_hit){t, fmin(exp2(exponent), 0.99)};
    }
    if (count)
        qsort(hits, count, sizeof *hits, compare_hits);
    double through = 1.0;
    size_t counted = 0;
    while (counted < count && through * (1.0 - hits[counted].alpha) >= 1e-4)
        through *= 1.0 - hits[counted++].alpha;
    job->all[item] = (int)count;
    job->counted[item] = (int)counted;
    job->terminated[item] = counted < count;
    sgsi_free(hits);
}

static sgs_status sample_rays(profile_job *job)
{
    const int samples = job->options.samples;
    sample_job *sampling = sgsi_calloc(1, sizeof *sampling);
    sgsi_tracer *tracer = NULL;
    sgs_status status =
        sampling ? sgsi_tracer_create(&tracer)
                 : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to trace sample rays");
    if (!status)
        status = sgsi_tracer_project(tracer, job->model, &job->view, NULL, NULL);
    if (sampling && !status) {
        sampling->profile = job;
        sampling->projected = sgsi_tracer_projected(tracer);
        sgsi_parallel_for((size_t)samples, 1, follow_ray, sampling);
        double rays = 0;
        for (int i = 0; i < samples; ++i) {
            if (sampling->all[i] < 0)
                continue;
            ++rays;
            job->out->sampled_hits += sampling->counted[i];
            job->out->sampled_hits_unterminated += sampling->all[i];
            job->out->sampled_terminated += sampling->terminated[i];
        }
        double *const sums[] = {&job->out->sampled_hits, &job->out->sampled_hits_unterminated,
                                &job->out->sampled_terminated};
        for (int k = 0; k < 3; ++k)
            *sums[k] = rays > 0 ? *sums[k] / rays : NAN;
    }
    sgsi_tracer_destroy(tracer);
    sgsi_free(sampling);
    return status;
}

// ---- The profile ----

static sgs_status check_options(const sgs_profile_options *o, const sgs_render_options *render)
{
    const sgs_status status = sgsi_render_options_check(render);
    if (status)
        return status;
    if (o->refits < 0 || o->repeat < 1 || o->samples < 0 || o->samples > SAMPLES_MAX ||
        !(o->step >= 0))
        return sgsi_fail(
            SGS_STATUS_INVALID_ARGUMENT,
            "a profile requires refits >= 0, repeat >= 1, 0 to %d samples and step >= 0",
            SAMPLES_MAX);
    if (render->filter_3d)
        return sgsi_fail(
            SGS_STATUS_UNSUPPORTED,
            "a profile requires a model with the 3D filter fused into its scales, as in PLY files");
    if (render->compact_box != 1.0)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "a profile counts hits of whole supports: compact_box must be 1");
    return SGS_STATUS_OK;
}

static sgs_status prepare(profile_job *job, const sgs_camera *camera, const sgs_pose *pose)
{
    sgs_profile *out = job->out;
    sgs_status status = check_options(&job->options, &job->render);
    if (!status)
        status = sgs_pose_validate(pose);
    if (!status && job->options.built_for)
        status = sgs_pose_validate(job->options.built_for);
    if (!status)
        status = sgsi_rays_create(camera, sgsi_macrotile_side(camera), &job->rays);
    if (status)
        return status;
    sgsi_view_set(&job->view, job->rays, pose, &job->render);
    sgsi_view_set(&job->built_for, job->rays,
                  job->options.built_for ? job->options.built_for : pose, &job->render);
    *out = (sgs_profile){.width = camera->width,
                         .height = camera->height,
                         .tiles_x = job->rays->tiles_x,
                         .tiles_y = job->rays->tiles_y,
                         .primitives = (double)job->model->count};
    const size_t pixels = (size_t)out->width * (size_t)out->height,
                 tiles = (size_t)out->tiles_x * (size_t)out->tiles_y;
    const size_t stride = ((size_t)out->width + 15) / 16 * 16, plane = stride * (size_t)out->height;
    job->block = sgsi_calloc(5 * plane, sizeof(float));
    job->costs = sgsi_calloc(tiles, sizeof *job->costs);
    job->depth_bounds = sgsi_calloc(tiles, sizeof *job->depth_bounds);
    // All maps in one allocation.
    out->pixel_hits = sgsi_calloc(2 * pixels + 3 * tiles, sizeof(float));
    if (!job->block || !job->costs || !job->depth_bounds || !out->pixel_hits)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for the profile of %dx%d pixels", out->width,
                         out->height);
    out->pixel_block_hits = out->pixel_hits + pixels;
    out->tile_candidates = out->pixel_block_hits + pixels;
    out->tile_evaluations = out->tile_candidates + tiles;
    out->tile_seconds = out->tile_evaluations + tiles;
    job->planes = (sgsi_planes){.width = out->width,
                                .height = out->height,
                                .stride = stride,
                                .color = {job->block, job->block + plane, job->block + 2 * plane},
                                .transmittance = job->block + 3 * plane};
    job->hits = job->block + 4 * plane;
    return copy_young(job);
}

sgs_status sgs_profile_view(const sgs_gaussians *model, const sgs_camera *camera,
                            const sgs_pose *pose, const sgs_profile_options *options,
                            sgs_profile **profile)
{
    *profile = NULL;
    profile_job job = {.model = model,
                       .options = sgs_profile_options_default(),
                       .render = sgs_render_options_default()};
    sgs_status status =
        sgsi_options_read(options, "sgs_profile_options", &job.options, sizeof job.options);
    if (!status)
        status = sgsi_options_read(job.options.render, "sgs_render_options", &job.render,
                                   sizeof job.render);
    if (status)
        return status;
    job.out = sgsi_calloc(1, sizeof *job.out);
    if (!job.out)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for a profile");
    status = prepare(&job, camera, pose);
    if (!status)
        status = measure_kinds(&job);
    if (!status)
        status = sample_rays(&job);
    sgs_gaussians_destroy(job.young);
    sgsi_rays_destroy(job.rays);
    sgsi_free(job.block);
    sgsi_free(job.costs);
    sgsi_free(job.depth_bounds);
    if (status)
        sgs_profile_destroy(job.out);
    else
        *profile = job.out;
    return status;
}

void sgs_profile_destroy(sgs_profile *profile)
{
    if (!profile)
        return;
    sgsi_free(profile->pixel_hits);
    sgsi_free(profile);
}
