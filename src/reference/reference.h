// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Shared part of the reference renderer: a model as one camera sees it, and the hits of one ray.
// reference_render.c builds the view and blends; reference_backward.c computes gradients through
// both. Written for clarity, not for speed; only the tests may depend on it.

#include <stdbool.h>

#include "sparegs/render.h"

enum { SGSI_SH_COUNT = 16 }; // SH basis functions of the bands 0..3

// One Gaussian from one camera centre c. Stages of the variances: stored, + 3D filter, + pixel
// filter.
typedef struct sgsi_reference_primitive {
    // Unit (w,x,y,z), and the norm of the stored quaternion; norm 0 means identity.
    double quaternion[4], quaternion_norm;
    double rotation[9];      // R, row-major: its columns are the axes in world space
    double variance[3];      // s^2
    double variance_3d[3];   // s'^2  = s^2 + f3^2   (f3 = 0 unless `mip`)
    double variance_view[3]; // s''^2 = s'^2 + eps^2 (eps = 0 for `none`)
    double opacity_stored;   // o = sigmoid(logit)
    double opacity;          // o'' = o times the filter's factors
    // From c to the mean: length and unit vector (0 if they coincide).
    double distance, direction[3];
    double depth, d_depth[3];    // z of the filters and its gradient with respect to the mean
    double matrix[9], offset[3]; // M = S''^-1 R^T row-major, p = M (c - mean)
    int sh_used;                 // basis functions of the degree in use
    double basis[SGSI_SH_COUNT]; // SH basis at `direction`, 0 from sh_used on
    double color[3];             // max(0, sum + 0.5)
    bool color_clamped[3];
} sgsi_reference_primitive;

typedef struct sgsi_reference_view {
    const sgs_camera *camera;
    const sgs_pose *pose;
    double center[3]; // c, world
    double near_distance;
    double filter_scale; // eps^2 = filter_scale z^2
    bool mip, axis_depth;
    size_t count;
    sgsi_reference_primitive *primitives; // [count], owned
} sgsi_reference_view;

// Validates the arguments and activates every primitive for the camera. Camera and pose must
// outlive the view. On failure view->primitives is NULL.
sgs_status sgsi_reference_view_create(const double *params, size_t count, const sgs_camera *camera,
                                      const sgs_pose *pose, const sgs_render_options *options,
                                      sgsi_reference_view *view);
void sgsi_reference_view_free(sgsi_reference_view *view);

// Unit direction, in world space, of the ray through the centre of pixel (x, y); false when the
// pixel has no ray.
bool sgsi_reference_ray(const sgsi_reference_view *view, int x, int y, double direction[3]);

// rho^2 and t of one primitive on the ray c + t direction. NaN for a degenerate primitive.
void sgsi_reference_response(const sgsi_reference_primitive *primitive, const double direction[3],
                             double *rho_squared, double *t);

// Shortest axis in world space (the first of equal ones), turned towards the camera centre.
void sgsi_reference_normal(const sgsi_reference_primitive *primitive, double normal[3]);

// Counted hits of a ray in blending order; `hits` has room for view->count. Returns their number.
size_t sgsi_reference_trace(const sgsi_reference_view *view, const double direction[3],
                            sgs_hit *hits);

// Determinant of the marginal of a Gaussian on the plane across a direction with components a in
// its own frame: prod(v) * sum(a_k^2 / v_k), without divisions. d_marginal: derivatives with
// respect to v, may be NULL.
double sgsi_reference_marginal(const double a[3], const double v[3], double d_marginal[3]);
