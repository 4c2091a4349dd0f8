// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Kernel table of one instruction set. Included by kernels_<isa>.c after simd.h.

#include "trace/kernels.h"
#include "base/radix.h"

#include <math.h>
#include <string.h>

#include "trace/kernel_gaussian.inl"
#include "trace/kernel_project.inl"
#include "trace/kernel_tile.inl"
#include "trace/kernel_sort.inl"
#include "trace/kernel_blend.inl"
#include "trace/kernel_score.inl"

const sgsi_kernels SGSI_KERNEL(sgsi_kernels) = {
#if SGSI_ISA == 2
    .name = "avx512",
#elif SGSI_ISA == 1
    .name = "avx2",
#else
    .name = "baseline",
#endif
    .project = project,
    .macrotile_filter = macrotile_filter,
    .tile_take = tile_take,
    .tile_sort = tile_sort,
    .tile_forward = tile_forward,
    .tile_backward = tile_backward,
    .tile_backward_abs_grad = tile_backward_abs_grad,
    .tile_score = tile_score,
};
