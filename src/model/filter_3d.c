// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Mip-Splatting (Yu et al. 2024, section 5.1). A camera of focal length f samples a primitive at
// depth z at intervals of z / f; finer detail is not in the images. f3 = sqrt(0.2) min z / F: the
// minimum over the training views that see the mean at z > near_limit (0.2 in the paper) inside the
// image plus a margin of 15 %, F the largest focal length of all views. Depth is z; for fisheye
// lenses it is the distance, and the margin is tested on the projected point. Other lenses are
// treated as pinholes, as in the original.

#include "model/filter_3d.h"

#include <math.h>

#include "base/core.h"
#include "base/threads.h"

static const double margin = 0.15, variance = 0.2;

typedef struct sampling_job {
    const sgs_gaussians *model;
    const sgs_scene *scene;
    const size_t *views;
    size_t view_count;
    double near_limit;
    float *filter_3d; // first the nearest depth, -1 if no view samples the primitive
} sampling_job;

static bool inside(double u, double v, const sgs_camera *camera)
{
    return u >= -margin * camera->width && u <= (1 + margin) * camera->width &&
           v >= -margin * camera->height && v <= (1 + margin) * camera->height;
}

// A row of the view's transform applied to a point.
static double axis_distance(const sgs_pose *pose, int row, const double mean[3])
{
    return pose->rotation[3 * row] * mean[0] + pose->rotation[3 * row + 1] * mean[1] +
           pose->rotation[3 * row + 2] * mean[2] + pose->translation[row];
}

// Depth at which a view samples a point; negative if it does not.
static double sampled_depth(const sgs_view *view, const double mean[3], double near_limit)
{
    double p[3], fx, fy, cx, cy, pixel[2];
    for (int row = 0; row < 3; ++row)
        p[row] = axis_distance(&view->pose, row, mean);
    if (sgs_camera_is_fisheye(view->camera.model)) {
        const double distance = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
        const bool seen = distance > near_limit && sgs_camera_project(&view->camera, p, pixel) &&
                          inside(pixel[0], pixel[1], &view->camera);
        return seen ? distance : -1.0;
    }
    if (!(p[2] > near_limit))
        return -1.0;
    sgs_camera_intrinsics(&view->camera, &fx, &fy, &cx, &cy);
    return inside(fx * p[0] / p[2] + cx, fy * p[1] / p[2] + cy, &view->camera) ? p[2] : -1.0;
}

static void sample_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const sampling_job *job = context;
    for (size_t i = begin; i < end; ++i) {
        double mean[3], nearest = -1.0;
        for (int k = 0; k < 3; ++k)
            mean[k] = (double)*sgs_gaussians_at(job->model, i, SGS_PARAM_MEAN + k);
        for (size_t v = 0; v < job->view_count; ++v) {
            const sgs_view *view = &job->scene->views[job->views[v]];
            // Most views are farther away than the nearest one, by the axis or by the distance.
            if (nearest >= 0.0 && axis_distance(&view->pose, 2, mean) >= nearest)
                continue;
            const double depth = sampled_depth(view, mean, job->near_limit);
            if (depth > 0.0 && (nearest < 0.0 || depth < nearest))
                nearest = depth;
        }
        job->filter_3d[i] = (float)nearest;
    }
}

float sgsi_filter_3d_sample(const sgs_gaussians *model, const sgs_scene *scene, const size_t *views,
                            size_t view_count, double near_limit, float *filter_3d)
{
    sampling_job job = {model, scene, views, view_count, near_limit, filter_3d};
    sgsi_parallel_ranges(model->count, 1024, sample_range, &job);
    float farthest = 0.0f;
    for (size_t i = 0; i < model->count; ++i)
        farthest = fmaxf(farthest, filter_3d[i]);
    return farthest;
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
    const float scale = (float)(sqrt(variance) / focal);
    for (size_t i = 0; i < count; ++i)
        filter_3d[i] = (filter_3d[i] < 0.0f ? farthest : filter_3d[i]) * scale;
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
    const double factor = opacity_factor(params + SGS_PARAM_SCALE, filter_3d);
    const double opacity = factor / (1.0 + exp(-(double)params[SGS_PARAM_OPACITY]));
    const double held = fmin(fmax(opacity, 1e-12), 1.0 - 1e-7);
    params[SGS_PARAM_OPACITY] = (float)log(held / (1.0 - held));
    for (int k = 0; k < 3; ++k)
        params[SGS_PARAM_SCALE + k] =
            (float)(0.5 *
                    log(exp(2.0 * (double)params[SGS_PARAM_SCALE + k]) + filter_3d * filter_3d));
}

void sgsi_filter_3d_fuse_row(const sgs_gaussians *from, size_t i, float filter_3d,
                             sgs_gaussians *to)
{
    float params[SGS_PARAM_COUNT];
    sgs_gaussians_get(from, i, params);
    params[SGS_PARAM_OPACITY] = sgs_gaussians_opacity_logit(from, i);
    sgsi_filter_3d_fuse(params, (double)filter_3d);
    sgs_gaussians_set(to, i, params);
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
    for (size_t i = 0; i < model->count; ++i)
        sgsi_filter_3d_fuse_row(model, i, filter_3d[i], *fused);
    return SGS_STATUS_OK;
}
