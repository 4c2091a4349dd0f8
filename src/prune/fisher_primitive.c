// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A primitive as one view sees it, in double precision: the activations of 3DGS and the pixel
// filters of sparegs/render.h, with the gradients by mean and log scale that are constant over the
// rays of the view.

#include "prune/fisher_primitive.h"

#include <math.h>
#include <string.h>

#include "base/sh.h"

enum { SH_COUNT = 16 };

void sgsi_fisher_camera_set(sgsi_fisher_camera *camera, const sgsi_traced_view *traced)
{
    double fx, fy, cx, cy;
    sgs_camera_intrinsics(traced->camera, &fx, &fy, &cx, &cy);
    const sgs_filter filter = traced->render->filter;
    const double pixel = filter == SGS_FILTER_3DGS ? 0.3 : filter == SGS_FILTER_MIP ? 0.1 : 0.0;
    *camera = (sgsi_fisher_camera){.camera = traced->camera,
                                   .pose = traced->pose,
                                   .near_distance = traced->render->near_distance,
                                   .filter_scale = pixel / (fx * fy),
                                   .mip = filter == SGS_FILTER_MIP,
                                   .fisheye = sgs_camera_is_fisheye(traced->camera->model),
                                   .filter_3d = traced->render->filter_3d,
                                   .sh_degree = traced->render->sh_degree};
    sgs_pose_center(traced->pose, camera->center);
}

static void rotation_of(const float *stored, double r[9])
{
    double q[4], norm = 0;
    for (int k = 0; k < 4; ++k)
        norm += (double)stored[k] * (double)stored[k];
    norm = sqrt(norm);
    for (int k = 0; k < 4; ++k)
        q[k] = norm > 0 ? (double)stored[k] / norm : k == 0;
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double matrix[9] = {
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
        2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
    memcpy(r, matrix, sizeof matrix);
}

// SH basis (the signs of 3DGS) and its gradients by the direction as a free vector.
static void sh_basis(const double d[3], double basis[SH_COUNT], double gradient[SH_COUNT][3])
{
    const double x = d[0], y = d[1], z = d[2], xx = x * x, yy = y * y, zz = z * z;
    static const double scale[SH_COUNT] = {
        SGSI_SH_C0,         -0.4886025119029199, 0.4886025119029199,  -0.4886025119029199,
        1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792,
        0.5462742152960396, -0.5900435899266435, 2.890611442640554,   -0.4570457994644658,
        0.3731763325901154, -0.4570457994644658, 1.445305721320277,   -0.5900435899266435};
    // Polynomial, then its derivatives by x, y, z.
    const double terms[SH_COUNT][4] = {
        {1, 0, 0, 0},
        {y, 0, 1, 0},
        {z, 0, 0, 1},
        {x, 1, 0, 0},
        {x * y, y, x, 0},
        {y * z, 0, z, y},
        {2 * zz - xx - yy, -2 * x, -2 * y, 4 * z},
        {x * z, z, 0, x},
        {xx - yy, 2 * x, -2 * y, 0},
        {y * (3 * xx - yy), 6 * x * y, 3 * (xx - yy), 0},
        {x * y * z, y * z, x * z, x * y},
        {y * (4 * zz - xx - yy), -2 * x * y, 4 * zz - xx - 3 * yy, 8 * y * z},
        {z * (2 * zz - 3 * xx - 3 * yy), -6 * x * z, -6 * y * z, 6 * zz - 3 * xx - 3 * yy},
        {x * (4 * zz - xx - yy), 4 * zz - 3 * xx - yy, -2 * x * y, 8 * x * z},
        {z * (xx - yy), 2 * x * z, -2 * y * z, xx - yy},
        {x * (xx - 3 * yy), 3 * (xx - yy), -6 * x * y, 0}};
    for (int k = 0; k < SH_COUNT; ++k) {
        basis[k] = scale[k] * terms[k][0];
        for (int j = 0; j < 3; ++j)
            gradient[k][j] = scale[k] * terms[k][1 + j];
    }
}

// Through u = (mean - c) / distance: adds (d_u - u (u . d_u)) / distance.
static void add_direction(const double u[3], double distance, const double d_u[3], double d_mean[3])
{
    const double along = u[0] * d_u[0] + u[1] * d_u[1] + u[2] * d_u[2];
    for (int j = 0; j < 3 && distance > 0; ++j)
        d_mean[j] += (d_u[j] - u[j] * along) / distance;
}

static void set_colors(const float params[SGS_PARAM_COUNT], int degree, const double u[3],
                       double distance, sgsi_fisher_primitive *out)
{
    double basis[SH_COUNT], gradient[SH_COUNT][3];
    const int used = (degree + 1) * (degree + 1);
    sh_basis(u, basis, gradient);
    for (int c = 0; c < 3; ++c) {
        double sum = 0.5, d_u[3] = {0, 0, 0};
        for (int k = 0; k < used; ++k) {
            const double coefficient = (double)params[SGS_PARAM_SH_DC + 3 * k + c];
            sum += basis[k] * coefficient;
            for (int j = 0; j < 3; ++j)
                d_u[j] += coefficient * gradient[k][j];
        }
        out->color[c] = sum < 0 ? 0 : sum;
        if (sum >= 0)
            add_direction(u, distance, d_u, out->d_color[c]);
    }
}

// Determinant of the marginal across a, prod(v) sum(a_k^2 / v_k), and its derivatives by v.
static double marginal(const double a[3], const double v[3], double d_v[3])
{
    double sum = 0;
    for (int k = 0; k < 3; ++k) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        d_v[k] = a[i] * a[i] * v[j] + a[j] * a[j] * v[i];
        sum += a[k] * a[k] * v[i] * v[j];
    }
    return sum;
}

// Mip-Splatting's factors: ln o'' = ln o + 1/2 sum (ln v - ln v') + 1/2 ln D(v') - 1/2 ln D(v''),
// v' = v + f3^2, v'' = v' + eps^2, D the marginal across a = R^T u; and its gradient.
static void set_mip_opacity(const double r[9], const double u[3], double distance,
                            const double v0[3], const double v1[3], const double v2[3],
                            sgsi_fisher_primitive *out)
{
    double a[3], slope1[3], slope2[3], d_u[3] = {0, 0, 0};
    for (int k = 0; k < 3; ++k) {
        a[k] = r[k] * u[0] + r[3 + k] * u[1] + r[6 + k] * u[2];
        out->opacity *= sqrt(v0[k] / v1[k]);
        out->d_log_opacity[3 + k] = 1 - v0[k] / v1[k];
    }
    if (!(distance > 0))
        return;
    const double d1 = marginal(a, v1, slope1), d2 = marginal(a, v2, slope2);
    out->opacity *= sqrt(d1 / d2);
    for (int k = 0; k < 3; ++k) {
        const int i = (k + 1) % 3, j = (k + 2) % 3;
        const double d_a = a[k] * (v1[i] * v1[j] / d1 - v2[i] * v2[j] / d2);
        out->d_log_opacity[3 + k] += v0[k] * (slope1[k] / d1 - slope2[k] / d2);
        for (int row = 0; row < 3; ++row) {
            out->d_log_opacity[row] -= slope2[k] / d2 * out->depth[row];
            d_u[row] += r[3 * row + k] * d_a;
        }
    }
    add_direction(u, distance, d_u, out->d_log_opacity);
}

void sgsi_fisher_primitive_set(const sgsi_fisher_camera *camera, const sgs_gaussians *model,
                               size_t row, sgsi_fisher_primitive *out)
{
    float params[SGS_PARAM_COUNT];
    double r[9], u[3], to_center[3], depth_axis[3], distance = 0, depth;
    double v0[3], v1[3], v2[3];
    *out = (sgsi_fisher_primitive){0};
    sgs_gaussians_get(model, row, params);
    rotation_of(params + SGS_PARAM_ROTATION, r);
    for (int k = 0; k < 3; ++k) {
        to_center[k] = camera->center[k] - (double)params[SGS_PARAM_MEAN + k];
        distance += to_center[k] * to_center[k];
    }
    distance = sqrt(distance);
    for (int k = 0; k < 3; ++k)
        u[k] = distance > 0 ? -to_center[k] / distance : 0;
    depth = camera->fisheye ? distance : camera->pose->translation[2];
    for (int k = 0; k < 3; ++k) {
        depth_axis[k] = camera->fisheye ? u[k] : camera->pose->rotation[6 + k];
        if (!camera->fisheye)
            depth += depth_axis[k] * (double)params[SGS_PARAM_MEAN + k];
    }
    const double f3 = camera->mip && camera->filter_3d ? (double)camera->filter_3d[row] : 0;
    for (int k = 0; k < 3; ++k) {
        const double scale = exp(fmin(fmax((double)params[SGS_PARAM_SCALE + k], -40), 40));
        v0[k] = scale * scale;
        v1[k] = v0[k] + f3 * f3;
        v2[k] = v1[k] + camera->filter_scale * depth * depth;
        out->depth[k] = camera->filter_scale * depth * depth_axis[k];
        out->ratio[k] = v0[k] / v2[k];
        out->inv_variance[k] = 1 / v2[k];
    }
    for (int k = 0; k < 3; ++k)
        for (int j = 0; j < 3; ++j) {
            out->matrix[3 * k + j] = r[3 * j + k] / sqrt(v2[k]);
            out->offset[k] += out->matrix[3 * k + j] * to_center[j];
        }
    const double logit = (double)params[SGS_PARAM_OPACITY];
    out->opacity = model->linear_opacity ? fabs(logit) : 1 / (1 + exp(-logit));
    if (camera->mip)
        set_mip_opacity(r, u, distance, v0, v1, v2, out);
    set_colors(params, camera->sh_degree, u, distance, out);
}
