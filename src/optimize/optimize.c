// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Dispatches the optimiser step to the selected instruction set.

#include "optimize/optimize.h"

#include "sparegs/runtime.h"

sgsi_optimize_counts sgsi_optimize_blocks(const sgsi_optimize *input, size_t begin, size_t end)
{
    switch (sgs_isa_get()) {
#ifdef SGSI_X86
    case SGS_ISA_AVX512:
        return sgsi_optimize_blocks_avx512(input, begin, end);
    case SGS_ISA_AVX2:
        return sgsi_optimize_blocks_avx2(input, begin, end);
#endif
    default:
        return sgsi_optimize_blocks_baseline(input, begin, end);
    }
}
