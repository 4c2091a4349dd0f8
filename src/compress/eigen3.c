// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Jacobi rotations for the eigenvalues of a symmetric 3x3 matrix; Shepperd's method for the
// quaternion of a rotation matrix (square roots and divisions only).

#include "compress/eigen3.h"

#include <math.h>
#include <string.h>

void sgsi_covariance3(const float rotation[4], const float scale[3], double covariance[6])
{
    const double length =
        sqrt((double)rotation[0] * rotation[0] + (double)rotation[1] * rotation[1] +
             (double)rotation[2] * rotation[2] + (double)rotation[3] * rotation[3]);
    const double factor = length > 0 ? 1 / length : 0;
    const double w = length > 0 ? rotation[0] * factor : 1, x = rotation[1] * factor,
                 y = rotation[2] * factor, z = rotation[3] * factor;
    const double r[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                            {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                            {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
    double variance[3];
    for (int k = 0; k < 3; ++k)
        variance[k] = exp(2 * (double)scale[k]);
    int at = 0;
    for (int i = 0; i < 3; ++i)
        for (int j = i; j < 3; ++j) {
            covariance[at] = 0;
            for (int k = 0; k < 3; ++k)
                covariance[at] += variance[k] * r[i][k] * r[j][k];
            ++at;
        }
}

// One Jacobi rotation that makes a[p][q] zero; accumulates the eigenvectors in the columns of v.
static void rotate(double a[3][3], double v[3][3], int p, int q)
{
    if (a[p][q] == 0)
        return;
    const double theta = (a[q][q] - a[p][p]) / (2 * a[p][q]);
    const double t = (theta >= 0 ? 1 : -1) / (fabs(theta) + sqrt(theta * theta + 1));
    const double c = 1 / sqrt(t * t + 1), s = t * c;
    for (int k = 0; k < 3; ++k) {
        const double x = a[k][p], y = a[k][q];
        a[k][p] = c * x - s * y;
        a[k][q] = s * x + c * y;
    }
    for (int k = 0; k < 3; ++k) {
        const double x = a[p][k], y = a[q][k];
        a[p][k] = c * x - s * y;
        a[q][k] = s * x + c * y;
    }
    for (int k = 0; k < 3; ++k) {
        const double x = v[k][p], y = v[k][q];
        v[k][p] = c * x - s * y;
        v[k][q] = s * x + c * y;
    }
}

// Unit quaternion (w x y z, w >= 0) of a rotation matrix, row-major.
static void quaternion_of(const double r[9], double q[4])
{
    const double trace = r[0] + r[4] + r[8];
    const double squares[4] = {1 + trace, 1 + 2 * r[0] - trace, 1 + 2 * r[4] - trace,
                               1 + 2 * r[8] - trace}; // 4 w^2, 4 x^2, 4 y^2, 4 z^2
    int largest = 0;
    for (int k = 1; k < 4; ++k)
        if (squares[k] > squares[largest])
            largest = k;
    const double half = 0.5 * sqrt(squares[largest]), scale = 0.25 / half;
    const double wx = r[7] - r[5], wy = r[2] - r[6], wz = r[3] - r[1]; // 4 w x, ...
    const double xy = r[1] + r[3], xz = r[2] + r[6], yz = r[5] + r[7];
    const double products[4][4] = {
        {0, wx, wy, wz}, {wx, 0, xy, xz}, {wy, xy, 0, yz}, {wz, xz, yz, 0}};
    for (int k = 0; k < 4; ++k)
        q[k] = k == largest ? half : products[largest][k] * scale;
    if (q[0] < 0)
        for (int k = 0; k < 4; ++k)
            q[k] = -q[k];
}

void sgsi_eigen3(const double covariance[6], double values[3], double quaternion[4])
{
    double a[3][3] = {{covariance[0], covariance[1], covariance[2]},
                      {covariance[1], covariance[3], covariance[4]},
                      {covariance[2], covariance[4], covariance[5]}};
    double v[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (int sweep = 0; sweep < 16; ++sweep) {
        rotate(a, v, 0, 1);
        rotate(a, v, 0, 2);
        rotate(a, v, 1, 2);
    }
    int order[3] = {0, 1, 2};
    for (int i = 0; i < 2; ++i)
        for (int j = 0; j < 2 - i; ++j)
            if (a[order[j]][order[j]] > a[order[j + 1]][order[j + 1]]) {
                const int swapped = order[j];
                order[j] = order[j + 1];
                order[j + 1] = swapped;
            }
    double r[9];
    for (int k = 0; k < 3; ++k) {
        values[k] = a[order[k]][order[k]];
        for (int i = 0; i < 3; ++i)
            r[3 * i + k] = v[i][order[k]];
    }
    const double determinant = r[0] * (r[4] * r[8] - r[5] * r[7]) -
                               r[1] * (r[3] * r[8] - r[5] * r[6]) +
                               r[2] * (r[3] * r[7] - r[4] * r[6]);
    for (int k = 0; k < 9 && determinant < 0; ++k)
        r[k] = -r[k];
    quaternion_of(r, quaternion);
}
