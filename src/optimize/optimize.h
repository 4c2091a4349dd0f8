// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The optimiser step: from the gradient sums of a view to the gradients of the stored parameters
// and through Adam, fused, compiled once per instruction set from kernel_optimize.inl.

#include "trace/trace.h"

typedef struct sgsi_optimize {
    float *params, *m, *v; // model layout
    size_t count;
    sgsi_view view;
    const float *sums;       // [capacity][16]
    const uint8_t *touched;  // [capacity / 16]: 0 = no sums there
    const uint16_t *visible; // [capacity / 16]: bits of the rows the sparse optimiser steps besides
                             // those hit; may be NULL
    bool dense;              // update every row
    bool apply; // false: statistics only (3DGS makes no step on densification iterations)
    float lr_mean, lr_rotation, lr_scale, lr_opacity, lr_dc, lr_rest;
    float beta1, beta2, epsilon;
    float correction1,
        correction2;     // 1 / (1 - beta1^t), 1 / sqrt(1 - beta2^t); 1 without bias correction
    float *gradient_sum; // a_i, or NULL
    float *abs_grad_sum; // the same from SGSI_GRAD_SUM_ABS, or NULL
    bool abs_grad_norm;  // the 2-norm over both axes instead of the sum
    float tan_half_x, tan_half_y;
    // Gradients that add up before a step; accumulated_grad is NULL where every iteration steps.
    float *accumulated_grad;    // model layout
    uint16_t *accumulated_rows; // [capacity / 16][2]: rows seen since the last step of main, rest
    bool step_main, step_rest;
    float rest_correction1, rest_correction2;
    float *gradients; // [capacity][59] in model layout, or NULL: writes dL/dparameter instead of
                      // stepping (tests)
} sgsi_optimize;

// Steps blocks [begin, end) of 16 primitives with the chosen instruction set. Returns the number of
// rows whose gradient was not finite; those rows are left alone.
size_t sgsi_optimize_blocks(const sgsi_optimize *input, size_t begin, size_t end);

size_t sgsi_optimize_blocks_baseline(const sgsi_optimize *input, size_t begin, size_t end);
#ifdef SGSI_X86
size_t sgsi_optimize_blocks_avx2(const sgsi_optimize *input, size_t begin, size_t end);
size_t sgsi_optimize_blocks_avx512(const sgsi_optimize *input, size_t begin, size_t end);
#endif
