// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The covariance of a deformed Gaussian is B B^T with B = A R diag(s). The left singular vectors of
// B are its axes, the singular values its scales. One-sided Jacobi rotations (Hestenes 1958) make
// the columns of B orthogonal. Unlike the eigenvalues of B B^T, they keep the smallest scale of a
// flat Gaussian, which may be 1e-13 of the others (Demmel and Veselic 1992).

#include "model/affine.h"

#include <math.h>
#include <string.h>

#include "sparegs/camera.h"

// A lower limit, for scales of 0: without length, axes have no direction. exp(-104) is 0 in float.
static const double MIN_LOG_SCALE = -104.0;

static double dot_columns(const double a[3][3], int i, int j)
{
    return a[0][i] * a[0][j] + a[1][i] * a[1][j] + a[2][i] * a[2][j];
}

static void rotate_columns(double a[3][3], int i, int j, double cosine, double sine)
{
    for (int k = 0; k < 3; ++k) {
        const double x = a[k][i], y = a[k][j];
        a[k][i] = cosine * x - sine * y;
        a[k][j] = sine * x + cosine * y;
    }
}

// Makes the columns of b orthogonal: b becomes b v. v may be NULL.
static void orthogonalize(double b[3][3], double v[3][3])
{
    enum { SWEEPS = 30 };
    bool rotated = true;
    for (int sweep = 0; sweep < SWEEPS && rotated; ++sweep) {
        rotated = false;
        for (int i = 0; i < 2; ++i)
            for (int j = i + 1; j < 3; ++j) {
                const double left = dot_columns(b, i, i), right = dot_columns(b, j, j),
                             product = dot_columns(b, i, j);
                if (!(fabs(product) > 1e-15 * sqrt(left) * sqrt(right)))
                    continue;
                const double zeta = (right - left) / (2.0 * product),
                             tangent = copysign(1.0, zeta) / (fabs(zeta) + hypot(1.0, zeta)),
                             cosine = 1.0 / hypot(1.0, tangent);
                rotate_columns(b, i, j, cosine, cosine * tangent);
                if (v)
                    rotate_columns(v, i, j, cosine, cosine * tangent);
                rotated = true;
            }
    }
}

static double determinant(const double a[3][3])
{
    return a[0][0] * (a[1][1] * a[2][2] - a[1][2] * a[2][1]) -
           a[0][1] * (a[1][0] * a[2][2] - a[1][2] * a[2][0]) +
           a[0][2] * (a[1][0] * a[2][1] - a[1][1] * a[2][0]);
}

static bool is_similarity(const double a[3][3], double square)
{
    bool is = true;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            is = is && fabs(dot_columns(a, i, j) - (i == j ? square : 0.0)) < 2e-3 * square;
    return is;
}

// The orthogonal factor U V^T of A = U diag(s) V^T. False if A is singular.
static bool polar_rotation(const double a[3][3], double rotation[3][3])
{
    double u[3][3], v[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, scales[3];
    memcpy(u, a, sizeof u);
    orthogonalize(u, v);
    for (int k = 0; k < 3; ++k)
        scales[k] = sqrt(dot_columns(u, k, k));
    const double least = fmin(scales[0], fmin(scales[1], scales[2])),
                 most = fmax(scales[0], fmax(scales[1], scales[2]));
    memset(rotation, 0, 9 * sizeof **rotation);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 3; ++k)
                rotation[i][j] += u[i][k] / scales[k] * v[j][k];
    return least > 1e-12 * most;
}

bool sgsi_affine_make(const double matrix[3][3], const double translation[3], sgsi_affine *affine)
{
    static const double none[3];
    const double volume = determinant(matrix), sign = volume < 0.0 ? -1.0 : 1.0,
                 scale = cbrt(fabs(volume)), square = scale * scale;
    double turned[3][3], rotation[3][3], quaternion[4];
    sgs_pose pose = {0};
    bool valid = isfinite(square) && square > 0.0;
    for (int k = 0; k < 3; ++k)
        valid = valid && isfinite(translation[k]);
    *affine = (sgsi_affine){.mirrored = volume < 0.0};
    memcpy(affine->matrix, matrix, sizeof affine->matrix);
    memcpy(affine->translation, translation, sizeof affine->translation);
    affine->deforms = valid && !is_similarity(matrix, square);
    for (int k = 0; k < 9; ++k)
        turned[k / 3][k % 3] = sign * matrix[k / 3][k % 3];
    if (!valid || !polar_rotation((const double(*)[3])turned, rotation))
        return false;
    memcpy(pose.rotation, rotation, sizeof pose.rotation);
    sgs_pose_quaternion(&pose, quaternion);
    affine->similarity = affine->deforms ? sgsi_similarity_make(1.0, quaternion, none)
                                         : sgsi_similarity_make(scale, quaternion, translation);
    return true;
}

// x -> -x: the functions of odd degrees change their signs.
static void mirror(float params[SGS_PARAM_COUNT])
{
    for (int k = 0; k < 3; ++k)
        params[SGS_PARAM_MEAN + k] = 0.0f - params[SGS_PARAM_MEAN + k];
    for (int k = 0; k < 3 * 15; ++k)
        if (k < 3 * 3 || k >= 3 * 8)
            params[SGS_PARAM_SH_REST + k] = 0.0f - params[SGS_PARAM_SH_REST + k];
}

// R diag(s) of the stored rotation and log scales.
static void read_axes(const float rotation[4], const float log_scales[3], double axes[3][3])
{
    double q[4], norm = 0.0;
    for (int k = 0; k < 4; ++k)
        norm += (double)rotation[k] * (double)rotation[k];
    norm = sqrt(norm);
    for (int k = 0; k < 4; ++k) // the zero quaternion is no rotation
        q[k] = norm == 0.0 ? (double)(k == 0) : (double)rotation[k] / norm;
    sgsi_rotation_matrix(q, axes);
    for (int k = 0; k < 3; ++k) {
        const double given = (double)log_scales[k];
        // Not fmax, which would make a valid scale of NaN.
        const double scale = exp(given < MIN_LOG_SCALE ? MIN_LOG_SCALE : given);
        for (int i = 0; i < 3; ++i)
            axes[i][k] *= scale;
    }
}

// The stored rotation and log scales of a Gaussian whose axes are the columns of b, which are
// orthogonal. The shortest one follows from the others, so that the axes are right-handed.
static void write_axes(const double b[3][3], float rotation[4], float log_scales[3])
{
    double scales[3], quaternion[4];
    sgs_pose pose = {0};
    for (int k = 0; k < 3; ++k) {
        scales[k] = sqrt(dot_columns(b, k, k));
        log_scales[k] = (float)log(scales[k]);
        for (int i = 0; i < 3; ++i)
            pose.rotation[3 * i + k] = b[i][k] / scales[k];
    }
    const int shortest = scales[0] < scales[1] ? (scales[0] < scales[2] ? 0 : 2)
                                               : (scales[1] < scales[2] ? 1 : 2),
              p = (shortest + 1) % 3, q = (shortest + 2) % 3;
    for (int i = 0; i < 3; ++i) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;
        pose.rotation[3 * i + shortest] = pose.rotation[3 * j + p] * pose.rotation[3 * k + q] -
                                          pose.rotation[3 * k + p] * pose.rotation[3 * j + q];
    }
    sgs_pose_quaternion(&pose, quaternion);
    for (int k = 0; k < 4; ++k)
        rotation[k] = (float)quaternion[k];
}

// B = A R diag(s)
static void transform_axes(const sgsi_affine *a, const float *old, double b[3][3])
{
    double axes[3][3];
    read_axes(old + SGS_PARAM_ROTATION, old + SGS_PARAM_SCALE, axes);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            b[i][j] = a->matrix[i][0] * axes[0][j] + a->matrix[i][1] * axes[1][j] +
                      a->matrix[i][2] * axes[2][j];
}

// Mean, rotation and scales; `old` holds those before the transform.
static void deform(const sgsi_affine *a, const float *old, float params[SGS_PARAM_COUNT])
{
    double b[3][3];
    const float *mean = old + SGS_PARAM_MEAN;
    for (int i = 0; i < 3; ++i) {
        const double *row = a->matrix[i];
        params[SGS_PARAM_MEAN + i] = (float)(row[0] * (double)mean[0] + row[1] * (double)mean[1] +
                                             row[2] * (double)mean[2] + a->translation[i]);
    }
    transform_axes(a, old, b);
    orthogonalize(b, NULL);
    write_axes((const double(*)[3])b, params + SGS_PARAM_ROTATION, params + SGS_PARAM_SCALE);
}

static bool is_unrotated(const float q[4])
{
    return q[0] == 0.0f && q[1] == 0.0f && q[2] == 0.0f && q[3] == 0.0f;
}

// Readers drop zero quaternions, or replace them by the identity after the transform. For the
// latter, the scales are the standard deviations along the axes of the world.
static void keep_unrotated(const sgsi_affine *a, const float *old, float params[SGS_PARAM_COUNT])
{
    double b[3][3];
    transform_axes(a, old, b);
    for (int k = 0; k < 4; ++k)
        params[SGS_PARAM_ROTATION + k] = 0.0f;
    for (int i = 0; i < 3; ++i)
        params[SGS_PARAM_SCALE + i] =
            (float)(0.5 * log(b[i][0] * b[i][0] + b[i][1] * b[i][1] + b[i][2] * b[i][2]));
}

void sgsi_affine_apply(const sgsi_affine *affine, float params[SGS_PARAM_COUNT])
{
    float old[SGS_PARAM_SCALE + 3];
    memcpy(old, params, sizeof old);
    if (affine->mirrored)
        mirror(params);
    sgsi_similarity_apply(&affine->similarity, params);
    if (affine->deforms)
        deform(affine, old, params);
    if (is_unrotated(old + SGS_PARAM_ROTATION) && (affine->deforms || affine->similarity.rotates))
        keep_unrotated(affine, old, params);
}
