// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Thinning follows a Morton curve, on which neighbours are mostly near in space. In each round
// every second point may be removed, those nearest to their predecessor first. Neighbours are never
// removed in the same round, so that a dense row keeps every other point. Distances alone would
// give a small cap to the far background, where points are sparse: each run of points along the
// curve keeps at least FLOOR times its share. Runs are long enough for SHARE points after thinning.

#include "train/initial_selection.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "base/morton.h"
#include "density/pipeline.h"
#include "model/opacity.h"

enum { MIN_RUN = 64, SHARE = 16 };
#define FLOOR 0.5

typedef struct ordered_point {
    uint64_t code;
    size_t index;
    size_t run; // number of its run
} ordered_point;

static int by_code(const void *a, const void *b)
{
    const ordered_point *p = a, *q = b;
    if (p->code != q->code)
        return p->code < q->code ? -1 : 1;
    return p->index < q->index ? -1 : p->index > q->index;
}

static void order_points(const float *points, size_t n, size_t run, ordered_point *order)
{
    float low[3], inv_size[3];
    for (size_t k = 0; k < 3; ++k) {
        float high = low[k] = points[k];
        for (size_t i = 1; i < n; ++i) {
            low[k] = fminf(low[k], points[3 * i + k]);
            high = fmaxf(high, points[3 * i + k]);
        }
        inv_size[k] = high > low[k] ? 1.0f / (high - low[k]) : 0.0f;
    }
    for (size_t i = 0; i < n; ++i)
        order[i] =
            (ordered_point){.code = sgsi_morton_code(points + 3 * i, low, inv_size), .index = i};
    qsort(order, n, sizeof *order, by_code);
    for (size_t i = 0; i < n; ++i)
        order[i].run = i / run;
}

static double squared_distance(const float *a, const float *b)
{
    double sum = 0.0;
    for (int k = 0; k < 3; ++k)
        sum += ((double)a[k] - (double)b[k]) * ((double)a[k] - (double)b[k]);
    return sum;
}

// Keeps no more candidates among `count` points than may be lost: those of highest score. chosen
// [count]: scratch.
static sgs_status limit_run(const double *score, size_t count, size_t may_lose, uint8_t *removable,
                            uint8_t *chosen)
{
    size_t candidates = 0;
    for (size_t i = 0; i < count; ++i)
        candidates += removable[i];
    if (candidates <= may_lose)
        return SGS_STATUS_OK;
    const sgs_status status = sgsi_select_best(score, removable, count, may_lose, chosen);
    if (!status)
        memcpy(removable, chosen, count);
    return status;
}

// Removes up to `excess` of the *count points. may_lose [runs]; score [*count], marks [2 * *count]:
// scratch.
static sgs_status thin_once(const float *points, ordered_point *order, size_t *count, size_t excess,
                            size_t *may_lose, double *score, uint8_t *marks)
{
    const size_t n = *count;
    const size_t most = (n / 2 + 1) / 2; // half of the candidates, because distances grow
    uint8_t *const removable = marks, *const removed = marks + n;
    for (size_t i = 0; i < n; ++i) {
        removable[i] = i % 2;
        score[i] =
            i % 2 ? -squared_distance(points + 3 * order[i].index, points + 3 * order[i - 1].index)
                  : 0.0;
    }
    sgs_status status = SGS_STATUS_OK;
    for (size_t begin = 0, end = 0; begin < n && !status; begin = end) {
        while (end < n && order[end].run == order[begin].run)
            ++end;
        status = limit_run(score + begin, end - begin, may_lose[order[begin].run],
                           removable + begin, removed + begin);
    }
    if (!status)
        status = sgsi_select_best(score, removable, n, excess < most ? excess : most, removed);
    *count = 0;
    for (size_t i = 0; i < n && !status; ++i) {
        if (removed[i])
            --may_lose[order[i].run];
        else
            order[(*count)++] = order[i];
    }
    return status;
}

// may_lose [n / MIN_RUN + 1]: scratch, as of thin_once.
static sgs_status thin(const float *points, size_t n, size_t wanted, ordered_point *order,
                       size_t *may_lose, double *score, uint8_t *marks, uint8_t *chosen)
{
    const size_t enough = (SHARE * n + wanted - 1) / wanted,
                 run = enough > MIN_RUN ? enough : MIN_RUN;
    sgs_status status = SGS_STATUS_OK;
    size_t count = n;
    order_points(points, n, run, order);
    for (size_t r = 0; r <= n / run; ++r) {
        const size_t size = n - r * run < run ? n - r * run : run;
        may_lose[r] = size - (size_t)(FLOOR * (double)size * (double)wanted / (double)n);
    }
    while (!status && count > wanted)
        status = thin_once(points, order, &count, count - wanted, may_lose, score, marks);
    memset(chosen, 0, n);
    for (size_t i = 0; i < count; ++i)
        chosen[order[i].index] = 1;
    return status;
}

sgs_status sgsi_thin_points(const float *points, size_t n, size_t wanted, uint8_t *chosen)
{
    ordered_point *order = sgsi_alloc(n, sizeof *order);
    double *score = sgsi_alloc(n, sizeof *score);
    uint8_t *marks = sgsi_alloc(n, 2);
    size_t *may_lose = sgsi_alloc(n / MIN_RUN + 1, sizeof *may_lose);
    sgs_status status;
    if (order && score && marks && may_lose)
        status = thin(points, n, wanted, order, may_lose, score, marks, chosen);
    else
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu points", n);
    sgsi_free(order);
    sgsi_free(score);
    sgsi_free(marks);
    sgsi_free(may_lose);
    return status;
}

sgs_status sgsi_select_largest(const sgs_gaussians *model, const uint8_t *eligible, size_t wanted,
                               uint8_t *chosen)
{
    const size_t n = model->count;
    double *score = sgsi_alloc(n ? n : 1, sizeof *score);
    if (!score)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to rank %zu primitives", n);
    for (size_t i = 0; i < n; ++i) {
        float sum = 0.0f, least = INFINITY;
        for (int k = 0; k < 3; ++k) {
            const float scale = *sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k);
            sum += scale;
            least = fminf(least, scale);
        }
        const double value = log((double)sgsi_gaussians_opacity(model, i)) + (double)(sum - least);
        score[i] = isnan(value) ? -INFINITY : value;
    }
    const sgs_status status = sgsi_select_best(score, eligible, n, wanted, chosen);
    sgsi_free(score);
    return status;
}
