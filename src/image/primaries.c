// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// RGB to XYZ as SMPTE RP 177: the columns are the XYZ of the primaries, scaled so that their sum is
// the white point. White points are matched by Bradford's cone responses (K. M. Lam, 1985; as in
// ICC.1 annex E): XYZ -> B^-1 diag(B white' / B white) B XYZ.

#include "image/primaries.h"

#include <math.h>

const float sgsi_rec709[SGSI_CHROMATICITIES] = {0.64f, 0.33f, 0.30f,   0.60f,
                                                0.15f, 0.06f, 0.3127f, 0.3290f};

static const double TOLERANCE = 1e-3;
static const double MIN_DETERMINANT = 1e-6;
static const double MAX_ENTRY = 1e3; // of a matrix between colour spaces in use: 3

static const double bradford[3][3] = {
    {0.8951, 0.2664, -0.1614}, {-0.7502, 1.7135, 0.0367}, {0.0389, -0.0685, 1.0296}};

bool sgsi_primaries_are_equal(const float a[SGSI_CHROMATICITIES],
                              const float b[SGSI_CHROMATICITIES])
{
    for (int k = 0; k < SGSI_CHROMATICITIES; ++k)
        if (!(fabs((double)a[k] - (double)b[k]) <= TOLERANCE))
            return false;
    return true;
}

bool sgsi_primaries_are_rec709(const float chromaticities[SGSI_CHROMATICITIES])
{
    return sgsi_primaries_are_equal(chromaticities, sgsi_rec709);
}

static void multiply(const double a[3][3], const double b[3][3], double product[3][3])
{
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            product[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
}

static void apply(const double m[3][3], const double v[3], double out[3])
{
    for (int i = 0; i < 3; ++i)
        out[i] = m[i][0] * v[0] + m[i][1] * v[1] + m[i][2] * v[2];
}

static bool invert(const double m[3][3], double inverse[3][3])
{
    double determinant = 0.0;
    for (int i = 0; i < 3; ++i) {
        const int a = (i + 1) % 3, b = (i + 2) % 3;
        for (int j = 0; j < 3; ++j) {
            const int c = (j + 1) % 3, d = (j + 2) % 3;
            inverse[j][i] = m[a][c] * m[b][d] - m[a][d] * m[b][c];
        }
        determinant += m[0][i] * (m[1][a] * m[2][b] - m[1][b] * m[2][a]);
    }
    for (int i = 0; i < 9; ++i)
        inverse[i / 3][i % 3] /= determinant;
    return fabs(determinant) > MIN_DETERMINANT; // false for NaN
}

// *white: XYZ of the white point.
static bool rgb_to_xyz(const float c[SGSI_CHROMATICITIES], double matrix[3][3], double white[3])
{
    double primaries[3][3], inverse[3][3], scale[3];
    for (int k = 0; k < 3; ++k) {
        primaries[0][k] = (double)c[2 * k];
        primaries[1][k] = (double)c[2 * k + 1];
        primaries[2][k] = 1.0 - (double)c[2 * k] - (double)c[2 * k + 1];
    }
    white[0] = (double)c[6] / (double)c[7];
    white[1] = 1.0;
    white[2] = (1.0 - (double)c[6] - (double)c[7]) / (double)c[7];
    if (!invert(primaries, inverse))
        return false;
    apply(inverse, white, scale);
    for (int i = 0; i < 3; ++i)
        for (int k = 0; k < 3; ++k)
            matrix[i][k] = primaries[i][k] * scale[k];
    return true;
}

bool sgsi_primaries_to_rec709(const float chromaticities[SGSI_CHROMATICITIES], double matrix[3][3])
{
    double from[3][3], to[3][3], from_white[3], to_white[3], from_cones[3], to_cones[3],
        from_xyz[3][3], back[3][3], adapted[3][3], xyz[3][3];
    if (!rgb_to_xyz(chromaticities, from, from_white) || !rgb_to_xyz(sgsi_rec709, to, to_white) ||
        !invert(to, from_xyz) || !invert(bradford, back))
        return false;
    apply(bradford, from_white, from_cones);
    apply(bradford, to_white, to_cones);
    multiply(bradford, from, adapted);
    for (int i = 0; i < 9; ++i)
        adapted[i / 3][i % 3] *= to_cones[i / 3] / from_cones[i / 3];
    multiply(back, adapted, xyz);
    multiply(from_xyz, xyz, matrix);
    for (int i = 0; i < 9; ++i)
        if (!(fabs(matrix[i / 3][i % 3]) <= MAX_ENTRY))
            return false;
    return true;
}
