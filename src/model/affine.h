// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Affine transforms of Gaussians, x -> A x + translation: with a scale that is not uniform, a shear
// or a mirror. The covariance C becomes A C A^T.

#include <stdbool.h>

#include "model/similarity.h"

typedef struct sgsi_affine {
    double matrix[3][3], translation[3];
    bool mirrored; // the points change their signs before the rest of the transform
    bool deforms;  // no similarity, even with the mirror
    // The transform after the mirror, with the nearest rotation; if it deforms, the rotation alone.
    sgsi_similarity similarity;
} sgsi_affine;

// False if A is singular or a value is not finite. Scales that differ by less than 0.1 % are equal.
bool sgsi_affine_make(const double matrix[3][3], const double translation[3], sgsi_affine *affine);
// SH are rotated by the orthogonal factor of the polar decomposition of A: for A = R S, a scale and
// then a rotation, by R, as KHR_gaussian_splatting prescribes. Without deformation, that is exact.
// A zero quaternion stays zero, and the scales become the standard deviations along the axes.
void sgsi_affine_apply(const sgsi_affine *affine, float params[SGS_PARAM_COUNT]);
