// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The kernel of k-means for AVX-512.

#ifdef SGSI_AVX_KERNELS
#define SGSI_ISA 2
#include "simd/simd.h"

#include "sog/palette_kernels.inl"
#endif
