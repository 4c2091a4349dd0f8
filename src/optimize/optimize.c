// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Dispatches the optimiser step to the selected instruction set.

#include "optimize/optimize.h"

#include "simd/kernel_variants.h"

static sgsi_optimize_counts (*const kernels[SGS_ISA_COUNT])(const sgsi_optimize *, size_t, size_t) =
    SGSI_VARIANTS(sgsi_optimize_blocks);

sgsi_optimize_counts sgsi_optimize_blocks(const sgsi_optimize *input, size_t begin, size_t end)
{
    return kernels[sgs_isa_get()](input, begin, end);
}
