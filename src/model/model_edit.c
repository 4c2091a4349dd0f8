// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "sparegs/model_edit.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/compare.h"
#include "base/core.h"
#include "base/keyed_rows.h"
#include "base/sh.h"
#include "base/threads.h"
#include "model/knn.h"
#include "model/sh_degree.h"
#include "model/similarity.h"

enum { VOXEL_BITS = 20, VOXELS_PER_SIDE = 1 << VOXEL_BITS, NEIGHBORS = 13 };

static const double VOXEL_FACTOR = 4.0;

// ---- Transforms ----

typedef struct transform_job {
    sgs_gaussians *model;
    sgsi_similarity similarity;
} transform_job;

static void transform_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const transform_job *job = context;
    for (size_t i = begin; i < end; ++i) {
        float params[SGS_PARAM_COUNT];
        sgs_gaussians_get(job->model, i, params);
        sgsi_similarity_apply(&job->similarity, params);
        sgs_gaussians_set(job->model, i, params);
    }
}

// The first primitive whose centre or scale would leave the range of model files; count if none.
static size_t find_out_of_range(const sgs_gaussians *model, const sgsi_similarity *s)
{
    for (size_t i = 0; i < model->count; ++i) {
        double mean[3];
        for (int k = 0; k < 3; ++k) {
            mean[k] = (double)*sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k);
            if ((double)*sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k) + s->log_scale >
                (double)SGSI_MAX_LOG_SCALE)
                return i;
        }
        for (int k = 0; k < 3; ++k)
            if (!(fabs(s->scale * (s->rotation[k][0] * mean[0] + s->rotation[k][1] * mean[1] +
                                   s->rotation[k][2] * mean[2]) +
                       s->translation[k]) <= (double)FLT_MAX))
                return i;
    }
    return model->count;
}

sgs_status sgs_gaussians_transform(sgs_gaussians *model, const sgs_similarity *similarity)
{
    double largest = 0.0;
    bool valid = similarity->scale > 0.0 && isfinite(similarity->scale);
    for (int k = 0; k < 4; ++k) {
        valid = valid && isfinite(similarity->rotation[k]);
        largest = fmax(largest, fabs(similarity->rotation[k]));
    }
    for (int k = 0; k < 3; ++k)
        valid = valid && isfinite(similarity->translation[k]);
    if (!valid || !(largest > 0.0))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "a transform requires a positive scale, a rotation that is not 0, and a "
                         "finite translation");
    transform_job job = {model, sgsi_similarity_make(similarity->scale, similarity->rotation,
                                                     similarity->translation)};
    const size_t wrong = find_out_of_range(model, &job.similarity);
    if (wrong < model->count)
        return sgsi_fail(SGS_STATUS_LIMIT,
                         "the transform moves or scales primitive %zu beyond the range of float; "
                         "use a smaller scale or translation",
                         wrong);
    sgsi_parallel_ranges(model->count, 1024, transform_range, &job);
    return SGS_STATUS_OK;
}

void sgs_gaussians_limit_sh(sgs_gaussians *model, int sh_degree)
{
    sh_degree = sh_degree < 0 ? 0 : sh_degree;
    if (sh_degree >= model->sh_degree)
        return;
    const int first = SGS_PARAM_SH_REST + 3 * ((sh_degree + 1) * (sh_degree + 1) - 1);
    for (size_t i = 0; i < model->count; ++i)
        for (int k = first; k < SGS_PARAM_COUNT; ++k)
            *sgs_gaussians_at(model, i, k) = 0.0f;
    model->sh_degree = sh_degree;
}

void sgs_selection_apply(sgs_gaussians *model, const unsigned char *keep)
{
    size_t kept = 0;
    for (size_t i = 0; i < model->count; ++i) {
        float params[SGS_PARAM_COUNT];
        if (!keep[i])
            continue;
        sgs_gaussians_get(model, i, params);
        sgs_gaussians_set(model, kept++, params);
    }
    sgs_gaussians_resize(model, kept); // shrinking needs no memory
}

// ---- Selections ----

void sgs_select_box(const sgs_gaussians *model, const double low[3], const double high[3],
                    unsigned char *keep)
{
    for (size_t i = 0; i < model->count; ++i)
        for (int k = 0; k < 3; ++k) {
            const double value = (double)*sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k);
            if (!(value >= low[k] && value <= high[k]))
                keep[i] = 0;
        }
}

void sgs_select_sphere(const sgs_gaussians *model, const double center[3], double radius,
                       unsigned char *keep)
{
    for (size_t i = 0; i < model->count; ++i) {
        double sum = 0.0;
        for (int k = 0; k < 3; ++k) {
            const double offset =
                (double)*sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k) - center[k];
            sum += offset * offset;
        }
        if (!(radius >= 0.0 && sum <= radius * radius))
            keep[i] = 0;
    }
}

typedef enum activation { AS_STORED, AS_OPACITY, AS_SCALE, AS_COLOR } activation;

// A number below `count` after the prefix; -1 if the name has another form.
static int numbered(const char *name, const char *prefix, int count)
{
    const size_t length = strlen(prefix);
    char *end;
    if (strncmp(name, prefix, length) || name[length] < '0' || name[length] > '9')
        return -1;
    const long number = strtol(name + length, &end, 10);
    return (!*end || !strcmp(end, "_raw")) && number < count ? (int)number : -1;
}

// Parameter of a property, -1 if the name is unknown.
static int find_property(const char *name, int sh_degree, activation *how)
{
    const size_t length = strlen(name);
    const bool raw = length > 4 && !strcmp(name + length - 4, "_raw");
    const int per_channel = (sh_degree + 1) * (sh_degree + 1) - 1;
    int k;
    *how = AS_STORED;
    if (length == 1 && *name >= 'x' && *name <= 'z')
        return SGS_PARAM_MEAN + (*name - 'x');
    if (!strcmp(name, "opacity") || !strcmp(name, "opacity_raw")) {
        *how = raw ? AS_STORED : AS_OPACITY;
        return SGS_PARAM_OPACITY;
    }
    if ((k = numbered(name, "scale_", 3)) >= 0) {
        *how = raw ? AS_STORED : AS_SCALE;
        return SGS_PARAM_SCALE + k;
    }
    if ((k = numbered(name, "f_dc_", 3)) >= 0) {
        *how = raw ? AS_STORED : AS_COLOR;
        return SGS_PARAM_SH_DC + k;
    }
    if ((k = numbered(name, "rot_", 4)) >= 0)
        return SGS_PARAM_ROTATION + k;
    if ((k = numbered(name, "f_rest_", 3 * per_channel)) >= 0)
        return SGS_PARAM_SH_REST + 3 * (k % per_channel) + k / per_channel;
    return -1;
}

static double property_value(const sgs_gaussians *model, size_t i, int param, activation how)
{
    const double stored = param == SGS_PARAM_OPACITY ? (double)sgs_gaussians_opacity_logit(model, i)
                                                     : (double)*sgs_gaussians_at(model, i, param);
    return how == AS_OPACITY ? 1.0 / (1.0 + exp(-stored))
           : how == AS_SCALE ? exp(stored)
           : how == AS_COLOR ? 0.5 + SGSI_SH_C0 * stored
                             : stored;
}

static bool compare(double a, sgs_comparison comparison, double b)
{
    switch (comparison) {
    case SGS_LESS:
        return a < b;
    case SGS_LESS_EQUAL:
        return a <= b;
    case SGS_GREATER:
        return a > b;
    case SGS_GREATER_EQUAL:
        return a >= b;
    case SGS_EQUAL:
        return a == b;
    default:
        return a != b;
    }
}

sgs_status sgs_select_value(const sgs_gaussians *model, const char *property,
                            sgs_comparison comparison, double value, unsigned char *keep)
{
    activation how;
    const sgs_status status = sgsi_sh_degree_check(model, NULL);
    if (status)
        return status;
    const int param = find_property(property, model->sh_degree, &how);
    if (param < 0)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "unknown property '%.64s'; the model has x, y, z, opacity, scale_0 to 2, "
                         "rot_0 to 3, f_dc_0 to 2 and %d f_rest",
                         property, 3 * ((model->sh_degree + 1) * (model->sh_degree + 1) - 1));
    for (size_t i = 0; i < model->count; ++i)
        if (!compare(property_value(model, i, param, how), comparison, value))
            keep[i] = 0;
    return SGS_STATUS_OK;
}

// ---- Components ----

typedef struct voxel_grid {
    sgsi_keyed_row *rows; // solid primitives by voxel
    size_t row_count, voxel_count;
    uint64_t *voxels;  // [voxel_count] keys, ascending
    uint32_t *parents; // [voxel_count] of the union-find forest
    size_t *members;   // [voxel_count]
    double low[3], size;
} voxel_grid;

// Four times the median distance to the third nearest neighbour.
static sgs_status find_voxel_size(const sgs_gaussians *model, const sgsi_keyed_row *rows,
                                  size_t count, double *size)
{
    float *points = sgsi_alloc(count, 3 * sizeof *points);
    double *distances = sgsi_alloc(count, SGSI_KNN_NEIGHBOURS * sizeof *distances);
    sgs_status status = points && distances ? SGS_STATUS_OK
                                            : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                                        "not enough memory for %zu points", count);
    for (size_t i = 0; !status && i < count; ++i)
        for (size_t k = 0; k < 3; ++k)
            points[3 * i + k] = *sgs_gaussians_at(model, rows[i].row, SGS_PARAM_MEAN + (int)k);
    if (!status)
        status = sgsi_knn(points, count, distances);
    if (!status) {
        for (size_t i = 0; i < count; ++i)
            distances[i] = distances[SGSI_KNN_NEIGHBOURS * i + SGSI_KNN_NEIGHBOURS - 1];
        qsort(distances, count, sizeof *distances, sgsi_compare_doubles);
        *size = VOXEL_FACTOR * sqrt(distances[count / 2]);
    }
    sgsi_free(points);
    sgsi_free(distances);
    return status;
}

// Begins the grid at the lowest centre or, if it does not reach the highest one from there, around
// the median, so that far outliers share the outermost voxels and the rest is resolved.
static sgs_status place_grid(const sgs_gaussians *model, voxel_grid *grid)
{
    double *values = NULL;
    for (int k = 0; k < 3; ++k) {
        double low = INFINITY, high = -INFINITY;
        for (size_t i = 0; i < model->count; ++i) {
            const double value = (double)*sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k);
            low = fmin(low, value);
            high = fmax(high, value);
        }
        grid->low[k] = low;
        if (!grid->row_count || (high - low) / grid->size < VOXELS_PER_SIDE)
            continue;
        values = values ? values : sgsi_alloc(grid->row_count, sizeof *values);
        if (!values)
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu points",
                             grid->row_count);
        for (size_t i = 0; i < grid->row_count; ++i)
            values[i] = (double)*sgs_gaussians_at(model, grid->rows[i].row, SGS_PARAM_MEAN + k);
        qsort(values, grid->row_count, sizeof *values, sgsi_compare_doubles);
        const double low_end = values[grid->row_count / 100],
                     high_end = values[grid->row_count - 1 - grid->row_count / 100];
        if ((high_end - low_end) / grid->size >= VOXELS_PER_SIDE) {
            sgsi_free(values);
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                             "voxel size %g is too small for floaters: at least %.2g is required "
                             "for this model",
                             grid->size, 1.01 * (high_end - low_end) / VOXELS_PER_SIDE);
        }
        grid->low[k] = values[grid->row_count / 2] - grid->size * (VOXELS_PER_SIDE / 2);
    }
    sgsi_free(values);
    return SGS_STATUS_OK;
}

static uint64_t voxel_of(const sgs_gaussians *model, size_t i, const voxel_grid *grid)
{
    uint64_t key = 0;
    for (int k = 0; k < 3; ++k) {
        const double cell = floor(
            ((double)*sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k) - grid->low[k]) / grid->size);
        // One cell of margin on each side, so that neighbours do not wrap.
        key =
            key << (VOXEL_BITS + 1) | (uint64_t)(fmin(fmax(cell, 0.0), VOXELS_PER_SIDE - 1) + 1.0);
    }
    return key;
}

// Index of an occupied voxel; voxel_count if it is empty.
static size_t find_voxel(const voxel_grid *grid, uint64_t key)
{
    size_t low = 0, high = grid->voxel_count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (grid->voxels[middle] < key)
            low = middle + 1;
        else
            high = middle;
    }
    return low < grid->voxel_count && grid->voxels[low] == key ? low : grid->voxel_count;
}

static uint32_t find_root(uint32_t *parents, uint32_t k)
{
    while (parents[k] != k) {
        parents[k] = parents[parents[k]];
        k = parents[k];
    }
    return k;
}

// Joins voxels with the half of their 26 neighbours that follows them.
static void join_voxels(voxel_grid *grid)
{
    const uint64_t x = UINT64_C(1) << (2 * VOXEL_BITS + 2), y = UINT64_C(1) << (VOXEL_BITS + 1);
    const uint64_t steps[NEIGHBORS] = {1,         y - 1,     y,        y + 1, x - y - 1,
                                       x - y,     x - y + 1, x - 1,    x,     x + 1,
                                       x + y - 1, x + y,     x + y + 1};
    for (size_t k = 0; k < grid->voxel_count; ++k)
        for (int n = 0; n < NEIGHBORS; ++n) {
            const size_t other = find_voxel(grid, grid->voxels[k] + steps[n]);
            if (other == grid->voxel_count)
                continue;
            const uint32_t a = find_root(grid->parents, (uint32_t)k),
                           b = find_root(grid->parents, (uint32_t)other);
            grid->parents[a > b ? a : b] = a > b ? b : a;
        }
}

// Solid primitives sorted by voxel, and the list of voxels.
static sgs_status fill_grid(const sgs_gaussians *model, const sgs_floater_options *options,
                            voxel_grid *grid)
{
    const size_t count = model->count;
    grid->rows = sgsi_alloc(count + 1, sizeof *grid->rows);
    grid->voxels = sgsi_alloc(count + 1, sizeof *grid->voxels);
    grid->parents = sgsi_alloc(count + 1, sizeof *grid->parents);
    grid->members = sgsi_calloc(count + 1, sizeof *grid->members);
    sgsi_keyed_row *spare = sgsi_alloc(count + 1, sizeof *spare);
    sgs_status status = SGS_STATUS_OK;
    if (!grid->rows || !grid->voxels || !grid->parents || !grid->members || !spare)
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to connect %zu primitives",
                           count);
    for (size_t i = 0; !status && i < count; ++i) {
        const double opacity = 1.0 / (1.0 + exp(-(double)sgs_gaussians_opacity_logit(model, i)));
        if (opacity >= options->opacity)
            grid->rows[grid->row_count++].row = (uint32_t)i;
    }
    grid->size = options->voxel;
    if (!status && !(grid->size > 0.0) && grid->row_count > SGSI_KNN_NEIGHBOURS)
        status = find_voxel_size(model, grid->rows, grid->row_count, &grid->size);
    if (!status && !(grid->size > 0.0))
        grid->size = 1.0; // coincident or few primitives
    if (!status)
        status = place_grid(model, grid);
    for (size_t i = 0; !status && i < grid->row_count; ++i)
        grid->rows[i].key = voxel_of(model, grid->rows[i].row, grid);
    if (!status)
        sgsi_sort_rows(grid->rows, spare, grid->row_count);
    for (size_t i = 0; !status && i < grid->row_count; ++i)
        if (!i || grid->rows[i].key != grid->rows[i - 1].key) {
            grid->parents[grid->voxel_count] = (uint32_t)grid->voxel_count;
            grid->voxels[grid->voxel_count++] = grid->rows[i].key;
        }
    sgsi_free(spare);
    return status;
}

static bool is_amount(double value)
{
    return value >= 0.0 && isfinite(value);
}

sgs_status sgs_select_connected(const sgs_gaussians *model, const sgs_floater_options *options,
                                unsigned char *keep)
{
    static const sgs_floater_options typical = {.voxel = 0.0, .opacity = 0.1, .share = 0.01};
    voxel_grid grid = {0};
    options = options ? options : &typical;
    if (!is_amount(options->voxel) || !is_amount(options->opacity) || !is_amount(options->share))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "voxel size, opacity and share of floaters must be finite and not "
                         "negative");
    const sgs_status status = fill_grid(model, options, &grid);
    if (!status) {
        join_voxels(&grid);
        for (size_t i = 0; i < grid.row_count; ++i) {
            const size_t voxel = find_voxel(&grid, grid.rows[i].key);
            ++grid.members[find_root(grid.parents, (uint32_t)voxel)];
        }
        for (size_t i = 0; i < model->count; ++i) {
            const size_t voxel = find_voxel(&grid, voxel_of(model, i, &grid));
            if (voxel == grid.voxel_count ||
                (double)grid.members[find_root(grid.parents, (uint32_t)voxel)] <
                    options->share * (double)grid.row_count)
                keep[i] = 0;
        }
    }
    sgsi_free(grid.rows);
    sgsi_free(grid.voxels);
    sgsi_free(grid.parents);
    sgsi_free(grid.members);
    return status;
}
