// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "compress/importance.h"

#include <string.h>

#include "model/opacity.h"
#include "prune/scores.h"
#include "sparegs/trainer.h"

sgs_status sgsi_rows_model(const sgsi_compress_job *job, sgs_gaussians **model)
{
    sgs_status status = sgs_gaussians_create(job->count, model);
    if (!status)
        status = sgs_gaussians_resize(*model, job->count);
    if (status)
        return status;
    (*model)->sh_degree = job->sh_degree;
    for (size_t i = 0; i < job->count; ++i)
        sgs_gaussians_set(*model, i, job->rows + i * SGS_PARAM_COUNT);
    return SGS_STATUS_OK;
}

void sgsi_rows_set(sgsi_compress_job *job, const sgs_gaussians *model)
{
    job->count = model->count;
    for (size_t i = 0; i < job->count; ++i) {
        float *row = job->rows + i * SGS_PARAM_COUNT;
        sgs_gaussians_get(model, i, row);
        row[SGS_PARAM_OPACITY] = sgs_gaussians_opacity_logit(model, i);
    }
}

void sgsi_rows_keep(sgsi_compress_job *job, const bool *keep)
{
    size_t kept = 0;
    for (size_t i = 0; i < job->count; ++i)
        if (keep[i])
            memmove(job->rows + kept++ * SGS_PARAM_COUNT, job->rows + i * SGS_PARAM_COUNT,
                    SGS_PARAM_COUNT * sizeof *job->rows);
    job->count = kept;
}

static const double VOLUME_POWER = 0.1; // of MesonGS

static bool pass_progress(void *user, size_t done, size_t total)
{
    return !sgsi_compress_progress(user, "rendering views for the importance", done, total);
}

static sgs_view_pass_options pass_options(const sgsi_compress_job *job)
{
    sgs_view_pass_options options = sgs_view_pass_options_default();
    options.render = &job->render;
    options.progress = pass_progress;
    options.progress_user = (void *)job;
    return options;
}

sgs_status sgsi_significance(const sgsi_compress_job *job, double *importance)
{
    if (!job->options->scene) {
        for (size_t i = 0; i < job->count; ++i)
            importance[i] = 1;
        return SGS_STATUS_OK;
    }
    sgs_gaussians *model = NULL;
    sgs_status status = sgsi_rows_model(job, &model);
    sgs_prune_options options = sgs_prune_options_default();
    options.method = SGS_PRUNE_LIGHTGAUSSIAN;
    options.scene = job->options->scene;
    const sgs_view_pass_options views = pass_options(job);
    options.views = &views;
    if (!status)
        status = sgs_prune_scores(model, &options, importance);
    sgs_gaussians_destroy(model);
    return status;
}

// Sums of the blending weights, or opacities without a scene.
static sgs_status blending_weights(const sgsi_compress_job *job, const sgs_gaussians *model,
                                   double *weights)
{
    if (!job->options->scene) {
        for (size_t i = 0; i < model->count; ++i)
            weights[i] = (double)sgsi_gaussians_opacity(model, i);
        return SGS_STATUS_OK;
    }
    sgs_contribution *sums = sgsi_alloc(model->count, sizeof *sums);
    if (!sums)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives",
                         model->count);
    const sgs_view_pass_options options = pass_options(job);
    const sgs_status status = sgs_contributions(model, job->options->scene, &options, sums);
    for (size_t i = 0; i < model->count && !status; ++i)
        weights[i] = sums[i].weight;
    sgsi_free(sums);
    return status;
}

sgs_status sgsi_blending_importance(const sgsi_compress_job *job, double *importance)
{
    sgs_gaussians *model = NULL;
    sgs_status status = sgsi_rows_model(job, &model);
    if (!status)
        status = blending_weights(job, model, importance);
    if (!status)
        status = sgsi_weigh_by_volume(model, VOLUME_POWER, importance);
    sgs_gaussians_destroy(model);
    return status;
}

typedef struct tuning {
    const sgsi_compress_job *job;
    int iterations;
} tuning;

static bool tuning_progress(void *user, const sgs_step_info *info)
{
    const tuning *t = user;
    return !sgsi_compress_progress(t->job, "fine-tuning", (size_t)info->iteration,
                                   (size_t)t->iterations);
}

sgs_status sgsi_finetune_iterations(const sgsi_compress_job *job, int automatic, int *iterations)
{
    const int asked = job->options->finetune;
    *iterations = asked >= 0 ? asked : job->options->scene ? automatic : 0;
    return *iterations && !job->options->scene
               ? sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "fine-tuning requires a scene")
               : SGS_STATUS_OK;
}

sgs_status sgsi_rows_finetune(sgsi_compress_job *job, int automatic)
{
    int iterations;
    sgs_status status = sgsi_finetune_iterations(job, automatic, &iterations);
    if (status || !iterations)
        return status;
    tuning t = {job, iterations};
    sgs_finetune_options options = sgs_finetune_options_default();
    options.iterations = iterations;
    options.filter = job->render.filter;
    options.compact_box = job->render.compact_box;
    memcpy(options.background, job->options->background, sizeof options.background);
    options.seed = job->options->seed;
    options.progress = tuning_progress;
    options.progress_user = &t;
    sgs_gaussians *model = NULL, *tuned = NULL;
    status = sgsi_rows_model(job, &model);
    if (!status)
        status = sgs_finetune(model, job->options->scene, &options, &tuned);
    if (!status)
        sgsi_rows_set(job, tuned);
    sgs_gaussians_destroy(model);
    sgs_gaussians_destroy(tuned);
    return status;
}
