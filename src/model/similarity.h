// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Similarity transforms of Gaussians: x -> scale R x + translation. SH are rotated too.

#include "sparegs/gaussians.h"

// exp(44)^2 is the largest square of a scale that float holds.
#define SGSI_MAX_LOG_SCALE 44.0f

typedef struct sgsi_similarity {
    double scale, log_scale;
    double quaternion[4], translation[3]; // w, x, y, z
    double rotation[3][3];
    // Rotation of the coefficients of degrees 1, 2, 3: new_i = sum_j sh[degree][i][j] old_j.
    double sh[4][7][7];
    bool rotates;
} sgsi_similarity;

// quaternion: w, x, y, z, of norm 1. Points are columns: R x.
void sgsi_rotation_matrix(const double quaternion[4], double rotation[3][3]);

// quaternion: w, x, y, z, of any positive norm. scale > 0.
sgsi_similarity sgsi_similarity_make(double scale, const double quaternion[4],
                                     const double translation[3]);
void sgsi_similarity_apply(const sgsi_similarity *similarity, float params[SGS_PARAM_COUNT]);
