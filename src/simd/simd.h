// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Sixteen virtual lanes: the operations in which every kernel is written once and compiled per
// instruction set. A translation unit defines SGSI_ISA (0 baseline, 1 AVX2+FMA, 2 AVX-512) before
// including this file. AVX2 and AVX-512 perform the same IEEE operations in the same order and give
// the same bits. The baseline has no fused multiply-add on x86-64 and rounds twice.
//
// vf: 16 floats; vh: 8 floats; vi: 16 int32; vm: 16 booleans. Loads and stores named _u accept any
// address, the others require 64-byte alignment.

#include <stdint.h>

#ifndef SGSI_ISA
#error "define SGSI_ISA before including simd.h"
#endif

#define SGSI_CONCAT2(a, b) a##b
#define SGSI_CONCAT(a, b) SGSI_CONCAT2(a, b)
#if SGSI_ISA == 2
#include "simd/simd_avx512.h"
#define SGSI_KERNEL(name) SGSI_CONCAT(name, _avx512)
#elif SGSI_ISA == 1
#include "simd/simd_avx2.h"
#define SGSI_KERNEL(name) SGSI_CONCAT(name, _avx2)
#else
#include "simd/simd_baseline.h"
#define SGSI_KERNEL(name) SGSI_CONCAT(name, _baseline)
#endif

// Everything below uses only the primitives of the three headers.

#ifdef SIMD_KEYS // AVX-512 has its own versions
#include "simd/simd_common.h"
#endif

// With few registers, code with many values works on one part of the lanes after the other. A vf of
// a part is valid in all operations on vf and vm, but only vf_store_part stores it, and vm_bits and
// sums over the lanes are undefined. p: the row of all sixteen lanes.
#ifndef SIMD_PARTS
#define SIMD_PARTS 1
static inline vf vf_load_part(const float *p, int part)
{
    (void)part;
    return vf_load(p);
}
static inline void vf_store_part(float *p, int part, vf x)
{
    (void)part;
    vf_store(p, x);
}
static inline vf vf_part(vf x, int part)
{
    (void)part;
    return x;
}
static inline vf vf_join_parts(const vf parts[SIMD_PARTS])
{
    return parts[0];
}
#endif

static inline vf vf_clamp(vf a, vf low, vf high)
{
    return vf_min(vf_max(a, low), high);
}

// Sum of the lower and the upper half.
static inline vh vf_fold(vf x)
{
    vh halves[2];
    vf_halves(x, halves);
    return vh_add(halves[0], halves[1]);
}

// Sum of the lanes by the fixed tree (i, i+8), (i, i+4), (i, i+2), (i, i+1), identical for every
// instruction set.
static inline float vf_sum(vf a)
{
    float x[16] __attribute__((aligned(64)));
    vf_store(x, a);
    for (int stride = 8; stride; stride /= 2)
        for (int i = 0; i < stride; ++i)
            x[i] += x[i + stride];
    return x[0];
}

// Smallest and largest of every 32 keys.
static inline void simd_extremes(const int16_t *keys, uint32_t count, int16_t *least, int16_t *most)
{
    for (uint32_t begin = 0; begin < count; begin += 32) {
        const uint32_t end = begin + 32 < count ? begin + 32 : count;
        int16_t low = INT16_MAX, high = INT16_MIN;
        for (uint32_t i = begin; i < end; ++i) {
            if (keys[i] < low)
                low = keys[i];
            if (keys[i] > high)
                high = keys[i];
        }
        least[begin / 32] = low;
        most[begin / 32] = high;
    }
}

// 2^x for x in [-120, 126], and 0 for -127. x is rounded to a multiple n + j/8; 2^(j/8) comes from
// a table, the rest from a minimax polynomial of degree 3 on [-1/16, 1/16]. Relative error below
// 1.2e-7 (measured by tests/simd/test_simd.c). The result for NaN is undefined.
static inline vf vf_exp2(vf x)
{
    // Bits of 2^(j/8) minus j 2^20, which the shifted multiple contributes.
    static const int32_t powers[8]
        __attribute__((aligned(32))) = {0x3F800000, 0x3F7B95C2, 0x3F7837F0, 0x3F75FED7,
                                        0x3F7504F3, 0x3F75672A, 0x3F7744FD, 0x3F7AC0C7};
    // Adding 1.5 2^20 rounds to a multiple of 1/8, which the low bits then count.
    const vf magic = vf_set1(1572864.0f), shifted = vf_add(x, magic);
    const vf r = vf_sub(x, vf_sub(shifted, magic));
    const vi eighths = vf_as_vi(shifted);
    const vf power = vi_as_vf(vi_add(vi_lookup8(powers, eighths), vi_sll(eighths, 20)));
    const vf q =
        vf_fma(vf_fma(vf_set1(5.5496223e-2f), r, vf_set1(0.24025764f)), r, vf_set1(0.69314718f));
    return vf_fma(power, vf_mul(q, r), power);
}

// Base-2 logarithm of a normal positive number: x = 2^n m with m in [sqrt(1/2), sqrt(2)), then f
// Q(f) with f = m - 1 and Q of degree 8, minimax in the relative error (2.7e-8). Error below 2.5e-7
// of the result or 1.2e-7 of n, whichever is larger (tests/simd/test_simd.c). Zero and subnormal
// numbers give -127 to -126.
static inline vf vf_log2(vf x)
{
    const int32_t root_half = 0x3F3504F3; // bits of sqrt(1/2)
    const vi n = vi_sra(vi_sub(vf_as_vi(x), vi_set1(root_half)), 23);
    const vf f = vf_sub(vi_as_vf(vi_sub(vf_as_vi(x), vi_sll(n, 23))), vf_set1(1.0f));
    // Estrin's scheme by powers of f^2: the dependency chain of Horner's scheme would be twice as
    // long.
    const vf f2 = vf_mul(f, f), f4 = vf_mul(f2, f2);
    const vf q0 = vf_fma(vf_set1(-7.21347332e-1f), f, vf_set1(1.44269502f));
    const vf q2 = vf_fma(vf_set1(-3.60703677e-1f), f, vf_set1(4.80910629e-1f));
    const vf q4 = vf_fma(vf_set1(-2.38944814e-1f), f, vf_set1(2.87916243e-1f));
    const vf q6 = vf_fma(vf_set1(-2.07269818e-1f), f, vf_set1(2.15715617e-1f));
    const vf high = vf_fma(vf_fma(vf_set1(1.25837058e-1f), f2, q6), f2, q4);
    const vf q = vf_fma(high, f4, vf_fma(q2, f2, q0));
    return vf_fma(q, f, vi_to_vf(n));
}

// e^x for x in [-83, 87]. The product with log2(e) is rounded and its rounding error added
// afterwards: relative error 2e-7 with fused multiply-add, otherwise 1.2e-7 (1 + |x|).
static inline vf vf_exp(vf x)
{
    const vf log2e = vf_set1(1.44269502f), log2e_rest = vf_set1(1.92596303e-8f);
    const vf product = vf_mul(x, log2e);
    const vf lost = vf_fma(x, log2e_rest, vf_fms(x, log2e, product));
    const vf y = vf_exp2(product);
    return vf_fma(y, vf_mul(lost, vf_set1(0.69314718f)), y);
}
