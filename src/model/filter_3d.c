// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Mip-Splatting (Yu et al. 2024, section 5.1). A camera of focal length f samples a primitive at
// depth z at intervals of z / f; finer detail is not in the images. f3 = sqrt(0.2) min z / F: the
// minimum over the training views that see the mean at z > near_limit (0.2 in the paper) inside the
// image plus a margin of 15 %, F the largest focal length of all views. Depth is z; for fisheye
// lenses it is the distance, and the margin is tested on the projected point. Other lenses are
// treated as pinholes, as in the original.
//
// Neighbouring rows of a model are near in space. Therefore blocks of rows first exclude the views
// that cannot sample any of them, or only farther away than others do; these bounds allow for the
// rounding of the exact test, so that they do not change the result.

#include "model/filter_3d.h"

#include <math.h>
#include <stdlib.h>

#include "base/compare.h"
#include "base/core.h"
#include "base/threads.h"

static const double margin = 0.15, variance = 0.2, round_off = 1e-9;

enum { BLOCK = 256, VIEWS_AT_ONCE = 512, SCALE_GRAIN = 1 << 14, FUSE_GRAIN = 1024 };

// What the loop over the views reads of each.
typedef struct sampling_view {
    double rotation[9], translation[3];
    double fx, fy, cx, cy;
    double low[2], high[2];    // of the image with its margin, pixels
    const sgs_camera *fisheye; // NULL for other lenses
    bool has_pyramid;          // the four values below are valid
    double slope[2][2];        // of the sides of the pyramid: x / z and y / z
    double slope_magnitude[2]; // of the terms that make up a slope
} sampling_view;

typedef struct sampling_job {
    const sgs_gaussians *model;
    sampling_view *views; // [view_count]
    size_t view_count;
    double near_limit;
    float *filter_3d; // first the nearest depth, -1 if no view samples the primitive
    float *farthest;  // [threads]
} sampling_job;

// Rows of the model with the nearest depth so far, INFINITY = not sampled. Rows that are not
// finite, which no view samples, have -INFINITY.
typedef struct sampling_block {
    size_t count;
    double mean[3][BLOCK], nearest[BLOCK], z[BLOCK];
    double center[3], half[3]; // box of the finite rows
    double farthest;           // of `nearest`
} sampling_block;

// A view that may sample a row of a block, at this depth or beyond. compare_doubles reads `depth`.
typedef struct candidate {
    double depth;
    size_t view;
} candidate;

static sampling_view make_view(const sgs_view *view, double near_limit)
{
    const sgs_camera *camera = &view->camera;
    const double size[2] = {camera->width, camera->height};
    sampling_view v = {.fisheye = sgs_camera_is_fisheye(camera->model) ? camera : NULL};
    for (int k = 0; k < 9; ++k)
        v.rotation[k] = view->pose.rotation[k];
    sgs_camera_intrinsics(camera, &v.fx, &v.fy, &v.cx, &v.cy);
    v.has_pyramid = !v.fisheye && near_limit >= 0.0 && v.fx > 0.0 && v.fy > 0.0;
    for (int k = 0; k < 3; ++k)
        v.translation[k] = view->pose.translation[k];
    for (int k = 0; k < 2; ++k) {
        const double focal = k ? v.fy : v.fx, middle = k ? v.cy : v.cx;
        v.low[k] = -margin * size[k];
        v.high[k] = (1 + margin) * size[k];
        v.slope[k][0] = (v.low[k] - middle) / focal;
        v.slope[k][1] = (v.high[k] - middle) / focal;
        v.slope_magnitude[k] = (fabs(middle) + v.high[k]) / focal;
    }
    return v;
}

static bool inside(double x, double y, const sampling_view *view)
{
    return x >= view->low[0] && x <= view->high[0] && y >= view->low[1] && y <= view->high[1];
}

// A row of the view's transform applied to a point.
static double axis_distance(const sampling_view *view, int row, const double mean[3])
{
    return view->rotation[3 * row] * mean[0] + view->rotation[3 * row + 1] * mean[1] +
           view->rotation[3 * row + 2] * mean[2] + view->translation[row];
}

// Depth below `nearest` at which a view samples a point; negative if there is none.
static double sampled_depth(const sampling_view *view, const double mean[3], double near_limit,
                            double nearest)
{
    double p[3], pixel[2];
    for (int row = 0; row < 3; ++row)
        p[row] = axis_distance(view, row, mean);
    if (view->fisheye) {
        const double distance = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
        const bool seen = distance > near_limit && distance < nearest &&
                          sgs_camera_project(view->fisheye, p, pixel) &&
                          inside(pixel[0], pixel[1], view);
        return seen ? distance : -1.0;
    }
    if (!(p[2] > near_limit))
        return -1.0;
    return inside(view->fx * p[0] / p[2] + view->cx, view->fy * p[1] / p[2] + view->cy, view)
               ? p[2]
               : -1.0;
}

// A lower bound of the depths at which a view samples rows of the block; INFINITY if it samples
// none.
static double least_depth(const sampling_view *view, const sampling_block *b, double near_limit)
{
    double p[3], reach[3], error[3]; // centre, half extents and rounding in camera space
    for (int k = 0; k < 3; ++k) {
        const double *r = view->rotation + 3 * (size_t)k;
        p[k] = axis_distance(view, k, b->center);
        reach[k] = error[k] = 0.0;
        for (int c = 0; c < 3; ++c) {
            reach[k] += fabs(r[c]) * b->half[c];
            error[k] += fabs(r[c]) * fabs(b->center[c]);
        }
        error[k] = round_off * (error[k] + reach[k] + fabs(view->translation[k]));
    }
    if (view->fisheye) {
        double squared = 0.0;
        for (int k = 0; k < 3; ++k) {
            const double least = fmax(fabs(p[k]) - reach[k] - error[k], 0.0);
            squared += least * least;
        }
        return sqrt(squared) * (1.0 - round_off);
    }
    if (p[2] + reach[2] + error[2] <= near_limit)
        return INFINITY;
    for (int k = 0; k < 2 && view->has_pyramid; ++k)
        for (int side = 0; side < 2; ++side) {
            const double slope = view->slope[k][side],
                         within = side ? slope * p[2] - p[k] : p[k] - slope * p[2],
                         slack = reach[k] + fabs(slope) * reach[2] + error[k] +
                                 view->slope_magnitude[k] * error[2];
            if (within + slack < 0.0)
                return INFINITY;
        }
    return p[2] - reach[2] - error[2];
}

static void begin_block(const sgs_gaussians *model, size_t begin, size_t end, sampling_block *b)
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    b->count = end - begin;
    b->farthest = -INFINITY;
    for (size_t i = 0; i < b->count; ++i) {
        bool finite = true;
        for (int k = 0; k < 3; ++k) {
            b->mean[k][i] = (double)*sgs_gaussians_at(model, begin + i, SGS_PARAM_MEAN + k);
            finite = finite && isfinite(b->mean[k][i]);
        }
        b->nearest[i] = finite ? INFINITY : -INFINITY;
        for (int k = 0; k < 3 && finite; ++k) {
            low[k] = fmin(low[k], b->mean[k][i]);
            high[k] = fmax(high[k], b->mean[k][i]);
        }
        b->farthest = fmax(b->farthest, b->nearest[i]);
    }
    for (int k = 0; k < 3; ++k) {
        b->center[k] = 0.5 * (low[k] + high[k]);
        b->half[k] = 0.5 * (high[k] - low[k]);
    }
}

static void sample_view(const sampling_view *view, double near_limit, sampling_block *b)
{
    const double *r = view->rotation + 6, along = view->translation[2];
    bool changed = false;
    for (size_t i = 0; i < b->count; ++i) // vectorised; the order is that of axis_distance
        b->z[i] = r[0] * b->mean[0][i] + r[1] * b->mean[1][i] + r[2] * b->mean[2][i] + along;
    for (size_t i = 0; i < b->count; ++i) {
        if (!(b->z[i] < b->nearest[i])) // farther away by the axis, hence by the distance
            continue;
        const double mean[3] = {b->mean[0][i], b->mean[1][i], b->mean[2][i]};
        const double depth = sampled_depth(view, mean, near_limit, b->nearest[i]);
        if (!(depth > 0.0))
            continue;
        b->nearest[i] = depth;
        changed = true;
    }
    if (!changed)
        return;
    b->farthest = -INFINITY;
    for (size_t i = 0; i < b->count; ++i)
        b->farthest = b->nearest[i] > b->farthest ? b->nearest[i] : b->farthest;
}

static void sample_block(void *context, size_t begin, size_t end, int thread)
{
    const sampling_job *job = context;
    sampling_block b;
    candidate candidates[VIEWS_AT_ONCE];
    begin_block(job->model, begin, end, &b);
    for (size_t first = 0; first < job->view_count; first += VIEWS_AT_ONCE) {
        const size_t left = job->view_count - first,
                     last = first + (left < VIEWS_AT_ONCE ? left : VIEWS_AT_ONCE);
        size_t count = 0;
        for (size_t v = first; v < last; ++v) {
            const double depth = least_depth(&job->views[v], &b, job->near_limit);
            if (depth < b.farthest)
                candidates[count++] = (candidate){depth, v};
        }
        qsort(candidates, count, sizeof *candidates, sgsi_compare_doubles);
        for (size_t k = 0; k < count && candidates[k].depth < b.farthest; ++k)
            sample_view(&job->views[candidates[k].view], job->near_limit, &b);
    }
    for (size_t i = 0; i < b.count; ++i) {
        const float depth = isinf(b.nearest[i]) ? -1.0f : (float)b.nearest[i];
        job->filter_3d[begin + i] = depth;
        job->farthest[thread] = fmaxf(job->farthest[thread], depth);
    }
}

sgs_status sgsi_filter_3d_sample(const sgs_gaussians *model, const sgs_scene *scene,
                                 const size_t *views, size_t view_count, double near_limit,
                                 float *filter_3d, float *farthest)
{
    const size_t threads = (size_t)sgsi_threads();
    sampling_job job = {.model = model,
                        .views = sgsi_alloc(view_count, sizeof *job.views),
                        .view_count = view_count,
                        .near_limit = near_limit,
                        .filter_3d = filter_3d,
                        .farthest = sgsi_calloc(threads, sizeof *job.farthest)};
    const bool complete = job.views && job.farthest;
    *farthest = 0.0f;
    for (size_t v = 0; v < view_count && complete; ++v)
        job.views[v] = make_view(&scene->views[views[v]], near_limit);
    if (complete)
        sgsi_parallel_ranges(model->count, BLOCK, sample_block, &job);
    for (size_t k = 0; k < threads && complete; ++k)
        *farthest = fmaxf(*farthest, job.farthest[k]);
    sgsi_free(job.views);
    sgsi_free(job.farthest);
    return complete ? SGS_STATUS_OK
                    : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                "not enough memory for the 3D filter of %zu views", view_count);
}

typedef struct scale_job {
    float farthest, scale, *filter_3d;
} scale_job;

static void scale_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const scale_job *job = context;
    for (size_t i = begin; i < end; ++i)
        job->filter_3d[i] =
            (job->filter_3d[i] < 0.0f ? job->farthest : job->filter_3d[i]) * job->scale;
}

void sgsi_filter_3d_scale(const sgs_scene *scene, const size_t *views, size_t view_count,
                          float farthest, float *filter_3d, size_t count)
{
    double focal = 0.0;
    for (size_t v = 0; v < view_count; ++v) {
        double fx, fy, cx, cy;
        sgs_camera_intrinsics(&scene->views[views[v]].camera, &fx, &fy, &cx, &cy);
        focal = fmax(focal, fx);
    }
    scale_job job = {farthest, (float)(sqrt(variance) / focal), filter_3d};
    sgsi_parallel_ranges(count, SCALE_GRAIN, scale_range, &job);
}

static double opacity_factor(const float log_scale[3], double filter_3d)
{
    double factor = 1.0;
    for (int k = 0; k < 3; ++k) {
        const double s = exp((double)log_scale[k]);
        factor *= s / sqrt(s * s + filter_3d * filter_3d);
    }
    return factor;
}

double sgsi_filter_3d_factor(const sgs_gaussians *model, size_t i, float filter_3d)
{
    float log_scale[3];
    for (int k = 0; k < 3; ++k)
        log_scale[k] = *sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k);
    return opacity_factor(log_scale, (double)filter_3d);
}

void sgsi_filter_3d_fuse(float params[SGS_PARAM_COUNT], double filter_3d)
{
    if (filter_3d == 0.0)
        return;
    const double factor = opacity_factor(params + SGS_PARAM_SCALE, filter_3d);
    const double opacity = factor / (1.0 + exp(-(double)params[SGS_PARAM_OPACITY]));
    const double held = fmin(fmax(opacity, 1e-12), 1.0 - 1e-7);
    params[SGS_PARAM_OPACITY] = (float)log(held / (1.0 - held));
    for (int k = 0; k < 3; ++k)
        params[SGS_PARAM_SCALE + k] =
            (float)(0.5 *
                    log(exp(2.0 * (double)params[SGS_PARAM_SCALE + k]) + filter_3d * filter_3d));
}

// Ratios of the raw to the given variances, at least `share`. *bounded: one of them is the share.
// Returns the product of the ratios of the scales, which is the factor on the opacity of an exact
// inverse.
static double raw_ratios(const double variances[3], double filter_3d, double share,
                         double ratios[3], bool *bounded)
{
    double product = 1.0;
    *bounded = false;
    for (int k = 0; k < 3; ++k) {
        const double left = 1.0 - filter_3d * filter_3d / variances[k]; // -inf for a scale of 0
        *bounded = *bounded || !(left > share);
        ratios[k] = fmax(left, share);
        product *= sqrt(ratios[k]);
    }
    return product;
}

void sgsi_filter_3d_unfuse(float params[SGS_PARAM_COUNT], double filter_3d)
{
    // Where there is no exact inverse, opacities are at most 0.99: higher ones hardly train.
    static const double least_share = 0.01, growth = 1.25, most_opaque = 0.99, near_one = 0.9999,
                        rounding = 1e-6;
    double variances[3], ratios[3], share = least_share, product;
    bool bounded;
    if (!(filter_3d > 0.0))
        return;
    for (int k = 0; k < 3; ++k)
        variances[k] = exp(2.0 * (double)params[SGS_PARAM_SCALE + k]);
    const double opacity = 1.0 / (1.0 + exp(-(double)params[SGS_PARAM_OPACITY]));
    for (;; share = fmin(share * growth, 1.0)) {
        product = raw_ratios(variances, filter_3d, share, ratios, &bounded);
        if ((!bounded && opacity <= product * (1.0 + rounding)) || share >= 1.0 ||
            opacity <= most_opaque * product)
            break;
    }
    if (share >= 1.0)
        return;
    const double raw = fmin(fmax(opacity / product, 1e-12), near_one);
    params[SGS_PARAM_OPACITY] = (float)log(raw / (1.0 - raw));
    for (int k = 0; k < 3; ++k)
        params[SGS_PARAM_SCALE + k] += (float)(0.5 * log(ratios[k]));
}

typedef struct fuse_job {
    const sgs_gaussians *from;
    const float *filter_3d;
    sgs_gaussians *to;
} fuse_job;

static void fuse_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const fuse_job *job = context;
    for (size_t i = begin; i < end; ++i) {
        float params[SGS_PARAM_COUNT];
        sgs_gaussians_get(job->from, i, params);
        params[SGS_PARAM_OPACITY] = sgs_gaussians_opacity_logit(job->from, i);
        sgsi_filter_3d_fuse(params, (double)job->filter_3d[i]);
        sgs_gaussians_set(job->to, i, params);
    }
}

void sgsi_filter_3d_fuse_rows(const sgs_gaussians *from, const float *filter_3d, sgs_gaussians *to)
{
    fuse_job job = {from, filter_3d, to};
    sgsi_parallel_ranges(from->count, FUSE_GRAIN, fuse_range, &job);
}

static void unfuse_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const fuse_job *job = context;
    for (size_t i = begin; i < end; ++i) {
        float params[SGS_PARAM_COUNT];
        sgs_gaussians_get(job->to, i, params);
        sgsi_filter_3d_unfuse(params, (double)job->filter_3d[i]);
        sgs_gaussians_set(job->to, i, params);
    }
}

void sgsi_filter_3d_unfuse_rows(sgs_gaussians *model, const float *filter_3d)
{
    fuse_job job = {NULL, filter_3d, model};
    sgsi_parallel_ranges(model->count, FUSE_GRAIN, unfuse_range, &job);
}

sgs_status sgs_gaussians_fuse_filter_3d(const sgs_gaussians *model, const float *filter_3d,
                                        sgs_gaussians **fused)
{
    sgs_status status = sgs_gaussians_create(model->count, fused);
    if (!status)
        status = sgs_gaussians_resize(*fused, model->count);
    if (status) {
        sgs_gaussians_destroy(*fused);
        *fused = NULL;
        return status;
    }
    (*fused)->sh_degree = model->sh_degree;
    sgsi_filter_3d_fuse_rows(model, filter_3d, *fused);
    return SGS_STATUS_OK;
}
