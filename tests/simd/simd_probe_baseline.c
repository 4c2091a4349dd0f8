// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The probe of simd_probe.h, portable.

#define SGSI_ISA 0
#include "simd/simd_probe.inl"
