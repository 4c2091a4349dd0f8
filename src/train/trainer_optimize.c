// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The optimiser step of an iteration: learning rates of 3DGS (Kerbl et al. 2023), bias corrections,
// one pass of the kernels over the model, and the noise of pipelines that sample.

#include <math.h>
#include <stdatomic.h>

#include "base/core.h"
#include "base/threads.h"
#include "cluster/rank_calls.h"
#include "density/position_noise.h"
#include "optimize/optimize.h"
#include "train/trainer_state.h"

typedef struct optimize_job {
    sgsi_optimize input;
    atomic_size_t seen, broken;
} optimize_job;

static void optimize_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    optimize_job *job = context;
    const sgsi_optimize_counts counts = sgsi_optimize_blocks(&job->input, begin, end);
    atomic_fetch_add(&job->seen, counts.seen);
    if (counts.broken) // rare
        atomic_fetch_add(&job->broken, counts.broken);
}

bool sgsi_trainer_makes_step(const sgs_trainer *trainer, int iteration)
{
    return iteration < trainer->options.iterations &&
           !sgsi_schedule_is_update(&trainer->schedule, iteration);
}

// 1 - beta^t: the bias of a moment after t steps.
static double bias(double beta, int steps)
{
    return 1.0 - pow(beta, fmax(steps, 1));
}

static double mean_rate(const sgs_trainer *trainer, int iteration)
{
    return SGS_TRAIN_LR_MEAN * trainer->scene->extent *
           sgsi_schedule_lr(&trainer->schedule, iteration);
}

static sgsi_optimize settings(const sgs_trainer *trainer, const sgsi_train_view *view)
{
    const sgs_camera *camera = &view->camera;
    const double lr_mean = mean_rate(trainer, view->iteration);
    const float rate = (float)sgsi_schedule_lr_other(&trainer->schedule, view->iteration);
    const float shape = rate * (float)trainer->schedule.lr_shape;
    const double rest = trainer->schedule.lr_sh;
    const double rows = fmax((double)trainer->count, 1.0);
    return (sgsi_optimize){.params = trainer->model->data,
                           .m = trainer->m,
                           .v = trainer->v,
                           .count = sgsi_trainer_own(trainer),
                           .view = view->view,
                           .sums = sgsi_tracer_grad_sums(trainer->views.rows),
                           .touched = sgsi_tracer_touched(trainer->views.rows),
                           .visible = sgsi_tracer_visible(trainer->views.rows),
                           .dense = trainer->schedule.dense,
                           .lr_mean = (float)lr_mean,
                           .lr_rotation = shape * 1e-3f,
                           .lr_scale = shape * 5e-3f,
                           .lr_opacity = rate * sgsi_trainer_lr_opacity(trainer, view->iteration),
                           .lr_dc = rate * 2.5e-3f,
                           .lr_rest = rate * (float)rest * trainer->pipeline->lr_rest,
                           .beta1 = 0.9f,
                           .beta2 = 0.999f,
                           .epsilon = 1e-15f,
                           .correction1 = 1.0f,
                           .correction2 = 1.0f,
                           .rest_correction1 = 1.0f,
                           .rest_correction2 = 1.0f,
                           .opacity_loss = (float)(trainer->sampling.opacity_loss / rows),
                           .scale_loss = (float)(trainer->sampling.scale_loss / (3.0 * rows)),
                           .accumulated_grad = trainer->accumulated_grad,
                           .accumulated_rows = trainer->accumulated_rows,
                           .gradient_scale = 1.0f,
                           .abs_grad_norm = trainer->pipeline->abs_grad_norm,
                           .near_depth =
                               (float)(sgsi_trainer_near_depth(trainer) * trainer->scene->extent),
                           .tan_half_x = 0.5f * (float)camera->width / view->view.rays->fx,
                           .tan_half_y = 0.5f * (float)camera->height / view->view.rays->fy};
}

bool sgsi_trainer_ends_batch(const sgs_trainer *trainer, int iteration)
{
    const sgsi_schedule *schedule = &trainer->schedule;
    // The last iteration makes no step. A run of the paper's schedule may be extended: its batch
    // stays open.
    const bool last = trainer->options.schedule != SGS_SCHEDULE_PAPER &&
                      iteration + 1 == trainer->options.iterations;
    return last || trainer->progress.batch_views + 1 >= trainer->options.batch ||
           sgsi_schedule_is_update(schedule, iteration + 1) ||
           sgsi_schedule_is_reset(schedule, iteration) || iteration == schedule->densify_until;
}

// True if a pipeline's own, rarer steps are due in one of the last `views` iterations.
static bool is_due(bool (*steps)(const sgsi_schedule *, int), const sgsi_schedule *schedule,
                   int iteration, int views)
{
    bool due = false;
    for (int i = 0; i < views; ++i)
        due = due || steps(schedule, iteration - i);
    return due;
}

// The step of a batch of n views, as Grendel-GS scales it (Zhao et al. 2024, arXiv 2406.18533):
// rates by sqrt(n), decays beta^n, epsilon by 1 / sqrt(n). The moments then decay per view as
// without batches, and the noise of a mean is smaller by sqrt(n).
static void scale_step(sgsi_optimize *input, int views)
{
    const double root = sqrt(views);
    float *const rates[] = {&input->lr_mean,    &input->lr_rotation, &input->lr_scale,
                            &input->lr_opacity, &input->lr_dc,       &input->lr_rest};
    for (size_t i = 0; i < sizeof rates / sizeof *rates; ++i)
        *rates[i] = (float)(root * (double)*rates[i]);
    input->beta1 = (float)pow(0.9, views);
    input->beta2 = (float)pow(0.999, views);
    input->epsilon = (float)(1e-15 / root);
    input->gradient_scale = 1.0f / (float)views;
}

// Counts the view and, at the end of its batch, the step; sets the bias corrections. As in 3DGS the
// sparse optimiser has none.
static void begin_step(sgs_trainer *trainer, int iteration, sgsi_optimize *input)
{
    sgsi_train_progress *progress = &trainer->progress;
    const sgsi_schedule *schedule = &trainer->schedule;
    const bool ends = sgsi_trainer_ends_batch(trainer, iteration);
    const int views = ++progress->batch_views;
    input->apply = true;
    input->step_main = ends && is_due(sgsi_schedule_steps_main, schedule, iteration, views);
    input->step_rest = ends && is_due(sgsi_schedule_steps_rest, schedule, iteration, views);
    if (!ends)
        return;
    progress->batch_views = 0;
    if (views > 1)
        scale_step(input, views);
    progress->adam_step += input->step_main ? views : 0;
    progress->rest_step += input->step_rest ? views : 0;
    if (!input->dense)
        return;
    input->correction1 = (float)(1.0 / bias(0.9, progress->adam_step));
    input->correction2 = (float)(1.0 / sqrt(bias(0.999, progress->adam_step)));
    input->rest_correction1 = (float)(1.0 / bias(0.9, progress->rest_step));
    input->rest_correction2 = (float)(1.0 / sqrt(bias(0.999, progress->rest_step)));
}

// Adds the counts of all ranks.
static sgs_status share_counts(sgs_trainer *trainer, sgsi_step_counts *counts)
{
    sgs_ranks *ranks = trainer->views.ranks;
    if (!sgsi_trainer_is_shared(trainer))
        return SGS_STATUS_OK;
    const uint64_t first = counts->rejected.first;
    if (first != UINT64_MAX)
        counts->rejected.first =
            sgsi_shard_row(first, sgsi_trainer_rank(trainer), sgsi_trainer_ranks(trainer));
    sgsi_step_counts *sent = sgsi_ranks_room(ranks, sgsi_ranks_padded(sizeof *counts));
    const sgs_status own =
        sent ? SGS_STATUS_OK : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for a step");
    if (sent)
        *sent = *counts;
    const unsigned char *got;
    const size_t *sizes;
    const sgs_status status =
        sgsi_ranks_share(ranks, own, SGS_RANKS_SUMS, sizeof *counts, &got, &sizes);
    *counts = (sgsi_step_counts){.rejected.first = UINT64_MAX};
    for (int r = 0; r < sgs_ranks_count(ranks) && !status; got += sizes[r++]) {
        const sgsi_step_counts *one = (const sgsi_step_counts *)got;
        const uint64_t rows = counts->rejected.rows + one->rejected.rows;
        counts->seen += one->seen;
        if (one->rejected.first < counts->rejected.first)
            counts->rejected = one->rejected;
        counts->rejected.rows = rows;
    }
    return status;
}

sgs_status sgsi_trainer_optimize(sgs_trainer *trainer, const sgsi_train_view *view, size_t *visible)
{
    const double start = sgsi_seconds();
    const bool collects = view->visible_count != NULL;
    sgsi_train_progress *progress = &trainer->progress;
    optimize_job job = {.input = settings(trainer, view)};
    if (sgsi_trainer_makes_step(trainer, view->iteration))
        begin_step(trainer, view->iteration, &job.input);
    if (collects)
        job.input.gradient_sum = trainer->statistics.gradient_sum;
    if (collects && sgsi_trainer_uses_abs_grad(trainer, view->iteration))
        job.input.abs_grad_sum = trainer->statistics.abs_grad_sum;
    sgsi_parallel_ranges((sgsi_trainer_own(trainer) + SGS_LANES - 1) / SGS_LANES, 64,
                         optimize_range, &job);
    sgsi_trainer_clamp_to_region(trainer);
    sgsi_step_counts counts = {atomic_load(&job.seen), {atomic_load(&job.broken), UINT64_MAX, {0}}};
    if (counts.rejected.rows && sgsi_skip_is_due(&progress->skipped))
        sgsi_find_rejected(&job.input, &counts.rejected);
    const sgs_status status = share_counts(trainer, &counts);
    if (!status && counts.rejected.rows)
        sgsi_skip_gradients(&progress->skipped, view->iteration, view->source->name,
                            &counts.rejected);
    progress->seconds.optimizer += sgsi_seconds() - start;
    *visible = (size_t)counts.seen;
    return status;
}

void sgsi_trainer_add_noise(sgs_trainer *trainer, int iteration, int views)
{
    const double start = sgsi_seconds(), noise = trainer->sampling.noise * sqrt(views);
    if (noise > 0.0) {
        sgs_gaussians own = *trainer->model;
        own.count = sgsi_trainer_own(trainer);
        sgsi_position_noise_add(&own, sgsi_trainer_rank(trainer), sgsi_trainer_ranks(trainer),
                                noise * mean_rate(trainer, iteration), trainer->options.seed,
                                iteration);
        sgsi_trainer_clamp_to_region(trainer);
    }
    trainer->progress.seconds.optimizer += sgsi_seconds() - start;
}
