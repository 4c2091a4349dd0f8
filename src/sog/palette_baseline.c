// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The kernel of k-means in portable C.

#define SGSI_ISA 0
#include "simd/simd.h"

#include "sog/palette_kernels.inl"
