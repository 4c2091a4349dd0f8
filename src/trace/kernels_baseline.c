// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Kernels for the baseline instruction set.

#define SGSI_ISA 0
#include "simd/simd.h"
#include "trace/kernel_table.inl"
