// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Loops that do nothing but reach one limit of a core, compiled per instruction set from
// limit_kernels.inl.

#include <stddef.h>

enum { SGSI_LIMIT_CHAINS = 12 }; // independent chains of multiply-adds of 16 lanes

typedef struct sgsi_limit_kernels {
    // rounds * SGSI_LIMIT_CHAINS * 16 multiply-adds. out [16], 64-byte aligned.
    void (*multiply_add)(size_t rounds, float *out);
    // Reads all; floats is a multiple of 128, data 64-byte aligned. The sum goes to out [16].
    void (*read)(const float *data, size_t floats, float *out);
    // Reads and writes all, in place.
    void (*update)(float *data, size_t floats);
} sgsi_limit_kernels;

extern const sgsi_limit_kernels sgsi_limit_kernels_baseline;
#ifdef SGSI_X86
extern const sgsi_limit_kernels sgsi_limit_kernels_avx2;
extern const sgsi_limit_kernels sgsi_limit_kernels_avx512;
#endif
