// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The convolution kernel of LPIPS in portable C.

#define SGSI_ISA 0
#include "simd/simd.h"

#include "image/lpips_kernels.inl"
