// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The probe of simd_probe.h, AVX-512.

#define SGSI_ISA 2
#include "simd/simd_probe.inl"
