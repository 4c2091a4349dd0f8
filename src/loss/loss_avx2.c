// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The loss kernel for AVX2 and FMA.

#ifdef SGSI_AVX_KERNELS
#define SGSI_ISA 1
#include "simd/simd.h"

#include "loss/loss_kernels.inl"
#endif
