// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Returns the kernel table of the selected instruction set.

#include "trace/kernels.h"

#include "simd/kernel_variants.h"

const sgsi_kernels *sgsi_kernels_get(void)
{
    static const sgsi_kernels *const kernels[SGS_ISA_COUNT] = SGSI_VARIANTS(&sgsi_kernels);
    return kernels[sgs_isa_get()];
}
