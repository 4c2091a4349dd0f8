// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Half of the sixteen lanes as one AVX register, and sums over the lanes. A sum of products starts
// with the two halves: x = a b of the lower one, then fma(a, b, x) of the upper one, which makes
// the first addition free. Included by simd_avx2.h and simd_avx512.h.

typedef __m256 vh;

static inline vh vh_load(const float *p)
{
    return _mm256_load_ps(p);
}
static inline vh vh_zero(void)
{
    return _mm256_setzero_ps();
}
static inline vh vh_add(vh a, vh b)
{
    return _mm256_add_ps(a, b);
}
static inline vh vh_mul(vh a, vh b)
{
    return _mm256_mul_ps(a, b);
}
static inline vh vh_fma(vh a, vh b, vh c)
{
    return _mm256_fmadd_ps(a, b, c);
} // a b + c
static inline vh vh_fnma(vh a, vh b, vh c)
{
    return _mm256_fnmadd_ps(a, b, c);
} // c - a b

// Lane k of the result is the sum over the lanes of x[k]. Each step adds the upper to the lower
// parts of two vectors with one shuffle and one blend, because blends run on more ports than
// shuffles.
static inline vh vh_sum8(const vh x[8])
{
    vh b[4], c[2];
    for (int k = 0; k < 4; ++k) // 128-bit halves of x[k] and x[k + 4]
        b[k] = _mm256_add_ps(_mm256_permute2f128_ps(x[k], x[k + 4], 0x21),
                             _mm256_blend_ps(x[k], x[k + 4], 0xF0));
    for (int k = 0; k < 2; ++k) // pairs: each half holds 2k, 2k, 2k + 1, 2k + 1
        c[k] = _mm256_add_ps(_mm256_shuffle_ps(b[2 * k], b[2 * k + 1], 0x4E),
                             _mm256_blend_ps(b[2 * k], b[2 * k + 1], 0xCC));
    return _mm256_add_ps(_mm256_shuffle_ps(c[0], c[1], 0x88), _mm256_shuffle_ps(c[0], c[1], 0xDD));
}

// Adds the sum over the lanes of x[k] to row[k], by the tree of vf_sum.
static inline void vh_add_sums(float *row, const vh x[16])
{
    _mm256_store_ps(row, _mm256_add_ps(_mm256_load_ps(row), vh_sum8(x)));
    _mm256_store_ps(row + 8, _mm256_add_ps(_mm256_load_ps(row + 8), vh_sum8(x + 8)));
}
