// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// REFINE (arXiv 2606.09074): importance in closed form from the stored parameters and the camera
// positions, without rendering.
//
//     H_i     = (o_i / C) sum over cameras c of 1 / (max(|x_i - c|^2, 1e-6) + 0.5)
//     S_geo   = H s_1 s_2 (the two largest scales),  S_color = H Y^2,  S_opa = H o^2,
//     score   = w_geo S_geo / mean + w_color S_color / mean + w_opa S_opa / mean,
// with Y the luma of the colour of band 0 and scene weights from the mean anisotropy, the variance
// of Y and the mean of 4 o (1 - o), each divided by a constant of the released code.
//
// Sums run over blocks of fixed size, which are added in order: the bits do not depend on the
// number of threads.

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/sh.h"
#include "base/threads.h"
#include "model/opacity.h"
#include "prune/scores.h"

enum { BLOCK = 4096 };
static const double TINY = 1e-6;

// The figures of one primitive.
typedef struct figures {
    double luma, opacity, anisotropy, area, visibility;
} figures;

typedef struct block_sums {
    double luma, luma2, opacity, anisotropy; // of the scene's weights
    double geometry, color, opacity_score;   // of the terms
} block_sums;

typedef struct refine_job {
    const sgs_gaussians *model;
    const double (*cameras)[3];
    size_t camera_count;
    double mean_luma;
    figures *figures; // [count]
    block_sums *sums; // [blocks]
    double weights[3], means[3];
    double *scores;
} refine_job;

static double visibility_of(const refine_job *job, size_t i, double opacity)
{
    double mean[3], sum = 0;
    for (int k = 0; k < 3; ++k)
        mean[k] = (double)*sgs_gaussians_at(job->model, i, SGS_PARAM_MEAN + k);
    for (size_t c = 0; c < job->camera_count; ++c) {
        const double *at = job->cameras[c];
        const double x = mean[0] - at[0], y = mean[1] - at[1], z = mean[2] - at[2];
        sum += 1 / (fmax(x * x + y * y + z * z, TINY) + 0.5);
    }
    return opacity * sum / (double)job->camera_count;
}

static figures figures_of(const refine_job *job, size_t i)
{
    static const double luma[3] = {0.299, 0.587, 0.114};
    const sgs_gaussians *model = job->model;
    figures f = {.opacity = (double)sgsi_gaussians_opacity(model, i)};
    double s[3];
    for (int k = 0; k < 3; ++k) {
        const double color =
            SGSI_SH_C0 * (double)*sgs_gaussians_at(model, i, SGS_PARAM_SH_DC + k) + 0.5;
        f.luma += luma[k] * fmin(fmax(color, 0), 1);
        s[k] = exp(fmin(fmax((double)*sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k), -80), 80));
    }
    const double largest = fmax(s[0], fmax(s[1], s[2])), least = fmin(s[0], fmin(s[1], s[2]));
    const double middle = fmax(fmin(s[0], s[1]), fmin(fmax(s[0], s[1]), s[2]));
    f.anisotropy = largest / (least + TINY);
    f.area = largest * middle;
    f.visibility = visibility_of(job, i, f.opacity);
    return f;
}

static void fill_block(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const refine_job *job = context;
    block_sums sum = {0};
    for (size_t i = begin; i < end; ++i) {
        const figures f = figures_of(job, i);
        job->figures[i] = f;
        sum.luma += f.luma;
        sum.opacity += 4 * f.opacity * (1 - f.opacity);
        sum.anisotropy += f.anisotropy;
        sum.geometry += f.visibility * f.area;
        sum.color += f.visibility * f.luma * f.luma;
        sum.opacity_score += f.visibility * f.opacity * f.opacity;
    }
    job->sums[begin / BLOCK] = sum;
}

static void variance_block(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const refine_job *job = context;
    double sum = 0;
    for (size_t i = begin; i < end; ++i)
        sum += (job->figures[i].luma - job->mean_luma) * (job->figures[i].luma - job->mean_luma);
    job->sums[begin / BLOCK].luma2 = sum;
}

static void score_block(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const refine_job *job = context;
    for (size_t i = begin; i < end; ++i) {
        const figures *f = &job->figures[i];
        const double terms[3] = {f->area, f->luma * f->luma, f->opacity * f->opacity};
        job->scores[i] = 0;
        for (int k = 0; k < 3; ++k)
            job->scores[i] += job->weights[k] * f->visibility * terms[k] / job->means[k];
    }
}

static block_sums add_blocks(const refine_job *job)
{
    block_sums sum = {0};
    for (size_t b = 0; b < (job->model->count + BLOCK - 1) / BLOCK; ++b) {
        sum.luma += job->sums[b].luma;
        sum.luma2 += job->sums[b].luma2;
        sum.opacity += job->sums[b].opacity;
        sum.anisotropy += job->sums[b].anisotropy;
        sum.geometry += job->sums[b].geometry;
        sum.color += job->sums[b].color;
        sum.opacity_score += job->sums[b].opacity_score;
    }
    return sum;
}

// The weights of the three terms, with absolute values that sum to 1.
static void set_weights(refine_job *job, const block_sums *sum)
{
    const double n = (double)job->model->count;
    const double variance = n > 1 ? sum->luma2 / (n - 1) : 0;
    const double raw[3] = {log(sum->anisotropy / n + TINY) / 10.73, 100 * variance / 56.06,
                           100 * (sum->opacity / n) / 100.67};
    const double norm = fabs(raw[0]) + fabs(raw[1]) + fabs(raw[2]);
    const double totals[3] = {sum->geometry, sum->color, sum->opacity_score};
    for (int k = 0; k < 3; ++k) {
        job->weights[k] = norm > 0 ? raw[k] / norm : 0;
        job->means[k] = totals[k] / n + 1e-8;
    }
}

static sgs_status choose_cameras(const sgs_prune_options *options, double (*chosen)[3],
                                 size_t *count)
{
    size_t rows[SGSI_REFINE_CAMERAS];
    const bool all = options->camera_count <= SGSI_REFINE_CAMERAS;
    *count = all ? options->camera_count : SGSI_REFINE_CAMERAS;
    const sgs_status status =
        all ? SGS_STATUS_OK : sgsi_refine_sample(options->camera_count, SGSI_REFINE_CAMERAS, rows);
    for (size_t c = 0; c < *count && !status; ++c)
        memcpy(chosen[c], options->cameras[all ? c : rows[c]], sizeof *chosen);
    return status;
}

sgs_status sgsi_refine_scores(const sgs_gaussians *model, const sgs_prune_options *options,
                              double *scores)
{
    double cameras[SGSI_REFINE_CAMERAS][3];
    refine_job job = {.model = model, .cameras = (const double(*)[3])cameras, .scores = scores};
    sgs_status status = choose_cameras(options, cameras, &job.camera_count);
    if (status)
        return status;
    job.figures = sgsi_alloc(model->count, sizeof *job.figures);
    job.sums = sgsi_calloc((model->count + BLOCK - 1) / BLOCK, sizeof *job.sums);
    if (job.figures && job.sums) {
        sgsi_parallel_ranges(model->count, BLOCK, fill_block, &job);
        job.mean_luma = add_blocks(&job).luma / (double)model->count;
        sgsi_parallel_ranges(model->count, BLOCK, variance_block, &job);
        const block_sums sum = add_blocks(&job);
        set_weights(&job, &sum);
        sgsi_parallel_ranges(model->count, BLOCK, score_block, &job);
    } else {
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                           "not enough memory for the scores of %zu primitives", model->count);
    }
    sgsi_free(job.figures);
    sgsi_free(job.sums);
    return status;
}
