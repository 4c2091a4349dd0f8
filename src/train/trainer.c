// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The training loop. sgs_trainer_step runs one iteration in the order of 3DGS (Kerbl et al. 2023,
// algorithm 1): learning rates and SH degree, view, forward, loss, backward, optimiser step,
// statistics. The model may be saved now. Density control, image size and opacity reset follow at
// the beginning of the next call. Two details of the released code are kept because they affect
// quality: iterations with a structural update make no optimiser step, and moments of new rows
// start at zero although the step counter continues.

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/float_mode.h"
#include "base/threads.h"
#include "cluster/rank_calls.h"
#include "model/sh_degree.h"
#include "sparegs/option_descriptors.h"
#include "train/near_depth.h"
#include "train/rank_handshake.h"
#include "train/region_targets.h"
#include "train/small_images.h"
#include "train/traffic.h"
#include "train/trainer_state.h"
#include "train/view_ranks.h"

enum { FILTER_INTERVAL = 100 };

// ---- Creation ----

static void adopt_images(sgs_trainer *trainer, sgsi_small_images *images)
{
    if (!sgsi_small_images_adopt(&trainer->views, images))
        return;
    const int before = trainer->progress.resolution, now = trainer->views.small_images.scale;
    // Scaled schedules also change the size between updates; the released code of DashGaussian
    // changes it with updates only, when the statistics are 0.
    if (before && trainer->model)
        sgsi_statistics_resize_images(&trainer->statistics, trainer->model->count,
                                      (float)before / (float)now);
    trainer->progress.resolution = now;
    trainer->progress.disturbed = 1; // losses at different sizes are not comparable
    sgsi_train_views_forget_depths(&trainer->views);
}

static bool shrinks_images(const sgs_trainer *trainer)
{
    return trainer->pipeline->small_images && trainer->options.schedule != SGS_SCHEDULE_FINETUNE;
}

// True if the image sizes follow from the photos.
static bool plans_images(const sgs_trainer *trainer)
{
    return shrinks_images(trainer) && !trainer->scene->float_images;
}

// Plans the image sizes, if the pipeline or the schedule changes them, and sets the first one. A
// model to start from (`has_init`) is not trained with images of half the size.
static sgs_status plan_resolution(sgs_trainer *trainer, bool has_init)
{
    const bool shrinks = shrinks_images(trainer);
    if (!shrinks && !trainer->schedule.half_size_until)
        return SGS_STATUS_OK;
    if (trainer->scene->float_images) {
        if (shrinks)
            sgsi_warn("%s: some photos are not 8-bit; pipeline %s trains at full resolution",
                      trainer->scene->path, trainer->pipeline->name);
        return SGS_STATUS_OK;
    }
    sgs_status status = SGS_STATUS_OK;
    if (shrinks) {
        status = sgsi_small_images_plan(&trainer->views, trainer->schedule.densify_until,
                                        &trainer->resolution);
        trainer->schedule.lr_begin = trainer->resolution.decay_begin;
    } else {
        trainer->resolution = sgsi_resolution_half(trainer->schedule.half_size_until);
        if (has_init)
            return SGS_STATUS_OK;
    }
    sgsi_small_images images;
    if (!status)
        status = sgsi_small_images_make(&trainer->views,
                                        sgsi_resolution_at(&trainer->resolution, 1), &images);
    if (!status)
        adopt_images(trainer, &images);
    return status;
}

static sgs_status create_parts(sgs_trainer *trainer, sgsi_float_mode caller_mode)
{
    sgsi_train_views *views = &trainer->views;
    sgs_status status = sgsi_train_views_create(trainer->scene, &trainer->options, views);
    if (status)
        return status;
    views->caller_mode = caller_mode;
    const bool random = sgs_train_random_points(trainer->scene, &trainer->options) > 0;
    trainer->progress.start = random ? SGSI_START_RANDOM : SGSI_START_GIVEN;
    trainer->schedule = sgsi_train_schedule(trainer->scene, &trainer->options, random);
    if (trainer->schedule.near_depth > 0.0)
        status = sgsi_near_depth_limit(trainer->scene, &trainer->progress.near_limit);
    if (status)
        return status;
    views->ssim_weight = (float)trainer->schedule.ssim_weight;
    views->ssim_sigma = (float)trainer->schedule.ssim_sigma;
    const bool has_init = trainer->options.init != NULL;
    trainer->order = sgsi_calloc(views->count, sizeof *trainer->order);
    trainer->view_fits = sgsi_calloc(2 * views->count, sizeof *trainer->view_fits);
    const bool prefetches = sgs_scene_prefetch_count(trainer->scene) > 0;
    if (prefetches)
        trainer->next_order = sgsi_calloc(views->count, sizeof *trainer->next_order);
    if (!trainer->order || !trainer->view_fits || (prefetches && !trainer->next_order))
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu views", views->count);
    status = sgsi_trainer_create_model(trainer);
    const bool mixes = trainer->fixed && !trainer->options.exposure;
    views->to_prepare = ((size_t)mixes + plans_images(trainer)) * views->count;
    if (!status && mixes)
        status = sgsi_region_targets_make(views, trainer->model, sgsi_trainer_trained(trainer),
                                          trainer->filter_3d);
    return status ? status : plan_resolution(trainer, has_init);
}

// takes: takes over `init`, which may be NULL, in place of options->init, also after a failure.
static sgs_status create(const sgs_scene *scene, const sgs_train_options *options, bool takes,
                         sgs_gaussians *init, sgsi_float_mode caller_mode, sgs_trainer **trainer)
{
    *trainer = NULL;
    sgs_train_options own = sgs_train_options_default();
    sgs_status status = sgsi_options_read(options, "sgs_train_options", &own, sizeof own);
    if (takes)
        own.init = init;
    if (!status)
        status = sgs_train_options_check(&own);
    if (!status && !own.init && !sgs_box_is_infinite(&own.region))
        status = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "region requires init");
    if (!status && own.init)
        status = sgsi_sh_degree_check(own.init, NULL);
    sgs_trainer *made = status ? NULL : sgsi_calloc(1, sizeof *made);
    if (!status && !made)
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for a trainer");
    if (status) {
        sgs_gaussians_destroy(init);
        return status;
    }
    made->model = init;
    made->scene = scene;
    made->options = own;
    made->pipeline = sgsi_pipeline_get(own.pipeline);
    made->sampling = sgsi_pipeline_sampling(&own, scene->extent);
    made->progress.last_reset = -1;
    spare_equilibrium_begin(&made->progress.equilibrium);
    status = create_parts(made, caller_mode);
    if (status) {
        sgs_trainer_destroy(made);
        return status;
    }
    *trainer = made;
    return SGS_STATUS_OK;
}

sgs_status sgs_trainer_create(const sgs_scene *scene, const sgs_train_options *options,
                              sgs_trainer **trainer)
{
    const sgsi_float_mode mode = sgsi_float_mode_enter();
    const sgs_status status = create(scene, options, false, NULL, mode, trainer);
    sgsi_float_mode_set(mode);
    return status;
}

sgs_status sgs_trainer_create_from(const sgs_scene *scene, const sgs_train_options *options,
                                   sgs_gaussians **init, sgs_trainer **trainer)
{
    sgs_gaussians *taken = *init;
    *init = NULL;
    const sgsi_float_mode mode = sgsi_float_mode_enter();
    const sgs_status status = create(scene, options, true, taken, mode, trainer);
    sgsi_float_mode_set(mode);
    return status;
}

void sgs_trainer_destroy(sgs_trainer *trainer)
{
    if (!trainer)
        return;
    sgsi_train_views_free(&trainer->views);
    sgsi_statistics_free(&trainer->statistics);
    sgsi_view_scores_free(&trainer->scores);
    sgs_gaussians_destroy(trainer->model);
    sgsi_trainer_release(trainer);
    void *const arrays[] = {(void *)trainer->regions.regions,
                            trainer->m,
                            trainer->v,
                            trainer->order,
                            trainer->next_order,
                            trainer->view_fits,
                            trainer->cloud_points,
                            trainer->cloud_colors,
                            trainer->accumulated_grad,
                            trainer->accumulated_rows,
                            trainer->filter_3d,
                            trainer->held_params};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; ++i)
        sgsi_free(arrays[i]);
    sgsi_free(trainer);
}

// ---- One iteration ----

// The permutation of the views in an epoch; it depends on seed and epoch only.
static void shuffle_views(const sgs_trainer *trainer, uint64_t epoch, uint32_t *order)
{
    sgsi_random_permutation(sgsi_random_bits(trainer->options.seed ^ 0x0EDE2, epoch),
                            trainer->views.count, order);
}

static size_t next_view(sgs_trainer *trainer)
{
    sgsi_train_progress *progress = &trainer->progress;
    const size_t n = trainer->views.count;
    if (progress->order_position >= n || (!progress->order_position && !progress->order_epoch)) {
        progress->order_position = 0;
        ++progress->order_epoch;
    }
    if (!progress->order_position)
        shuffle_views(trainer, progress->order_epoch, trainer->order);
    return trainer->order[progress->order_position++];
}

// Prefetches the views of the following iterations, also of the next epoch.
static void prefetch_views(sgs_trainer *trainer, int iteration)
{
    const size_t n = trainer->views.count, first = trainer->progress.order_position,
                 most = trainer->views.targets ? 0 : sgs_scene_prefetch_count(trainer->scene),
                 left = (size_t)(trainer->options.iterations - iteration),
                 ahead = most < left ? most : left;
    const uint64_t next_epoch = trainer->progress.order_epoch + 1;
    for (size_t i = first; i < first + ahead && i < first + n - 1; ++i) {
        if (i >= n && trainer->next_epoch != next_epoch) {
            shuffle_views(trainer, next_epoch, trainer->next_order);
            trainer->next_epoch = next_epoch;
        }
        const size_t view = i < n ? trainer->order[i] : trainer->next_order[i - n];
        sgs_scene_prefetch(trainer->scene, trainer->views.scene_views[view]);
    }
}

// Iterations per additional SH band. Runs with a region use all bands at once, because the
// primitives outside are already trained. A region without such primitives has the same schedule,
// so that all blocks of a scene are trained in the same way.
static int sh_interval(const sgs_trainer *trainer)
{
    return sgs_box_is_infinite(&trainer->options.region) ? trainer->schedule.sh_interval : 0;
}

static int active_sh_degree(const sgs_trainer *trainer, int iteration)
{
    const int interval = sh_interval(trainer);
    const int degree = interval ? iteration / interval : trainer->options.sh_degree;
    return degree < trainer->options.sh_degree ? degree : trainer->options.sh_degree;
}

// True if statistics for density control are collected.
static bool collects_statistics(const sgs_trainer *trainer, int iteration)
{
    return sgsi_schedule_needs_statistics(&trainer->schedule, iteration);
}

// The next view and its photo. After a failure the same view is next.
static sgs_status begin_view(sgs_trainer *trainer, int iteration, sgsi_train_view *view)
{
    const sgsi_train_progress before = trainer->progress;
    const bool collects = collects_statistics(trainer, iteration);
    sgsi_tracer_collect_abs_grad(trainer->views.tracer,
                                 collects && sgsi_trainer_uses_abs_grad(trainer, iteration));
    *view = (sgsi_train_view){.iteration = iteration,
                              .index = next_view(trainer),
                              .model = trainer->model,
                              .filter_3d = trainer->filter_3d,
                              .sh_degree = active_sh_degree(trainer, iteration),
                              .visible_count = collects ? trainer->statistics.visible_count : NULL,
                              .radius_max = collects ? trainer->statistics.radius_max : NULL,
                              .seconds = &trainer->progress.seconds};
    prefetch_views(trainer, iteration);
    const sgs_status status = sgsi_train_view_fetch(&trainer->views, view);
    if (status)
        trainer->progress = before;
    return status;
}

// Warns if no training view contains a primitive: the run would succeed with an empty result.
static void check_visibility(sgs_trainer *trainer, int iteration)
{
    const bool seen = sgsi_trainer_is_shared(trainer)
                          ? (sgs_ranks_raised(trainer->views.ranks) & SGSI_RANKS_SEEN) != 0
                          : sgsi_tracer_counts(trainer->views.tracer).block_hits != 0;
    trainer->seen = trainer->seen || seen;
    if (!trainer->seen && (size_t)iteration == trainer->views.count)
        sgsi_warn("%s: no primitive is visible in any of the %zu training views; do the points (or "
                  "option init) belong to these cameras?",
                  trainer->scene->path, trainer->views.count);
}

// True if this iteration changes the parameters.
static bool ends_batch(const sgs_trainer *trainer, int iteration)
{
    return sgsi_trainer_makes_step(trainer, iteration) &&
           sgsi_trainer_ends_batch(trainer, iteration);
}

static void count_traffic(sgs_trainer *trainer, const sgsi_train_view *view)
{
    const sgsi_rays *rays = view->view.rays;
    const sgsi_traffic traffic = {
        .tracer = trainer->views.tracer,
        .rows = trainer->views.rows,
        .primitives = trainer->model->count,
        .pixels = (size_t)view->planes.width * (size_t)view->planes.height,
        .tiles = (size_t)rays->tiles_x * (size_t)rays->tiles_y,
        .macrotiles = (size_t)rays->macrotiles_x * (size_t)rays->macrotiles_y,
        .sh_degree = view->view.sh_degree,
        .channels = view->source->image.channels,
        .collects = view->visible_count != NULL,
        .steps = ends_batch(trainer, view->iteration),
        .dense = trainer->schedule.dense};
    sgsi_traffic_add(&traffic, &trainer->bytes);
}

// From the photo of a view to updated parameters.
static sgs_status train_on_view(sgs_trainer *trainer, sgsi_train_view *view, sgs_step_info *info)
{
    sgsi_train_views *views = &trainer->views;
    // Rays of the view's tiles, projected primitives; the BVH is rebuilt after density control,
    // otherwise refitted to the bounds of this view.
    sgs_status status = sgsi_train_view_project(views, view);
    // Macrotiles gather candidates from the BVH; kernels evaluate, order and blend them.
    if (!status)
        status = sgsi_train_view_forward(views, view);
    if (status)
        return status;
    check_visibility(trainer, view->iteration);
    // Loss against the photo, and its gradient image.
    status = sgsi_train_view_loss(views, view);
    // The same tiles backward: one gradient record per (tile, primitive), summed per primitive in
    // tile order.
    if (!status)
        status = sgsi_train_view_backward(views, view);
    if (status)
        return status;
    count_traffic(trainer, view);
    if (!isfinite(view->loss.loss)) {
        sgsi_skip_step(&trainer->progress.skipped, view->iteration, view->source->name,
                       view->loss.loss);
        return SGS_STATUS_OK;
    }
    if (views->exposure && view->iteration < trainer->options.iterations)
        sgsi_exposure_step(views->exposure, view->index,
                           sgsi_exposure_lr(view->iteration, trainer->options.iterations));
    // Chain rule, statistics for density control, Adam.
    const bool steps = ends_batch(trainer, view->iteration);
    const int batch = trainer->progress.batch_views + 1;
    status = sgsi_trainer_optimize(trainer, view, &info->visible);
    if (!status && steps)
        sgsi_trainer_add_noise(trainer, view->iteration, batch);
    return status;
}

// Clones, splits and removes primitives; computes scores from views if the pipeline uses them.
static sgs_status control_density(sgs_trainer *trainer, int iteration, sgs_step_info *info)
{
    const sgsi_view_scores *scores = NULL;
    if (trainer->pipeline->score_views) {
        const double start = sgsi_seconds();
        const sgsi_score_input input = {.pipeline = trainer->pipeline,
                                        .model = trainer->model,
                                        .count = sgsi_trainer_own(trainer),
                                        .whole_count = sgsi_trainer_trained(trainer),
                                        .filter_3d = trainer->filter_3d,
                                        .sh_degree = active_sh_degree(trainer, iteration),
                                        .iteration = iteration,
                                        .statistics = &trainer->statistics};
        const sgs_status status =
            sgsi_view_scores_compute(&trainer->views, &input, &trainer->scores);
        trainer->progress.seconds.density += sgsi_seconds() - start;
        if (status)
            return status; // nothing has changed
        scores = &trainer->scores;
    }
    trainer->inconsistent = true;
    const sgs_status status = sgsi_trainer_update_structure(trainer, iteration, scores, info);
    if (sgsi_trainer_is_shared(trainer)) // they have a row for each primitive of all ranks
        sgsi_view_scores_free(&trainer->scores);
    if (!status)
        trainer->inconsistent = false;
    return status;
}

// Applies density control, image size and opacity reset of the previous iteration. If a photo
// cannot be read, the trainer is unchanged.
static sgs_status apply_deferred(sgs_trainer *trainer, sgs_step_info *info)
{
    sgsi_train_progress *progress = &trainer->progress;
    const sgsi_schedule *schedule = &trainer->schedule;
    const int iteration = progress->iteration;
    if (progress->structure_iteration >= iteration)
        return SGS_STATUS_OK;
    sgsi_small_images images = {0};
    sgs_status status = SGS_STATUS_OK;
    if (progress->resolution && sgsi_schedule_may_resize(schedule, iteration)) {
        status = sgsi_small_images_make(
            &trainer->views, sgsi_resolution_at(&trainer->resolution, iteration), &images);
        if (trainer->views.ranks) // all ranks resize, or none
            status = sgs_ranks_agree(trainer->views.ranks, status);
    }
    if (!status && sgsi_schedule_is_update(schedule, iteration))
        status = control_density(trainer, iteration, info);
    if (status) {
        sgsi_small_images_free(&images);
        return status;
    }
    adopt_images(trainer, &images);
    if (sgsi_schedule_is_structural(schedule, iteration))
        sgsi_trainer_add_noise(trainer, iteration, 1);
    if (sgsi_schedule_is_reset(schedule, iteration))
        sgsi_trainer_reset_opacity(trainer, iteration);
    progress->structure_iteration = iteration;
    return SGS_STATUS_OK;
}

// Mip-Splatting: positions still change after the last structural update.
static sgs_status refresh_filter_3d(sgs_trainer *trainer, int iteration)
{
    const bool due = trainer->filter_3d && iteration > trainer->schedule.densify_until &&
                     iteration % FILTER_INTERVAL == 0 &&
                     iteration < trainer->options.iterations - FILTER_INTERVAL;
    return due ? sgsi_trainer_update_filter_3d(trainer) : SGS_STATUS_OK;
}

static double follow(double *average, double *weight, double value)
{
    if (isfinite(value)) {
        *average = 0.98 * *average + 0.02 * value;
        *weight = 0.98 * *weight + 0.02;
    }
    return *weight > 0.0 ? *average / *weight : 0.0;
}

static void fill_info(sgs_trainer *trainer, const sgsi_train_view *view, sgs_step_info *info)
{
    sgsi_train_progress *progress = &trainer->progress;
    const sgsi_loss_output *loss = &view->loss;
    info->iteration = view->iteration;
    info->view = (size_t)(view->source - trainer->scene->views);
    info->loss = loss->loss;
    info->loss_average = follow(&progress->loss_average, &progress->loss_weight, loss->loss);
    info->psnr_average = follow(&progress->psnr_average, &progress->psnr_weight,
                                -10.0 * log10(fmax(loss->mse, 1e-12)));
    info->gaussians = trainer->count;
    const sgsi_trace_counts counts = sgsi_tracer_counts(trainer->views.tracer);
    info->callbacks = counts.callbacks;
    info->candidates = counts.candidates;
    info->fallback_gathers = counts.fallback_gathers;
}

// Time of the step that began at `start`.
static void account_step(sgs_trainer *trainer, double start, sgsi_loop_seconds loops)
{
    sgs_train_seconds *seconds = &trainer->progress.seconds;
    const sgsi_loop_seconds now = sgsi_threads_seconds();
    const double total = sgsi_seconds() - start;
    seconds->total += total;
    seconds->serial += total - (now.inside - loops.inside);
    seconds->waiting += now.waiting - loops.waiting;
}

static sgs_status check_ready(const sgs_trainer *trainer)
{
    const sgsi_train_progress *progress = &trainer->progress;
    if (progress->stop != SGS_STOP_NONE)
        return sgsi_fail(SGS_STATUS_LIMIT, "training has ended after %d iterations",
                         progress->iteration);
    if (trainer->inconsistent)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "the step after iteration %d failed and left an inconsistent state; load "
                         "a checkpoint",
                         progress->iteration);
    return SGS_STATUS_OK;
}

// Continues a run that completed a shorter schedule: its last iteration changed counters only and
// is repeated, so that the state equals that of a run with the present length. The rate of exposure
// and the last refreshes of the 3D filter depend on the length and are those of the shorter one. If
// the shorter run ended at a final pruning (fastgs), its last batch stayed open and is dropped. If
// it ended with the densification and has linear opacities, it has converted them, and the repeated
// iteration trains the converted ones.
static sgs_status repeat_last(sgs_trainer *trainer)
{
    sgsi_train_progress *progress = &trainer->progress;
    sgs_step_info info;
    if (progress->stop != SGS_STOP_SCHEDULE || progress->iteration >= trainer->options.iterations)
        return SGS_STATUS_OK;
    const sgsi_train_progress before = *progress;
    progress->stop = SGS_STOP_NONE;
    --progress->iteration;
    --progress->order_position;
    const sgs_status status = sgs_trainer_step(trainer, &info);
    if (status) { // the next call repeats it
        progress->stop = before.stop;
        progress->iteration = before.iteration;
        progress->order_position = before.order_position;
        return status;
    }
    if (progress->stop == SGS_STOP_NONE)
        trainer->stop_text[0] = '\0';
    // The averages and the counts already include it.
    progress->loss_average = before.loss_average;
    progress->loss_weight = before.loss_weight;
    progress->psnr_average = before.psnr_average;
    progress->psnr_weight = before.psnr_weight;
    progress->skipped = before.skipped;
    return SGS_STATUS_OK;
}

// One iteration; a failure of this rank alone is not known to the others yet.
static sgs_status step(sgs_trainer *trainer, sgs_step_info *info)
{
    const double start = sgsi_seconds();
    const sgsi_loop_seconds loops = sgsi_threads_seconds();
    sgsi_trainer_release(trainer);
    sgs_status status = sgsi_trainer_reserve_state(trainer);
    if (!status)
        status = apply_deferred(trainer, info);
    if (status)
        return status;
    const int iteration = trainer->progress.iteration + 1;
    sgsi_train_view view;
    const sgsi_train_progress before = trainer->progress;
    status = begin_view(trainer, iteration, &view);
    if (trainer->views.ranks) // before anything changes, so that all ranks stay consistent
        status = sgs_ranks_agree(trainer->views.ranks, status);
    if (status) {
        trainer->progress = before;
        return status;
    }
    trainer->inconsistent = true;
    status = train_on_view(trainer, &view, info);
    if (!status)
        status = refresh_filter_3d(trainer, iteration);
    if (status)
        return status;
    trainer->progress.iteration = iteration;
    sgsi_trainer_convert_opacity(trainer);
    fill_info(trainer, &view, info);
    info->stop = sgsi_trainer_decide_stop(trainer, view.index, view.loss.loss);
    trainer->progress.stop = info->stop;
    trainer->inconsistent = false;
    account_step(trainer, start, loops);
    return SGS_STATUS_OK;
}

bool sgs_trainer_update_refused(const sgs_trainer *trainer)
{
    return trainer->update_refused;
}

static sgs_status step_on_all_ranks(sgs_trainer *trainer, sgs_step_info *info)
{
    *info = (sgs_step_info){.mean_weight = 1.0};
    sgs_status status = repeat_last(trainer);
    if (!status)
        status = check_ready(trainer);
    if (status)
        return status; // the same on all ranks
    trainer->update_refused = false;
    status = step(trainer, info);
    if (!status)
        return SGS_STATUS_OK;
    // All ranks refuse the same update, unless one of them failed.
    const sgs_status own = trainer->update_refused ? SGS_STATUS_OK : status;
    const sgs_status failed = sgs_ranks_agree(trainer->views.ranks, own);
    return failed ? failed : status;
}

sgs_status sgs_trainer_step(sgs_trainer *trainer, sgs_step_info *info)
{
    const sgsi_float_mode mode = sgsi_float_mode_enter();
    const sgs_status status = step_on_all_ranks(trainer, info);
    sgsi_float_mode_set(mode);
    return status;
}

// ---- Measurements ----

sgs_status sgsi_trainer_hold(sgs_trainer *trainer, int iteration)
{
    const size_t bytes = trainer->model->capacity * SGS_PARAM_COUNT * sizeof(float);
    sgsi_free(trainer->held_params);
    trainer->held_params = sgsi_alloc(bytes, 1);
    if (!trainer->held_params)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for a second copy of %zu primitives",
                         trainer->model->count);
    memcpy(trainer->held_params, trainer->model->data, bytes);
    trainer->held_iteration = iteration;
    sgsi_trainer_restore(trainer);
    return SGS_STATUS_OK;
}

void sgsi_trainer_restore(sgs_trainer *trainer)
{
    const size_t bytes = trainer->model->capacity * SGS_PARAM_COUNT * sizeof(float);
    memcpy(trainer->model->data, trainer->held_params, bytes);
    trainer->progress.iteration = trainer->progress.structure_iteration = trainer->held_iteration;
}

// ---- State ----

// A limit of this rank concerns the updates of all.
static void announce_limit(const sgs_trainer *trainer)
{
    if (trainer->memory_limit)
        sgs_ranks_raise(trainer->views.ranks, SGSI_RANKS_LIMITED);
}

sgs_status sgs_trainer_ranks_set(sgs_trainer *trainer, sgs_ranks *ranks)
{
    sgs_status status = sgsi_view_ranks_create(&trainer->views, ranks);
    announce_limit(trainer);
    status = sgs_ranks_agree(ranks, status);
    if (!status && ranks)
        status = sgsi_rank_handshake(&trainer->views, trainer->model, trainer->progress.near_limit,
                                     ranks);
    return status || !sgsi_trainer_is_shared(trainer) ? status : sgsi_trainer_share(trainer);
}

void sgs_trainer_memory_limit_set(sgs_trainer *trainer, size_t bytes, size_t image_cache)
{
    trainer->memory_limit = bytes;
    trainer->image_cache = image_cache;
    const size_t rays = sgs_train_ray_limit(bytes);
    if (bytes && rays < sgsi_ray_cache_limit(trainer->views.rays))
        sgsi_ray_cache_limit_set(trainer->views.rays, rays);
    announce_limit(trainer);
}

void sgs_trainer_memory_reserve_set(sgs_trainer *trainer, size_t bytes, size_t row_bytes)
{
    trainer->reserved_bytes = bytes;
    trainer->reserved_row_bytes = row_bytes;
}

void sgs_trainer_ray_limit_set(sgs_trainer *trainer, size_t bytes)
{
    sgsi_ray_cache_limit_set(trainer->views.rays, bytes);
}

bool sgs_trainer_is_consistent(const sgs_trainer *trainer)
{
    return !trainer->inconsistent;
}

int sgs_trainer_structure_iteration(const sgs_trainer *trainer)
{
    return trainer->progress.structure_iteration;
}

const sgs_gaussians *sgs_trainer_model(const sgs_trainer *trainer)
{
    return trainer->collected ? trainer->collected : trainer->model;
}

size_t sgs_trainer_count(const sgs_trainer *trainer)
{
    return trainer->count;
}

size_t sgs_trainer_trained(const sgs_trainer *trainer)
{
    return sgsi_trainer_trained(trainer);
}

const double *sgs_trainer_exposure(const sgs_trainer *trainer, size_t view)
{
    const sgsi_train_views *views = &trainer->views;
    for (size_t i = 0; views->exposure && i < views->count; ++i)
        if (views->scene_views[i] == view)
            return sgsi_exposure_map(views->exposure, i);
    return NULL;
}

const float *sgs_trainer_filter_3d(const sgs_trainer *trainer)
{
    return trainer->collected ? trainer->collected_filter : trainer->filter_3d;
}

sgs_regions sgs_trainer_regions(const sgs_trainer *trainer)
{
    return trainer->regions;
}

int sgs_trainer_iteration(const sgs_trainer *trainer)
{
    return trainer->progress.iteration;
}

sgs_train_bytes sgs_trainer_bytes(const sgs_trainer *trainer)
{
    return trainer->bytes;
}

sgs_train_milestones sgs_trainer_milestones(const sgs_trainer *trainer)
{
    const sgsi_schedule *schedule = &trainer->schedule;
    const bool grows = sgsi_schedule_first_update(schedule) > 0,
               resets = sgsi_schedule_is_reset(schedule, schedule->reset_interval),
               halves = trainer->progress.resolution && !trainer->pipeline->small_images;
    const size_t limit = trainer->options.max_gaussians,
                 initial = (size_t)trainer->progress.pipeline.initial_count;
    const bool limits =
        trainer->pipeline->limit && trainer->options.schedule != SGS_SCHEDULE_FINETUNE;
    return (sgs_train_milestones){
        .densify_from = grows ? schedule->densify_from : 0,
        .densify_until = grows ? schedule->densify_until : 0,
        .densify_interval = grows ? schedule->densify_interval : 0,
        .reset_interval = resets ? schedule->reset_interval : 0,
        .thin_until = grows ? schedule->thin_until : 0,
        .half_size_until = halves ? schedule->half_size_until : 0,
        .sh_interval = sh_interval(trainer),
        .gradient_factor = schedule->threshold_factor,
        .shape_factor = schedule->lr_shape,
        .sh_factor = schedule->lr_sh,
        .opacity_factor = schedule->lr_opacity,
        .ssim_weight = schedule->ssim_weight,
        .ssim_sigma = schedule->ssim_sigma,
        .optimizer = schedule->dense ? SGS_OPTIMIZER_DENSE : SGS_OPTIMIZER_SPARSE,
        .max_gaussians = limits ? trainer->pipeline->limit(limit, initial) : limit};
}

sgs_train_seconds sgs_trainer_seconds(const sgs_trainer *trainer)
{
    return trainer->progress.seconds;
}

sgs_train_skipped sgs_trainer_skipped(const sgs_trainer *trainer)
{
    const sgsi_skipped *skipped = &trainer->progress.skipped;
    return (sgs_train_skipped){.steps = skipped->steps, .gradients = skipped->gradients};
}

const char *sgs_trainer_stop_text(const sgs_trainer *trainer)
{
    return trainer->stop_text;
}

size_t sgs_trainer_initial_cloud(const sgs_trainer *trainer, const float **points,
                                 const unsigned char **colors)
{
    *points = trainer->cloud_points;
    *colors = trainer->cloud_colors;
    return trainer->cloud_count;
}
