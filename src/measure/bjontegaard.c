// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Bjontegaard deltas (VCEG-M33, 2001) with PCHIP instead of one cubic through four points: papers
// on 3D Gaussians report three points per curve, which do not determine a cubic. The slopes are the
// weighted harmonic means of Fritsch and Butland (1984) inside and the shape-preserving three-point
// formula at the ends, as in SciPy's PchipInterpolator.

#include "sparegs/rate_distortion.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include "base/core.h"

// Published values are rounded to 0.01 dB, so two of them may be out of order by twice as much.
static const double NOT_MONOTONE_DB = 0.02;
// Common ranges of sizes below this ratio say nothing about the curves.
static const double COMMON_SIZE_RATIO = 1.04;
static const double TIE = 1e-9;

typedef struct sample {
    double x, y;
    size_t point; // index in the curve
} sample;

// A piecewise cubic through (x, y) with slopes d; x ascends strictly.
typedef struct pchip {
    size_t count;
    sample *at; // [count]
    double *d;  // [count]
} pchip;

static int by_x(const void *a, const void *b)
{
    const sample *p = a, *q = b;
    if (p->x != q->x)
        return p->x < q->x ? -1 : 1;
    if (p->y != q->y)
        return p->y < q->y ? -1 : 1;
    return p->point < q->point ? -1 : p->point > q->point;
}

static double end_slope(double h0, double h1, double s0, double s1)
{
    const double d = ((2 * h0 + h1) * s0 - h0 * s1) / (h0 + h1);
    if (d * s0 <= 0)
        return 0;
    return s0 * s1 <= 0 && fabs(d) > 3 * fabs(s0) ? 3 * s0 : d;
}

static void set_slopes(pchip *curve)
{
    const size_t n = curve->count;
    const sample *p = curve->at;
    double *d = curve->d;
    if (n == 2) {
        d[0] = d[1] = (p[1].y - p[0].y) / (p[1].x - p[0].x);
        return;
    }
    double h0 = p[1].x - p[0].x, s0 = (p[1].y - p[0].y) / h0;
    for (size_t k = 1; k + 1 < n; ++k) {
        const double h1 = p[k + 1].x - p[k].x, s1 = (p[k + 1].y - p[k].y) / h1;
        const double w0 = 2 * h1 + h0, w1 = h1 + 2 * h0;
        d[k] = s0 * s1 <= 0 ? 0 : (w0 + w1) / (w0 / s0 + w1 / s1);
        if (k == 1)
            d[0] = end_slope(h0, h1, s0, s1);
        if (k + 2 == n)
            d[n - 1] = end_slope(h1, h0, s1, s0);
        h0 = h1;
        s0 = s1;
    }
}

// Sorts by x and moves equal x apart. Sets moved [count] at the points that it moves.
static void separate(pchip *curve, bool *moved)
{
    qsort(curve->at, curve->count, sizeof *curve->at, by_x);
    for (size_t k = 1; k < curve->count; ++k)
        if (curve->at[k].x <= curve->at[k - 1].x) {
            curve->at[k].x = curve->at[k - 1].x + TIE;
            moved[curve->at[k].point] = true;
        }
}

// Integral of one cubic piece from its left end to the fraction t of its width.
static double piece_integral(const pchip *curve, size_t k, double t)
{
    const double h = curve->at[k + 1].x - curve->at[k].x;
    const double y0 = curve->at[k].y, y1 = curve->at[k + 1].y;
    const double d0 = h * curve->d[k], d1 = h * curve->d[k + 1];
    const double cubic = 2 * (y0 - y1) + d0 + d1, square = 3 * (y1 - y0) - 2 * d0 - d1;
    return h * t * (y0 + t * (d0 / 2 + t * (square / 3 + t * cubic / 4)));
}

// Integral over [low, high] inside the curve's range.
static double integral(const pchip *curve, double low, double high)
{
    double sum = 0;
    for (size_t k = 0; k + 1 < curve->count; ++k) {
        const double left = curve->at[k].x, width = curve->at[k + 1].x - left;
        const double from = fmin(fmax((low - left) / width, 0), 1);
        const double to = fmin(fmax((high - left) / width, 0), 1);
        if (to > from)
            sum += piece_integral(curve, k, to) - piece_integral(curve, k, from);
    }
    return sum;
}

static void pchip_free(pchip *curve)
{
    sgsi_free(curve->at);
    sgsi_free(curve->d);
}

// PSNR over ln(size), or the inverse.
static bool make_curve(const sgs_rd_point *points, size_t count, bool inverse, pchip *curve,
                       bool *moved)
{
    *curve = (pchip){.count = count,
                     .at = sgsi_alloc(count, sizeof *curve->at),
                     .d = sgsi_alloc(count, sizeof *curve->d)};
    if (!curve->at || !curve->d)
        return false;
    for (size_t k = 0; k < count; ++k) {
        const double size = log(points[k].size), psnr = points[k].psnr;
        curve->at[k] = inverse ? (sample){psnr, size, k} : (sample){size, psnr, k};
    }
    separate(curve, moved);
    set_slopes(curve);
    return true;
}

// Two curves, and for each point whether it is moved.
typedef struct comparison {
    const sgs_rd_point *points[2]; // anchor, test
    size_t counts[2];
    bool *moved[2]; // one block, owned by moved[0]
} comparison;

// Mean of test - anchor over the common range of x; NaN if that is not wider than `width`. *common:
// the width of the range, at most 0 if there is none.
static sgs_status mean_difference(const comparison *c, bool inverse, double width, double *mean,
                                  double *common)
{
    pchip curves[2] = {0};
    bool made = true;
    for (int k = 0; k < 2 && made; ++k)
        made = make_curve(c->points[k], c->counts[k], inverse, &curves[k], c->moved[k]);
    *mean = NAN;
    if (made) {
        const sample *a = curves[0].at, *t = curves[1].at;
        const double low = fmax(a[0].x, t[0].x);
        const double high = fmin(a[c->counts[0] - 1].x, t[c->counts[1] - 1].x);
        *common = high - low;
        if (high - low > width)
            *mean =
                (integral(&curves[1], low, high) - integral(&curves[0], low, high)) / (high - low);
    }
    pchip_free(&curves[0]);
    pchip_free(&curves[1]);
    return made ? SGS_STATUS_OK
                : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                            "not enough memory for curves of %zu and %zu points", c->counts[0],
                            c->counts[1]);
}

// True if some smaller file is better by more than the rounding of published values.
static bool is_not_monotone(const sgs_rd_point *points, size_t count)
{
    for (size_t i = 0; i < count; ++i)
        for (size_t k = 0; k < count; ++k)
            if (points[i].size < points[k].size &&
                points[i].psnr > points[k].psnr + NOT_MONOTONE_DB)
                return true;
    return false;
}

static sgs_status check_points(const char *curve, const sgs_rd_point *points, size_t count)
{
    for (size_t k = 0; k < count; ++k)
        if (!(points[k].size > 0) || isinf(points[k].size) || !isfinite(points[k].psnr))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                             "point %zu of the %s has size %g and PSNR %g; a size must be positive "
                             "and both must be finite",
                             k + 1, curve, points[k].size, points[k].psnr);
    return SGS_STATUS_OK;
}

// Curves of three points or more.
static sgs_status compare(const sgs_rd_point *anchor, size_t anchor_count, const sgs_rd_point *test,
                          size_t test_count, sgs_bd *bd)
{
    bool *moved = sgsi_calloc(anchor_count + test_count, sizeof *moved);
    const comparison c = {
        {anchor, test}, {anchor_count, test_count}, {moved, moved + anchor_count}};
    double rate = NAN, common = 0, common_sizes;
    sgs_status status = moved ? mean_difference(&c, true, 0, &rate, &common)
                              : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                          "not enough memory for curves of %zu and %zu points",
                                          anchor_count, test_count);
    if (!status)
        status = mean_difference(&c, false, log(COMMON_SIZE_RATIO), &bd->psnr_db, &common_sizes);
    for (size_t k = 0; k < anchor_count + test_count && !status; ++k)
        bd->ties += moved[k];
    sgsi_free(moved);
    if (status)
        return status;
    bd->common_psnr_db = fmax(common, 0);
    bd->rate_percent = 100 * expm1(rate);
    if (isnan(rate))
        bd->rate_reason = "the curves have no common range of PSNR";
    if (isnan(bd->psnr_db))
        bd->psnr_reason = "the curves have no common range of sizes of at least 4 %";
    return SGS_STATUS_OK;
}

sgs_status sgs_bd_compute(const sgs_rd_point *anchor, size_t anchor_count, const sgs_rd_point *test,
                          size_t test_count, sgs_bd *bd)
{
    *bd = (sgs_bd){.rate_percent = NAN, .psnr_db = NAN};
    sgs_status status = check_points("anchor", anchor, anchor_count);
    if (!status)
        status = check_points("test curve", test, test_count);
    if (status)
        return status;
    const char *reason = NULL;
    if (anchor_count < 3 || test_count < 3)
        reason = "fewer than three points";
    else if (is_not_monotone(anchor, anchor_count) || is_not_monotone(test, test_count))
        reason = "a smaller file is better by more than 0.02 dB";
    bd->rate_reason = bd->psnr_reason = reason;
    if (reason)
        return SGS_STATUS_OK;
    return compare(anchor, anchor_count, test, test_count, bd);
}
