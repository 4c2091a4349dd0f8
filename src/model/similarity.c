// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Rotated SH: f'(d) = f(R^-1 d) is in the span of the same 2 l + 1 functions, so their coefficients
// follow from the values at 2 l + 1 directions: Y(d_i) c' = Y(R^-1 d_i) c for all i.

#include "model/similarity.h"

#include <math.h>
#include <string.h>

enum { MAX_SIZE = 7 };

// Real SH of one degree in the order and with the signs of 3DGS, without the factors that all
// functions of a degree share.
static void basis(int degree, const double d[3], double y[MAX_SIZE])
{
    const double a = d[0], b = d[1], c = d[2];
    if (degree == 1) {
        y[0] = -b;
        y[1] = c;
        y[2] = -a;
    } else if (degree == 2) {
        y[0] = sqrt(3.0) * a * b;
        y[1] = -sqrt(3.0) * b * c;
        y[2] = 0.5 * (2.0 * c * c - a * a - b * b);
        y[3] = -sqrt(3.0) * a * c;
        y[4] = 0.5 * sqrt(3.0) * (a * a - b * b);
    } else {
        y[0] = -sqrt(5.0 / 8.0) * b * (3.0 * a * a - b * b);
        y[1] = sqrt(15.0) * a * b * c;
        y[2] = -sqrt(3.0 / 8.0) * b * (4.0 * c * c - a * a - b * b);
        y[3] = 0.5 * c * (2.0 * c * c - 3.0 * a * a - 3.0 * b * b);
        y[4] = -sqrt(3.0 / 8.0) * a * (4.0 * c * c - a * a - b * b);
        y[5] = 0.5 * sqrt(15.0) * c * (a * a - b * b);
        y[6] = -sqrt(5.0 / 8.0) * a * (a * a - 3.0 * b * b);
    }
}

// Directions in general position. Their angles must not be symmetric about the middle one: odd
// functions would be dependent.
static void direction(int i, int count, double d[3])
{
    const double z = 1.0 - (2.0 * i + 1.0) / count, radius = sqrt(1.0 - z * z),
                 angle = 0.9 * i * i + 0.3;
    d[0] = radius * cos(angle);
    d[1] = radius * sin(angle);
    d[2] = z;
}

// Solves left x = right for `size` right sides by Gauss-Jordan elimination; right becomes x.
static void solve(int size, double left[MAX_SIZE][MAX_SIZE], double right[MAX_SIZE][MAX_SIZE])
{
    for (int column = 0; column < size; ++column) {
        int pivot = column;
        for (int row = column + 1; row < size; ++row)
            if (fabs(left[row][column]) > fabs(left[pivot][column]))
                pivot = row;
        for (int k = 0; k < size; ++k) {
            const double a = left[column][k], b = right[column][k];
            left[column][k] = left[pivot][k];
            right[column][k] = right[pivot][k];
            left[pivot][k] = a;
            right[pivot][k] = b;
        }
        const double inverse = 1.0 / left[column][column];
        for (int k = 0; k < size; ++k) {
            left[column][k] *= inverse;
            right[column][k] *= inverse;
        }
        for (int row = 0; row < size; ++row) {
            const double factor = left[row][column];
            for (int k = 0; row != column && k < size; ++k) {
                left[row][k] -= factor * left[column][k];
                right[row][k] -= factor * right[column][k];
            }
        }
    }
}

static void rotate_sh(const double rotation[3][3], double sh[4][MAX_SIZE][MAX_SIZE])
{
    for (int degree = 1; degree <= 3; ++degree) {
        const int size = 2 * degree + 1;
        double left[MAX_SIZE][MAX_SIZE];
        for (int i = 0; i < size; ++i) {
            double d[3], turned[3]; // R^-1 d
            direction(i, size, d);
            for (int k = 0; k < 3; ++k)
                turned[k] = rotation[0][k] * d[0] + rotation[1][k] * d[1] + rotation[2][k] * d[2];
            basis(degree, d, left[i]);
            basis(degree, turned, sh[degree][i]);
        }
        solve(size, left, sh[degree]);
    }
}

void sgsi_rotation_matrix(const double quaternion[4], double rotation[3][3])
{
    const double w = quaternion[0], x = quaternion[1], y = quaternion[2], z = quaternion[3];
    const double rows[3][3] = {
        {1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)},
        {2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)},
        {2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)}};
    memcpy(rotation, rows, sizeof rows);
}

sgsi_similarity sgsi_similarity_make(double scale, const double quaternion[4],
                                     const double translation[3])
{
    sgsi_similarity s = {.scale = scale, .log_scale = log(scale)};
    // Scaled by a power of two, which is exact, so that no square overflows or vanishes.
    double largest = 0.0, norm = 0.0;
    int exponent;
    for (int k = 0; k < 4; ++k)
        largest = fmax(largest, fabs(quaternion[k]));
    frexp(largest, &exponent);
    for (int k = 0; k < 4; ++k) {
        s.quaternion[k] = ldexp(quaternion[k], -exponent);
        norm += s.quaternion[k] * s.quaternion[k];
    }
    norm = sqrt(norm);
    for (int k = 0; k < 4; ++k)
        s.quaternion[k] /= norm;
    memcpy(s.translation, translation, sizeof s.translation);
    sgsi_rotation_matrix(s.quaternion, s.rotation);
    s.rotates = s.quaternion[1] != 0.0 || s.quaternion[2] != 0.0 || s.quaternion[3] != 0.0;
    rotate_sh((const double(*)[3])s.rotation, s.sh);
    return s;
}

static void apply_rotation(const sgsi_similarity *s, float params[SGS_PARAM_COUNT])
{
    const double *p = s->quaternion;
    float *q = params + SGS_PARAM_ROTATION;
    const double x = (double)q[1], y = (double)q[2], z = (double)q[3];
    const bool is_zero = q[0] == 0.0f && q[1] == 0.0f && q[2] == 0.0f && q[3] == 0.0f;
    const double w = is_zero ? 1.0 : (double)q[0]; // the zero quaternion is no rotation
    q[0] = (float)(p[0] * w - p[1] * x - p[2] * y - p[3] * z);
    q[1] = (float)(p[0] * x + p[1] * w + p[2] * z - p[3] * y);
    q[2] = (float)(p[0] * y - p[1] * z + p[2] * w + p[3] * x);
    q[3] = (float)(p[0] * z + p[1] * y - p[2] * x + p[3] * w);
    for (int degree = 1, first = 0; degree <= 3; first += 2 * degree + 1, ++degree) {
        const int size = 2 * degree + 1;
        for (int channel = 0; channel < 3; ++channel) {
            float *values = params + SGS_PARAM_SH_REST + 3 * first + channel;
            double old[MAX_SIZE];
            for (int j = 0; j < size; ++j)
                old[j] = (double)values[3 * j];
            for (int i = 0; i < size; ++i) {
                double sum = 0.0;
                for (int j = 0; j < size; ++j)
                    sum += s->sh[degree][i][j] * old[j];
                values[3 * i] = (float)sum;
            }
        }
    }
}

void sgsi_similarity_apply(const sgsi_similarity *s, float params[SGS_PARAM_COUNT])
{
    float *mean = params + SGS_PARAM_MEAN;
    const double old[3] = {(double)mean[0], (double)mean[1], (double)mean[2]};
    for (int k = 0; k < 3; ++k) {
        mean[k] = (float)(s->scale * (s->rotation[k][0] * old[0] + s->rotation[k][1] * old[1] +
                                      s->rotation[k][2] * old[2]) +
                          s->translation[k]);
        if (s->scale != 1.0)
            params[SGS_PARAM_SCALE + k] =
                (float)((double)params[SGS_PARAM_SCALE + k] + s->log_scale);
    }
    if (s->rotates)
        apply_rotation(s, params);
}
