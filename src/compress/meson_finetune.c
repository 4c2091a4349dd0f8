// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// MesonGS (Xie et al. 2024), section 3.5, with the constants of the released code. Every step
// quantises the values, renders the decoded model in a training view (each once per epoch, in
// random order) and passes the gradient straight through quantiser and transform: the transform is
// orthonormal, so the gradient with respect to a decoded value is that of the value before. The
// rate of the scales is 0.001 times the extent of the scene, although they are logarithms. Every
// 400 steps all training views are rendered; the best state is kept.
//
// Difference from the release: the rates of Adam are multiplied by 0.4, its finetune_lr_scale for
// most scenes. The release multiplies them by it twice, in training_setup and in finetuning_setup,
// which is 0.16. On a model of room, 0.4 gives 0.3 to 0.8 dB more after 400 steps.

#include "compress/meson_finetune.h"

#include <math.h>
#include <string.h>

#include "base/threads.h"
#include "compress/adam.h"
#include "compress/view_gradient.h"

enum { CHECK_INTERVAL = 400, VALUES = SGSI_MESON_VALUES, DIMENSIONS = 8 };
static const double FACTOR = 0.4;
static const double LR_OPACITY = 0.05, LR_ROTATION = 1e-3, LR_DC = 2.5e-3,
                    LR_SCALE = 1e-3, // times the extent
    LR_REST = 2.5e-3 / 20;

// Parameters with both moments of Adam and a copy of the best state.
typedef struct tuned {
    size_t count;
    float *values; // borrowed
    float *m, *v, *best;
} tuned;

typedef struct meson_tuning {
    const sgsi_compress_job *job;
    sgsi_meson *meson;
    sgs_gaussians *model;
    sgsi_view_gradient views;
    tuned cells, codes;
    float *d_codes; // [dim][count] of the codebook
    sgsi_adam_step adam;
    sgsi_meson_block *best_ranges;
    double best_error;
} meson_tuning;

static bool tuned_create(tuned *t, float *values, size_t count)
{
    *t = (tuned){.count = count, .values = values};
    t->m = sgsi_calloc(count + 1, sizeof(float));
    t->v = sgsi_calloc(count + 1, sizeof(float));
    t->best = sgsi_calloc(count + 1, sizeof(float));
    return t->m && t->v && t->best;
}

static void tuned_free(tuned *t)
{
    sgsi_free(t->m);
    sgsi_free(t->v);
    sgsi_free(t->best);
}

double sgsi_meson_rate(size_t value, double extent)
{
    return FACTOR * (value == 0  ? LR_OPACITY
                     : value < 5 ? LR_ROTATION
                     : value < 8 ? LR_DC
                                 : LR_SCALE * extent);
}

// Gradients and steps of the values of the cells [begin, end).
static void step_cells(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const meson_tuning *t = context;
    const sgs_gaussians *d = t->views.d_model;
    double rates[VALUES];
    for (size_t k = 0; k < VALUES; ++k)
        rates[k] = sgsi_meson_rate(k, t->job->options->scene->extent);
    for (size_t i = begin; i < end; ++i) {
        float g[VALUES], dot = 0;
        const size_t at = i * VALUES;
        // A quaternion and its negative are the same rotation.
        for (int k = 0; k < 4; ++k)
            dot += t->cells.values[at + 1 + (size_t)k] *
                   *sgs_gaussians_at(t->model, i, SGS_PARAM_ROTATION + k);
        g[0] = *sgs_gaussians_at(d, i, SGS_PARAM_OPACITY);
        for (int k = 0; k < 4; ++k)
            g[1 + k] = copysignf(1, dot) * *sgs_gaussians_at(d, i, SGS_PARAM_ROTATION + k);
        for (int k = 0; k < 3; ++k) {
            g[5 + k] = *sgs_gaussians_at(d, i, SGS_PARAM_SH_DC + k);
            g[8 + k] = *sgs_gaussians_at(d, i, SGS_PARAM_SCALE + k);
        }
        for (size_t k = 0; k < VALUES; ++k)
            sgsi_adam_update(&t->adam, (double)g[k], rates[k], &t->cells.values[at + k],
                             &t->cells.m[at + k], &t->cells.v[at + k]);
    }
}

// Adds the gradients of a group of dimensions of the cells to their codes, in the order of the
// cells. A group is contiguous in each block of the model.
static void add_dimensions(void *context, size_t group, int thread)
{
    (void)thread;
    const meson_tuning *t = context;
    const sgsi_meson *meson = t->meson;
    const size_t begin = group * DIMENSIONS, count = meson->codebook.count;
    const size_t left = meson->codebook.dim - begin, dims = left < DIMENSIONS ? left : DIMENSIONS;
    float *sums = t->d_codes + begin * count;
    memset(sums, 0, dims * count * sizeof *sums);
    for (size_t first = 0; first < meson->count; first += SGS_LANES) {
        const float *d = sgs_gaussians_at(t->views.d_model, first, SGS_PARAM_SH_REST + (int)begin);
        const size_t cells = meson->count - first < SGS_LANES ? meson->count - first : SGS_LANES;
        for (size_t k = 0; k < dims; ++k)
            for (size_t i = 0; i < cells; ++i)
                sums[k * count + meson->labels[first + i]] += d[k * SGS_LANES + i];
    }
}

static void step_codes(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const meson_tuning *t = context;
    const size_t dim = t->meson->codebook.dim, count = t->meson->codebook.count;
    for (size_t code = begin; code < end; ++code)
        for (size_t k = 0; k < dim; ++k) {
            const size_t at = code * dim + k;
            sgsi_adam_update(&t->adam, (double)t->d_codes[k * count + code], FACTOR * LR_REST,
                             &t->codes.values[at], &t->codes.m[at], &t->codes.v[at]);
        }
}

// One step of Adam with the gradient of the decoded model.
static void step_all(meson_tuning *t, int step)
{
    const sgsi_codebook *codebook = &t->meson->codebook;
    t->adam = sgsi_adam_begin(step);
    sgsi_parallel_ranges(t->meson->count, 1024, step_cells, t);
    sgsi_parallel_for((codebook->dim + DIMENSIONS - 1) / DIMENSIONS, 1, add_dimensions, t);
    sgsi_parallel_ranges(codebook->count, 64, step_codes, t);
}

static sgs_status draw(meson_tuning *t)
{
    sgsi_meson_quantise(t->meson);
    sgsi_meson_reconstruct(t->meson, t->model);
    return sgs_renderer_refit(t->views.renderer);
}

// Keeps the current state if its mean PSNR over the training views is the best so far.
static sgs_status check(meson_tuning *t)
{
    double error = 0; // mean of log(mse), monotone in the mean PSNR
    sgs_status status = draw(t);
    for (size_t k = 0; k < t->views.count && !status; ++k) {
        double mse;
        status = sgsi_view_gradient_evaluate(&t->views, k, false, &mse);
        if (!status)
            error += log(fmax(mse, 1e-10));
    }
    if (status || !(error < t->best_error))
        return status;
    t->best_error = error;
    memcpy(t->cells.best, t->cells.values, t->cells.count * sizeof(float));
    if (t->codes.count) // none of models of SH degree 0
        memcpy(t->codes.best, t->codes.values, t->codes.count * sizeof(float));
    memcpy(t->best_ranges, t->meson->ranges,
           t->meson->blocks * SGSI_MESON_CHANNELS * sizeof *t->best_ranges);
    return SGS_STATUS_OK;
}

static sgs_status tune(meson_tuning *t, int iterations)
{
    sgs_status status = check(t);
    for (int i = 1; i <= iterations && !status; ++i) {
        status = sgsi_compress_progress(t->job, "fine-tuning", (size_t)i - 1, (size_t)iterations);
        const size_t view = sgsi_view_gradient_next(&t->views, t->job->options->seed ^ 0x51E, i);
        double mse;
        if (!status)
            status = draw(t);
        if (!status)
            status = sgsi_view_gradient_evaluate(&t->views, view, true, &mse);
        if (status)
            break;
        step_all(t, i);
        if (i % CHECK_INTERVAL == 0 || i == iterations)
            status = check(t);
    }
    if (status)
        return status;
    memcpy(t->cells.values, t->cells.best, t->cells.count * sizeof(float));
    if (t->codes.count)
        memcpy(t->codes.values, t->codes.best, t->codes.count * sizeof(float));
    memcpy(t->meson->ranges, t->best_ranges,
           t->meson->blocks * SGSI_MESON_CHANNELS * sizeof *t->best_ranges);
    sgsi_meson_quantise(t->meson);
    return SGS_STATUS_OK;
}

sgs_status sgsi_meson_finetune(const sgsi_compress_job *job, sgsi_meson *meson, int iterations)
{
    meson_tuning t = {.job = job, .meson = meson, .best_error = INFINITY};
    sgs_status status = sgs_gaussians_create(meson->count, &t.model);
    if (!status)
        status = sgs_gaussians_resize(t.model, meson->count);
    if (!status) {
        t.model->sh_degree = meson->sh_degree;
        t.best_ranges = sgsi_alloc(meson->blocks, SGSI_MESON_CHANNELS * sizeof *t.best_ranges);
        const size_t codes = meson->codebook.count * meson->codebook.dim;
        t.d_codes = sgsi_calloc(codes + 1, sizeof *t.d_codes);
        if (!tuned_create(&t.cells, meson->values, meson->count * VALUES) ||
            !tuned_create(&t.codes, meson->codebook.codes, codes) || !t.best_ranges || !t.d_codes)
            status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to fine-tune %zu cells",
                               meson->count);
    }
    if (!status)
        status = sgsi_view_gradient_create(job, t.model, true, &t.views);
    if (!status)
        status = tune(&t, iterations);
    sgsi_view_gradient_free(&t.views);
    tuned_free(&t.cells);
    tuned_free(&t.codes);
    sgsi_free(t.d_codes);
    sgsi_free(t.best_ranges);
    sgs_gaussians_destroy(t.model);
    return status;
}
