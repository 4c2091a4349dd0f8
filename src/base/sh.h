// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The constant of the first spherical harmonic, 1 / (2 sqrt(pi)): colour = 1/2 + SGSI_SH_C0 times
// the coefficient of degree 0. In kernels: (float)SGSI_SH_C0.

#define SGSI_SH_C0 0.28209479177387814
