// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Returns the kernel table of the selected instruction set.

#include "trace/kernels.h"

#include "sparegs/runtime.h"

const sgsi_kernels *sgsi_kernels_get(void)
{
    switch (sgs_isa_get()) {
#ifdef SGSI_X86
    case SGS_ISA_AVX512:
        return &sgsi_kernels_avx512;
    case SGS_ISA_AVX2:
        return &sgsi_kernels_avx2;
#endif
    default:
        return &sgsi_kernels_baseline;
    }
}
