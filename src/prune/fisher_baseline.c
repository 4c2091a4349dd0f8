// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The kernel of the Fisher matrices for every processor.

#define SGSI_ISA 0
#include "simd/simd.h"

#include "prune/fisher_kernel.inl"
