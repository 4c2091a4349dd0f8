// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Scores by method, LightGaussian's score, and the selection of the primitives that remain.
//
// LightGaussian (Fan et al., "LightGaussian: Unbounded 3D Gaussian Compression with 15x Reduction
// and 200+ FPS", NeurIPS 2024), equation 4: the sum over all hits of opacity times transmittance,
// without the response of the Gaussian, times (V / V_90)^0.1, V the product of the scales and V_90
// the element of rank 0.9 count of the volumes in descending order, as in the released code; the
// paper limits V / V_90 to 1. The rasteriser that the release pins (240618b) omits the
// transmittance, a later commit of it (9893d8c) does not.

#include "sparegs/prune.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/compare.h"
#include "base/core.h"
#include "model/finite_model.h"
#include "prune/scores.h"

void sgs_prune_options_init(sgs_prune_options *options, size_t size)
{
    const sgs_prune_options defaults = {.volume_power = 0.1, .fisher_downscale = 4};
    sgsi_options_init(options, size, &defaults, sizeof defaults);
}

// ---- LightGaussian ----

// Logarithms of the volumes, which do not overflow.
static double log_volume(const sgs_gaussians *model, size_t i)
{
    double sum = 0;
    for (int k = 0; k < 3; ++k)
        sum += (double)*sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k);
    return sum;
}

sgs_status sgsi_weigh_by_volume(const sgs_gaussians *model, double power, double *scores)
{
    const size_t n = model->count;
    double *volumes = sgsi_alloc(n, sizeof *volumes);
    if (!volumes)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for the volumes of %zu primitives", n);
    for (size_t i = 0; i < n; ++i)
        volumes[i] = log_volume(model, i);
    qsort(volumes, n, sizeof *volumes, sgsi_compare_doubles);
    const double reference = volumes[n - 1 - (size_t)(0.9 * (double)n)];
    for (size_t i = 0; i < n; ++i) {
        const double exponent = power * (log_volume(model, i) - reference);
        scores[i] *= exp(fmin(fmax(exponent, -700), 600));
    }
    sgsi_free(volumes);
    return SGS_STATUS_OK;
}

sgs_status sgsi_lightgaussian_scores(const sgs_gaussians *model, const sgs_prune_options *options,
                                     double *scores)
{
    sgs_contribution *sums = sgsi_alloc(model->count, sizeof *sums);
    if (!sums)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for the scores of %zu primitives", model->count);
    sgs_status status = sgs_contributions(model, options->scene, options->views, sums);
    for (size_t i = 0; i < model->count && !status; ++i)
        scores[i] = sums[i].front;
    sgsi_free(sums);
    return status ? status : sgsi_weigh_by_volume(model, options->volume_power, scores);
}

// ---- RAP ----

sgs_status sgsi_rap_scores(const sgs_gaussians *model, const sgs_prune_options *options,
                           double *scores)
{
    float *features = sgsi_alloc(model->count, SGS_RAP_FEATURES * sizeof *features);
    if (!features)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for the features of %zu primitives", model->count);
    const sgs_status status =
        sgs_rap_features(model, options->progress, options->progress_user, features);
    for (size_t i = 0; i < model->count && !status; ++i)
        scores[i] = sgs_rap_score(options->rap, features + i * SGS_RAP_FEATURES);
    sgsi_free(features);
    return status;
}

// ---- Dispatch ----

static sgs_status check_inputs(const sgs_prune_options *options)
{
    switch (options->method) {
    case SGS_PRUNE_LIGHTGAUSSIAN:
    case SGS_PRUNE_PUP:
        if (!options->scene)
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "this score requires a scene");
        if (!(options->volume_power >= 0 && options->volume_power <= 10))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "volume power %g is not in [0, 10]",
                             options->volume_power);
        for (int c = 0; c < 3; ++c)
            if (!isfinite(options->background[c]))
                return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "background %g is not finite",
                                 (double)options->background[c]);
        return SGS_STATUS_OK;
    case SGS_PRUNE_REFINE:
        if (!options->cameras || !options->camera_count)
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "REFINE requires camera positions");
        return SGS_STATUS_OK;
    case SGS_PRUNE_RAP:
        if (!options->rap)
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                             "RAP requires the network of its authors (sgs_rap_read)");
        return SGS_STATUS_OK;
    }
    return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "unknown pruning method %d",
                     (int)options->method);
}

sgs_status sgs_prune_scores(const sgs_gaussians *model, const sgs_prune_options *options,
                            double *scores)
{
    sgs_prune_options own = sgs_prune_options_default();
    sgs_status status = sgsi_options_read(options, "sgs_prune_options", &own, sizeof own);
    if (!status)
        status = check_inputs(&own);
    if (!status)
        status = sgsi_finite_model_check(model, NULL);
    if (status || !model->count)
        return status;
    switch (own.method) {
    case SGS_PRUNE_LIGHTGAUSSIAN:
        return sgsi_lightgaussian_scores(model, &own, scores);
    case SGS_PRUNE_REFINE:
        return sgsi_refine_scores(model, &own, scores);
    case SGS_PRUNE_PUP:
        return sgsi_pup_scores(model, &own, scores);
    case SGS_PRUNE_RAP:
        return sgsi_rap_scores(model, &own, scores);
    }
    return SGS_STATUS_INTERNAL; // excluded by check_inputs
}

// ---- Selection ----

typedef struct ranked {
    double score;
    size_t row;
} ranked;

static int by_score_then_row(const void *a, const void *b)
{
    const ranked *p = a, *q = b;
    if (p->score != q->score)
        return p->score < q->score ? -1 : 1;
    return p->row < q->row ? -1 : p->row > q->row;
}

// LightGaussian's and PUP's released code removes up to a threshold, REFINE's and RAP's a number.
static bool removes_up_to_threshold(sgs_prune_method method)
{
    return method == SGS_PRUNE_LIGHTGAUSSIAN || method == SGS_PRUNE_PUP;
}

double sgsi_other_share(double share)
{
    return nearbyint((1 - share) * 1e15) / 1e15;
}

// RAP's released code keeps int(count keep). Its argument is a decimal fraction.
static size_t kept_by_rap(size_t count, double ratio)
{
    return (size_t)((double)count * sgsi_other_share(ratio));
}

sgs_status sgs_prune_select(sgs_prune_method method, const double *scores, size_t count,
                            double ratio, bool *keep, size_t *kept)
{
    *kept = count;
    if (!(ratio >= 0 && ratio <= 1))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "ratio %g is not in [0, 1]", ratio);
    ranked *order = sgsi_alloc(count ? count : 1, sizeof *order);
    if (!order)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to order %zu scores", count);
    sgs_status status = SGS_STATUS_OK;
    for (size_t i = 0; i < count && !status; ++i) {
        order[i] = (ranked){scores[i], i};
        keep[i] = true;
        if (isnan(scores[i]))
            status = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "the score of primitive %zu is NaN", i);
    }
    if (!status && count && ratio > 0) {
        qsort(order, count, sizeof *order, by_score_then_row);
        size_t removed = method == SGS_PRUNE_RAP ? count - kept_by_rap(count, ratio)
                                                 : (size_t)((double)count * ratio);
        if (removes_up_to_threshold(method)) {
            const double threshold = order[(size_t)(ratio * (double)(count - 1))].score;
            for (removed = 0; removed < count && order[removed].score <= threshold;)
                ++removed;
        }
        for (size_t k = 0; k < removed; ++k)
            keep[order[k].row] = false;
        *kept = count - removed;
    }
    sgsi_free(order);
    return status;
}

sgs_status sgs_gaussians_keep(const sgs_gaussians *model, const bool *keep, sgs_gaussians **out)
{
    size_t kept = 0;
    for (size_t i = 0; i < model->count; ++i)
        kept += keep[i];
    sgs_status status = sgs_gaussians_create(kept, out);
    if (!status)
        status = sgs_gaussians_resize(*out, kept);
    if (status) {
        sgs_gaussians_destroy(*out);
        *out = NULL;
        return status;
    }
    (*out)->sh_degree = model->sh_degree;
    (*out)->linear_opacity = model->linear_opacity;
    for (size_t i = 0, to = 0; i < model->count; ++i)
        if (keep[i]) {
            float params[SGS_PARAM_COUNT];
            sgs_gaussians_get(model, i, params);
            sgs_gaussians_set(*out, to++, params);
        }
    return SGS_STATUS_OK;
}
