// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Discrete Fourier transforms of complex lines of any length in double precision, by KissFFT.

#include <stddef.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct sgsi_fourier sgsi_fourier;

// A plan for lines of `length` >= 1 numbers; NULL when out of memory. Plans are read-only: threads
// may share one.
sgsi_fourier *sgsi_fourier_create(int length);
void sgsi_fourier_destroy(sgsi_fourier *plan); // accepts NULL

// Size of the scratch of a transform, in doubles.
size_t sgsi_fourier_scratch(const sgsi_fourier *plan);

// Forward transform in place, unscaled: line [length][2] (real, imaginary).
void sgsi_fourier_transform(const sgsi_fourier *plan, double *line, double *scratch);

#ifdef __cplusplus
}
#endif
