// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Contributions of the primitives to the training views: the sums of the tracer's score pass, per
// view in single precision in tile order, over the views in double precision in view order.

#include <math.h>

#include "base/core.h"
#include "base/threads.h"
#include "model/score_slots.h"
#include "prune/view_pass.h"

typedef struct contribution_job {
    sgs_contribution *sums; // [count]
    const float *columns;   // of one view, [count][16]
    const float *projected; // likewise
    const uint8_t *touched;
    size_t count;
    float *ones; // pixel weights
    size_t one_count;
} contribution_job;

static void add_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const contribution_job *job = context;
    for (size_t i = begin; i < end; ++i) {
        const float *column = job->columns + SGSI_PROJECTED_FLOATS * i;
        if (!job->touched[i / SGS_LANES] || !(column[SGSI_SCORE_HITS] > 0.0f))
            continue;
        const double opacity =
            exp2((double)job->projected[SGSI_PROJECTED_FLOATS * i + SGSI_PROJECTED_LOG_OPACITY]);
        sgs_contribution *sum = &job->sums[i];
        sum->weight += (double)column[SGSI_SCORE_BLEND];
        sum->front += opacity * (double)column[SGSI_SCORE_FRONT];
        sum->hits += (double)column[SGSI_SCORE_HITS];
        ++sum->views;
    }
}

static sgs_status reserve_ones(contribution_job *job, size_t floats)
{
    if (floats <= job->one_count)
        return SGS_STATUS_OK;
    sgsi_free(job->ones);
    job->ones = sgsi_alloc(floats, sizeof *job->ones);
    job->one_count = job->ones ? floats : 0;
    for (size_t i = 0; i < job->one_count; ++i)
        job->ones[i] = 1.0f;
    return job->ones
               ? SGS_STATUS_OK
               : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the weights of a view");
}

static sgs_status add_view(void *context, const sgsi_traced_view *traced)
{
    contribution_job *job = context;
    const sgsi_planes *planes = traced->planes;
    sgs_status status = reserve_ones(job, planes->stride * (size_t)planes->height);
    const sgsi_score_planes score = {.weight = job->ones};
    if (!status)
        status = sgsi_tracer_score(traced->tracer, traced->view, planes, &score);
    if (status)
        return status;
    job->columns = sgsi_tracer_grad_sums(traced->tracer);
    job->projected = sgsi_tracer_projected(traced->tracer);
    job->touched = sgsi_tracer_touched(traced->tracer);
    sgsi_parallel_ranges(job->count, 4096, add_range, job);
    return SGS_STATUS_OK;
}

sgs_status sgs_contributions(const sgs_gaussians *model, const sgs_scene *scene,
                             const sgs_view_pass_options *options, sgs_contribution *contributions)
{
    sgs_view_pass_options own = sgs_view_pass_options_default();
    sgs_status status = sgsi_options_read(options, "sgs_view_pass_options", &own, sizeof own);
    if (status)
        return status;
    for (size_t i = 0; i < model->count; ++i)
        contributions[i] = (sgs_contribution){0};
    contribution_job job = {.sums = contributions, .count = model->count};
    status = sgsi_view_pass(model, scene, &own, add_view, &job);
    sgsi_free(job.ones);
    return status;
}
