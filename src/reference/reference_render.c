// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The reference renderer, forward pass: the definition of what every faster renderer of this
// library must compute. Every ray is tested against every Gaussian in double precision, without a
// BVH, SIMD or bounds.
//
// The model is 3D Gaussian Splatting (Kerbl et al., 2023) seen by rays, as in 3D Gaussian Ray
// Tracing (Moenne-Loccoz et al., 2024): a Gaussian's response on a ray is its maximum along the
// ray, at depth t. With M = S^-1 R^T, p = M (c - mean), g = M d, n = p x g:
//     rho^2 = |n|^2 / |g|^2,    t = -(p.g) / |g|^2,    alpha = min(0.99, o exp(-rho^2 / 2)).
// Differences from the rasteriser of 3DGS: hits are ordered per ray by (t, id), not per image by
// the depth of the mean; `near` cuts at the hit, not at the mean; the 0.3 px^2 dilation is
// isotropic in space, which equals the rasteriser's on the optical axis and over-dilates the radial
// direction by 1/cos(theta) off it.
//
// The tests of one ray, in this order: (1) keep hits with alpha >= 1/255 and t > near; (2) sort;
// (3) blend. The first hit with T (1 - alpha) < 1e-4 ends the ray and is not counted, even if a
// later, fainter hit would still fit.

#include "reference/reference.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/sh.h"
#include "base/aov_planes.h"
#include "base/core.h"
#include "base/threads.h"

static const double alpha_min = 1.0 / 255, alpha_max = 0.99, transmittance_min = 1e-4;
static const double dilation_3dgs = 0.3, dilation_mip = 0.1; // px^2

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

// Matrices are row-major.
static void multiply(const double m[9], const double v[3], double out[3])
{
    for (int row = 0; row < 3; ++row)
        out[row] = dot(m + 3 * row, v);
}

static void multiply_transposed(const double m[9], const double v[3], double out[3])
{
    for (int column = 0; column < 3; ++column)
        out[column] = m[column] * v[0] + m[3 + column] * v[1] + m[6 + column] * v[2];
}

// ---- Activation: from stored parameters to the view of one camera ----

static void activate_rotation(const double *stored, sgsi_reference_primitive *out)
{
    const double norm = sqrt(stored[0] * stored[0] + dot(stored + 1, stored + 1));
    out->quaternion_norm = norm;
    for (int k = 0; k < 4; ++k)
        out->quaternion[k] = norm == 0 ? (k == 0) : stored[k] / norm; // NaN stays NaN
    const double w = out->quaternion[0], x = out->quaternion[1], y = out->quaternion[2],
                 z = out->quaternion[3];
    const double rotation[9] = {
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
        2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y),
    };
    memcpy(out->rotation, rotation, sizeof rotation);
}

// Distance and direction of the mean from the centre (for Mip-Splatting's factor and SH), and the
// depth z that converts pixels to world units.
static void activate_position(const sgsi_reference_view *view, const double *mean,
                              sgsi_reference_primitive *out)
{
    const double to_mean[3] = {mean[0] - view->center[0], mean[1] - view->center[1],
                               mean[2] - view->center[2]};
    out->distance = sqrt(dot(to_mean, to_mean));
    for (int k = 0; k < 3; ++k)
        out->direction[k] = out->distance > 0 ? to_mean[k] / out->distance : 0;
    if (sgs_camera_is_fisheye(view->camera->model)) {
        out->depth = out->distance;
        memcpy(out->d_depth, out->direction, sizeof out->d_depth);
    } else {
        out->depth = dot(view->pose->rotation + 6, mean) + view->pose->translation[2];
        memcpy(out->d_depth, view->pose->rotation + 6, sizeof out->d_depth);
    }
}

double sgsi_reference_marginal(const double a[3], const double v[3], double d_marginal[3])
{
    const double a2[3] = {a[0] * a[0], a[1] * a[1], a[2] * a[2]};
    for (int k = 0; k < 3 && d_marginal; ++k) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        d_marginal[k] = a2[i] * v[j] + a2[j] * v[i];
    }
    return a2[0] * v[1] * v[2] + a2[1] * v[2] * v[0] + a2[2] * v[0] * v[1];
}

// Applies the filters to scales and opacity. Mip-Splatting (Yu et al. 2024, section 5) preserves
// the integral of a widened Gaussian: in space by the ratio of the volumes, in the image by the
// ratio of the marginals across the line of sight.
static void activate_filters(const sgsi_reference_view *view, const double *stored,
                             double filter_3d, sgsi_reference_primitive *out)
{
    for (int k = 0; k < 3; ++k) {
        const double scale = exp(stored[SGS_PARAM_SCALE + k]);
        out->variance[k] = scale * scale;
        out->variance_3d[k] = out->variance[k] + filter_3d * filter_3d;
        out->variance_view[k] = out->variance_3d[k] + view->filter_scale * out->depth * out->depth;
    }
    out->opacity_stored = 1 / (1 + exp(-stored[SGS_PARAM_OPACITY]));
    out->opacity = out->opacity_stored;
    if (!view->mip)
        return;
    for (int k = 0; k < 3; ++k)
        out->opacity *= sqrt(out->variance[k] / out->variance_3d[k]);
    if (out->distance > 0) {
        double a[3];
        multiply_transposed(out->rotation, out->direction, a);
        out->opacity *= sqrt(sgsi_reference_marginal(a, out->variance_3d, NULL) /
                             sgsi_reference_marginal(a, out->variance_view, NULL));
    }
}

static void activate_color(const double *sh, int degree, sgsi_reference_primitive *out)
{
    const double x = out->direction[0], y = out->direction[1], z = out->direction[2];
    const double basis[SGSI_SH_COUNT] = {
        SGSI_SH_C0,
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.0925484305920792 * x * y,
        -1.0925484305920792 * y * z,
        0.31539156525252005 * (2 * z * z - x * x - y * y),
        -1.0925484305920792 * x * z,
        0.5462742152960396 * (x * x - y * y),
        -0.5900435899266435 * y * (3 * x * x - y * y),
        2.890611442640554 * x * y * z,
        -0.4570457994644658 * y * (4 * z * z - x * x - y * y),
        0.3731763325901154 * z * (2 * z * z - 3 * x * x - 3 * y * y),
        -0.4570457994644658 * x * (4 * z * z - x * x - y * y),
        1.445305721320277 * z * (x * x - y * y),
        -0.5900435899266435 * x * (x * x - 3 * y * y),
    };
    out->sh_used = (degree + 1) * (degree + 1);
    for (int k = 0; k < SGSI_SH_COUNT; ++k)
        out->basis[k] = k < out->sh_used ? basis[k] : 0;
    for (int c = 0; c < 3; ++c) {
        double sum = 0.5;
        for (int k = 0; k < out->sh_used; ++k)
            sum += out->basis[k] * sh[3 * k + c];
        out->color_clamped[c] = sum < 0;
        out->color[c] = sum < 0 ? 0 : sum;
    }
}

static void activate(const sgsi_reference_view *view, const double *stored, double filter_3d,
                     int degree, sgsi_reference_primitive *out)
{
    activate_rotation(stored + SGS_PARAM_ROTATION, out);
    activate_position(view, stored + SGS_PARAM_MEAN, out);
    activate_filters(view, stored, filter_3d, out);
    activate_color(stored + SGS_PARAM_SH_DC, degree, out);
    for (int row = 0; row < 3; ++row)
        for (int column = 0; column < 3; ++column)
            out->matrix[3 * row + column] =
                out->rotation[3 * column + row] / sqrt(out->variance_view[row]);
    double to_center[3];
    for (int k = 0; k < 3; ++k)
        to_center[k] = view->center[k] - stored[SGS_PARAM_MEAN + k];
    multiply(out->matrix, to_center, out->offset);
}

sgs_status sgsi_reference_view_create(const double *params, size_t count, const sgs_camera *camera,
                                      const sgs_pose *pose, const sgs_render_options *options,
                                      sgsi_reference_view *view)
{
    *view = (sgsi_reference_view){.camera = camera, .pose = pose, .count = count};
    if ((!params && count) || !camera || !pose)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "reference: parameters, camera and pose are required");
    sgs_render_options own = sgs_render_options_default();
    const sgs_status read = sgsi_options_read(options, "sgs_render_options", &own, sizeof own);
    if (read)
        return read;
    options = &own;
    if (options->filter != SGS_FILTER_3DGS && options->filter != SGS_FILTER_NONE &&
        options->filter != SGS_FILTER_MIP)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "reference: unknown filter %d",
                         (int)options->filter);
    if (options->compact_box != 1.0)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "the reference renderer has no tiles; compact_box must be 1");
    if (count > UINT32_MAX)
        return sgsi_fail(SGS_STATUS_LIMIT, "reference: %zu primitives; ids have 32 bits", count);
    sgs_status status = sgs_camera_validate(camera);
    if (status == SGS_STATUS_OK)
        status = sgs_pose_validate(pose);
    if (status != SGS_STATUS_OK)
        return status;
    double fx, fy, cx, cy;
    sgs_camera_intrinsics(camera, &fx, &fy, &cx, &cy);
    sgs_pose_center(pose, view->center);
    view->near_distance = options->near_distance;
    view->axis_depth = options->axis_depth;
    view->mip = options->filter == SGS_FILTER_MIP;
    if (options->filter != SGS_FILTER_NONE)
        view->filter_scale = (view->mip ? dilation_mip : dilation_3dgs) / (fx * fy);
    view->primitives = sgsi_alloc(count ? count : 1, sizeof *view->primitives);
    if (!view->primitives)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "reference: not enough memory for %zu primitives", count);
    const int degree = options->sh_degree < 0 ? 0 : options->sh_degree > 3 ? 3 : options->sh_degree;
    for (size_t i = 0; i < count; ++i) {
        const double filter_3d = view->mip && options->filter_3d ? options->filter_3d[i] : 0;
        activate(view, params + i * SGS_PARAM_COUNT, filter_3d, degree, &view->primitives[i]);
    }
    return SGS_STATUS_OK;
}

void sgsi_reference_view_free(sgsi_reference_view *view)
{
    sgsi_free(view->primitives);
    view->primitives = NULL;
}

// ---- One ray ----

bool sgsi_reference_ray(const sgsi_reference_view *view, int x, int y, double direction[3])
{
    const double pixel[2] = {x + 0.5, y + 0.5};
    double in_camera[3];
    if (!sgs_camera_unproject(view->camera, pixel, in_camera))
        return false;
    multiply_transposed(view->pose->rotation, in_camera, direction);
    return true;
}

void sgsi_reference_response(const sgsi_reference_primitive *primitive, const double direction[3],
                             double *rho_squared, double *t)
{
    double g[3], n[3];
    multiply(primitive->matrix, direction, g);
    cross(primitive->offset, g, n);
    *rho_squared = dot(n, n) / dot(g, g);
    *t = -dot(primitive->offset, g) / dot(g, g);
}

static int compare_hits(const void *left, const void *right)
{
    const sgs_hit *a = left, *b = right;
    if (a->t != b->t)
        return a->t < b->t ? -1 : 1;
    return a->primitive < b->primitive ? -1 : a->primitive > b->primitive;
}

// Unordered hits of all primitives, as if each were alone. Returns how many.
static size_t find_hits(const sgsi_reference_view *view, const double direction[3], sgs_hit *hits)
{
    size_t found = 0;
    for (size_t i = 0; i < view->count; ++i) {
        double rho_squared, t;
        sgsi_reference_response(&view->primitives[i], direction, &rho_squared, &t);
        const double alpha = view->primitives[i].opacity * exp(-0.5 * rho_squared);
        // Also rejects NaN and infinite t: a degenerate primitive is never hit.
        if (alpha >= alpha_min && t > view->near_distance && t < HUGE_VAL)
            hits[found++] = (sgs_hit){(uint32_t)i, t, alpha < alpha_max ? alpha : alpha_max, 1};
    }
    return found;
}

// Orders the hits and computes their transmittances. Returns how many are counted.
static size_t order_hits(sgs_hit *hits, size_t found)
{
    qsort(hits, found, sizeof *hits, compare_hits);
    double transmittance = 1;
    for (size_t k = 0; k < found; ++k) {
        hits[k].transmittance = transmittance;
        transmittance *= 1 - hits[k].alpha;
        if (transmittance < transmittance_min)
            return k;
    }
    return found;
}

size_t sgsi_reference_trace(const sgsi_reference_view *view, const double direction[3],
                            sgs_hit *hits)
{
    return order_hits(hits, find_hits(view, direction, hits));
}

// ---- The image ----

typedef struct render_job {
    const sgsi_reference_view *view;
    sgs_reference_frame *frame;
    sgs_hit *hits; // [threads][count]
} render_job;

typedef struct pixel_values {
    double color[3], transmittance, depth_mean, depth_median, depth_first, hits, normal[3],
        position[3], primitive;
} pixel_values;

void sgsi_reference_normal(const sgsi_reference_primitive *primitive, double normal[3])
{
    int shortest = 0;
    for (int k = 1; k < 3; ++k)
        if (primitive->variance[k] < primitive->variance[shortest])
            shortest = k;
    for (int k = 0; k < 3; ++k)
        normal[k] = primitive->rotation[3 * k + shortest];
    const double towards = dot(normal, primitive->direction) > 0 ? -1 : 1;
    for (int k = 0; k < 3; ++k)
        normal[k] *= towards;
}

static pixel_values blend(const sgsi_reference_view *view, const double direction[3],
                          const sgs_hit *hits, size_t count)
{
    pixel_values pixel = {.transmittance = 1, .hits = (double)count, .primitive = -1};
    double weight_sum = 0, largest = 0;
    for (size_t k = 0; k < count; ++k) {
        const double weight = hits[k].transmittance * hits[k].alpha;
        for (int c = 0; c < 3; ++c)
            pixel.color[c] += weight * view->primitives[hits[k].primitive].color[c];
        weight_sum += weight;
        pixel.depth_mean += weight * hits[k].t;
        pixel.transmittance = hits[k].transmittance * (1 - hits[k].alpha);
        if (hits[k].transmittance > 0.5 && pixel.transmittance <= 0.5)
            pixel.depth_median = hits[k].t;
        double normal[3];
        sgsi_reference_normal(&view->primitives[hits[k].primitive], normal);
        for (int c = 0; c < 3; ++c) {
            pixel.normal[c] += weight * normal[c];
            pixel.position[c] += weight * (view->center[c] + hits[k].t * direction[c]);
        }
        if (weight > largest) {
            largest = weight;
            pixel.primitive = hits[k].primitive;
        }
    }
    if (!count)
        return pixel;
    pixel.depth_mean /= weight_sum;
    pixel.depth_first = hits[0].t;
    const double length = sqrt(dot(pixel.normal, pixel.normal));
    for (int c = 0; c < 3; ++c) {
        pixel.position[c] /= weight_sum;
        pixel.normal[c] = length > 0 ? pixel.normal[c] / length : 0;
    }
    if (view->axis_depth) {
        const double along = dot(view->pose->rotation + 6, direction);
        pixel.depth_mean *= along;
        pixel.depth_median *= along;
        pixel.depth_first *= along;
    }
    return pixel;
}

static void store(double *plane, size_t index, double value)
{
    if (plane)
        plane[index] = value;
}

static void render_row(void *context, size_t y, int thread)
{
    const render_job *job = context;
    const sgs_reference_frame *frame = job->frame;
    sgs_hit *hits = job->hits + (size_t)thread * job->view->count;
    for (int x = 0; x < frame->width; ++x) {
        double direction[3] = {0, 0, 0};
        size_t found = 0;
        if (sgsi_reference_ray(job->view, x, (int)y, direction))
            found = find_hits(job->view, direction, hits);
        const size_t count = order_hits(hits, found);
        const pixel_values pixel = blend(job->view, direction, hits, count);
        const size_t index = y * (size_t)frame->width + (size_t)x;
        for (int c = 0; c < 3; ++c) {
            store(frame->color[c], index, pixel.color[c]);
            store(frame->normal[c], index, pixel.normal[c]);
            store(frame->position[c], index, pixel.position[c]);
        }
        store(frame->primitive, index, pixel.primitive);
        store(frame->transmittance, index, pixel.transmittance);
        store(frame->depth_mean, index, pixel.depth_mean);
        store(frame->depth_median, index, pixel.depth_median);
        store(frame->depth_first, index, pixel.depth_first);
        store(frame->hits, index, pixel.hits);
        store(frame->candidates, index, (double)found);
    }
}

static bool all_rays_forward(const sgs_camera *camera)
{
    for (int y = 0; y < camera->height; ++y)
        for (int x = 0; x < camera->width; ++x) {
            double direction[3];
            if (sgs_camera_unproject(camera, (double[2]){x + 0.5, y + 0.5}, direction) &&
                !(direction[2] > 0))
                return false;
        }
    return true;
}

sgs_status sgs_reference_render(const double *params, size_t count, const sgs_camera *camera,
                                const sgs_pose *pose, const sgs_render_options *options,
                                sgs_reference_frame *frame)
{
    if (!frame || !camera || frame->width != camera->width || frame->height != camera->height)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "reference: the frame must have the size of the camera");
    sgsi_reference_view view;
    sgs_status status = sgsi_reference_view_create(params, count, camera, pose, options, &view);
    if (status != SGS_STATUS_OK)
        return status;
    if (view.axis_depth && !all_rays_forward(camera)) {
        sgsi_reference_view_free(&view);
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "reference: option axis_depth is not defined for rays 90 degrees or more "
                         "from the camera axis; measure along the ray");
    }
    const size_t threads = (size_t)sgsi_threads();
    render_job job = {&view, frame, sgsi_alloc(threads, (count ? count : 1) * sizeof(sgs_hit))};
    if (job.hits)
        sgsi_parallel_for((size_t)frame->height, 1, render_row, &job);
    else
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                           "reference: not enough memory for the hits of %zu primitives", count);
    sgsi_free(job.hits);
    sgsi_reference_view_free(&view);
    return status;
}

sgs_status sgs_reference_hits(const double *params, size_t count, const sgs_camera *camera,
                              const sgs_pose *pose, const sgs_render_options *options, int x, int y,
                              sgs_hit *hits, size_t capacity, size_t *hit_count)
{
    *hit_count = 0;
    sgsi_reference_view view;
    sgs_status status = sgsi_reference_view_create(params, count, camera, pose, options, &view);
    if (status != SGS_STATUS_OK)
        return status;
    size_t found = 0;
    double direction[3];
    sgs_hit *all = sgsi_alloc(count ? count : 1, sizeof *all);
    if (!all)
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                           "reference: not enough memory for the hits of %zu primitives", count);
    else if (x >= 0 && y >= 0 && x < camera->width && y < camera->height &&
             sgsi_reference_ray(&view, x, y, direction))
        found = sgsi_reference_trace(&view, direction, all);
    for (size_t k = 0; k < found && k < capacity && hits; ++k)
        hits[k] = all[k];
    sgsi_free(all);
    sgsi_reference_view_free(&view);
    *hit_count = found;
    return status;
}

// ---- Frames ----

sgs_status sgs_reference_frame_create(int width, int height, sgs_reference_frame *frame)
{
    if (!frame)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "reference: frame is NULL");
    *frame = (sgs_reference_frame){0};
    if (width < 1 || height < 1 || width > 65536 || height > 65536)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "reference: invalid frame size %d x %d",
                         width, height);
    size_t count;
    const sgs_aov *aovs = sgs_aov_descriptors(&count);
    for (size_t i = 0; i < count; ++i)
        for (int c = 0; c < aovs[i].channels; ++c) {
            double *plane = sgsi_calloc((size_t)width * (size_t)height, sizeof(double));
            if (!plane) {
                sgs_reference_frame_free(frame);
                return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                 "reference: not enough memory for %d x %d pixels", width, height);
            }
            sgsi_plane_set(frame, aovs[i].reference_offset, c, plane);
        }
    frame->width = width;
    frame->height = height;
    return SGS_STATUS_OK;
}

void sgs_reference_frame_free(sgs_reference_frame *frame)
{
    if (!frame)
        return;
    size_t count;
    const sgs_aov *aovs = sgs_aov_descriptors(&count);
    for (size_t i = 0; i < count; ++i)
        for (int c = 0; c < aovs[i].channels; ++c)
            sgsi_free(sgs_aov_reference_plane(&aovs[i], frame, c));
    *frame = (sgs_reference_frame){0};
}
