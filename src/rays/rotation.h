// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// 3x3 matrices, row-major.

// Determinant of m, and its cofactors: m^-1 = cofactors^T / determinant. Cannot fail.
double sgsi_determinant(const double m[9], double cofactors[9]);

// Replaces m, which differs from a rotation by a few percent at most, by the nearest rotation in
// the Frobenius norm. Cannot fail.
void sgsi_nearest_rotation(double m[9]);
