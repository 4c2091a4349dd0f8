// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The kernel of k-means for AVX2 and FMA.

#ifdef SGSI_AVX_KERNELS
#define SGSI_ISA 1
#include "simd/simd.h"

#include "sog/palette_kernels.inl"
#endif
