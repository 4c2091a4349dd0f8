// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The kernel template for baseline.

#define SGSI_ISA 0
#include "simd/simd.h"
#include "trace/kernel_table.inl"
