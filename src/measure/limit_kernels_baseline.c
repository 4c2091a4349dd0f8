// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The limit loops for portable C.

#define SGSI_ISA 0
#include "simd/simd.h"

#include "measure/limit_kernels.h"
#include "measure/limit_kernels.inl"
