// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// What the trainer does to the structure of its model: the updates of the base pipeline with
// SPARE-GS's hooks, opacity resets, and the decision that nothing moves any more.

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "train/trainer_state.h"

sgs_status sgsi_trainer_reserve_accumulated_grad(sgs_trainer *trainer)
{
    if (!trainer->schedule.batch_rest)
        return SGS_STATUS_OK;
    const size_t capacity = trainer->model->capacity;
    sgsi_free(trainer->accumulated_grad);
    sgsi_free(trainer->accumulated_rows);
    trainer->accumulated_grad = sgsi_calloc_shared(capacity, SGS_PARAM_COUNT * sizeof(float));
    trainer->accumulated_rows = sgsi_calloc(capacity / SGS_LANES + 1, 2 * sizeof(uint16_t));
    if (trainer->accumulated_grad && trainer->accumulated_rows)
        return SGS_STATUS_OK;
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for the gradients of %zu primitives",
                     trainer->model->count);
}

sgs_status sgsi_trainer_update_filter_3d(sgs_trainer *trainer)
{
    if (trainer->options.filter != SGS_FILTER_MIP)
        return SGS_STATUS_OK;
    sgsi_free(trainer->filter_3d);
    trainer->filter_3d = sgsi_calloc(trainer->model->capacity, sizeof *trainer->filter_3d);
    if (!trainer->filter_3d)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for the 3D filter of %zu primitives",
                         trainer->model->count);
    sgsi_filter_3d_compute(trainer->model, trainer->scene, trainer->train_views,
                           trainer->train_view_count, trainer->filter_3d);
    return SGS_STATUS_OK;
}

// Taming 3DGS treats opacities in its own way once densification is over.
static bool opacities_are(const sgs_trainer *trainer, sgs_taming_opacity treated, int iteration)
{
    return trainer->options.pipeline == SGS_PIPELINE_TAMING &&
           trainer->options.pipeline_options.taming_opacity == treated &&
           iteration >= trainer->schedule.densify_until;
}

float sgsi_trainer_lr_opacity(const sgs_trainer *trainer, int iteration)
{
    return opacities_are(trainer, SGS_TAMING_FROZEN, iteration) ? 0.0f
                                                                : trainer->pipeline->lr_opacity;
}

bool sgsi_trainer_opacity_is_linear(const sgs_trainer *trainer)
{
    return opacities_are(trainer, SGS_TAMING_LINEAR, trainer->progress.iteration);
}

void sgsi_trainer_convert_opacity(sgs_trainer *trainer)
{
    sgs_gaussians *model = trainer->model;
    if (!sgsi_trainer_opacity_is_linear(trainer) || model->linear_opacity)
        return;
    sgs_gaussians_linearize_opacity(model);
    for (size_t block = 0; block < model->capacity / SGS_LANES; ++block) {
        const size_t at = (block * SGS_PARAM_COUNT + SGS_PARAM_OPACITY) * SGS_LANES;
        memset(trainer->m + at, 0, SGS_LANES * sizeof(float));
        memset(trainer->v + at, 0, SGS_LANES * sizeof(float));
    }
}

static spare_options spare_settings(const sgs_train_options *o, double gradient_threshold)
{
    spare_options spare = spare_options_default();
    spare.tau_gradient = gradient_threshold;
    spare.grid = o->spare_grid;
    spare.tau_alpha = o->spare_tau_alpha;
    spare.phi = (spare_phi)o->spare_phi;
    spare.budget_scale = o->spare_budget;
    spare.use_h = o->spare_demand & SGS_DEMAND_H;
    spare.use_v = o->spare_demand & SGS_DEMAND_V;
    spare.use_c = o->spare_demand & SGS_DEMAND_C;
    return spare;
}

sgs_status sgsi_trainer_update_structure(sgs_trainer *trainer, int iteration, sgs_step_info *info)
{
    const double start = sgsi_seconds();
    const sgs_train_options *o = &trainer->options;
    const sgsi_schedule *schedule = &trainer->schedule;
    sgsi_progress *progress = &trainer->progress;
    const double extent = trainer->scene->extent,
                 gradient_threshold = 2e-4 * schedule->threshold_factor;
    const bool rests =
        spare_pruning_rests(iteration, progress->last_reset, schedule->densify_interval);
    const bool final_prune = !sgsi_schedule_is_structural(schedule, iteration);
    if (trainer->pipeline->score_views) {
        const sgs_status status = sgsi_trainer_score(trainer, iteration);
        if (status)
            return status; // nothing is changed yet
    }
    trainer->inconsistent = true;
    const sgsi_density_options options = {
        .pipeline = trainer->pipeline,
        .train = o,
        .state = &progress->pipeline,
        .extent = extent,
        .update = progress->updates,
        .update_count = sgsi_schedule_updates(schedule),
        .until = schedule->densify_until,
        .interval = schedule->densify_interval,
        .resolution = progress->resolution ? progress->resolution : 1,
        .final_prune = final_prune,
        .importance = trainer->scores.importance,
        .prune_score = trainer->scores.prune_score,
        .gradient_threshold = gradient_threshold,
        .opacity_min = 0.005,
        .size_split = 0.01 * extent,
        .size_max =
            sgsi_schedule_prunes_large(schedule, progress->last_reset) ? 0.1 * extent : INFINITY,
        .max_count = o->max_gaussians,
        .seed = o->seed,
        .iteration = iteration,
        .spare_densify = (o->spare & SGS_SPARE_BMD) && !final_prune,
        .spare_prune = (o->spare & SGS_SPARE_RAP) && !rests && !final_prune,
        .spare = spare_settings(o, gradient_threshold)};
    sgsi_density_result result;
    sgs_status status = sgsi_density_update(trainer->model, &trainer->m, &trainer->v,
                                            &trainer->statistics, &options, &result);
    sgsi_free((void *)trainer->regions.regions);
    trainer->regions = (sgs_regions){.iteration = result.region_list ? iteration : 0,
                                     .grid = o->spare_grid,
                                     .count = result.region_list ? result.regions : 0,
                                     .regions = result.region_list};
    memcpy(trainer->regions.low, result.region_low, sizeof result.region_low);
    memcpy(trainer->regions.cell, result.region_cell, sizeof result.region_cell);
    if (!status)
        status = sgsi_trainer_reserve_accumulated_grad(trainer);
    if (!status)
        status = sgsi_trainer_update_filter_3d(trainer);
    if (status)
        return status;
    if (trainer->pipeline->opacity_ceiling > 0.0f && !final_prune)
        sgsi_density_reset_opacity(trainer->model, trainer->m, trainer->v,
                                   (double)trainer->pipeline->opacity_ceiling, NULL);
    trainer->structure_changed = true;
    progress->updates += !final_prune;
    info->structural = true;
    info->structure_iteration = iteration;
    info->gaussians = trainer->model->count;
    info->densified = result.cloned + result.split;
    info->pruned = result.pruned;
    info->spare_pruned = result.spare_pruned;
    info->regions = result.regions;
    info->over_budget_share = result.over_budget_share;
    info->mean_weight = result.mean_weight;
    info->bmd_suppressed = result.bmd_suppressed;
    info->bmd_boosted = result.bmd_boosted;
    info->spare_seconds = result.spare_seconds;
    progress->seconds.spare += result.spare_seconds;
    progress->seconds.density += sgsi_seconds() - start - result.spare_seconds;
    trainer->inconsistent = false;
    return SGS_STATUS_OK;
}

void sgsi_trainer_forget_depths(sgs_trainer *trainer)
{
    for (size_t i = 0; i < trainer->train_view_count; ++i)
        for (size_t t = 0; t < trainer->tile_counts[i]; ++t)
            trainer->depth_bounds[i][t] = INFINITY;
}

static void reset_opacity(sgs_trainer *trainer, int iteration)
{
    sgsi_density_reset_opacity(trainer->model, trainer->m, trainer->v, 0.01, trainer->filter_3d);
    trainer->progress.last_reset = iteration;
    trainer->progress.reset_since_check = 1;
    sgsi_trainer_forget_depths(trainer); // nothing is opaque now
}

sgs_status sgsi_trainer_apply_deferred(sgs_trainer *trainer, sgs_step_info *info)
{
    sgsi_progress *progress = &trainer->progress;
    const sgsi_schedule *schedule = &trainer->schedule;
    const int iteration = progress->iteration;
    if (progress->structure_iteration >= iteration)
        return SGS_STATUS_OK;
    sgsi_small_images next;
    sgs_status status = sgsi_trainer_next_resolution(trainer, iteration, &next);
    if (status)
        return status;
    if (sgsi_schedule_is_structural(schedule, iteration) ||
        sgsi_schedule_is_final_prune(schedule, iteration))
        status = sgsi_trainer_update_structure(trainer, iteration, info);
    if (status) {
        sgsi_small_images_free(&next);
        return status;
    }
    sgsi_trainer_adopt_resolution(trainer, &next);
    if (sgsi_schedule_is_reset(schedule, iteration))
        reset_opacity(trainer, iteration);
    progress->structure_iteration = iteration;
    return SGS_STATUS_OK;
}

static void describe_equilibrium(sgs_trainer *trainer)
{
    const spare_equilibrium *e = &trainer->progress.equilibrium;
    snprintf(trainer->stop_text, sizeof trainer->stop_text,
             "stopped at %d of %d: loss changed %.2f %%, count %.2f %% in the last of %d checks",
             trainer->progress.iteration, trainer->options.iterations, 100.0 * e->last_loss_change,
             100.0 * e->last_count_change, trainer->options.spare_patience);
}

// Whether the loss can show an equilibrium: densification has ended, and every training view has
// been seen twice since the last structural update or opacity reset. Until then the average still
// falls from those changes, and a short run would end long before its schedule does.
static bool may_be_in_equilibrium(const sgs_trainer *trainer)
{
    const sgsi_schedule *schedule = &trainer->schedule;
    const int iteration = trainer->progress.iteration;
    const size_t epochs = 2 * trainer->train_view_count;
    if (iteration < schedule->densify_until || (size_t)iteration < epochs)
        return false;
    const int calm_since = iteration - (int)epochs;
    if (trainer->progress.last_reset > calm_since)
        return false;
    for (int i = iteration; i > calm_since; --i)
        if (sgsi_schedule_is_structural(schedule, i) || sgsi_schedule_is_final_prune(schedule, i))
            return false;
    return true;
}

sgs_stop_reason sgsi_trainer_decide_stop(sgs_trainer *trainer, double loss)
{
    sgsi_progress *progress = &trainer->progress;
    const sgs_train_options *o = &trainer->options;
    const int iteration = progress->iteration;
    if (o->spare & SGS_SPARE_EDT && iteration < o->iterations) {
        spare_equilibrium_observe(&progress->equilibrium, loss, trainer->schedule.loss_decay);
        if (iteration % trainer->schedule.check_interval == 0) {
            const bool still = spare_equilibrium_check(
                &progress->equilibrium, trainer->model->count, progress->reset_since_check,
                o->spare_eps_loss, o->spare_eps_count, o->spare_patience);
            progress->reset_since_check = 0;
            if (!may_be_in_equilibrium(trainer))
                progress->equilibrium.held = 0;
            else if (still) {
                describe_equilibrium(trainer);
                return SGS_STOP_EQUILIBRIUM;
            }
        }
    }
    if (iteration < o->iterations)
        return SGS_STOP_NONE;
    snprintf(trainer->stop_text, sizeof trainer->stop_text, "all %d iterations done",
             o->iterations);
    return SGS_STOP_SCHEDULE;
}
