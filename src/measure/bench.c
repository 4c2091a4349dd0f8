// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Times training iterations. The benchmark owns a trainer over its views and keeps it at an
// iteration without structural update at which all SH bands are active. The parameters are restored
// after each step, so all steps do the same work. No trainer code is duplicated here.

#include "sparegs/bench.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "bvh/bvh.h"
#include "sparegs/metrics.h"
#include "train/rank_traffic.h"
#include "train/trainer_state.h"
#include "train/view_ranks.h"

enum { VIEWS_MAX = 16, HELD_ITERATION = 3000 };

// Floating-point operations per lane. Response: three affine forms 12, |n|^2 and G 7, quotients and
// t 6. Alpha, of hits only: 2^x and clamp 15. Blending: w, three colours, T 10. Backward: response
// and w again, shading and v 12, nine products and fourteen sums 23.
enum { RESPONSE_FLOPS = 25, ALPHA_FLOPS = 15, BLEND_FLOPS = 10, GRADIENT_FLOPS = 35, LANES = 16 };
enum { RECORD_BYTES = SGSI_PROJECTED_FLOATS * sizeof(float) };

struct sgs_bench {
    sgs_render_options render;
    sgs_scene *scene;
    sgs_trainer *trainer;
    sgs_bench_counts counts;
};

// Makes the photo of a view: its render plus noise of a few grey levels. Also counts hits.
static sgs_status make_photo(sgs_bench *bench, sgs_renderer *renderer, size_t v,
                             const sgs_view_source *view, sgs_image8 *image)
{
    const sgs_camera *camera = &view->camera;
    const float black[3] = {0, 0, 0};
    sgs_frame frame;
    sgs_status status = sgs_frame_create(camera->width, camera->height, &frame);
    if (status)
        return status;
    status = sgs_renderer_render(renderer, camera, &view->pose, &bench->render, &frame);
    const size_t pixels = (size_t)camera->width * (size_t)camera->height;
    for (size_t i = 0; !status && i < pixels; ++i) {
        bench->counts.hits += (double)frame.hits[i];
        for (size_t c = 0; c < 3; ++c)
            frame.color[c][i] += (float)(0.03 * (sgsi_random_uniform(v, 3 * i + c) - 0.5));
    }
    if (!status) {
        const float *const color[3] = {frame.color[0], frame.color[1], frame.color[2]};
        status = sgs_image8_from_planes(color, NULL, black, camera->width, camera->height, image);
    }
    bench->counts.pixels += (double)pixels;
    bench->counts.tiles += (double)sgsi_tile_count(camera->width, camera->height);
    sgs_frame_free(&frame);
    return status;
}

// The scene of all photos.
static sgs_status make_photos(sgs_bench *bench, const sgs_gaussians *model, const sgs_view *views,
                              size_t view_count)
{
    sgs_view_source sources[VIEWS_MAX] = {0};
    sgs_image8 images[VIEWS_MAX] = {0};
    sgs_renderer *renderer;
    sgs_status status = sgs_renderer_create(model, &renderer);
    for (size_t v = 0; !status && v < view_count; ++v) {
        const sgs_camera *camera = &views[v].camera;
        sources[v] = (sgs_view_source){.camera = *camera,
                                       .pose = views[v].pose,
                                       .channels = 3,
                                       .channel_stride = (ptrdiff_t)camera->width * camera->height,
                                       .pixel_stride = 1,
                                       .row_stride = camera->width};
        status = make_photo(bench, renderer, v, &sources[v], &images[v]);
        sources[v].pixels = images[v].pixels;
    }
    if (!status)
        status = sgs_scene_create(sources, view_count, NULL, NULL, 0, NULL, &bench->scene);
    if (!status) // the learning rates of every scene are those of extent 1
        bench->scene->extent = 1.0;
    sgs_renderer_destroy(renderer);
    for (size_t v = 0; v < view_count; ++v)
        sgs_image8_free(&images[v]);
    bench->counts.hits /= (double)view_count;
    bench->counts.pixels /= (double)view_count;
    bench->counts.tiles /= (double)view_count;
    return status;
}

static sgs_status start_trainer(sgs_bench *bench, const sgs_gaussians *model)
{
    sgs_train_options options = sgs_train_options_default();
    options.spare = 0;
    options.init = model;
    sgs_status status = sgs_trainer_create(bench->scene, &options, &bench->trainer);
    if (status)
        return status;
    sgs_render_options *drawn = &bench->trainer->views.render;
    drawn->filter = bench->render.filter;
    drawn->near_distance = bench->render.near_distance;
    drawn->compact_box = bench->render.compact_box;
    status = sgsi_trainer_hold(bench->trainer, HELD_ITERATION);
    if (status)
        return status;
    bench->counts.primitives = (double)bench->trainer->model->count;
    sgs_bench_sample warm;
    return sgs_bench_run(bench, &warm);
}

// Of the options, what the trainer cannot take from them keeps its default.
static sgs_status read_render(const sgs_render_options *options, sgs_render_options *render)
{
    sgs_render_options own = sgs_render_options_default();
    const sgs_status status = sgsi_options_read(options, "sgs_render_options", &own, sizeof own);
    *render = sgs_render_options_default();
    render->filter = own.filter;
    render->near_distance = own.near_distance;
    render->compact_box = own.compact_box;
    if (!status && own.filter_3d)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED, "a benchmark requires a model with the 3D filter "
                                                 "fused into its scales, as in PLY files");
    return status;
}

sgs_status sgs_bench_create(const sgs_gaussians *model, const sgs_view *views, size_t view_count,
                            sgs_bench **bench)
{
    return sgs_bench_create_with(model, views, view_count, NULL, bench);
}

sgs_status sgs_bench_create_with(const sgs_gaussians *model, const sgs_view *views,
                                 size_t view_count, const sgs_render_options *options,
                                 sgs_bench **bench)
{
    *bench = NULL;
    if (view_count < 1 || view_count > VIEWS_MAX || !model->count)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "a benchmark requires 1 to %d views and a model with primitives",
                         VIEWS_MAX);
    sgs_bench *made = sgsi_calloc(1, sizeof *made);
    if (!made)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for a benchmark");
    sgs_status status = read_render(options, &made->render);
    if (!status)
        status = make_photos(made, model, views, view_count);
    if (!status)
        status = start_trainer(made, model);
    if (status) {
        sgs_bench_destroy(made);
        return status;
    }
    *bench = made;
    return SGS_STATUS_OK;
}

void sgs_bench_destroy(sgs_bench *bench)
{
    if (!bench)
        return;
    sgs_trainer_destroy(bench->trainer);
    sgs_scene_destroy(bench->scene);
    sgsi_free(bench);
}

sgs_status sgs_bench_step(sgs_bench *bench, sgs_bench_sample *sample)
{
    sgs_trainer *trainer = bench->trainer;
    const sgs_train_seconds before = trainer->progress.seconds;
    sgs_step_info info;
    const sgs_status status = sgs_trainer_step(trainer, &info);
    if (status)
        return status;
    const sgs_train_seconds *after = &trainer->progress.seconds;
    const sgsi_trace_seconds traced = sgsi_tracer_seconds(trainer->views.tracer);
    sample->refit += traced.bvh_refit;
    sample->gather += traced.gather;
    sample->project += traced.project;
    sample->forward += traced.project + traced.forward;
    sample->reduce += traced.reduce;
    sample->backward += traced.backward + traced.reduce;
    sample->loss += after->loss - before.loss;
    sample->optimizer += after->optimizer - before.optimizer;
    sample->iteration += after->total - before.total;
    sample->serial += after->serial - before.serial;
    sample->waiting += after->waiting - before.waiting;
    const sgsi_trace_counts counts = sgsi_tracer_counts(trainer->views.tracer);
    bench->counts.gathered += (double)counts.gathered;
    bench->counts.candidates += (double)counts.candidates;
    bench->counts.evaluations += (double)counts.evaluations;
    bench->counts.block_hits += (double)counts.block_hits;
    bench->counts.fallback_gathers += (double)counts.fallback_gathers;
    return SGS_STATUS_OK;
}

void sgs_bench_restore(sgs_bench *bench)
{
    sgsi_trainer_restore(bench->trainer);
}

// Builds a tree over the bounds of the last view; later steps refit it.
sgs_status sgs_bench_build(sgs_bench *bench, sgs_bench_sample *sample)
{
    sgs_trainer *trainer = bench->trainer;
    const sgs_view *source = &bench->scene->views[bench->scene->view_count - 1];
    const sgsi_rays *rays;
    sgsi_view view;
    sgs_status status = sgsi_ray_cache_get(trainer->views.rays, &source->camera, &rays);
    if (status)
        return status;
    sgsi_view_set(&view, rays, &source->pose, &bench->render);
    status = sgsi_tracer_project(trainer->views.tracer, trainer->model, &view, NULL, NULL);
    if (!status)
        status = sgsi_tracer_commit(trainer->views.tracer, true, SGSI_BVH_REFIT);
    sample->build = sgsi_tracer_seconds(trainer->views.tracer).bvh_build;
    trainer->views.rebuild = false;
    return status;
}

sgs_status sgs_bench_rank_build(sgs_bench *bench, sgs_bench_sample *sample)
{
    sgsi_train_views *views = &bench->trainer->views;
    const sgs_status status = sgsi_tracer_commit(views->tracer, true, SGSI_BVH_LOW);
    sample->rank_build = sgsi_tracer_seconds(views->tracer).bvh_build;
    views->rebuild = true;
    return status;
}

sgs_status sgs_bench_run(sgs_bench *bench, sgs_bench_sample *sample)
{
    *sample = (sgs_bench_sample){0};
    sgs_bench_counts *counts = &bench->counts;
    counts->gathered = counts->candidates = counts->evaluations = counts->block_hits =
        counts->fallback_gathers = 0;
    bench->trainer->bytes = (sgs_train_bytes){0};
    sgs_status status = sgs_bench_build(bench, sample);
    for (size_t v = 0; !status && v < bench->scene->view_count; ++v) {
        status = sgs_bench_step(bench, sample);
        sgs_bench_restore(bench);
    }
    if (status)
        return status;
    const double share = 1.0 / (double)bench->scene->view_count;
    double *const means[] = {&sample->refit,         &sample->gather,
                             &sample->forward,       &sample->backward,
                             &sample->loss,          &sample->optimizer,
                             &sample->iteration,     &sample->project,
                             &sample->reduce,        &counts->gathered,
                             &counts->candidates,    &counts->evaluations,
                             &counts->block_hits,    &counts->fallback_gathers,
                             &sample->serial,        &sample->waiting,
                             &counts->bytes.project, &counts->bytes.bvh,
                             &counts->bytes.gather,  &counts->bytes.forward,
                             &counts->bytes.loss,    &counts->bytes.backward,
                             &counts->bytes.reduce,  &counts->bytes.optimizer,
                             &counts->bytes.total,   &counts->bytes.macrotiles};
    counts->bytes = sgs_trainer_bytes(bench->trainer);
    for (size_t i = 0; i < sizeof means / sizeof *means; ++i)
        *means[i] *= share;
    counts->bytes.iterations = 1.0;
    counts->forward_flops = LANES * (counts->evaluations * RESPONSE_FLOPS +
                                     counts->block_hits * (ALPHA_FLOPS + BLEND_FLOPS));
    counts->backward_flops =
        LANES * counts->block_hits * (RESPONSE_FLOPS + ALPHA_FLOPS + BLEND_FLOPS + GRADIENT_FLOPS);
    counts->forward_l2_bytes = counts->evaluations * RECORD_BYTES;
    // Per block hit: a record read, sums read and written.
    counts->backward_l2_bytes = counts->block_hits * 3 * RECORD_BYTES;
    counts->build_bytes = counts->primitives * sizeof(sgsi_bounds) + (double)sgsi_bvh_bytes();
    return SGS_STATUS_OK;
}

sgs_bench_counts sgs_bench_counts_get(const sgs_bench *bench)
{
    return bench->counts;
}

// ---- Several machines ----

enum { MAX_RANKS = 1024 };

// Adds one view, `share` of the mean.
static void add_view(const sgsi_rank_traffic *traffic, double share, sgs_rank_prediction *to)
{
    double cost = 0.0, most_cost = 0.0, primitives = 0.0;
    for (int k = 0; k < SGS_RANKS_PURPOSE_COUNT; ++k) {
        sgs_rank_call *call = &to->calls[k];
        double max_messages = 0.0, max_bytes = 0.0;
        for (int r = 0; r < to->ranks; ++r) {
            const sgs_ranks_traffic *sent = &traffic[r].sent[k];
            call->messages += share * (double)sent->messages;
            call->bytes += share * (double)sent->bytes;
            max_messages = fmax(max_messages, (double)sent->messages);
            max_bytes = fmax(max_bytes, fmax((double)sent->bytes, (double)traffic[r].received[k]));
        }
        call->calls += share * (double)traffic[0].sent[k].calls;
        call->max_messages += share * max_messages;
        call->max_bytes += share * max_bytes;
    }
    for (int r = 0; r < to->ranks; ++r) {
        cost += traffic[r].cost;
        most_cost = fmax(most_cost, traffic[r].cost);
        primitives = fmax(primitives, (double)traffic[r].primitives);
        to->traced += share * (double)traffic[r].traced;
        to->hit += share * (double)traffic[r].hit;
    }
    to->balance += share * (most_cost > 0.0 ? cost / to->ranks / most_cost : 1.0);
    to->primitives += share * primitives;
}

// Predictions for the view of the last step. costs [cells] is a workspace.
static sgs_status predict_view(sgs_bench *bench, size_t view_index, const sgsi_tile_cost *tiles,
                               float *costs, sgsi_rank_traffic *traffic, size_t count,
                               sgs_rank_prediction *predictions)
{
    const sgs_view *source = &bench->scene->views[view_index];
    const sgsi_rays *rays;
    sgsi_view view;
    sgs_status status = sgsi_ray_cache_get(bench->trainer->views.rays, &source->camera, &rays);
    if (status)
        return status;
    sgsi_view_set(&view, rays, &source->pose, &bench->render);
    // Every step of a view does the same work: the costs are also those of its last visit.
    for (size_t i = 0; i < rays->cells.count; ++i)
        costs[i] = (float)sgsi_cell_cost(&rays->cells, tiles, i);
    const sgsi_rank_input input = {.tracer = bench->trainer->views.tracer,
                                   .view = &view,
                                   .rows = bench->trainer->model->count,
                                   .cell_costs = costs,
                                   .tiles = tiles};
    for (size_t i = 0; i < count && !status; ++i) {
        status = sgsi_rank_traffic_predict(&input, predictions[i].ranks, traffic);
        if (!status)
            add_view(traffic, 1.0 / (double)bench->scene->view_count, &predictions[i]);
    }
    return status;
}

sgs_status sgs_bench_ranks(sgs_bench *bench, const int *ranks, size_t count,
                           sgs_rank_prediction *predictions)
{
    const sgsi_train_views *views = &bench->trainer->views;
    size_t most_tiles = 0;
    for (size_t i = 0; i < count; ++i) {
        if (ranks[i] < 2 || ranks[i] > MAX_RANKS)
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%d ranks are not within 2 to %d",
                             ranks[i], MAX_RANKS);
        predictions[i] = (sgs_rank_prediction){.ranks = ranks[i]};
    }
    for (size_t v = 0; v < views->count; ++v)
        most_tiles = views->tile_counts[v] > most_tiles ? views->tile_counts[v] : most_tiles;
    sgsi_tile_cost *tiles = sgsi_calloc(most_tiles, sizeof *tiles);
    float *costs = sgsi_calloc(most_tiles, sizeof *costs); // a cell has at least one tile
    sgsi_rank_traffic *traffic = sgsi_calloc(MAX_RANKS, sizeof *traffic);
    sgs_status status = tiles && costs && traffic
                            ? SGS_STATUS_OK
                            : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                        "not enough memory to predict the traffic of ranks");
    sgsi_tracer_watch_tiles(views->tracer, tiles);
    for (size_t v = 0; v < bench->scene->view_count && !status; ++v) {
        sgs_step_info info;
        status = sgs_trainer_step(bench->trainer, &info);
        if (!status)
            status = predict_view(bench, info.view, tiles, costs, traffic, count, predictions);
        sgs_bench_restore(bench);
    }
    sgsi_tracer_watch_tiles(views->tracer, NULL);
    sgsi_free(tiles);
    sgsi_free(costs);
    sgsi_free(traffic);
    return status;
}

double sgs_rank_seconds(const sgs_rank_prediction *prediction, double latency, double bandwidth)
{
    double seconds = 0.0;
    for (int k = 0; k < SGS_RANKS_PURPOSE_COUNT; ++k) {
        const sgs_rank_call *call = &prediction->calls[k];
        const double rounds = k == SGS_RANKS_STATUS ? call->max_messages / (prediction->ranks - 1) *
                                                          ceil(log2(prediction->ranks))
                                                    : call->max_messages;
        seconds += rounds * latency + call->max_bytes / bandwidth;
    }
    return seconds;
}

// ---- Scaling ----

double sgs_scaling_predict(const sgs_scaling *s, int cores, double memory_gbs)
{
    const double width = s->cores && s->cores < s->threads ? s->cores : s->threads;
    const double work = (s->seconds - s->serial - s->waiting) * width;
    const double macrotile_seconds =
        s->macrotiles > 0.0 ? fmin(s->macrotile_seconds * width, work) : 0.0;
    const double rounds =
        s->macrotiles > 0.0 && cores > 0 ? ceil(s->macrotiles / cores) / s->macrotiles : 0.0;
    const double streaming = memory_gbs > 0.0 ? s->bytes / (1e9 * memory_gbs) : 0.0;
    const double shared =
        fmax((work - macrotile_seconds) / cores + macrotile_seconds * rounds, streaming);
    return work > 0.0 && s->serial >= 0.0 && cores > 0 ? (s->serial + work) / (s->serial + shared)
                                                       : 1.0;
}
