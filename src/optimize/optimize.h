// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The optimiser step: from the gradient sums of a view through the chain rule and Adam to the
// stored parameters. Compiled once per instruction set from kernel_optimize.inl.

#include "trace/trace.h"

typedef struct sgsi_optimize {
    float *params, *m, *v; // model layout
    size_t count;
    sgsi_view view;
    const float *sums;      // [capacity][16]
    const uint8_t *touched; // [capacity / 16]: 0 = no sums for the block
    // [capacity / 16] or NULL: rows that the sparse optimiser steps in addition to those hit.
    const uint16_t *visible;
    bool dense; // step every row
    bool apply; // false: statistics only (3DGS does not step on densification iterations)
    float lr_mean, lr_rotation, lr_scale, lr_opacity, lr_dc, lr_rest;
    float beta1, beta2, epsilon;
    // 1 / (1 - beta1^t) and 1 / sqrt(1 - beta2^t); 1 without bias correction.
    float correction1, correction2;
    float *gradient_sum; // a_i of 3DGS, or NULL
    float *abs_grad_sum; // the same from SGSI_GRAD_SUM_ABS, or NULL
    bool abs_grad_norm;  // norm over both axes instead of their sum
    // Both sums weigh views by min(1, (depth / near_depth)^2), depth in world units; 0: all alike.
    float near_depth;
    float tan_half_x, tan_half_y; // tangents of half the fields of view
    // Added to the loss for every row, hit or not: opacity_loss * o + scale_loss * (s_x + s_y +
    // s_z), the regularisers of Kheradmand et al. 2024.
    float opacity_loss, scale_loss;
    // Gradients accumulated before a step. accumulated_grad is NULL if every iteration steps.
    float *accumulated_grad; // model layout
    // [capacity / 16][2]: rows seen since the last step of main and of rest.
    uint16_t *accumulated_rows;
    bool step_main, step_rest;
    float gradient_scale; // of the accumulated gradients, at a step
    float rest_correction1, rest_correction2;
    // [capacity][59] in model layout, or NULL: write dL/dparameter instead of stepping (tests).
    float *gradients;
} sgsi_optimize;

typedef struct sgsi_optimize_counts {
    size_t seen;   // rows with a counted hit
    size_t broken; // of these, rows whose gradient is not finite; they are not updated
} sgsi_optimize_counts;

// Steps blocks [begin, end) of 16 primitives. All counts are 0 if input->gradients is set.
sgsi_optimize_counts sgsi_optimize_blocks(const sgsi_optimize *input, size_t begin, size_t end);

sgsi_optimize_counts sgsi_optimize_blocks_baseline(const sgsi_optimize *input, size_t begin,
                                                   size_t end);
#ifdef SGSI_AVX_KERNELS
sgsi_optimize_counts sgsi_optimize_blocks_avx2(const sgsi_optimize *input, size_t begin,
                                               size_t end);
sgsi_optimize_counts sgsi_optimize_blocks_avx512(const sgsi_optimize *input, size_t begin,
                                                 size_t end);
#endif
