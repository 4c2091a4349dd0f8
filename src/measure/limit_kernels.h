// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Loops that each saturate one resource of a core. Compiled once per instruction set from
// limit_kernels.inl.

#include <stddef.h>

enum { SGSI_LIMIT_CHAINS = 12 }; // independent multiply-add chains of 16 lanes

typedef struct sgsi_limit_kernels {
    // Computes rounds * SGSI_LIMIT_CHAINS * 16 multiply-adds: x <- x * factor + term, `rounds`
    // times, from each of start [SGSI_LIMIT_CHAINS][16]. out [16] receives the sums over the
    // chains. Both arrays are 64-byte aligned.
    void (*multiply_add)(size_t rounds, const float *start, float factor, float term, float *out);
    // Reads all data. floats: a multiple of 128; data: 64-byte aligned. out [16] receives the sum.
    void (*read)(const float *data, size_t floats, float *out);
    // Reads and writes all data, in place.
    void (*update)(float *data, size_t floats);
} sgsi_limit_kernels;

// Those of the current instruction set.
const sgsi_limit_kernels *sgsi_limit_kernels_get(void);

extern const sgsi_limit_kernels sgsi_limit_kernels_baseline;
#ifdef SGSI_AVX_KERNELS
extern const sgsi_limit_kernels sgsi_limit_kernels_avx2;
extern const sgsi_limit_kernels sgsi_limit_kernels_avx512;
#endif
