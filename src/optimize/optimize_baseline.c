// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Optimiser step for the baseline instruction set.

#define SGSI_ISA 0
#include "simd/simd.h"
#include "optimize/kernel_optimize.inl"
