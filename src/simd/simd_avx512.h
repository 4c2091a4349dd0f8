// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The sixteen lanes as one AVX-512 register. Included by simd.h only.

#include <immintrin.h>

#include "simd/simd_halves.h"

typedef __m512 vf;
typedef __m512i vi;
typedef __mmask16 vm;

static inline vf vf_load(const float *p)
{
    return _mm512_load_ps(p);
}
static inline vf vf_load_u(const float *p)
{
    return _mm512_loadu_ps(p);
}
static inline void vf_store(float *p, vf a)
{
    _mm512_store_ps(p, a);
}
static inline void vf_store_u(float *p, vf a)
{
    _mm512_storeu_ps(p, a);
}
static inline void vf_store_masked(float *p, vm m, vf a)
{
    _mm512_mask_storeu_ps(p, m, a);
}
static inline vf vf_set1(float a)
{
    return _mm512_set1_ps(a);
}
static inline vf vf_zero(void)
{
    return _mm512_setzero_ps();
}
static inline vf vf_add(vf a, vf b)
{
    return _mm512_add_ps(a, b);
}
static inline vf vf_sub(vf a, vf b)
{
    return _mm512_sub_ps(a, b);
}
static inline vf vf_mul(vf a, vf b)
{
    return _mm512_mul_ps(a, b);
}
static inline vf vf_div(vf a, vf b)
{
    return _mm512_div_ps(a, b);
}
static inline vf vf_sqrt(vf a)
{
    return _mm512_sqrt_ps(a);
}
static inline vf vf_fma(vf a, vf b, vf c)
{
    return _mm512_fmadd_ps(a, b, c);
} // a b + c
static inline vf vf_fnma(vf a, vf b, vf c)
{
    return _mm512_fnmadd_ps(a, b, c);
} // c - a b
static inline vf vf_fms(vf a, vf b, vf c)
{
    return _mm512_fmsub_ps(a, b, c);
} // a b - c
static inline vf vf_min(vf a, vf b)
{
    return _mm512_min_ps(a, b);
} // b when a lane of a or b is NaN
static inline vf vf_max(vf a, vf b)
{
    return _mm512_max_ps(a, b);
}

static inline vf vf_abs(vf a)
{
    return _mm512_abs_ps(a);
}

static inline vm vf_lt(vf a, vf b)
{
    return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ);
}
static inline vm vf_le(vf a, vf b)
{
    return _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ);
}
static inline vm vf_gt(vf a, vf b)
{
    return _mm512_cmp_ps_mask(a, b, _CMP_GT_OQ);
}
static inline vm vf_ge(vf a, vf b)
{
    return _mm512_cmp_ps_mask(a, b, _CMP_GE_OQ);
}
static inline vf vf_select(vm m, vf a, vf b)
{
    return _mm512_mask_blend_ps(m, b, a);
} // m ? a : b
static inline vf vf_keep(vm m, vf a)
{
    return _mm512_maskz_mov_ps(m, a);
} // m ? a : 0
static inline vm vm_and(vm a, vm b)
{
    return a & b;
}
static inline vm vm_or(vm a, vm b)
{
    return a | b;
}
static inline vm vm_andnot(vm a, vm b)
{
    return (vm)(a & ~b);
} // a and not b
static inline vm vm_not(vm a)
{
    return (vm)~a;
}
static inline vm vm_none(void)
{
    return 0;
}
static inline int vm_any(vm a)
{
    return a != 0;
}
static inline unsigned vm_bits(vm a)
{
    return a;
}
static inline vm vm_from_bits(unsigned bits)
{
    return (vm)bits;
}

static inline vi vi_load(const int32_t *p)
{
    return _mm512_load_si512(p);
}
static inline vi vi_load_u(const int32_t *p)
{
    return _mm512_loadu_si512(p);
}
static inline void vi_store(int32_t *p, vi a)
{
    _mm512_store_si512(p, a);
}
static inline vi vi_set1(int32_t a)
{
    return _mm512_set1_epi32(a);
}
static inline vi vi_add(vi a, vi b)
{
    return _mm512_add_epi32(a, b);
}
static inline vi vi_sub(vi a, vi b)
{
    return _mm512_sub_epi32(a, b);
}
#define vi_sll(a, n) _mm512_slli_epi32(a, n)
#define vi_sra(a, n) _mm512_srai_epi32(a, n)
static inline vf vi_as_vf(vi a)
{
    return _mm512_castsi512_ps(a);
}
static inline vi vf_as_vi(vf a)
{
    return _mm512_castps_si512(a);
}
static inline vf vi_to_vf(vi a)
{
    return _mm512_cvtepi32_ps(a);
}
static inline vi vf_to_vi(vf a)
{
    return _mm512_cvtps_epi32(a);
} // round to nearest even
// 16 bytes to 16 floats 0..255.
static inline vf vf_load_u8(const uint8_t *p)
{
    return _mm512_cvtepi32_ps(_mm512_cvtepu8_epi32(_mm_loadu_si128((const __m128i *)p)));
}

// table[i % 8]; table: 32-byte aligned.
static inline vi vi_lookup8(const int32_t table[8], vi i)
{
    const __m256i half = _mm256_load_si256((const __m256i *)table);
    return _mm512_permutexvar_epi32(i, _mm512_broadcast_i64x4(half));
}

// low < x <= high, for 0 <= low <= high. Non-negative floats have the order of their bits; negative
// numbers and NaN have larger bits as unsigned integers.
static inline vm vf_between(vf x, vf low, vf high)
{
    const __m512i top = _mm512_castps_si512(high);
    return _mm512_cmplt_epu32_mask(_mm512_sub_epi32(top, _mm512_castps_si512(x)),
                                   _mm512_sub_epi32(top, _mm512_castps_si512(low)));
}

static inline void vf_halves(vf x, vh halves[2])
{
    halves[0] = _mm512_castps512_ps256(x), halves[1] = _mm512_extractf32x8_ps(x, 1);
}
static inline vf vf_join(const vh halves[2])
{
    return _mm512_insertf32x8(_mm512_castps256_ps512(halves[0]), halves[1], 1);
}

// Transposes 16 rows of 16 lanes in place.
static inline void vf_transpose16(vf r[16])
{
    vf q[4][4];
    for (int g = 0; g < 4; ++g) {
        const vf a = _mm512_unpacklo_ps(r[4 * g], r[4 * g + 1]),
                 b = _mm512_unpackhi_ps(r[4 * g], r[4 * g + 1]);
        const vf c = _mm512_unpacklo_ps(r[4 * g + 2], r[4 * g + 3]),
                 d = _mm512_unpackhi_ps(r[4 * g + 2], r[4 * g + 3]);
        q[g][0] = _mm512_castpd_ps(_mm512_unpacklo_pd(_mm512_castps_pd(a), _mm512_castps_pd(c)));
        q[g][1] = _mm512_castpd_ps(_mm512_unpackhi_pd(_mm512_castps_pd(a), _mm512_castps_pd(c)));
        q[g][2] = _mm512_castpd_ps(_mm512_unpacklo_pd(_mm512_castps_pd(b), _mm512_castps_pd(d)));
        q[g][3] = _mm512_castpd_ps(_mm512_unpackhi_pd(_mm512_castps_pd(b), _mm512_castps_pd(d)));
    }
    for (int k = 0; k < 4; ++k) { // quarter L of q[g][k] is column 4 L + k of rows 4 g .. 4 g + 3
        const vf x0 = _mm512_shuffle_f32x4(q[0][k], q[1][k], 0x44),
                 x1 = _mm512_shuffle_f32x4(q[0][k], q[1][k], 0xEE);
        const vf y0 = _mm512_shuffle_f32x4(q[2][k], q[3][k], 0x44),
                 y1 = _mm512_shuffle_f32x4(q[2][k], q[3][k], 0xEE);
        r[k] = _mm512_shuffle_f32x4(x0, y0, 0x88);
        r[4 + k] = _mm512_shuffle_f32x4(x0, y0, 0xDD);
        r[8 + k] = _mm512_shuffle_f32x4(x1, y1, 0x88);
        r[12 + k] = _mm512_shuffle_f32x4(x1, y1, 0xDD);
    }
}

// Masked arithmetic: m ? a op b : a.
static inline vf vf_mul_where(vm m, vf a, vf b)
{
    return _mm512_mask_mul_ps(a, m, a, b);
}
static inline vf vf_add_where(vm m, vf a, vf b)
{
    return _mm512_mask_add_ps(a, m, a, b);
}
static inline vf vf_sub_where(vm m, vf a, vf b)
{
    return _mm512_mask_sub_ps(a, m, a, b);
}
static inline vf vf_min_where(vm m, vf a, vf b)
{
    return _mm512_mask_min_ps(a, m, a, b);
}

// Compresses the lanes of m to p and returns their number. May overwrite all sixteen words at p.
static inline unsigned vi_compress_store(int32_t *p, vm m, vi a)
{
    _mm512_storeu_si512(p, _mm512_maskz_compress_epi32(m, a));
    return (unsigned)__builtin_popcount(m);
}

// ranks[i] = position of keys[i] in ascending order, equal keys in the order of the array. keys and
// ranks have room for a multiple of 32 and are 64-byte aligned. least and most are the extremes of
// each 32 keys: chunks with disjoint ranges are not compared, so nearly sorted keys cost little
// more than their own chunks.
static inline void simd_rank(const int16_t *keys, uint16_t *ranks, uint32_t count,
                             const int16_t *least, const int16_t *most)
{
    const __m512i one = _mm512_set1_epi16(1);
    for (uint32_t c = 0; 32 * c < count; ++c) {
        const uint32_t begin = 32 * c, end = begin + 32 < count ? begin + 32 : count;
        const __m512i key = _mm512_load_si512(keys + begin);
        short in_front = 0;
        __m512i rank = _mm512_setzero_si512();
        for (uint32_t d = 0; d < c; ++d) {
            if (most[d] <= least[c]) {
                in_front += 32;
                continue;
            }
            for (uint32_t j = 32 * d; j < 32 * d + 32; ++j)
                rank = _mm512_mask_add_epi16(
                    rank, _mm512_cmple_epi16_mask(_mm512_set1_epi16(keys[j]), key), rank, one);
        }
        for (uint32_t j = begin; j < end; ++j) { // stable for equal keys
            const __m512i other = _mm512_set1_epi16(keys[j]);
            const __mmask32 later = (__mmask32)(0xFFFFFFFEu << (j - begin));
            const __mmask32 before =
                _mm512_cmplt_epi16_mask(other, key) | (_mm512_cmpeq_epi16_mask(other, key) & later);
            rank = _mm512_mask_add_epi16(rank, before, rank, one);
        }
        for (uint32_t d = c + 1; 32 * d < count; ++d) {
            if (least[d] >= most[c])
                continue;
            const uint32_t last = 32 * d + 32 < count ? 32 * d + 32 : count;
            for (uint32_t j = 32 * d; j < last; ++j)
                rank = _mm512_mask_add_epi16(
                    rank, _mm512_cmplt_epi16_mask(_mm512_set1_epi16(keys[j]), key), rank, one);
        }
        _mm512_store_si512(ranks + begin, _mm512_add_epi16(rank, _mm512_set1_epi16(in_front)));
    }
}

// The lanes converted to int16; every value must fit.
static inline void vi_store_i16(int16_t *p, vi a)
{
    _mm256_storeu_si256((__m256i *)p, _mm512_cvtepi32_epi16(a));
}
