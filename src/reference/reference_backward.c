// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The reference renderer, backward pass: dL/d(stored parameter) for the image of reference_render.c
// and any L with given gradients of colour and transmittance. Two steps, as in the fast trainer:
//   1. over pixels: each ray adds sixteen sums to each primitive it counts: dL/d colour (3),
//      dL/d opacity (1), dL/dp (3), dL/dM (9). They suffice because a view has one origin c, so p
//      and M are per primitive;
//   2. over primitives: the chain rule from these sums to the 59 stored parameters.
// Depths and hit counts are not differentiated, and neither are the jumps where a hit appears or
// disappears. Each derivation precedes its function; d_x is dL/dx. The sums of a fixed number of
// row bands are added in order, so the bits do not depend on the number of threads.

#include "reference/reference.h"

#include <math.h>
#include <string.h>

#include "base/sh.h"
#include "base/core.h"
#include "base/threads.h"

enum { BANDS = 8 };

// The sums of one primitive over the pixels of a view.
typedef struct hit_sums {
    double color[3], opacity, offset[3], matrix[9];
} hit_sums;

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

// ---- Step 1: from the image to the sums of each primitive ----

// Response. With g = M d, n = p x g and rho^2 = |n|^2 / |g|^2:
//   d|n|^2 = 2 n.(dp x g + p x dg) = 2 dp.(g x n) + 2 dg.(n x p), hence
//   d rho^2/dp = 2 (g x n) / |g|^2,    d rho^2/dg = 2 (n x p) / |g|^2 - 2 rho^2 g / |g|^2,
// and g = M d adds (d rho^2/dg) (x) d to d_M. The part of d_M through p = M (c - mean) is added in
// step 2: it is (d_p) (x) (c - mean), and c - mean is the same for all rays.
static void response_backward(const sgsi_reference_primitive *primitive, const double direction[3],
                              double d_rho_squared, hit_sums *sums)
{
    const double *p = primitive->offset;
    double g[3], n[3], g_cross_n[3], n_cross_p[3];
    for (int row = 0; row < 3; ++row)
        g[row] = dot(primitive->matrix + 3 * row, direction);
    cross(p, g, n);
    cross(g, n, g_cross_n);
    cross(n, p, n_cross_p);
    const double g2 = dot(g, g), rho_squared = dot(n, n) / g2;
    for (int row = 0; row < 3; ++row) {
        const double d_g = d_rho_squared * 2 * (n_cross_p[row] - rho_squared * g[row]) / g2;
        sums->offset[row] += d_rho_squared * 2 * g_cross_n[row] / g2;
        for (int column = 0; column < 3; ++column)
            sums->matrix[3 * row + column] += d_g * direction[column];
    }
}

// Blending. With T_i = prod_{j<i} (1 - alpha_j), C = sum_i T_i alpha_i c_i and T = prod_i (1 -
// alpha_i):
//   dC/dc_i = T_i alpha_i,
//   dC/dalpha_i = T_i c_i - behind_i / (1 - alpha_i),    behind_i = sum_{j>i} T_j alpha_j c_j,
//   dT/dalpha_i = -T / (1 - alpha_i).
// alpha = o'' G with G = exp(-rho^2 / 2), the clamp at 0.99 taken as the identity:
//   dalpha/do'' = G,    dalpha/drho^2 = -o'' G / 2.
// The loop runs back to front so that behind_i is the running sum of exactly its terms.
static void ray_backward(const sgsi_reference_view *view, const double direction[3],
                         const sgs_hit *hits, size_t count, const double d_color[3],
                         double d_transmittance, hit_sums *sums)
{
    if (!count)
        return;
    const double last = hits[count - 1].transmittance * (1 - hits[count - 1].alpha);
    double behind[3] = {0, 0, 0};
    for (size_t k = count; k-- > 0;) {
        const sgs_hit *hit = &hits[k];
        const sgsi_reference_primitive *primitive = &view->primitives[hit->primitive];
        hit_sums *sum = &sums[hit->primitive];
        const double weight = hit->transmittance * hit->alpha;
        double d_alpha = -d_transmittance * last / (1 - hit->alpha);
        for (int c = 0; c < 3; ++c) {
            d_alpha += d_color[c] *
                       (hit->transmittance * primitive->color[c] - behind[c] / (1 - hit->alpha));
            sum->color[c] += d_color[c] * weight;
            behind[c] += weight * primitive->color[c];
        }
        double rho_squared, t;
        sgsi_reference_response(primitive, direction, &rho_squared, &t);
        const double response = exp(-0.5 * rho_squared);
        sum->opacity += d_alpha * response;
        response_backward(primitive, direction, d_alpha * primitive->opacity * response * -0.5,
                          sum);
    }
}

typedef struct backward_job {
    const sgsi_reference_view *view;
    const double *const *d_color;
    const double *d_transmittance;
    sgs_hit *hits;  // [threads][count]
    hit_sums *sums; // [BANDS][count]
} backward_job;

static void band_backward(void *context, size_t band, int thread)
{
    const backward_job *job = context;
    const sgsi_reference_view *view = job->view;
    const size_t width = (size_t)view->camera->width, height = (size_t)view->camera->height;
    sgs_hit *hits = job->hits + (size_t)thread * view->count;
    for (size_t y = band * height / BANDS; y < (band + 1) * height / BANDS; ++y) {
        for (size_t x = 0; x < width; ++x) {
            double direction[3];
            if (!sgsi_reference_ray(view, (int)x, (int)y, direction))
                continue;
            const size_t index = y * width + x;
            const double d_color[3] = {job->d_color[0][index], job->d_color[1][index],
                                       job->d_color[2][index]};
            const size_t count = sgsi_reference_trace(view, direction, hits);
            ray_backward(view, direction, hits, count, d_color,
                         job->d_transmittance ? job->d_transmittance[index] : 0,
                         job->sums + band * view->count);
        }
    }
}

// ---- Step 2: from the sums to the stored parameters ----

// Gradients of the SH basis by the direction as a free vector (x, y, z), 0 from sh_used on.
static void sh_basis_gradients(const sgsi_reference_primitive *primitive,
                               double gradients[SGSI_SH_COUNT][3])
{
    const double x = primitive->direction[0], y = primitive->direction[1],
                 z = primitive->direction[2];
    const double xx = x * x, yy = y * y, zz = z * z;
    static const double scale[SGSI_SH_COUNT] = {
        SGSI_SH_C0,         -0.4886025119029199, 0.4886025119029199,  -0.4886025119029199,
        1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792,
        0.5462742152960396, -0.5900435899266435, 2.890611442640554,   -0.4570457994644658,
        0.3731763325901154, -0.4570457994644658, 1.445305721320277,   -0.5900435899266435,
    };
    const double polynomial[SGSI_SH_COUNT][3] = {
        {0, 0, 0},
        {0, 1, 0},                                          // y
        {0, 0, 1},                                          // z
        {1, 0, 0},                                          // x
        {y, x, 0},                                          // xy
        {0, z, y},                                          // yz
        {-2 * x, -2 * y, 4 * z},                            // 2zz - xx - yy
        {z, 0, x},                                          // xz
        {2 * x, -2 * y, 0},                                 // xx - yy
        {6 * x * y, 3 * xx - 3 * yy, 0},                    // y (3xx - yy)
        {y * z, x * z, x * y},                              // xyz
        {-2 * x * y, 4 * zz - xx - 3 * yy, 8 * y * z},      // y (4zz - xx - yy)
        {-6 * x * z, -6 * y * z, 6 * zz - 3 * xx - 3 * yy}, // z (2zz - 3xx - 3yy)
        {4 * zz - 3 * xx - yy, -2 * x * y, 8 * x * z},      // x (4zz - xx - yy)
        {2 * x * z, -2 * y * z, xx - yy},                   // z (xx - yy)
        {3 * xx - 3 * yy, -6 * x * y, 0},                   // x (xx - 3yy)
    };
    for (int k = 0; k < SGSI_SH_COUNT; ++k)
        for (int j = 0; j < 3; ++j)
            gradients[k][j] = k < primitive->sh_used ? scale[k] * polynomial[k][j] : 0;
}

// A unit vector u = v / |v|: du = (I - u u^T) dv / |v|, so d_v = (d_u - u (u.d_u)) / |v|. Adds to
// d_v; the zero vector gets nothing.
static void direction_backward(const sgsi_reference_primitive *primitive,
                               const double d_direction[3], double d_mean[3])
{
    const double along = dot(primitive->direction, d_direction);
    for (int k = 0; k < 3 && primitive->distance > 0; ++k)
        d_mean[k] += (d_direction[k] - primitive->direction[k] * along) / primitive->distance;
}

// Colour. color_c = max(0, 1/2 + sum_k sh_kc basis_k(u)), u = (mean - c) / |mean - c|:
//   d_sh_kc = basis_k d_color_c,    d_u = sum_kc sh_kc d_color_c grad basis_k,
// both 0 in a clamped channel. The part through u goes to d_mean.
static void color_backward(const sgsi_reference_primitive *primitive, const hit_sums *sums,
                           const double *sh, double *d_sh, double d_mean[3])
{
    double gradients[SGSI_SH_COUNT][3], d_direction[3] = {0, 0, 0};
    sh_basis_gradients(primitive, gradients);
    for (int c = 0; c < 3; ++c) {
        const double d_color = primitive->color_clamped[c] ? 0 : sums->color[c];
        for (int k = 0; k < SGSI_SH_COUNT; ++k) {
            d_sh[3 * k + c] = d_color * primitive->basis[k];
            for (int j = 0; j < 3; ++j)
                d_direction[j] += d_color * sh[3 * k + c] * gradients[k][j];
        }
    }
    direction_backward(primitive, d_direction, d_mean);
}

// Opacity and variances through the filters. Write v = s^2, v' = v + f3^2, v'' = v' + eps^2, eps^2
// = kappa z^2 / f^2, a = R^T u, and D(v) = a_0^2 v_1 v_2 + a_1^2 v_2 v_0 + a_2^2 v_0 v_1. Without
// `mip`, o'' = o; with it
//   ln o'' = ln o + 1/2 sum_k (ln v_k - ln v'_k) + 1/2 ln D(v') - 1/2 ln D(v'').
// Let l = d_o'' o'' = dL / d ln o''. With d_v'' entering from M:
//   d_v''_k -= l/2 (dD/dv_k)(v'') / D(v'')
//   d_v'_k   = d_v''_k + l/2 (dD/dv_k)(v') / D(v') - l / (2 v'_k)
//   d_v_k    = d_v'_k + l / (2 v_k),    and v = exp(2 log s) makes d_log_s = 2 v d_v
//   d_eps^2  = sum_k d_v''_k,           d_z = 2 kappa z / f^2 d_eps^2
//   d_a_k    = l a_k (v'_i v'_j / D(v') - v''_i v''_j / D(v''))    with {i, j, k} = {0, 1, 2}
//   a_k = sum_j R_jk u_j: d_R_jk += u_j d_a_k, d_u_j = sum_k R_jk d_a_k
//   o = sigmoid(logit): d_logit = (d_o'' o'' / o) o (1 - o) = l (1 - o).
// d_variance_view holds dL/dv'' from M on entry. d_rotation and d_mean are added to.
static void filters_backward(const sgsi_reference_view *view,
                             const sgsi_reference_primitive *primitive, const hit_sums *sums,
                             double d_variance_view[3], double d_rotation[9], double d_mean[3],
                             double *d_stored)
{
    const double *stage1 = primitive->variance_3d, *stage2 = primitive->variance_view;
    const double d_log_opacity = sums->opacity * primitive->opacity;
    double d_variance_3d[3] = {0, 0, 0}; // direct part; the rest comes through variance_view
    if (view->mip && primitive->distance > 0) {
        double a[3], slope1[3], slope2[3], d_direction[3] = {0, 0, 0};
        for (int k = 0; k < 3; ++k)
            a[k] = primitive->rotation[k] * primitive->direction[0] +
                   primitive->rotation[3 + k] * primitive->direction[1] +
                   primitive->rotation[6 + k] * primitive->direction[2];
        const double marginal1 = sgsi_reference_marginal(a, stage1, slope1);
        const double marginal2 = sgsi_reference_marginal(a, stage2, slope2);
        for (int k = 0; k < 3; ++k) {
            const int i = (k + 1) % 3, j = (k + 2) % 3;
            d_variance_3d[k] += 0.5 * d_log_opacity * slope1[k] / marginal1;
            d_variance_view[k] -= 0.5 * d_log_opacity * slope2[k] / marginal2;
            const double d_a =
                d_log_opacity * a[k] *
                (stage1[i] * stage1[j] / marginal1 - stage2[i] * stage2[j] / marginal2);
            for (int row = 0; row < 3; ++row) {
                d_rotation[3 * row + k] += primitive->direction[row] * d_a;
                d_direction[row] += primitive->rotation[3 * row + k] * d_a;
            }
        }
        direction_backward(primitive, d_direction, d_mean);
    }
    double d_dilation = 0;
    for (int k = 0; k < 3; ++k) {
        const double through_scale = d_variance_view[k] + d_variance_3d[k];
        d_dilation += d_variance_view[k];
        d_stored[SGS_PARAM_SCALE + k] = 2 * primitive->variance[k] * through_scale;
        if (view->mip)
            d_stored[SGS_PARAM_SCALE + k] +=
                d_log_opacity * (1 - primitive->variance[k] / stage1[k]);
    }
    for (int k = 0; k < 3; ++k)
        d_mean[k] += d_dilation * 2 * view->filter_scale * primitive->depth * primitive->d_depth[k];
    d_stored[SGS_PARAM_OPACITY] = d_log_opacity * (1 - primitive->opacity_stored);
}

// Rotation. R(q) as written in reference_render.c, with G = d_R; each line collects the entries of
// R that hold the component. Then the normalisation q = r / |r|: d_r = (d_q - q (q.d_q)) / |r|. |r|
// = 0 means identity: gradient 0.
static void rotation_backward(const sgsi_reference_primitive *primitive, const double G[9],
                              double *d_stored)
{
    const double *q = primitive->quaternion;
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double d_q[4] = {
        2 * (z * (G[3] - G[1]) + y * (G[2] - G[6]) + x * (G[7] - G[5])),
        2 * (y * (G[1] + G[3]) + z * (G[2] + G[6]) + w * (G[7] - G[5]) - 2 * x * (G[4] + G[8])),
        2 * (x * (G[1] + G[3]) + z * (G[5] + G[7]) + w * (G[2] - G[6]) - 2 * y * (G[0] + G[8])),
        2 * (x * (G[2] + G[6]) + y * (G[5] + G[7]) + w * (G[3] - G[1]) - 2 * z * (G[0] + G[4])),
    };
    const double along = q[0] * d_q[0] + dot(q + 1, d_q + 1);
    for (int k = 0; k < 4; ++k)
        d_stored[k] = primitive->quaternion_norm > 0
                          ? (d_q[k] - q[k] * along) / primitive->quaternion_norm
                          : 0;
}

// Geometry. p = M (c - mean): d_M += d_p (x) (c - mean), d_mean = -M^T d_p.
// M_kj = R_jk / s''_k: d_R_jk = d_M_kj / s''_k, and d_s''_k = -sum_j d_M_kj M_kj / s''_k, that is
// d_v''_k = d_s''_k / (2 s''_k) = -sum_j d_M_kj M_kj / (2 v''_k).
static void primitive_backward(const sgsi_reference_view *view,
                               const sgsi_reference_primitive *primitive, const hit_sums *sums,
                               const double *stored, double *d_stored, double *d_mean_no_sh)
{
    double d_rotation[9], d_variance_view[3], d_mean[3];
    for (int k = 0; k < 3; ++k) {
        const double scale = sqrt(primitive->variance_view[k]);
        const double *row = primitive->matrix + 3 * k;
        d_variance_view[k] = 0;
        for (int j = 0; j < 3; ++j) {
            const double to_center = view->center[j] - stored[SGS_PARAM_MEAN + j];
            const double d_matrix = sums->matrix[3 * k + j] + sums->offset[k] * to_center;
            d_rotation[3 * j + k] = d_matrix / scale;
            d_variance_view[k] -= d_matrix * row[j] / (2 * primitive->variance_view[k]);
        }
    }
    for (int j = 0; j < 3; ++j)
        d_mean[j] =
            -(primitive->matrix[j] * sums->offset[0] + primitive->matrix[3 + j] * sums->offset[1] +
              primitive->matrix[6 + j] * sums->offset[2]);
    filters_backward(view, primitive, sums, d_variance_view, d_rotation, d_mean, d_stored);
    rotation_backward(primitive, d_rotation, d_stored + SGS_PARAM_ROTATION);
    if (d_mean_no_sh)
        memcpy(d_mean_no_sh, d_mean, sizeof d_mean);
    color_backward(primitive, sums, stored + SGS_PARAM_SH_DC, d_stored + SGS_PARAM_SH_DC, d_mean);
    memcpy(d_stored + SGS_PARAM_MEAN, d_mean, sizeof d_mean);
}

static bool reduce_bands(const hit_sums *bands, size_t count, size_t primitive, hit_sums *total)
{
    double sums[16] = {0};
    bool any = false;
    for (size_t band = 0; band < BANDS; ++band) {
        double part[16];
        memcpy(part, &bands[band * count + primitive], sizeof part);
        for (int k = 0; k < 16; ++k) {
            sums[k] += part[k];
            any |= part[k] != 0;
        }
    }
    memcpy(total, sums, sizeof sums);
    return any;
}

sgs_status sgs_reference_backward(const double *params, size_t count, const sgs_camera *camera,
                                  const sgs_pose *pose, const sgs_render_options *options,
                                  const double *const d_color[3], const double *d_transmittance,
                                  double *d_params, double *d_mean_no_sh)
{
    _Static_assert(sizeof(hit_sums) == 16 * sizeof(double), "sixteen sums");
    if (!d_color || !d_color[0] || !d_color[1] || !d_color[2] || (!d_params && count))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "reference: three colour gradients and d_params are required");
    sgsi_reference_view view;
    sgs_status status = sgsi_reference_view_create(params, count, camera, pose, options, &view);
    if (status != SGS_STATUS_OK)
        return status;
    const size_t threads = (size_t)sgsi_threads(), room = count ? count : 1;
    backward_job job = {&view, d_color, d_transmittance,
                        sgsi_alloc(threads, room * sizeof(sgs_hit)),
                        sgsi_calloc(room, BANDS * sizeof(hit_sums))};
    if (job.hits && job.sums) {
        sgsi_parallel_for(BANDS, 1, band_backward, &job);
        if (count)
            memset(d_params, 0, count * SGS_PARAM_COUNT * sizeof *d_params);
        if (d_mean_no_sh)
            memset(d_mean_no_sh, 0, count * 3 * sizeof *d_mean_no_sh);
        for (size_t i = 0; i < count; ++i) {
            // A primitive without hits has gradient 0, even if its matrices are not finite.
            hit_sums sums;
            if (reduce_bands(job.sums, count, i, &sums))
                primitive_backward(&view, &view.primitives[i], &sums, params + i * SGS_PARAM_COUNT,
                                   d_params + i * SGS_PARAM_COUNT,
                                   d_mean_no_sh ? d_mean_no_sh + 3 * i : NULL);
        }
    } else {
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                           "reference: not enough memory for gradients of %zu primitives", count);
    }
    sgsi_free(job.hits);
    sgsi_free(job.sums);
    sgsi_reference_view_free(&view);
    return status;
}
