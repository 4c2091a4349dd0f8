// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The probe of simd_probe.h, AVX2 + FMA.

#define SGSI_ISA 1
#include "simd/simd_probe.inl"
