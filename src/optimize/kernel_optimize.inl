// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Chain rule from a primitive's gradient sums to its stored parameters, fused with Adam, so that
// each parameter and moment is read and written once.
//
// From kernel_blend.inl, with m rotated back to the primitive's own axes by q1, q2, q3:
//   W = sum of dL/d(rho^2) m m^T = -1/2 sum v m m^T,    f = 2 sum of dL/d(rho^2) m = -sum v m.
//   dL/dlog s'_k  = -2 W_kk                                 (rho^2 = sum (y_k / s'_k)^2)
//   dL/domega     = -2 (W_yz (s'_y/s'_z - s'_z/s'_y), ...)  (R -> R exp([omega]x))
//   dL/dq         = sum over i of 2 dL/domega_i (q * e_i) / |stored q|
//   dL/ddelta     = -M^T f = -sum over k of f_k / s'_k axis_k
// Pixel filter: s'^2 = s^2 + eps^2 with eps^2 = dilation * depth^2, so dL/dlog s = dL/dlog s' s^2 /
// s'^2 and
//   dL/ddepth = dilation * depth * sum over k of dL/dlog s'_k / s'_k^2.
// Filter `mip`: see chain_mip. Opacity: dL/dlogit = sum v (1 - o); for linear opacities dL/dx = sum
// v / x. Colour: a channel clamped at 0 has zero gradient.

#include <math.h>
#include <string.h>

#include "optimize/optimize.h"
#include "trace/kernel_gaussian.inl"

typedef struct gradient16 {
    vf mean[3], rotation[4], scale[3], opacity, color[3];
    vec3 sight; // dL/dmean through the direction to the mean, camera axes; mip only
    // dL/dmean in camera axes, without the paths through the SH direction and the filter.
    vec3 transverse;
    vec3 direction; // unit, world
} gradient16;

// With the mip filter, opacity and pixel filter also depend on the scales. Let b = body, f =
// filtered, a = the line of sight in the primitive's axes, B = sum of a_k^2 / b_k^2, F = sum of
// a_k^2 / f_k^2, V = dL/dln o, and l_k the gradient through the response, as without the filter:
//   ln o = ln o_stored + sum (ln s_k - ln b_k) + sum (ln b_k - ln f_k) + (ln B - ln F) / 2
//   dL/dln f_k = l_k + V (a_k^2 / (f_k^2 F) - 1)
//   dL/dln b_k = dL/dln f_k b_k^2 / f_k^2 - V a_k^2 / (b_k^2 B)
//   dL/dln s_k = dL/dln b_k s_k^2 / b_k^2 + V
//   h_k = dL/da_k = V (a_k / (b_k^2 B) - a_k / (f_k^2 F))
//   dL/domega += h x a,    dL/dmean += R h / distance    (h.a = 0)
// Returns dL/dln f in *log_scale and dL/dln s in scale.
static inline void chain_mip(const gaussian16 *g, vf v, vec3 *log_scale, vec3 *omega, vf scale[3],
                             vec3 *sight_gradient)
{
    const vec3 a = sight(g),
               inv_body = divide3((vec3){vf_set1(1.0f), vf_set1(1.0f), vf_set1(1.0f)}, g->body);
    const vec3 before = divide3(a, g->body), after = divide3(a, g->filtered);
    const vf smallest = vf_set1(1e-37f), inv_b = vf_div(v, vf_max(dot3(before, before), smallest));
    const vf inv_f = vf_div(v, vf_max(dot3(after, after), smallest));
    vf *const out[3] = {&log_scale->x, &log_scale->y, &log_scale->z};
    const vf s[3] = {g->scale.x, g->scale.y, g->scale.z}, b[3] = {g->body.x, g->body.y, g->body.z};
    const vf inv[3] = {g->inv_filtered.x, g->inv_filtered.y, g->inv_filtered.z},
             inv_b1[3] = {inv_body.x, inv_body.y, inv_body.z};
    const vf u[3] = {before.x, before.y, before.z}, w[3] = {after.x, after.y, after.z};
    vf h[3];
    for (int k = 0; k < 3; ++k) {
        *out[k] = vf_add(*out[k], vf_fms(vf_mul(w[k], w[k]), inv_f, v));
        const vf shrink = vf_mul(b[k], inv[k]), rest = vf_mul(s[k], inv_b1[k]);
        const vf body = vf_fms(*out[k], vf_mul(shrink, shrink), vf_mul(vf_mul(u[k], u[k]), inv_b));
        scale[k] = vf_fma(body, vf_mul(rest, rest), v);
        h[k] = vf_fms(vf_mul(u[k], inv_b1[k]), inv_b, vf_mul(vf_mul(w[k], inv[k]), inv_f));
    }
    omega->x = vf_add(omega->x, vf_fms(h[1], a.z, vf_mul(h[2], a.y)));
    omega->y = vf_add(omega->y, vf_fms(h[2], a.x, vf_mul(h[0], a.z)));
    omega->z = vf_add(omega->z, vf_fms(h[0], a.y, vf_mul(h[1], a.x)));
    const vec3 across =
        add_scaled3(add_scaled3(scale3(g->axis[0], h[0]), g->axis[1], h[1]), g->axis[2], h[2]);
    *sight_gradient = scale3(across, vf_div(vf_set1(1.0f), g->distance));
}

static inline void chain_shape(const gaussian16 *g, const vf sums[16], bool mip, gradient16 *out)
{
    const vf inv_ph = vf_div(vf_set1(1.0f / SGSI_HALF_LOG2E), g->p);
    const float inv_h = 1.0f / SGSI_HALF_LOG2E, inv_root = 1.1774100225154747f; // 1 / sqrt(h)
    const vf half = vf_set1(-0.5f);
    // W and f in the frame q1, q2, q3.
    const vf xx = vf_mul(vf_mul(sums[SGSI_GRAD_SUM_VAA], vf_set1(inv_h)), half),
             xy = vf_mul(vf_mul(sums[SGSI_GRAD_SUM_VAB], vf_set1(inv_h)), half);
    const vf yy = vf_mul(vf_mul(sums[SGSI_GRAD_SUM_VBB], vf_set1(inv_h)), half);
    const vf third = vf_mul(inv_ph, vf_set1(-inv_root));
    const vf xz = vf_mul(vf_mul(sums[SGSI_GRAD_SUM_VAE], third), half),
             yz = vf_mul(vf_mul(sums[SGSI_GRAD_SUM_VBE], third), half);
    const vf zz = vf_mul(vf_mul(sums[SGSI_GRAD_SUM_VEE], vf_mul(inv_ph, inv_ph)), half);
    const vf fx = vf_mul(sums[SGSI_GRAD_SUM_VA], vf_set1(-inv_root)),
             fy = vf_mul(sums[SGSI_GRAD_SUM_VB], vf_set1(-inv_root));
    const vf fz = vf_mul(sums[SGSI_GRAD_SUM_VE], inv_ph);
    // To the primitive's axes: f = q1 fx + q2 fy + q3 fz, W = Q^T W Q.
    const vec3 f = add_scaled3(add_scaled3(scale3(g->q1, fx), g->q2, fy), g->q3, fz);
    const vec3 w1 =
        add_scaled3(add_scaled3(scale3(g->q1, xx), g->q2, xy), g->q3, xz); // row 1 of W Q
    const vec3 w2 = add_scaled3(add_scaled3(scale3(g->q1, xy), g->q2, yy), g->q3, yz);
    const vec3 w3 = add_scaled3(add_scaled3(scale3(g->q1, xz), g->q2, yz), g->q3, zz);
    const vf pxx = vf_fma(g->q1.x, w1.x, vf_fma(g->q2.x, w2.x, vf_mul(g->q3.x, w3.x)));
    const vf pyy = vf_fma(g->q1.y, w1.y, vf_fma(g->q2.y, w2.y, vf_mul(g->q3.y, w3.y)));
    const vf pzz = vf_fma(g->q1.z, w1.z, vf_fma(g->q2.z, w2.z, vf_mul(g->q3.z, w3.z)));
    const vf pxy = vf_fma(g->q1.x, w1.y, vf_fma(g->q2.x, w2.y, vf_mul(g->q3.x, w3.y)));
    const vf pxz = vf_fma(g->q1.x, w1.z, vf_fma(g->q2.x, w2.z, vf_mul(g->q3.x, w3.z)));
    const vf pyz = vf_fma(g->q1.y, w1.z, vf_fma(g->q2.y, w2.z, vf_mul(g->q3.y, w3.z)));
    const vf minus2 = vf_set1(-2.0f);
    const vec3 s = g->filtered, inv = g->inv_filtered;
    vec3 log_scale = {vf_mul(minus2, pxx), vf_mul(minus2, pyy), vf_mul(minus2, pzz)};
    vec3 omega = {vf_mul(vf_mul(minus2, pyz), vf_fms(s.y, inv.z, vf_mul(s.z, inv.y))),
                  vf_mul(vf_mul(minus2, pxz), vf_fms(s.z, inv.x, vf_mul(s.x, inv.z))),
                  vf_mul(vf_mul(minus2, pxy), vf_fms(s.x, inv.y, vf_mul(s.y, inv.x)))};
    if (mip)
        chain_mip(g, sums[SGSI_GRAD_SUM_V], &log_scale, &omega, out->scale, &out->sight);
    const vf *q = g->quaternion;
    const vf two = vf_mul(vf_set1(2.0f), g->inv_norm), zero = vf_zero();
    out->rotation[0] = vf_mul(two, vf_sub(zero, dot3((vec3){q[1], q[2], q[3]}, omega)));
    out->rotation[1] = vf_mul(two, dot3((vec3){q[0], vf_sub(zero, q[3]), q[2]}, omega));
    out->rotation[2] = vf_mul(two, dot3((vec3){q[3], q[0], vf_sub(zero, q[1])}, omega));
    out->rotation[3] = vf_mul(two, dot3((vec3){vf_sub(zero, q[2]), q[1], q[0]}, omega));
    const vec3 shrink = {vf_mul(g->scale.x, inv.x), vf_mul(g->scale.y, inv.y),
                         vf_mul(g->scale.z, inv.z)};
    if (!mip) {
        out->scale[0] = vf_mul(log_scale.x, vf_mul(shrink.x, shrink.x));
        out->scale[1] = vf_mul(log_scale.y, vf_mul(shrink.y, shrink.y));
        out->scale[2] = vf_mul(log_scale.z, vf_mul(shrink.z, shrink.z));
    }
    const vec3 back = {vf_mul(f.x, inv.x), vf_mul(f.y, inv.y), vf_mul(f.z, inv.z)};
    const vec3 towards = add_scaled3(add_scaled3(scale3(g->axis[0], back.x), g->axis[1], back.y),
                                     g->axis[2], back.z);
    out->transverse =
        (vec3){vf_sub(zero, towards.x), vf_sub(zero, towards.y), vf_sub(zero, towards.z)};
    // 2 dL/d(eps^2), for the filter's dependence on depth.
    const vf widen = vf_fma(
        log_scale.x, vf_mul(inv.x, inv.x),
        vf_fma(log_scale.y, vf_mul(inv.y, inv.y), vf_mul(log_scale.z, vf_mul(inv.z, inv.z))));
    out->mean[0] = widen;
}

// Gradient of the colour with respect to the unit direction: sum over coefficients of (sh . dcolor)
// grad basis.
static inline vec3 sh_direction_gradient(const float *p, vec3 d, int degree, const vf *d_color)
{
    const vf zero = vf_zero();
    vec3 g = {zero, zero, zero};
    vf k[15];
    const int count = degree < 1 ? 0 : degree < 2 ? 3 : degree < 3 ? 8 : 15;
    for (int i = 0; i < count; ++i) {
        const float *sh = p + 16 * (SGS_PARAM_SH_REST + 3 * i);
        k[i] = vf_fma(vf_load(sh), d_color[0],
                      vf_fma(vf_load(sh + 16), d_color[1], vf_mul(vf_load(sh + 32), d_color[2])));
    }
    if (count >= 3) {
        const vf c1 = vf_set1(0.4886025119029199f);
        g.y = vf_sub(zero, vf_mul(c1, k[0]));
        g.z = vf_mul(c1, k[1]);
        g.x = vf_sub(zero, vf_mul(c1, k[2]));
    }
    if (count >= 8) {
        const vf a = vf_mul(k[3], vf_set1(1.0925484305920792f)),
                 b = vf_mul(k[4], vf_set1(-1.0925484305920792f));
        const vf c = vf_mul(k[5], vf_set1(2.0f * 0.31539156525252005f)),
                 e = vf_mul(k[6], vf_set1(-1.0925484305920792f));
        const vf f = vf_mul(k[7], vf_set1(2.0f * 0.5462742152960396f));
        g.x = vf_add(g.x, vf_fma(a, d.y, vf_fma(e, d.z, vf_mul(vf_sub(f, c), d.x))));
        g.y = vf_add(g.y, vf_fma(a, d.x, vf_fma(b, d.z, vf_mul(vf_sub(zero, vf_add(f, c)), d.y))));
        g.z = vf_add(g.z, vf_fma(b, d.y, vf_fma(e, d.x, vf_mul(vf_add(c, c), d.z))));
    }
    if (count >= 15) {
        const vf xx = vf_mul(d.x, d.x), yy = vf_mul(d.y, d.y), zz = vf_mul(d.z, d.z);
        const vf xy = vf_mul(d.x, d.y), yz = vf_mul(d.y, d.z), xz = vf_mul(d.x, d.z);
        const vf two = vf_set1(2.0f), three = vf_set1(3.0f), four = vf_set1(4.0f),
                 six = vf_set1(6.0f), eight = vf_set1(8.0f);
        const vf k0 = vf_mul(k[8], vf_set1(-0.5900435899266435f)),
                 k1 = vf_mul(k[9], vf_set1(2.890611442640554f));
        const vf k2 = vf_mul(k[10], vf_set1(-0.4570457994644658f)),
                 k3 = vf_mul(k[11], vf_set1(0.3731763325901154f));
        const vf k4 = vf_mul(k[12], vf_set1(-0.4570457994644658f)),
                 k5 = vf_mul(k[13], vf_set1(1.445305721320277f));
        const vf k6 = vf_mul(k[14], vf_set1(-0.5900435899266435f));
        const vf xx_yy = vf_mul(three, vf_sub(xx, yy));
        vf x = vf_mul(vf_mul(k0, six), xy);
        x = vf_fma(k1, yz, x);
        x = vf_fma(vf_mul(k2, vf_set1(-2.0f)), xy, x);
        x = vf_fma(vf_mul(k3, vf_set1(-6.0f)), xz, x);
        x = vf_fma(k4, vf_sub(vf_fms(four, zz, vf_mul(three, xx)), yy), x);
        x = vf_fma(vf_mul(k5, two), xz, x);
        x = vf_fma(k6, xx_yy, x);
        vf y = vf_mul(k0, xx_yy);
        y = vf_fma(k1, xz, y);
        y = vf_fma(k2, vf_sub(vf_fms(four, zz, xx), vf_mul(three, yy)), y);
        y = vf_fma(vf_mul(k3, vf_set1(-6.0f)), yz, y);
        y = vf_fma(vf_mul(k4, vf_set1(-2.0f)), xy, y);
        y = vf_fma(vf_mul(k5, vf_set1(-2.0f)), yz, y);
        y = vf_fma(vf_mul(k6, vf_set1(-6.0f)), xy, y);
        vf z = vf_mul(k1, xy);
        z = vf_fma(vf_mul(k2, eight), yz, z);
        z = vf_fma(k3, vf_fms(six, zz, vf_mul(three, vf_add(xx, yy))), z);
        z = vf_fma(vf_mul(k4, eight), xz, z);
        z = vf_fma(k5, vf_sub(xx, yy), z);
        g = (vec3){vf_add(g.x, x), vf_add(g.y, y), vf_add(g.z, z)};
    }
    return g;
}

static inline void chain_rule(const sgsi_optimize *input, const float *p, const gaussian16 *g,
                              const vf sums[16], gradient16 *out)
{
    const vf one = vf_set1(1.0f);
    chain_shape(g, sums, input->view.mip, out);
    out->opacity = vf_mul(sums[SGSI_GRAD_SUM_V], g->transparency);
    if (input->view.linear_opacity) { // a primitive that was hit has x != 0
        const vf x = vf_load(p + 16 * SGS_PARAM_OPACITY);
        const vm seen = vf_gt(vf_abs(x), vf_set1(1e-6f));
        out->opacity = vf_keep(seen, vf_div(sums[SGSI_GRAD_SUM_V], vf_select(seen, x, one)));
    }
    const vf inv_distance = vf_div(one, g->distance);
    out->direction = scale3(g->delta_world, inv_distance);
    vf color[3];
    sh_colors(p, out->direction, input->view.sh_degree, color);
    for (int c = 0; c < 3; ++c)
        out->color[c] = vf_keep(vf_gt(color[c], vf_zero()), sums[SGSI_GRAD_SUM_COLOR + c]);
    // dL/dmean: footprint, filter through the depth, SH direction.
    const vf through_depth = vf_mul(vf_mul(out->mean[0], vf_set1(input->view.dilation)), g->depth);
    vec3 camera = out->transverse;
    if (input->view.rays->fisheye)
        camera = add_scaled3(camera, g->delta, vf_mul(through_depth, inv_distance));
    else
        camera.z = vf_add(camera.z, through_depth);
    if (input->view.mip)
        camera = (vec3){vf_add(camera.x, out->sight.x), vf_add(camera.y, out->sight.y),
                        vf_add(camera.z, out->sight.z)};
    vec3 mean = rotate3_back(input->view.rotation, camera);
    const vec3 by_direction =
        sh_direction_gradient(p, out->direction, input->view.sh_degree, out->color);
    const vf radial = dot3(by_direction, out->direction);
    const vec3 tangent = add_scaled3(by_direction, out->direction, vf_sub(vf_zero(), radial));
    mean = add_scaled3(mean, tangent, inv_distance);
    out->mean[0] = mean.x, out->mean[1] = mean.y, out->mean[2] = mean.z;
}

// The regularisers of optimize.h: dL/dlogit = w o (1 - o), dL/dlog s_k = w s_k.
static inline void regularise(const sgsi_optimize *input, const gaussian16 *g, gradient16 *d)
{
    const vf weight = vf_set1(input->scale_loss);
    d->opacity = vf_fma(vf_mul(vf_set1(input->opacity_loss), g->opacity_stored), g->transparency,
                        d->opacity);
    d->scale[0] = vf_fma(weight, g->scale.x, d->scale[0]);
    d->scale[1] = vf_fma(weight, g->scale.y, d->scale[1]);
    d->scale[2] = vf_fma(weight, g->scale.z, d->scale[2]);
}

// Densification statistic: norm of the gradient with respect to the projected centre in NDC units
// (Kerbl et al. 2023, section 5.2), z |(tan(fovx/2) gx, tan(fovy/2) gy)| with g the transverse
// gradient in camera axes.
static inline vf transverse_norm(const sgsi_optimize *input, const gaussian16 *g,
                                 const gradient16 *d)
{
    if (input->view.rays->fisheye) {
        const vec3 unit = scale3(g->delta, vf_div(vf_set1(1.0f), g->distance));
        const vec3 side =
            add_scaled3(d->transverse, unit, vf_sub(vf_zero(), dot3(d->transverse, unit)));
        return vf_mul(vf_mul(g->distance, vf_set1(input->tan_half_x)), vf_sqrt(dot3(side, side)));
    }
    const vf x = vf_mul(d->transverse.x, vf_set1(input->tan_half_x)),
             y = vf_mul(d->transverse.y, vf_set1(input->tan_half_y));
    const vf norm = vf_mul(g->delta.z, vf_sqrt(vf_fma(x, x, vf_mul(y, y))));
    return vf_keep(vf_gt(g->delta.z, vf_set1(input->view.near_distance)), norm);
}

// The same from sums of absolute values over pixels. The sums lack the factor 1 / (h |delta|) and
// the conversion to NDC units.
static inline vf abs_grad_value(const sgsi_optimize *input, const gaussian16 *g, const vf sums[16])
{
    const bool fisheye = input->view.rays->fisheye;
    const vf unit = vf_div(
        vf_mul(fisheye ? g->distance : g->delta.z, vf_set1(1.0f / SGSI_HALF_LOG2E)), g->distance);
    const vf x = vf_mul(vf_mul(sums[SGSI_GRAD_SUM_ABS], unit), vf_set1(input->tan_half_x));
    const vf y = vf_mul(vf_mul(sums[SGSI_GRAD_SUM_ABS + 1], unit),
                        vf_set1(fisheye ? input->tan_half_x : input->tan_half_y));
    const vf total = input->abs_grad_norm ? vf_sqrt(vf_fma(x, x, vf_mul(y, y))) : vf_add(x, y);
    return fisheye ? total : vf_keep(vf_gt(g->delta.z, vf_set1(input->view.near_distance)), total);
}

// Pixel-GS (Zhang et al. 2024, scaled gradient field): gradients of primitives close to the camera
// count less, so that floaters in front of it do not multiply.
static inline vf near_weight(const sgsi_optimize *input, const gaussian16 *g)
{
    if (input->near_depth <= 0.0f)
        return vf_set1(1.0f);
    const vf depth = vf_mul(input->view.rays->fisheye ? g->distance : g->delta.z,
                            vf_set1(1.0f / input->near_depth));
    return vf_min(vf_mul(depth, depth), vf_set1(1.0f));
}

static inline void add_where(float sums[16], vm rows, vf values)
{
    vf_store(sums, vf_add(vf_load(sums), vf_keep(rows, values)));
}

typedef struct adam16 {
    vf beta1, beta2, one_minus1, one_minus2, correction2, epsilon;
    float correction1;
    vm rows;
} adam16;

static inline void adam_step(const adam16 *adam, float *p, float *m, float *v, vf gradient,
                             float rate)
{
    const vf m1 = vf_fma(adam->one_minus1, gradient, vf_mul(adam->beta1, vf_load(m)));
    const vf v1 =
        vf_fma(vf_mul(adam->one_minus2, gradient), gradient, vf_mul(adam->beta2, vf_load(v)));
    const vf scale = vf_fma(vf_sqrt(v1), adam->correction2, adam->epsilon);
    const vf old = vf_load(p);
    const vf stepped = vf_fnma(vf_set1(rate * adam->correction1), vf_div(m1, scale), old);
    vf_store(p, vf_select(adam->rows, stepped, old));
    vf_store(m, vf_select(adam->rows, m1, vf_load(m)));
    vf_store(v, vf_select(adam->rows, v1, vf_load(v)));
}

static inline void step_block(const sgsi_optimize *input, size_t block, vm rows,
                              const gradient16 *d)
{
    const adam16 adam = {vf_set1(input->beta1),        vf_set1(input->beta2),
                         vf_set1(1.0f - input->beta1), vf_set1(1.0f - input->beta2),
                         vf_set1(input->correction2),  vf_set1(input->epsilon),
                         input->correction1,           rows};
    const size_t base = block * SGS_PARAM_COUNT * 16;
    float *p = input->params + base, *m = input->m + base, *v = input->v + base;
#define SGSI_STEP(k, gradient, rate)                                                               \
    adam_step(&adam, p + 16 * (k), m + 16 * (k), v + 16 * (k), gradient, rate)
    // In memory order: hardware prefetchers lose streams that jump back.
    for (int k = 0; k < 3; ++k)
        SGSI_STEP(SGS_PARAM_MEAN + k, d->mean[k], input->lr_mean);
    for (int k = 0; k < 4; ++k)
        SGSI_STEP(SGS_PARAM_ROTATION + k, d->rotation[k], input->lr_rotation);
    for (int k = 0; k < 3; ++k)
        SGSI_STEP(SGS_PARAM_SCALE + k, d->scale[k], input->lr_scale);
    SGSI_STEP(SGS_PARAM_OPACITY, d->opacity, input->lr_opacity);
    for (int c = 0; c < 3; ++c)
        SGSI_STEP(SGS_PARAM_SH_DC + c, vf_mul(vf_set1((float)SGSI_SH_C0), d->color[c]),
                  input->lr_dc);
    vf basis[15];
    const int count = sh_basis(d->direction, input->view.sh_degree, basis);
    for (int k = 0; k < count; ++k)
        for (int c = 0; c < 3; ++c)
            SGSI_STEP(SGS_PARAM_SH_REST + 3 * k + c, vf_mul(basis[k], d->color[c]), input->lr_rest);
#undef SGSI_STEP
}

#include "optimize/kernel_accumulate.inl"

static inline void write_gradients(const sgsi_optimize *input, size_t block, const gradient16 *d)
{
    float *out = input->gradients + block * SGS_PARAM_COUNT * 16;
    vf basis[15];
    const int count = sh_basis(d->direction, input->view.sh_degree, basis);
    for (int k = 0; k < 15; ++k)
        for (int c = 0; c < 3; ++c)
            vf_store(out + 16 * (SGS_PARAM_SH_REST + 3 * k + c),
                     k < count ? vf_mul(basis[k], d->color[c]) : vf_zero());
    for (int c = 0; c < 3; ++c) {
        vf_store(out + 16 * (SGS_PARAM_SH_DC + c), vf_mul(vf_set1((float)SGSI_SH_C0), d->color[c]));
        vf_store(out + 16 * (SGS_PARAM_MEAN + c), d->mean[c]);
        vf_store(out + 16 * (SGS_PARAM_SCALE + c), d->scale[c]);
    }
    for (int k = 0; k < 4; ++k)
        vf_store(out + 16 * (SGS_PARAM_ROTATION + k), d->rotation[k]);
    vf_store(out + 16 * SGS_PARAM_OPACITY, d->opacity);
}

// Mask of the lanes whose gradients are all finite and within range.
static inline vm finite_rows(const gradient16 *d)
{
    vf sum = vf_abs(d->opacity);
    for (int k = 0; k < 3; ++k)
        sum = vf_add(sum,
                     vf_add(vf_abs(d->mean[k]), vf_add(vf_abs(d->scale[k]), vf_abs(d->color[k]))));
    for (int k = 0; k < 4; ++k)
        sum = vf_add(sum, vf_abs(d->rotation[k]));
    return vf_lt(sum, vf_set1(1e15f));
}

sgsi_optimize_counts SGSI_KERNEL(sgsi_optimize_blocks)(const sgsi_optimize *input, size_t begin,
                                                       size_t end)
{
    sgsi_optimize_counts counts = {0};
    for (size_t block = begin; block < end; ++block) {
        const unsigned visible = input->visible ? input->visible[block] : 0;
        const bool waits = input->accumulated_grad && (input->accumulated_rows[2 * block] ||
                                                       input->accumulated_rows[2 * block + 1]);
        if (!input->touched[block] && !input->dense && !input->gradients &&
            !(visible && input->apply) && !waits)
            continue;
        const size_t left = input->count - 16 * block;
        const vm present = vm_from_bits(left >= 16 ? 0xFFFFu : (1u << left) - 1u);
        vf sums[16];
        for (int i = 0; i < 16; ++i)
            sums[i] = input->touched[block]
                          ? vf_load(input->sums + (16 * block + (size_t)i) * SGSI_PROJECTED_FLOATS)
                          : vf_zero();
        vf_transpose16(sums);
        const float *p = input->params + block * SGS_PARAM_COUNT * 16;
        gaussian16 g;
        load_gaussian(p, block, &input->view, &g);
        gradient16 d;
        chain_rule(input, p, &g, sums, &d);
        if (input->opacity_loss > 0.0f || input->scale_loss > 0.0f)
            regularise(input, &g, &d);
        if (input->gradients) {
            write_gradients(input, block, &d);
            continue;
        }
        const vm finite = finite_rows(&d);
        const vm seen = vm_and(vf_gt(sums[SGSI_GRAD_SUM_WEIGHT], vf_zero()), present);
        counts.seen += (size_t)__builtin_popcount(vm_bits(seen));
        counts.broken += (size_t)__builtin_popcount(vm_bits(vm_andnot(seen, finite)));
        const vm counted = vm_and(seen, finite);
        if (input->gradient_sum) {
            const vf norm = vf_mul(transverse_norm(input, &g, &d), near_weight(input, &g));
            add_where(input->gradient_sum + 16 * block, counted, norm);
        }
        if (input->abs_grad_sum) {
            const vf norm = vf_mul(abs_grad_value(input, &g, sums), near_weight(input, &g));
            add_where(input->abs_grad_sum + 16 * block, counted, norm);
        }
        const vm sparse = vm_and(vm_or(seen, vm_from_bits(visible)), present);
        if (input->apply && input->accumulated_grad)
            step_accumulated(input, block, vm_and(finite, input->dense ? present : sparse), &d);
        else if (input->apply)
            step_block(input, block, vm_and(finite, input->dense ? present : sparse), &d);
    }
    return counts;
}
