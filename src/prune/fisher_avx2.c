// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The kernel of the Fisher matrices for AVX2.

#ifdef SGSI_X86
#define SGSI_ISA 1
#include "simd/simd.h"

#include "prune/fisher_kernel.inl"
#endif
