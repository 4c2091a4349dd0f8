// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Storage of a model, its 3DGS initialisation from a point cloud, and its hash.
//
// Storage is blocks of 16 rows (include/sparegs/gaussians.h). Rows after the last one are inert, so
// that kernels can process whole blocks: the opacity of an inert row is 1e-13, below any hit.
//
// Initialisation follows the code of Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance
// Field Rendering", 2023: the scale is the root of the mean squared distance to the three nearest
// other points. The distances are exact and in double precision (in float in the original).

#include "sparegs/gaussians.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "base/sh.h"
#include "base/core.h"
#include "model/init_points.h"
#include "model/model_hash.h"
#include "model/knn.h"
#include "base/threads.h"

static const float INERT_OPACITY_LOGIT = -30.0f;
static const float INERT_LOG_SCALE = -20.0f;
static const double SMALLEST_SQUARED_DISTANCE = 1e-7; // for scenes of extent >= 1
static const double FALLBACK_OF_EXTENT = 0.01;
static const double LARGEST_SCALE = 1e18; // readers of models omit scales from exp(44) on

enum { INIT_GRAIN = 4096 };
static const size_t MAX_PRIMITIVES = (size_t)INT32_MAX - 15; // ids have 32 bits, some are signed

typedef struct inert_rows {
    sgs_gaussians *model;
    size_t first;
} inert_rows;

static void inert_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const inert_rows *rows = context;
    float params[SGS_PARAM_COUNT] = {0};
    params[SGS_PARAM_ROTATION] = 1.0f;
    for (int k = 0; k < 3; ++k)
        params[SGS_PARAM_SCALE + k] = INERT_LOG_SCALE;
    params[SGS_PARAM_OPACITY] = rows->model->linear_opacity ? 0.0f : INERT_OPACITY_LOGIT;
    for (size_t i = begin; i < end; ++i)
        sgs_gaussians_set(rows->model, rows->first + i, params);
}

// Zeroed by all threads, which distributes the pages over NUMA nodes.
static void make_inert(sgs_gaussians *model, size_t begin, size_t end)
{
    inert_rows rows = {model, begin};
    sgsi_parallel_ranges(end - begin, INIT_GRAIN, inert_range, &rows);
}

sgs_status sgs_gaussians_create(size_t capacity, sgs_gaussians **model)
{
    *model = NULL;
    sgs_gaussians *fresh = sgsi_calloc(1, sizeof *fresh);
    if (!fresh)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for a model");
    fresh->sh_degree = 3;
    const sgs_status status = sgs_gaussians_reserve(fresh, capacity ? capacity : SGS_LANES);
    if (status) {
        sgsi_free(fresh);
        return status;
    }
    *model = fresh;
    return SGS_STATUS_OK;
}

void sgs_gaussians_destroy(sgs_gaussians *model)
{
    if (!model)
        return;
    sgsi_free(model->data);
    sgsi_free(model);
}

sgs_status sgs_gaussians_reserve(sgs_gaussians *model, size_t capacity)
{
    if (capacity <= model->capacity)
        return SGS_STATUS_OK;
    if (capacity > MAX_PRIMITIVES)
        return sgsi_fail(SGS_STATUS_LIMIT, "%zu primitives exceed the limit of %zu", capacity,
                         MAX_PRIMITIVES);
    const size_t blocks = (capacity + SGS_LANES - 1) / SGS_LANES;
    void *data = model->data;
    if (!sgsi_grow(&data, model->capacity / SGS_LANES, blocks,
                   sizeof(float) * SGS_PARAM_COUNT * SGS_LANES))
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for %zu primitives; lower option max_gaussians",
                         capacity);
    const size_t old = model->capacity;
    model->data = data;
    model->capacity = blocks * SGS_LANES;
    make_inert(model, old, model->capacity);
    return SGS_STATUS_OK;
}

sgs_status sgs_gaussians_resize(sgs_gaussians *model, size_t count)
{
    const sgs_status status = sgs_gaussians_reserve(model, count);
    if (status)
        return status;
    // Rows that are added or removed become inert.
    const size_t low = count < model->count ? count : model->count;
    const size_t high = count < model->count ? model->count : count;
    make_inert(model, low, high);
    model->count = count;
    return SGS_STATUS_OK;
}

sgs_status sgs_gaussians_copy(sgs_gaussians *to, const sgs_gaussians *from)
{
    const sgs_status status = sgs_gaussians_resize(to, from->count);
    if (status)
        return status;
    const size_t blocks = (from->count + SGS_LANES - 1) / SGS_LANES;
    memcpy(to->data, from->data, blocks * SGS_PARAM_COUNT * SGS_LANES * sizeof *to->data);
    to->sh_degree = from->sh_degree;
    to->linear_opacity = from->linear_opacity;
    return SGS_STATUS_OK;
}

void sgs_gaussians_get(const sgs_gaussians *model, size_t i, float params[SGS_PARAM_COUNT])
{
    const float *column = sgs_gaussians_at(model, i, 0);
    for (int k = 0; k < SGS_PARAM_COUNT; ++k)
        params[k] = column[k * SGS_LANES];
}

void sgs_gaussians_set(sgs_gaussians *model, size_t i, const float params[SGS_PARAM_COUNT])
{
    float *column = sgs_gaussians_at(model, i, 0);
    for (int k = 0; k < SGS_PARAM_COUNT; ++k)
        column[k * SGS_LANES] = params[k];
}

typedef struct strided_copy {
    float *column; // parameter of row 0
    size_t first, stride;
    char *out;      // or
    const char *in; // this
} strided_copy;

static void copy_strided(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const strided_copy *copy = context;
    for (size_t i = begin; i < end; ++i) {
        const size_t row = copy->first + i;
        float *value =
            copy->column + row / SGS_LANES * SGS_LANES * SGS_PARAM_COUNT + row % SGS_LANES;
        if (copy->out)
            memcpy(copy->out + i * copy->stride, value, sizeof *value);
        else
            memcpy(value, copy->in + i * copy->stride, sizeof *value);
    }
}

static sgs_status copy_parameter(const sgs_gaussians *model, int param, size_t count,
                                 strided_copy *copy)
{
    if (param < 0 || param >= SGS_PARAM_COUNT)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "parameter %d is not within 0 to %d", param,
                         SGS_PARAM_COUNT - 1);
    if (copy->first > model->count || count > model->count - copy->first)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "%zu primitives from %zu on exceed the model's %zu", count, copy->first,
                         model->count);
    if (copy->stride && copy->stride < sizeof(float))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "a stride of %zu bytes is below %zu",
                         copy->stride, sizeof(float));
    if (!copy->stride)
        copy->stride = sizeof(float);
    copy->column = model->data + (size_t)param * SGS_LANES;
    sgsi_parallel_ranges(count, INIT_GRAIN, copy_strided, copy);
    return SGS_STATUS_OK;
}

sgs_status sgs_gaussians_read(const sgs_gaussians *model, int param, size_t first, size_t count,
                              float *out, size_t stride_bytes)
{
    strided_copy copy = {.first = first, .stride = stride_bytes, .out = (char *)out};
    return copy_parameter(model, param, count, &copy);
}

sgs_status sgs_gaussians_write(sgs_gaussians *model, int param, size_t first, size_t count,
                               const float *in, size_t stride_bytes)
{
    strided_copy copy = {.first = first, .stride = stride_bytes, .in = (const char *)in};
    return copy_parameter(model, param, count, &copy);
}

typedef struct init_loop {
    const float *points;
    const unsigned char *colors;
    const double *distances;
    double fallback_scale, least_squared;
    float logit, log_factor; // opacity; on the scales
    sgs_gaussians *model;
} init_loop;

static void init_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const init_loop *loop = context;
    for (size_t i = begin; i < end; ++i) {
        float params[SGS_PARAM_COUNT] = {0};
        double sum = 0.0;
        int found = 0;
        for (int k = 0; k < SGSI_KNN_NEIGHBOURS; ++k) {
            const double d = loop->distances[i * SGSI_KNN_NEIGHBOURS + (size_t)k];
            if (isfinite(d)) {
                sum += d;
                ++found;
            }
        }
        const double mean = found ? sum / found : loop->fallback_scale * loop->fallback_scale;
        const double squared = mean > loop->least_squared ? mean : loop->least_squared;
        for (int k = 0; k < 3; ++k) {
            params[SGS_PARAM_MEAN + k] = loop->points[3 * i + (size_t)k];
            params[SGS_PARAM_SCALE + k] = (float)(0.5 * log(squared)) + loop->log_factor;
            params[SGS_PARAM_SH_DC + k] =
                (float)(((loop->colors ? loop->colors[3 * i + (size_t)k] : 128) / 255.0 - 0.5) /
                        SGSI_SH_C0);
        }
        params[SGS_PARAM_ROTATION] = 1.0f;
        params[SGS_PARAM_OPACITY] = loop->logit;
        sgs_gaussians_set(loop->model, i, params);
    }
}

sgs_status sgs_gaussians_init_points(const float *points, const unsigned char *colors, size_t n,
                                     double fallback_scale, sgs_gaussians **model)
{
    return sgsi_gaussians_init_points(points, colors, n, fallback_scale, 0.1, 1.0, model);
}

sgs_status sgsi_gaussians_init_points(const float *points, const unsigned char *colors, size_t n,
                                      double fallback_scale, double opacity, double scale_factor,
                                      sgs_gaussians **model)
{
    *model = NULL;
    for (size_t i = 0; i < 3 * n; ++i) {
        if (!isfinite(points[i]))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                             "point %zu of the initial cloud is not finite; remove it", i / 3);
    }
    if (n == 1 && !(fallback_scale > 0.0 && fallback_scale <= LARGEST_SCALE))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "a cloud of one point requires a positive scale of at most %g, not %g",
                         LARGEST_SCALE, fallback_scale);
    double *distances = sgsi_alloc(n, sizeof *distances * SGSI_KNN_NEIGHBOURS);
    if (!distances)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for an initial cloud of %zu points", n);
    sgs_gaussians *fresh = NULL;
    sgs_status status = sgsi_knn(points, n, distances);
    if (!status)
        status = sgs_gaussians_create(n, &fresh);
    if (!status)
        status = sgs_gaussians_resize(fresh, n);
    if (status) {
        sgs_gaussians_destroy(fresh);
        sgsi_free(distances);
        return status;
    }
    const double extent = fallback_scale > 0.0 ? fallback_scale / FALLBACK_OF_EXTENT : 1.0;
    const double least = fmax(SMALLEST_SQUARED_DISTANCE * fmin(1.0, extent * extent),
                              1.0 / (LARGEST_SCALE * LARGEST_SCALE));
    init_loop loop = {.points = points,
                      .colors = colors,
                      .distances = distances,
                      .fallback_scale = fallback_scale,
                      .least_squared = least,
                      .logit = (float)log(opacity / (1.0 - opacity)),
                      .log_factor = (float)log(scale_factor),
                      .model = fresh};
    sgsi_parallel_ranges(n, INIT_GRAIN, init_range, &loop);
    sgsi_free(distances);
    *model = fresh;
    return SGS_STATUS_OK;
}

float sgs_gaussians_opacity_logit(const sgs_gaussians *model, size_t i)
{
    const float x = *sgs_gaussians_at(model, i, SGS_PARAM_OPACITY);
    if (!model->linear_opacity)
        return x;
    const double opacity = fmin(fmax(fabs((double)x), 1e-13), 1.0 - 1e-6);
    return (float)log(opacity / (1.0 - opacity));
}

void sgs_gaussians_linearize_opacity(sgs_gaussians *model)
{
    for (size_t i = 0; i < model->capacity && !model->linear_opacity; ++i) {
        float *x = sgs_gaussians_at(model, i, SGS_PARAM_OPACITY);
        *x = (float)(1.0 / (1.0 + exp(-(double)*x)));
    }
    model->linear_opacity = true;
}

void sgs_gaussians_declare_linear_opacity(sgs_gaussians *model)
{
    model->linear_opacity = true;
    make_inert(model, model->count, model->capacity);
}

// 64-bit XXH3 of count, degree and the rows in order; independent of capacity and block layout.
struct sgsi_gaussians_hasher {
    XXH3_state_t state;
};

static void hash_begin(sgsi_gaussians_hasher *hasher, size_t count, int sh_degree)
{
    const uint64_t head[2] = {count, (uint64_t)sh_degree};
    XXH3_64bits_reset(&hasher->state);
    XXH3_64bits_update(&hasher->state, head, sizeof head);
}

static void hash_end(const sgsi_gaussians_hasher *hasher, char hex[17])
{
    snprintf(hex, 17, "%016llx", (unsigned long long)XXH3_64bits_digest(&hasher->state));
}

sgsi_gaussians_hasher *sgsi_gaussians_hash_begin(size_t count, int sh_degree)
{
    sgsi_gaussians_hasher *hasher = sgsi_calloc(1, sizeof *hasher);
    if (hasher)
        hash_begin(hasher, count, sh_degree);
    return hasher;
}

void sgsi_gaussians_hash_rows(sgsi_gaussians_hasher *hasher, const sgs_gaussians *rows)
{
    for (size_t i = 0; i < rows->count; ++i) {
        float params[SGS_PARAM_COUNT];
        sgs_gaussians_get(rows, i, params);
        params[SGS_PARAM_OPACITY] = sgs_gaussians_opacity_logit(rows, i);
        XXH3_64bits_update(&hasher->state, params, sizeof params);
    }
}

void sgsi_gaussians_hash_end(sgsi_gaussians_hasher *hasher, char hex[17])
{
    if (hasher)
        hash_end(hasher, hex);
    sgsi_free(hasher);
}

void sgs_gaussians_hash(const sgs_gaussians *model, char hex[17])
{
    sgsi_gaussians_hasher hasher;
    hash_begin(&hasher, model->count, model->sh_degree);
    sgsi_gaussians_hash_rows(&hasher, model);
    hash_end(&hasher, hex);
}
