// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Optimiser step for AVX2.

#ifdef SGSI_X86
#define SGSI_ISA 1
#include "simd/simd.h"
#include "optimize/kernel_optimize.inl"
#endif
