// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The kernel of vector quantisation in portable C.

#define SGSI_ISA 0
#include "simd/simd.h"

#include "compress/vq_kernel.inl"
