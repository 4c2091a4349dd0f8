// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The kernel of the Fisher matrices for AVX2.

#ifdef SGSI_AVX_KERNELS
#define SGSI_ISA 1
#include "simd/simd.h"

#include "prune/fisher_kernel.inl"
#endif
