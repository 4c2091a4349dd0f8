// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "rays/rotation.h"

double sgsi_determinant(const double m[9], double cofactors[9])
{
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            const int a = (i + 1) % 3, b = (i + 2) % 3, c = (j + 1) % 3, d = (j + 2) % 3;
            cofactors[3 * i + j] = m[3 * a + c] * m[3 * b + d] - m[3 * a + d] * m[3 * b + c];
        }
    }
    return m[0] * cofactors[0] + m[1] * cofactors[1] + m[2] * cofactors[2];
}

// Newton iteration of the polar decomposition (Higham 1986): m <- (m + m^-T) / 2.
void sgsi_nearest_rotation(double m[9])
{
    double cofactors[9];
    for (int step = 0; step < 5; ++step) {
        const double det = sgsi_determinant(m, cofactors);
        for (int i = 0; i < 9; ++i)
            m[i] = 0.5 * (m[i] + cofactors[i] / det);
    }
}
