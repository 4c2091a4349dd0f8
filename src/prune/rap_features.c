// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The 15 features of RAP (CVPR 2026; rap_network.c): how the mean distance D to 128 neighbours, the
// anisotropy A of the colour, the scales, the volume V, the opacity and the colour of a primitive
// compare with its neighbours (z_loc) and with the model (z_glob, of the logarithm):
//
//     z_loc(f)  = (f - mean over the neighbours) / (standard deviation over them + 1e-8)
//     z_glob(f) = (f - mean) / sample standard deviation over the model
//
// then clipped to the 1 % and 99 % quantiles of the model and scaled to [0, 1]. As in the released
// code with its exact search: Euclidean distances, the primitive itself excluded.

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/compare.h"
#include "base/core.h"
#include "base/sh.h"
#include "base/threads.h"
#include "model/finite_model.h"
#include "model/knn.h"
#include "model/opacity.h"
#include "prune/scores.h"
#include "sparegs/prune.h"

enum {
    NEIGHBOURS = 128,
    DIRECTIONS = 60,
    SH_COUNT = 16,
    GRAIN = 1024,
    STEP = 1 << 15, // primitives between two calls of the progress function
    // Quantities that are compared with the neighbours.
    DISTANCE = 0,
    ANISOTROPY = 1,
    SCALE = 2, // 3, ascending
    VOLUME = 5,
    OPACITY = 6,
    COLOR = 7, // 3
    QUANTITIES = 10
};

static const char *const names[SGS_RAP_FEATURES] = {
    "distance_local", "distance_global", "anisotropy_local", "anisotropy_global", "scale1_local",
    "scale2_local",   "scale3_local",    "scale1_global",    "scale2_global",     "scale3_global",
    "volume_local",   "volume_global",   "opacity_local",    "opacity_global",    "color_local"};

typedef struct rap_job {
    const sgs_gaussians *model;
    float *points;        // [count][3]
    uint32_t *neighbours; // [count][wanted]
    size_t wanted, first;
    double (*quantities)[QUANTITIES]; // [count]
    double basis[DIRECTIONS][SH_COUNT];
    float *features, *sorted; // [count][15], [15][count]
} rap_job;

const char *sgs_rap_feature_name(int k)
{
    return k >= 0 && k < SGS_RAP_FEATURES ? names[k] : NULL;
}

// ---- Quantities of a primitive ----

static void sh_basis(double x, double y, double z, double basis[SH_COUNT])
{
    const double xx = x * x, yy = y * y, zz = z * z;
    const double values[SH_COUNT] = {SGSI_SH_C0,
                                     -0.4886025119029199 * y,
                                     0.4886025119029199 * z,
                                     -0.4886025119029199 * x,
                                     1.0925484305920792 * x * y,
                                     -1.0925484305920792 * y * z,
                                     0.31539156525252005 * (2 * zz - xx - yy),
                                     -1.0925484305920792 * x * z,
                                     0.5462742152960396 * (xx - yy),
                                     -0.5900435899266435 * y * (3 * xx - yy),
                                     2.890611442640554 * x * y * z,
                                     -0.4570457994644658 * y * (4 * zz - xx - yy),
                                     0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
                                     -0.4570457994644658 * x * (4 * zz - xx - yy),
                                     1.445305721320277 * z * (xx - yy),
                                     -0.5900435899266435 * x * (xx - 3 * yy)};
    memcpy(basis, values, sizeof values);
}

// The Fibonacci sphere of the released code.
static void set_basis(rap_job *job)
{
    const double pi = 3.14159265358979323846;
    for (int i = 0; i < DIRECTIONS; ++i) {
        const double u = i + 0.5, polar = acos(1 - 2 * u / DIRECTIONS);
        const double turn = pi * (1 + sqrt(5)) * u;
        sh_basis(sin(polar) * cos(turn), sin(polar) * sin(turn), cos(polar), job->basis[i]);
    }
}

// Standard deviation of the colour over directions. The released code reads the coefficients,
// stored [16][3], as [3][16] without transposing them. The published weights were trained with
// that, so it is kept. Models of a lower SH degree are read like models of degree 3 whose higher
// bands are 0. The released code strides by (degree + 1)^2 then, a reading that the weights,
// trained with degree 3, do not know.
static double anisotropy_of(const rap_job *job, const float params[SGS_PARAM_COUNT])
{
    const float *flat = params + SGS_PARAM_SH_DC;
    double total = 0;
    for (int c = 0; c < 3; ++c) {
        double colors[DIRECTIONS], mean = 0;
        for (int i = 0; i < DIRECTIONS; ++i) {
            double sum = 0.5;
            for (int k = 0; k < SH_COUNT; ++k)
                sum += job->basis[i][k] * (double)flat[SH_COUNT * c + k];
            colors[i] = fmin(fmax(sum, 0), 1);
            mean += colors[i] / DIRECTIONS;
        }
        for (int i = 0; i < DIRECTIONS; ++i)
            total += (colors[i] - mean) * (colors[i] - mean);
    }
    return sqrt(total / (3 * DIRECTIONS));
}

static void swap_if_larger(double *a, double *b)
{
    const double low = fmin(*a, *b), high = fmax(*a, *b);
    *a = low;
    *b = high;
}

static void fill_quantities(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const rap_job *job = context;
    for (size_t i = begin; i < end; ++i) {
        float params[SGS_PARAM_COUNT];
        double *q = job->quantities[i];
        sgs_gaussians_get(job->model, i, params);
        q[ANISOTROPY] = anisotropy_of(job, params);
        for (int k = 0; k < 3; ++k) {
            q[SCALE + k] = exp(fmin(fmax((double)params[SGS_PARAM_SCALE + k], -40), 40));
            q[COLOR + k] = fmin(fmax(SGSI_SH_C0 * (double)params[SGS_PARAM_SH_DC + k] + 0.5, 0), 1);
        }
        swap_if_larger(&q[SCALE], &q[SCALE + 1]);
        swap_if_larger(&q[SCALE + 1], &q[SCALE + 2]);
        swap_if_larger(&q[SCALE], &q[SCALE + 1]);
        q[VOLUME] = q[SCALE] * q[SCALE + 1] * q[SCALE + 2];
        q[OPACITY] = (double)sgsi_gaussians_opacity(job->model, i);
    }
}

static void fill_distances(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const rap_job *job = context;
    for (size_t i = begin; i < end; ++i) {
        const float *at = job->points + 3 * i;
        double sum = 0;
        for (size_t k = 0; k < job->wanted; ++k) {
            const float *to = job->points + 3 * (size_t)job->neighbours[i * job->wanted + k];
            double d2 = 0;
            for (int axis = 0; axis < 3; ++axis)
                d2 += ((double)to[axis] - at[axis]) * ((double)to[axis] - at[axis]);
            sum += sqrt(d2);
        }
        job->quantities[i][DISTANCE] = sum / (double)job->wanted;
    }
}

// ---- Features ----

// z_loc of all quantities of primitive i.
static void local_scores(const rap_job *job, size_t i, double z[QUANTITIES])
{
    const uint32_t *neighbours = job->neighbours + i * job->wanted;
    const double share = 1 / (double)job->wanted;
    double mean[QUANTITIES] = {0}, variance[QUANTITIES] = {0};
    for (size_t k = 0; k < job->wanted; ++k)
        for (int q = 0; q < QUANTITIES; ++q)
            mean[q] += job->quantities[neighbours[k]][q];
    for (int q = 0; q < QUANTITIES; ++q)
        mean[q] *= share;
    for (size_t k = 0; k < job->wanted; ++k)
        for (int q = 0; q < QUANTITIES; ++q) {
            const double difference = job->quantities[neighbours[k]][q] - mean[q];
            variance[q] += difference * difference;
        }
    for (int q = 0; q < QUANTITIES; ++q)
        z[q] = (job->quantities[i][q] - mean[q]) / (sqrt(variance[q] * share) + 1e-8);
}

// Columns of z_loc, and the logarithms for z_glob.
static void fill_features(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const rap_job *job = context;
    for (size_t at = begin; at < end; ++at) {
        const size_t i = job->first + at;
        const double *q = job->quantities[i];
        double z[QUANTITIES], ln[QUANTITIES];
        local_scores(job, i, z);
        for (int k = 0; k < COLOR; ++k) // D, A and o may be 0
            ln[k] = log(fmax(q[k], k == VOLUME ? 1e-60 : 1e-18));
        ln[ANISOTROPY] = log(fmax(q[ANISOTROPY], 1e-12));
        const double row[SGS_RAP_FEATURES] = {
            z[DISTANCE],    ln[DISTANCE], z[ANISOTROPY],
            ln[ANISOTROPY], z[SCALE],     z[SCALE + 1],
            z[SCALE + 2],   ln[SCALE],    ln[SCALE + 1],
            ln[SCALE + 2],  z[VOLUME],    ln[VOLUME],
            z[OPACITY],     ln[OPACITY],  (z[COLOR] + z[COLOR + 1] + z[COLOR + 2]) / 3};
        for (int k = 0; k < SGS_RAP_FEATURES; ++k)
            job->features[i * SGS_RAP_FEATURES + (size_t)k] = (float)row[k];
    }
}

static double quantile(const float *sorted, size_t count, double share)
{
    const double at = share * (double)(count - 1);
    const size_t below = (size_t)at;
    const size_t above = below + 1 < count ? below + 1 : below;
    const double low = (double)sorted[below], high = (double)sorted[above];
    return low + (at - (double)below) * (high - low);
}

static bool is_global(size_t column)
{
    return strstr(names[column], "_global") != NULL;
}

// z_glob where it applies, then clipping and scaling of a column.
static void finish_column(void *context, size_t column, int thread)
{
    (void)thread;
    const rap_job *job = context;
    const size_t n = job->model->count;
    float *values = job->features + column, *sorted = job->sorted + column * n;
    double mean = 0, variance = 0;
    for (size_t i = 0; i < n; ++i)
        mean += (double)values[i * SGS_RAP_FEATURES];
    mean /= (double)n;
    for (size_t i = 0; i < n; ++i) {
        const double difference = (double)values[i * SGS_RAP_FEATURES] - mean;
        variance += difference * difference;
    }
    const double deviation = n > 1 ? sqrt(variance / (double)(n - 1)) : 0;
    for (size_t i = 0; i < n; ++i) {
        float *value = &values[i * SGS_RAP_FEATURES];
        if (is_global(column))
            *value = deviation > 0 ? (float)(((double)*value - mean) / deviation) : 0.0f;
        sorted[i] = *value;
    }
    qsort(sorted, n, sizeof *sorted, sgsi_compare_floats);
    const double low = quantile(sorted, n, 0.01), high = quantile(sorted, n, 0.99);
    for (size_t i = 0; i < n; ++i) {
        float *value = &values[i * SGS_RAP_FEATURES];
        const double clipped = fmin(fmax((double)*value, low), high);
        *value = high > low ? (float)((clipped - low) / (high - low)) : 0.0f;
    }
}

typedef struct step_counter {
    size_t done, total;
    sgs_progress_fn call;
    void *user;
} step_counter;

static sgs_status count_step(step_counter *steps)
{
    ++steps->done;
    return !steps->call || steps->call(steps->user, steps->done, steps->total)
               ? SGS_STATUS_OK
               : sgsi_fail(SGS_STATUS_CANCELLED, "feature computation was cancelled");
}

// The search, then the features: STEP primitives each.
static sgs_status run_steps(rap_job *job, const sgsi_knn_tree *tree, sgs_progress_fn progress,
                            void *user)
{
    const size_t n = job->model->count;
    step_counter steps = {.total = 2 * ((n + STEP - 1) / STEP), .call = progress, .user = user};
    sgs_status status = SGS_STATUS_OK;
    for (size_t first = 0; first < n && !status; first += STEP) {
        sgsi_knn_tree_search(tree, first, first + STEP < n ? first + STEP : n, job->wanted,
                             job->neighbours);
        status = count_step(&steps);
    }
    if (!status)
        sgsi_parallel_ranges(n, GRAIN, fill_distances, job);
    for (job->first = 0; job->first < n && !status; job->first += STEP) {
        const size_t left = n - job->first;
        sgsi_parallel_ranges(left < STEP ? left : STEP, GRAIN, fill_features, job);
        status = count_step(&steps);
    }
    return status;
}

static sgs_status compute(rap_job *job, sgs_progress_fn progress, void *user)
{
    const size_t n = job->model->count;
    sgsi_knn_tree *tree = NULL;
    job->points = sgsi_alloc(n, 3 * sizeof *job->points);
    job->neighbours = sgsi_alloc(n, job->wanted * sizeof *job->neighbours);
    job->quantities = sgsi_alloc(n, sizeof *job->quantities);
    job->sorted = sgsi_alloc(n, SGS_RAP_FEATURES * sizeof *job->sorted);
    if (!job->points || !job->neighbours || !job->quantities || !job->sorted)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for the features of %zu primitives", n);
    for (int axis = 0; axis < 3; ++axis)
        for (size_t i = 0; i < n; ++i)
            job->points[3 * i + (size_t)axis] =
                *sgs_gaussians_at(job->model, i, SGS_PARAM_MEAN + axis);
    sgs_status status = sgsi_knn_tree_create(job->points, n, &tree);
    if (!status) {
        sgsi_parallel_ranges(n, GRAIN, fill_quantities, job);
        status = run_steps(job, tree, progress, user);
    }
    if (!status)
        sgsi_parallel_for(SGS_RAP_FEATURES, 1, finish_column, job);
    sgsi_knn_tree_destroy(tree);
    return status;
}

sgs_status sgs_rap_features(const sgs_gaussians *model, sgs_progress_fn progress, void *user,
                            float *features)
{
    if (model->count < 2)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "the model has %zu primitives; RAP compares primitives with their "
                         "neighbours and requires at least 2",
                         model->count);
    sgs_status status = sgsi_finite_model_check(model, NULL);
    if (status)
        return status;
    rap_job job = {.model = model,
                   .wanted = model->count - 1 < NEIGHBOURS ? model->count - 1 : NEIGHBOURS,
                   .features = features};
    set_basis(&job);
    status = compute(&job, progress, user);
    sgsi_free(job.points);
    sgsi_free(job.neighbours);
    sgsi_free(job.quantities);
    sgsi_free(job.sorted);
    return status;
}
