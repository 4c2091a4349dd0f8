// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The limit loops for portable C.

#define SGSI_ISA 0
#include "simd.h"

#include "limit_kernels.h"
#include "limit_kernels.inl"
