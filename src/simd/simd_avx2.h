// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The sixteen lanes as two AVX registers. Included by simd.h only.

#include <immintrin.h>

#include "simd/simd_halves.h"

#define SIMD_KEYS 16 // sort keys per comparison

typedef struct vf {
    __m256 a, b;
} vf;
typedef struct vi {
    __m256i a, b;
} vi;
typedef struct vm {
    __m256 a, b;
} vm;

#define SGSI_V1(type, name, intrinsic)                                                             \
    static inline type name(type x)                                                                \
    {                                                                                              \
        return (type){intrinsic(x.a), intrinsic(x.b)};                                             \
    }
#define SGSI_V2(name, intrinsic)                                                                   \
    static inline vf name(vf x, vf y)                                                              \
    {                                                                                              \
        return (vf){intrinsic(x.a, y.a), intrinsic(x.b, y.b)};                                     \
    }
#define SGSI_V3(name, intrinsic)                                                                   \
    static inline vf name(vf x, vf y, vf z)                                                        \
    {                                                                                              \
        return (vf){intrinsic(x.a, y.a, z.a), intrinsic(x.b, y.b, z.b)};                           \
    }
#define SGSI_COMPARE(name, predicate)                                                              \
    static inline vm name(vf x, vf y)                                                              \
    {                                                                                              \
        return (vm){_mm256_cmp_ps(x.a, y.a, predicate), _mm256_cmp_ps(x.b, y.b, predicate)};       \
    }

static inline vf vf_load(const float *p)
{
    return (vf){_mm256_load_ps(p), _mm256_load_ps(p + 8)};
}
static inline vf vf_load_u(const float *p)
{
    return (vf){_mm256_loadu_ps(p), _mm256_loadu_ps(p + 8)};
}
static inline void vf_store(float *p, vf x)
{
    _mm256_store_ps(p, x.a), _mm256_store_ps(p + 8, x.b);
}
static inline void vf_store_u(float *p, vf x)
{
    _mm256_storeu_ps(p, x.a), _mm256_storeu_ps(p + 8, x.b);
}
static inline void vf_store_masked(float *p, vm m, vf x)
{
    _mm256_maskstore_ps(p, _mm256_castps_si256(m.a), x.a);
    _mm256_maskstore_ps(p + 8, _mm256_castps_si256(m.b), x.b);
}
static inline vf vf_set1(float x)
{
    return (vf){_mm256_set1_ps(x), _mm256_set1_ps(x)};
}
static inline vf vf_zero(void)
{
    return (vf){_mm256_setzero_ps(), _mm256_setzero_ps()};
}
SGSI_V2(vf_add, _mm256_add_ps)
SGSI_V2(vf_sub, _mm256_sub_ps)
SGSI_V2(vf_mul, _mm256_mul_ps)
SGSI_V2(vf_div, _mm256_div_ps)
SGSI_V2(vf_min, _mm256_min_ps)
SGSI_V2(vf_max, _mm256_max_ps)
SGSI_V1(vf, vf_sqrt, _mm256_sqrt_ps)
SGSI_V3(vf_fma, _mm256_fmadd_ps)
SGSI_V3(vf_fnma, _mm256_fnmadd_ps)
SGSI_V3(vf_fms, _mm256_fmsub_ps)
static inline vf vf_abs(vf x)
{
    const __m256 sign = _mm256_set1_ps(-0.0f);
    return (vf){_mm256_andnot_ps(sign, x.a), _mm256_andnot_ps(sign, x.b)};
}
SGSI_COMPARE(vf_lt, _CMP_LT_OQ)
SGSI_COMPARE(vf_le, _CMP_LE_OQ)
SGSI_COMPARE(vf_gt, _CMP_GT_OQ)
SGSI_COMPARE(vf_ge, _CMP_GE_OQ)

static inline vf vf_select(vm m, vf x, vf y)
{
    return (vf){_mm256_blendv_ps(y.a, x.a, m.a), _mm256_blendv_ps(y.b, x.b, m.b)};
}
static inline vf vf_keep(vm m, vf x)
{
    return (vf){_mm256_and_ps(m.a, x.a), _mm256_and_ps(m.b, x.b)};
}
static inline vm vm_and(vm x, vm y)
{
    return (vm){_mm256_and_ps(x.a, y.a), _mm256_and_ps(x.b, y.b)};
}
static inline vm vm_or(vm x, vm y)
{
    return (vm){_mm256_or_ps(x.a, y.a), _mm256_or_ps(x.b, y.b)};
}
static inline vm vm_andnot(vm x, vm y)
{
    return (vm){_mm256_andnot_ps(y.a, x.a), _mm256_andnot_ps(y.b, x.b)};
}
static inline vm vm_none(void)
{
    return (vm){_mm256_setzero_ps(), _mm256_setzero_ps()};
}
static inline vm vm_not(vm x)
{
    const __m256 ones = _mm256_castsi256_ps(_mm256_set1_epi32(-1));
    return (vm){_mm256_xor_ps(x.a, ones), _mm256_xor_ps(x.b, ones)};
}
static inline unsigned vm_bits(vm x)
{
    return (unsigned)_mm256_movemask_ps(x.a) | (unsigned)_mm256_movemask_ps(x.b) << 8;
}
static inline int vm_any(vm x)
{
    return _mm256_movemask_ps(_mm256_or_ps(x.a, x.b)) != 0;
}
static inline vm vm_from_bits(unsigned bits)
{
    const __m256i lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
    const __m256i low = _mm256_and_si256(_mm256_set1_epi32((int)bits), lane);
    const __m256i high = _mm256_and_si256(_mm256_set1_epi32((int)(bits >> 8)), lane);
    return (vm){_mm256_castsi256_ps(_mm256_cmpeq_epi32(low, lane)),
                _mm256_castsi256_ps(_mm256_cmpeq_epi32(high, lane))};
}

static inline vi vi_load(const int32_t *p)
{
    return (vi){_mm256_load_si256((const __m256i *)p), _mm256_load_si256((const __m256i *)(p + 8))};
}
static inline vi vi_load_u(const int32_t *p)
{
    return (vi){_mm256_loadu_si256((const __m256i *)p),
                _mm256_loadu_si256((const __m256i *)(p + 8))};
}
static inline void vi_store(int32_t *p, vi x)
{
    _mm256_store_si256((__m256i *)p, x.a);
    _mm256_store_si256((__m256i *)(p + 8), x.b);
}
static inline vi vi_set1(int32_t x)
{
    return (vi){_mm256_set1_epi32(x), _mm256_set1_epi32(x)};
}
static inline vi vi_add(vi x, vi y)
{
    return (vi){_mm256_add_epi32(x.a, y.a), _mm256_add_epi32(x.b, y.b)};
}
static inline vi vi_sub(vi x, vi y)
{
    return (vi){_mm256_sub_epi32(x.a, y.a), _mm256_sub_epi32(x.b, y.b)};
}
static inline vi vi_sll(vi x, int n)
{
    return (vi){_mm256_slli_epi32(x.a, n), _mm256_slli_epi32(x.b, n)};
}
static inline vi vi_sra(vi x, int n)
{
    return (vi){_mm256_srai_epi32(x.a, n), _mm256_srai_epi32(x.b, n)};
}
static inline vf vi_as_vf(vi x)
{
    return (vf){_mm256_castsi256_ps(x.a), _mm256_castsi256_ps(x.b)};
}
static inline vi vf_as_vi(vf x)
{
    return (vi){_mm256_castps_si256(x.a), _mm256_castps_si256(x.b)};
}
static inline vf vi_to_vf(vi x)
{
    return (vf){_mm256_cvtepi32_ps(x.a), _mm256_cvtepi32_ps(x.b)};
}
static inline vi vf_to_vi(vf x)
{
    return (vi){_mm256_cvtps_epi32(x.a), _mm256_cvtps_epi32(x.b)};
}
static inline vf vf_load_u8(const uint8_t *p)
{
    const __m128i bytes = _mm_loadu_si128((const __m128i *)p);
    return (vf){_mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(bytes)),
                _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_srli_si128(bytes, 8)))};
}

// table[i % 8]; table: 32-byte aligned.
static inline vi vi_lookup8(const int32_t table[8], vi i)
{
    const __m256i all = _mm256_load_si256((const __m256i *)table);
    return (vi){_mm256_permutevar8x32_epi32(all, i.a), _mm256_permutevar8x32_epi32(all, i.b)};
}

static inline void vf_halves(vf x, vh halves[2])
{
    halves[0] = x.a, halves[1] = x.b;
}
static inline vf vf_join(const vh halves[2])
{
    return (vf){halves[0], halves[1]};
}

static inline void transpose8(__m256 r[8])
{
    __m256 q[2][4];
    for (int g = 0; g < 2; ++g) {
        const __m256 a = _mm256_unpacklo_ps(r[4 * g], r[4 * g + 1]),
                     b = _mm256_unpackhi_ps(r[4 * g], r[4 * g + 1]);
        const __m256 c = _mm256_unpacklo_ps(r[4 * g + 2], r[4 * g + 3]),
                     d = _mm256_unpackhi_ps(r[4 * g + 2], r[4 * g + 3]);
        q[g][0] = _mm256_shuffle_ps(a, c, 0x44);
        q[g][1] = _mm256_shuffle_ps(a, c, 0xEE);
        q[g][2] = _mm256_shuffle_ps(b, d, 0x44);
        q[g][3] = _mm256_shuffle_ps(b, d, 0xEE);
    }
    for (int k = 0; k < 4; ++k) {
        r[k] = _mm256_permute2f128_ps(q[0][k], q[1][k], 0x20);
        r[4 + k] = _mm256_permute2f128_ps(q[0][k], q[1][k], 0x31);
    }
}

// Transposes 16 rows of 16 lanes in place.
static inline void vf_transpose16(vf r[16])
{
    __m256 quadrant[2][2][8];
    for (int i = 0; i < 16; ++i) {
        quadrant[0][i / 8][i % 8] = r[i].a;
        quadrant[1][i / 8][i % 8] = r[i].b;
    }
    for (int i = 0; i < 4; ++i)
        transpose8(quadrant[i / 2][i % 2]);
    for (int i = 0; i < 16; ++i)
        r[i] = (vf){quadrant[i / 8][0][i % 8], quadrant[i / 8][1][i % 8]};
}

// m ? min(a, b) : a.
static inline vf vf_min_where(vm m, vf a, vf b)
{
    return vf_select(m, vf_min(a, b), a);
}

// The lanes converted to int16; every value must fit.
static inline void vi_store_i16(int16_t *p, vi x)
{
    _mm256_storeu_si256((__m256i *)p, _mm256_permute4x64_epi64(_mm256_packs_epi32(x.a, x.b), 0xD8));
}

// Compresses the lanes of a quarter to p and returns their number. Writes four words.
static inline unsigned compress4(int32_t *p, unsigned bits, __m128i x)
{
    static const int32_t source[16][4] __attribute__((aligned(16))) = {
        {0, 0, 0, 0}, {0, 0, 0, 0}, {1, 0, 0, 0}, {0, 1, 0, 0}, {2, 0, 0, 0}, {0, 2, 0, 0},
        {1, 2, 0, 0}, {0, 1, 2, 0}, {3, 0, 0, 0}, {0, 3, 0, 0}, {1, 3, 0, 0}, {0, 1, 3, 0},
        {2, 3, 0, 0}, {0, 2, 3, 0}, {1, 2, 3, 0}, {0, 1, 2, 3}};
    const __m128i lanes = _mm_load_si128((const __m128i *)source[bits]);
    _mm_storeu_ps((float *)p, _mm_permutevar_ps(_mm_castsi128_ps(x), lanes));
    return (unsigned)__builtin_popcount(bits);
}

// Compresses the lanes of m to p and returns their number. May overwrite all sixteen words at p.
static inline unsigned vi_compress_store(int32_t *p, vm m, vi x)
{
    const unsigned bits = vm_bits(m);
    unsigned count = compress4(p, bits & 15, _mm256_castsi256_si128(x.a));
    count += compress4(p + count, bits >> 4 & 15, _mm256_extracti128_si256(x.a, 1));
    count += compress4(p + count, bits >> 8 & 15, _mm256_castsi256_si128(x.b));
    return count + compress4(p + count, bits >> 12, _mm256_extracti128_si256(x.b, 1));
}

// See simd.h. Both registers hold the lanes of the part; the compiler computes them once.
#define SIMD_PARTS 2
static inline vf vf_load_part(const float *p, int part)
{
    const __m256 x = _mm256_load_ps(p + 8 * part);
    return (vf){x, x};
}
static inline void vf_store_part(float *p, int part, vf x)
{
    _mm256_store_ps(p + 8 * part, x.a);
}
static inline vf vf_part(vf x, int part)
{
    const __m256 y = part ? x.b : x.a;
    return (vf){y, y};
}
static inline vf vf_join_parts(const vf parts[SIMD_PARTS])
{
    return (vf){parts[0].a, parts[1].a};
}
