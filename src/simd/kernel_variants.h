// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The compiled variants of a kernel as a table, for callers that select one by sgs_isa_get.

#include "sparegs/runtime.h"

// Initialiser of an array [SGS_ISA_COUNT] with the variants of SGSI_KERNEL(name). Sets that this
// processor family lacks are NULL; sgs_isa_get never returns them.
#ifdef SGSI_AVX_KERNELS
#define SGSI_VARIANTS(name)                                                                        \
    {                                                                                              \
        [SGS_ISA_BASELINE] = name##_baseline, [SGS_ISA_AVX2] = name##_avx2,                        \
        [SGS_ISA_AVX512] = name##_avx512                                                           \
    }
#else
#define SGSI_VARIANTS(name)                                                                        \
    {                                                                                              \
        [SGS_ISA_BASELINE] = name##_baseline                                                       \
    }
#endif
