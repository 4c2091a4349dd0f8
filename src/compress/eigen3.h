// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Covariance of a Gaussian from its stored rotation and scales, and back: eigenvalues and the
// rotation of the eigenvectors of a symmetric 3x3 matrix. Order of the entries: xx xy xz yy yz zz.

// rotation: quaternion w x y z of any length; scale: logs.
void sgsi_covariance3(const float rotation[4], const float scale[3], double covariance[6]);

// Eigenvalues in ascending order and the unit quaternion (w x y z, w >= 0) of the rotation whose
// columns are the eigenvectors.
void sgsi_eigen3(const double covariance[6], double values[3], double quaternion[4]);
