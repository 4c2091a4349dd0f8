// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Changes of the model's structure: updates by the base pipeline with SPARE-GS, and opacity resets.

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "cluster/rank_calls.h"
#include "density/run_length.h"
#include "sparegs/runtime.h"
#include "train/trainer_state.h"

static const double NOISE_GRID_QUANTILE = 0.01;

// RAP treats a primitive without a gradient as redundant. A primitive that no view has shown since
// the last update has no gradient either. In scaled runs, an update may come before all views were
// trained, so such primitives are kept. Each pass has its own order, so that 2 V - 1 iterations
// contain all of V views.
static bool spares_unseen(const sgs_trainer *trainer)
{
    const sgs_train_options *o = &trainer->options;
    return o->spare_rap_visible ||
           (o->schedule == SGS_SCHEDULE_SCALED && o->iterations < SGSI_PAPER_LENGTH &&
            (size_t)trainer->schedule.densify_interval + 1 < 2 * trainer->views.count);
}

static spare_options spare_settings(const sgs_trainer *trainer)
{
    const sgs_train_options *o = &trainer->options;
    spare_options spare = spare_options_default();
    spare.tau_gradient = SGSI_GRADIENT_THRESHOLD * trainer->schedule.threshold_factor;
    spare.grid = o->spare_grid;
    spare.grid_quantile = o->spare_grid_quantile;
    if (o->spare_grid_quantile < 0.0) // noise moves faint primitives far away
        spare.grid_quantile = trainer->sampling.noise > 0.0 ? NOISE_GRID_QUANTILE : 0.0;
    spare.tau_alpha = o->spare_tau_alpha;
    spare.phi = (spare_phi)o->spare_phi;
    spare.budget_scale = o->spare_budget;
    spare.weight_range = o->spare_range;
    spare.slack_gain = o->spare_slope;
    spare.capacity_min = o->spare_capacity_min;
    spare.capacity_max = o->spare_capacity_max;
    spare.rap_require_visible = spares_unseen(trainer);
    spare.use_h = o->spare_demand & SGS_DEMAND_H;
    spare.use_v = o->spare_demand & SGS_DEMAND_V;
    spare.use_c = o->spare_demand & SGS_DEMAND_C;
    return spare;
}

// True if the memory of all ranks admits it: they must take the same decision. A failed call fails
// again in the next collective call of the step.
static bool all_ranks(sgs_ranks *ranks, bool own)
{
    const uint8_t mine = own;
    bool all = true;
    uint8_t *got = sgsi_alloc((size_t)sgs_ranks_count(ranks), 1);
    const sgs_status memory =
        got ? SGS_STATUS_OK
            : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the ranks");
    all = !sgs_ranks_gather(ranks, memory, &mine, 1, got);
    for (int r = 0; r < sgs_ranks_count(ranks) && all; ++r)
        all = got[r];
    sgsi_free(got);
    return all;
}

// True if the limit exceeds the estimate for `count` primitives, and also the current memory plus
// its estimated growth and the temporary copy of one array.
static bool own_memory_admits(const sgs_trainer *trainer, size_t count)
{
    const size_t before = trainer->count, limit = trainer->memory_limit;
    if (!limit || count <= before)
        return true;
    const int ranks = sgsi_trainer_ranks(trainer);
    sgs_train_options options = trainer->options;
    options.init = trainer->has_init ? trainer->model : NULL; // what the estimate asks
    const size_t rays = sgsi_ray_cache_limit(trainer->views.rays);
    const size_t copy = count / (size_t)ranks * SGS_PARAM_COUNT * sizeof(float);
    const size_t estimate = sgs_train_memory_per_rank(trainer->scene, &options,
                                                      trainer->image_cache, count, ranks, rays),
                 current = sgs_train_memory_per_rank(trainer->scene, &options, trainer->image_cache,
                                                     before, ranks, rays);
    const size_t reserved = trainer->reserved_bytes + count * trainer->reserved_row_bytes,
                 growth = (estimate > current ? estimate - current : 0) +
                          (count - before) * trainer->reserved_row_bytes;
    return estimate + reserved <= limit && sgs_rss_current() + copy + growth <= limit;
}

// With several ranks all call it, after the columns were gathered: they then know the same flags.
static bool memory_admits(const void *context, size_t count)
{
    const sgs_trainer *trainer = context;
    sgs_ranks *ranks = trainer->views.ranks;
    if (!sgsi_trainer_is_shared(trainer))
        return own_memory_admits(trainer, count);
    return !(sgs_ranks_raised(ranks) & SGSI_RANKS_LIMITED) ||
           all_ranks(ranks, own_memory_admits(trainer, count));
}

// Every rank plans the update. Different C libraries or faulty memory could give different plans.
static sgs_status plans_agree(const void *context, uint64_t digest)
{
    const sgs_trainer *trainer = context;
    sgs_ranks *ranks = trainer->views.ranks;
    const size_t count = (size_t)sgs_ranks_count(ranks);
    uint64_t *digests = sgsi_alloc(count, sizeof *digests);
    sgs_status status =
        digests ? SGS_STATUS_OK
                : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the ranks");
    status = sgs_ranks_gather(ranks, status, &digest, sizeof digest, digests);
    for (size_t r = 0; r < count && !status; ++r)
        if (digests[r] != digests[0])
            status =
                sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                          "the structural update of rank %zu differs from that of rank 0: its C "
                          "library differs, or its memory is faulty",
                          r);
    sgsi_free(digests);
    return status;
}

static sgsi_density_options density_options(sgs_trainer *trainer, int iteration,
                                            const sgsi_view_scores *scores,
                                            const spare_options *spare)
{
    const sgs_train_options *o = &trainer->options;
    const sgsi_schedule *schedule = &trainer->schedule;
    sgsi_train_progress *progress = &trainer->progress;
    const double extent = trainer->scene->extent;
    const bool final_prune = !sgsi_schedule_is_structural(schedule, iteration);
    const bool regulates = !final_prune || sgsi_schedule_is_thinning(schedule, iteration);
    const bool rests =
        spare_pruning_in_cooldown(iteration, progress->last_reset, schedule->densify_interval);
    return (sgsi_density_options){
        .train = o,
        .state = &progress->pipeline,
        .extent = extent,
        .update = progress->updates,
        .update_count = sgsi_schedule_updates(schedule),
        .until = schedule->densify_until,
        .interval = schedule->densify_interval,
        .resolution = progress->resolution ? progress->resolution : 1,
        .final_prune = final_prune,
        .importance = scores ? scores->importance : NULL,
        .prune_score = scores ? scores->prune_score : NULL,
        .gradient_threshold = spare->tau_gradient,
        .abs_share = schedule->abs_share,
        .opacity_min = 0.005,
        .size_split = 0.01 * extent,
        .size_max = sgsi_schedule_prunes_large(schedule, iteration, progress->last_reset)
                        ? 0.1 * extent
                        : INFINITY,
        .growth = schedule->growth,
        .removal_max = sgsi_schedule_removal_max(schedule, iteration),
        .max_count = o->max_gaussians,
        .admits = trainer->memory_limit || sgsi_trainer_is_shared(trainer) ? memory_admits : NULL,
        .compare = plans_agree,
        .context = trainer,
        .seed = o->seed,
        .iteration = iteration,
        .spare_densify = (o->spare & SGS_SPARE_BMD) && regulates,
        .spare_prune = (o->spare & SGS_SPARE_RAP) && !rests && regulates,
        .opacity_is_reset = rests,
        .spare = spare};
}

// Takes over the list of regions.
static void keep_regions(sgs_trainer *trainer, int iteration, const sgsi_density_result *result)
{
    sgsi_free((void *)trainer->regions.regions);
    trainer->regions = (sgs_regions){.iteration = result->region_list ? iteration : 0,
                                     .grid = trainer->options.spare_grid,
                                     .count = result->region_list ? result->regions : 0,
                                     .regions = result->region_list};
    memcpy(trainer->regions.low, result->region_low, sizeof result->region_low);
    memcpy(trainer->regions.voxel_size, result->region_voxel_size,
           sizeof result->region_voxel_size);
}

static void fill_info(const sgsi_density_result *result, int iteration, size_t gaussians,
                      sgs_step_info *info)
{
    info->structural = true;
    info->structure_iteration = iteration;
    info->gaussians = gaussians;
    info->densified = result->cloned + result->split;
    info->pruned = result->pruned;
    info->spare_pruned = result->spare_pruned;
    info->relocated = result->relocated;
    info->spare_deferred = result->spare_deferred;
    info->regions = result->regions;
    info->over_budget_share = result->over_budget_share;
    info->mean_weight = result->mean_weight;
    info->bmd_suppressed = result->bmd_suppressed;
    info->bmd_boosted = result->bmd_boosted;
    info->spare_seconds = result->spare_seconds;
}

static void limit_opacity(sgs_trainer *trainer, double ceiling, const float *filter_3d)
{
    sgs_gaussians own = *trainer->model;
    own.count = sgsi_trainer_own(trainer);
    sgsi_density_reset_opacity(&own, trainer->m, trainer->v, ceiling, filter_3d);
}

sgs_status sgsi_trainer_update_structure(sgs_trainer *trainer, int iteration,
                                         const sgsi_view_scores *scores, sgs_step_info *info)
{
    const double start = sgsi_seconds();
    sgsi_train_progress *progress = &trainer->progress;
    const spare_options spare = spare_settings(trainer);
    const sgsi_density_options options = density_options(trainer, iteration, scores, &spare);
    const sgsi_row_peers peers = sgsi_trainer_peers(trainer);
    if (sgsi_trainer_is_shared(trainer)) { // the peak of a rank: columns of the rows of all
        sgsi_tracer_forget(trainer->views.rows);
        sgsi_tracer_forget(trainer->views.tracer);
        sgsi_return_memory();
    }
    const sgsi_density_rows rows = {.model = trainer->model,
                                    .m = &trainer->m,
                                    .v = &trainer->v,
                                    .statistics = &trainer->statistics,
                                    .fixed = trainer->fixed,
                                    .peers = sgsi_trainer_is_shared(trainer) ? &peers : NULL,
                                    .count = &trainer->count};
    const sgsi_pipeline_state state = progress->pipeline;
    sgsi_density_result result;
    sgs_status status = sgsi_density_update(&rows, trainer->pipeline, &options, &result);
    trainer->update_refused = result.refused;
    if (result.unchanged) {
        trainer->inconsistent = false;
        progress->pipeline = state;
        sgsi_free(result.region_list);
        return status;
    }
    keep_regions(trainer, iteration, &result);
    if (sgsi_trainer_is_shared(trainer))
        sgsi_return_memory();
    if (!status)
        sgsi_trainer_clamp_to_region(trainer); // the children of splits
    if (!status)
        status = sgsi_trainer_reserve_accumulated_grad(trainer);
    if (!status)
        status = sgsi_trainer_update_filter_3d(trainer);
    if (status)
        return status;
    if (trainer->pipeline->opacity_ceiling > 0.0f && !options.final_prune)
        limit_opacity(trainer, (double)trainer->pipeline->opacity_ceiling, NULL);
    trainer->views.rebuild = true;
    progress->disturbed = 1;
    progress->updates += !options.final_prune;
    progress->seconds.spare += result.spare_seconds;
    progress->seconds.density += sgsi_seconds() - start - result.spare_seconds;
    fill_info(&result, iteration, trainer->count, info);
    return SGS_STATUS_OK;
}

void sgsi_trainer_reset_opacity(sgs_trainer *trainer, int iteration)
{
    limit_opacity(trainer, 0.01, trainer->filter_3d);
    trainer->progress.last_reset = iteration;
    trainer->progress.disturbed = 1;
    sgsi_train_views_forget_depths(&trainer->views); // no ray ends early now
}
