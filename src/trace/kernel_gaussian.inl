// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Sixteen Gaussians in a view: activations, filtered scales and the frame of trace.h. Shared by
// projection and chain rule, so that both use the same numbers.

#include "base/sh.h"

typedef struct vec3 {
    vf x, y, z;
} vec3;

static inline vf dot3(vec3 a, vec3 b)
{
    return vf_fma(a.z, b.z, vf_fma(a.y, b.y, vf_mul(a.x, b.x)));
}

static inline vec3 scale3(vec3 a, vf s)
{
    return (vec3){vf_mul(a.x, s), vf_mul(a.y, s), vf_mul(a.z, s)};
}

static inline vec3 add_scaled3(vec3 a, vec3 b, vf s) // a + b s
{
    return (vec3){vf_fma(b.x, s, a.x), vf_fma(b.y, s, a.y), vf_fma(b.z, s, a.z)};
}

static inline vec3 rotate3(const float r[9], vec3 a) // row-major matrix times vector
{
    const vec3 rows[3] = {{vf_set1(r[0]), vf_set1(r[1]), vf_set1(r[2])},
                          {vf_set1(r[3]), vf_set1(r[4]), vf_set1(r[5])},
                          {vf_set1(r[6]), vf_set1(r[7]), vf_set1(r[8])}};
    return (vec3){dot3(rows[0], a), dot3(rows[1], a), dot3(rows[2], a)};
}

static inline vec3 rotate3_back(const float r[9], vec3 a) // transposed matrix times vector
{
    const float back[9] = {r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8]};
    return rotate3(back, a);
}

typedef struct gaussian16 {
    vec3 delta_world; // mean - camera centre
    vec3 delta;       // the same in camera axes
    vf distance;      // |delta|
    vf depth;         // z of delta, or |delta| for fisheye lenses; scales the pixel filter
    vf quaternion[4]; // unit
    vf inv_norm;      // 1 / |stored quaternion|, 0 for a zero quaternion
    vec3 axis[3];     // columns of the rotation, camera axes
    vec3 scale;       // s
    vec3 body;        // sqrt(s^2 + f3^2) with the mip filter, else s
    vec3 filtered;    // s': body dilated by the pixel filter
    vec3 inv_filtered;
    vf opacity;        // as traced
    vf opacity_stored; // of the parameter; differs with the mip filter only
    vf transparency;   // 1 - opacity_stored
    vec3 q1, q2, q3;   // rows of the rotation that puts M delta on the third axis
    vf p;              // P = |M delta|
} gaussian16;

static inline void load_rotation(const float *p, gaussian16 *g, const float world_to_camera[9])
{
    vf w = vf_load(p + 16 * (SGS_PARAM_ROTATION + 0)),
       x = vf_load(p + 16 * (SGS_PARAM_ROTATION + 1));
    vf y = vf_load(p + 16 * (SGS_PARAM_ROTATION + 2)),
       z = vf_load(p + 16 * (SGS_PARAM_ROTATION + 3));
    const vf norm2 = vf_fma(w, w, vf_fma(x, x, vf_fma(y, y, vf_mul(z, z))));
    const vm usable = vf_gt(norm2, vf_set1(1e-30f)); // a zero quaternion is the identity
    g->inv_norm = vf_keep(usable, vf_div(vf_set1(1.0f), vf_sqrt(vf_max(norm2, vf_set1(1e-30f)))));
    w = vf_select(usable, vf_mul(w, g->inv_norm), vf_set1(1.0f));
    x = vf_mul(x, g->inv_norm);
    y = vf_mul(y, g->inv_norm);
    z = vf_mul(z, g->inv_norm);
    g->quaternion[0] = w, g->quaternion[1] = x, g->quaternion[2] = y, g->quaternion[3] = z;
    const vf two = vf_set1(2.0f), one = vf_set1(1.0f);
    const vf xx = vf_mul(x, x), yy = vf_mul(y, y), zz = vf_mul(z, z);
    const vec3 c0 = {vf_fnma(two, vf_add(yy, zz), one), vf_mul(two, vf_fma(x, y, vf_mul(w, z))),
                     vf_mul(two, vf_fms(x, z, vf_mul(w, y)))};
    const vec3 c1 = {vf_mul(two, vf_fms(x, y, vf_mul(w, z))), vf_fnma(two, vf_add(xx, zz), one),
                     vf_mul(two, vf_fma(y, z, vf_mul(w, x)))};
    const vec3 c2 = {vf_mul(two, vf_fma(x, z, vf_mul(w, y))),
                     vf_mul(two, vf_fms(y, z, vf_mul(w, x))), vf_fnma(two, vf_add(xx, yy), one)};
    g->axis[0] = rotate3(world_to_camera, c0);
    g->axis[1] = rotate3(world_to_camera, c1);
    g->axis[2] = rotate3(world_to_camera, c2);
}

static inline void swap_where(vm m, vf *a, vf *b)
{
    const vf old = *a;
    *a = vf_select(m, *b, old);
    *b = vf_select(m, old, *b);
}

// q1 and q2 orthogonal to the unit vector q3 (Duff et al., "Building an Orthonormal Basis,
// Revisited", 2017). The largest component of q3 takes the role of z. The components of q1 and q2
// along it are then those of q3 across it, without cancellation; a thin disc multiplies them by the
// inverse of its thickness.
static inline void complete_basis(gaussian16 *g)
{
    vec3 n = g->q3;
    const vf x = vf_abs(n.x), y = vf_abs(n.y), z = vf_abs(n.z);
    const vm first = vm_and(vf_gt(x, y), vf_gt(x, z)), second = vm_andnot(vf_gt(y, z), first);
    swap_where(first, &n.x, &n.z);
    swap_where(second, &n.y, &n.z);
    const vf one = vf_set1(1.0f);
    const vf sign = vf_select(vf_ge(n.z, vf_zero()), one, vf_set1(-1.0f));
    const vf a = vf_div(vf_set1(-1.0f), vf_add(sign, n.z));
    const vf b = vf_mul(vf_mul(n.x, n.y), a);
    g->q1 = (vec3){vf_fma(vf_mul(sign, vf_mul(n.x, n.x)), a, one), vf_mul(sign, b),
                   vf_sub(vf_zero(), vf_mul(sign, n.x))};
    g->q2 = (vec3){b, vf_fma(vf_mul(n.y, n.y), a, sign), vf_sub(vf_zero(), n.y)};
    swap_where(first, &g->q1.x, &g->q1.z);
    swap_where(first, &g->q2.x, &g->q2.z);
    swap_where(second, &g->q1.y, &g->q1.z);
    swap_where(second, &g->q2.y, &g->q2.z);
}

static inline vec3 divide3(vec3 a, vec3 b)
{
    return (vec3){vf_div(a.x, b.x), vf_div(a.y, b.y), vf_div(a.z, b.z)};
}

static inline vf widen1(vf scale, vf variance)
{
    return vf_sqrt(vf_fma(scale, scale, variance));
}

// Unit vector towards the mean, in the primitive's axes.
static inline vec3 sight(const gaussian16 *g)
{
    const vf inv_distance = vf_div(vf_set1(1.0f), g->distance);
    return (vec3){vf_mul(dot3(g->axis[0], g->delta), inv_distance),
                  vf_mul(dot3(g->axis[1], g->delta), inv_distance),
                  vf_mul(dot3(g->axis[2], g->delta), inv_distance)};
}

// Mip-Splatting's opacity factors. 3D filter: product of s / body. Pixel filter: ratio of the
// marginals across the line of sight a, sqrt(D(body^2) / D(filtered^2)) with D(v) = v_x v_y v_z
// (sum of a_k^2 / v_k).
static inline vf mip_factor(const gaussian16 *g)
{
    const vec3 a = sight(g), kept = divide3(g->scale, g->filtered);
    const vec3 before = divide3(a, g->body), after = divide3(a, g->filtered);
    const vf ratio = vf_div(dot3(before, before), vf_max(dot3(after, after), vf_set1(1e-37f)));
    return vf_mul(vf_mul(kept.x, vf_mul(kept.y, kept.z)), vf_sqrt(ratio));
}

// Coordinate k of the means minus that of the camera centre, world axes.
static inline vf from_center(const float *p, const sgsi_view *view, int k)
{
    return vf_sub(vf_sub(vf_load(p + 16 * (SGS_PARAM_MEAN + k)), vf_set1(view->center[k])),
                  vf_set1(view->center_low[k]));
}

// Loads block number `block` of 16 primitives; p: its parameters (model layout).
static inline void load_gaussian(const float *p, size_t block, const sgsi_view *view, gaussian16 *g)
{
    g->delta_world =
        (vec3){from_center(p, view, 0), from_center(p, view, 1), from_center(p, view, 2)};
    g->delta = rotate3(view->rotation, g->delta_world);
    g->distance = vf_max(vf_sqrt(dot3(g->delta, g->delta)), vf_set1(1e-12f));
    g->depth = view->rays->fisheye ? g->distance : g->delta.z;
    load_rotation(p, g, view->rotation);
    const vf low = vf_set1(-40.0f), high = vf_set1(40.0f);
    g->scale = (vec3){vf_exp(vf_clamp(vf_load(p + 16 * SGS_PARAM_SCALE), low, high)),
                      vf_exp(vf_clamp(vf_load(p + 16 * (SGS_PARAM_SCALE + 1)), low, high)),
                      vf_exp(vf_clamp(vf_load(p + 16 * (SGS_PARAM_SCALE + 2)), low, high))};
    const vf eps2 = vf_mul(vf_set1(view->dilation), vf_mul(g->depth, g->depth));
    g->body = g->scale;
    if (view->filter_3d) {
        const vf f3 = vf_load(view->filter_3d + 16 * block), variance = vf_mul(f3, f3);
        g->body = (vec3){widen1(g->scale.x, variance), widen1(g->scale.y, variance),
                         widen1(g->scale.z, variance)};
    }
    g->filtered = (vec3){widen1(g->body.x, eps2), widen1(g->body.y, eps2), widen1(g->body.z, eps2)};
    const vf flat = vf_mul(g->distance, vf_set1(1e-15f)); // keeps P^2 finite
    g->filtered = (vec3){vf_max(g->filtered.x, flat), vf_max(g->filtered.y, flat),
                         vf_max(g->filtered.z, flat)};
    const vf one = vf_set1(1.0f);
    g->inv_filtered =
        (vec3){vf_div(one, g->filtered.x), vf_div(one, g->filtered.y), vf_div(one, g->filtered.z)};
    const vf logit = vf_clamp(vf_load(p + 16 * SGS_PARAM_OPACITY), low, high);
    if (view->linear_opacity) {
        g->opacity_stored = vf_abs(logit);
        g->transparency = vf_sub(one, g->opacity_stored);
    } else { // 1 - 1 / (1 + e) cancels for large logits, e / (1 + e) does not
        const vf e = vf_exp(vf_sub(vf_zero(), logit));
        g->opacity_stored = vf_div(one, vf_add(one, e));
        g->transparency = vf_mul(e, g->opacity_stored);
    }
    g->opacity = view->mip ? vf_mul(g->opacity_stored, mip_factor(g)) : g->opacity_stored;
    const vec3 m_delta = {vf_mul(dot3(g->axis[0], g->delta), g->inv_filtered.x),
                          vf_mul(dot3(g->axis[1], g->delta), g->inv_filtered.y),
                          vf_mul(dot3(g->axis[2], g->delta), g->inv_filtered.z)};
    g->p = vf_max(vf_sqrt(dot3(m_delta, m_delta)), vf_set1(1e-12f));
    g->q3 = scale3(m_delta, vf_div(one, g->p));
    complete_basis(g);
}

// Row q of the frame times M, times `factor`: sum over k of q_k / s'_k axis_k.
static inline vec3 frame_row(const gaussian16 *g, vec3 q, vf factor)
{
    const vf x = vf_mul(vf_mul(q.x, g->inv_filtered.x), factor),
             y = vf_mul(vf_mul(q.y, g->inv_filtered.y), factor);
    const vf z = vf_mul(vf_mul(q.z, g->inv_filtered.z), factor);
    return add_scaled3(add_scaled3(scale3(g->axis[0], x), g->axis[1], y), g->axis[2], z);
}

// Real spherical harmonics of 3DGS (Kerbl et al. 2023; the signs of its released code), without the
// coefficient-free band 0.
static inline int sh_basis(vec3 d, int degree, vf basis[15])
{
    if (degree < 1)
        return 0;
    basis[0] = vf_mul(vf_set1(-0.4886025119029199f), d.y);
    basis[1] = vf_mul(vf_set1(0.4886025119029199f), d.z);
    basis[2] = vf_mul(vf_set1(-0.4886025119029199f), d.x);
    if (degree < 2)
        return 3;
    const vf xx = vf_mul(d.x, d.x), yy = vf_mul(d.y, d.y), zz = vf_mul(d.z, d.z);
    const vf xy = vf_mul(d.x, d.y), yz = vf_mul(d.y, d.z), xz = vf_mul(d.x, d.z);
    const vf two_zz = vf_sub(vf_sub(vf_add(zz, zz), xx), yy);
    basis[3] = vf_mul(vf_set1(1.0925484305920792f), xy);
    basis[4] = vf_mul(vf_set1(-1.0925484305920792f), yz);
    basis[5] = vf_mul(vf_set1(0.31539156525252005f), two_zz);
    basis[6] = vf_mul(vf_set1(-1.0925484305920792f), xz);
    basis[7] = vf_mul(vf_set1(0.5462742152960396f), vf_sub(xx, yy));
    if (degree < 3)
        return 8;
    const vf three = vf_set1(3.0f), four = vf_set1(4.0f);
    const vf four_zz = vf_sub(vf_fms(four, zz, xx), yy);
    basis[8] = vf_mul(vf_mul(vf_set1(-0.5900435899266435f), d.y), vf_fms(three, xx, yy));
    basis[9] = vf_mul(vf_mul(vf_set1(2.890611442640554f), xy), d.z);
    basis[10] = vf_mul(vf_mul(vf_set1(-0.4570457994644658f), d.y), four_zz);
    basis[11] = vf_mul(vf_mul(vf_set1(0.3731763325901154f), d.z),
                       vf_sub(vf_sub(vf_add(zz, zz), vf_mul(three, xx)), vf_mul(three, yy)));
    basis[12] = vf_mul(vf_mul(vf_set1(-0.4570457994644658f), d.x), four_zz);
    basis[13] = vf_mul(vf_mul(vf_set1(1.445305721320277f), d.z), vf_sub(xx, yy));
    basis[14] = vf_mul(vf_mul(vf_set1(-0.5900435899266435f), d.x), vf_fnma(three, yy, xx));
    return 15;
}

// Unclamped colours: band 0 + 0.5 + the bands up to `degree` in direction d (unit, world).
static inline void sh_colors(const float *p, vec3 d, int degree, vf color[3])
{
    vf basis[15];
    const int count = sh_basis(d, degree, basis);
    for (int c = 0; c < 3; ++c)
        color[c] = vf_fma(vf_set1((float)SGSI_SH_C0), vf_load(p + 16 * (SGS_PARAM_SH_DC + c)),
                          vf_set1(0.5f));
    for (int k = 0; k < count; ++k)
        for (int c = 0; c < 3; ++c)
            color[c] =
                vf_fma(basis[k], vf_load(p + 16 * (SGS_PARAM_SH_REST + 3 * k + c)), color[c]);
}
