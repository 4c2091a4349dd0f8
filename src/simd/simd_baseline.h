// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The sixteen lanes as four GNU C vectors, which become SSE2 on x86-64, NEON on ARM and scalar code
// elsewhere. 64-bit ARM has a fused multiply-add and gives the results of AVX2; the others round
// twice. Included by simd.h only.

#include <math.h>
#include <string.h>
#ifdef __SSE2__
#include <emmintrin.h>
#elif defined(__aarch64__)
#include <arm_neon.h>
#endif

typedef float qf __attribute__((vector_size(16)));
typedef int32_t qi __attribute__((vector_size(16)));
typedef uint32_t qu __attribute__((vector_size(16)));
#define SIMD_KEYS 8 // sort keys per comparison

typedef struct vf {
    qf a, b, c, d;
} vf;
typedef struct vi {
    qi a, b, c, d;
} vi;
typedef struct vm {
    qi a, b, c, d; // 0 or -1
} vm;

// Applies a function of one, two or three vectors to each quarter.
#define SGSI_EACH1(type, f, x) ((type){f((x).a), f((x).b), f((x).c), f((x).d)})
#define SGSI_EACH2(type, f, x, y)                                                                  \
    ((type){f((x).a, (y).a), f((x).b, (y).b), f((x).c, (y).c), f((x).d, (y).d)})
#define SGSI_EACH3(type, f, x, y, z)                                                               \
    ((type){f((x).a, (y).a, (z).a), f((x).b, (y).b, (z).b), f((x).c, (y).c, (z).c),                \
            f((x).d, (y).d, (z).d)})

// ---- Quarters ----

static inline qf qf_set1(float x)
{
    return (qf){x, x, x, x};
}
static inline qf qf_select(qi m, qf x, qf y)
{
    return (qf)((m & (qi)x) | (~m & (qi)y));
}
static inline qf qf_keep(qi m, qf x)
{
    return (qf)(m & (qi)x);
}
static inline qf qf_min(qf x, qf y)
{
#ifdef __SSE2__
    return (qf)_mm_min_ps((__m128)x, (__m128)y);
#else
    return qf_select(x < y, x, y);
#endif
}
static inline qf qf_max(qf x, qf y)
{
#ifdef __SSE2__
    return (qf)_mm_max_ps((__m128)x, (__m128)y);
#else
    return qf_select(x > y, x, y);
#endif
}
static inline qf qf_sqrt(qf x)
{
#ifdef __SSE2__
    return (qf)_mm_sqrt_ps((__m128)x);
#elif defined(__aarch64__)
    return (qf)vsqrtq_f32((float32x4_t)x);
#else
    return (qf){sqrtf(x[0]), sqrtf(x[1]), sqrtf(x[2]), sqrtf(x[3])};
#endif
}
static inline qf qf_fma(qf x, qf y, qf z)
{
#ifdef __aarch64__
    return (qf)vfmaq_f32((float32x4_t)z, (float32x4_t)x, (float32x4_t)y);
#else
    return x * y + z;
#endif
}
static inline qf qf_fnma(qf x, qf y, qf z)
{
    return qf_fma(-x, y, z);
}
static inline qf qf_fms(qf x, qf y, qf z)
{
    return qf_fma(x, y, -z);
}
static inline qi qf_round(qf x)
{
#ifdef __SSE2__
    return (qi)_mm_cvtps_epi32((__m128)x);
#elif defined(__aarch64__)
    return (qi)vcvtnq_s32_f32((float32x4_t)x);
#else
    return (qi){(int32_t)lrintf(x[0]), (int32_t)lrintf(x[1]), (int32_t)lrintf(x[2]),
                (int32_t)lrintf(x[3])};
#endif
}
static inline unsigned qi_bits(qi m)
{
#ifdef __SSE2__
    return (unsigned)_mm_movemask_ps((__m128)m);
#else
    const qi bits = m & (qi){1, 2, 4, 8};
    return (unsigned)(bits[0] | bits[1] | bits[2] | bits[3]);
#endif
}
// Interleaves the lower or the upper halves of two vectors.
static inline qf qf_zip_low(qf x, qf y)
{
    return __builtin_shufflevector(x, y, 0, 4, 1, 5);
}
static inline qf qf_zip_high(qf x, qf y)
{
    return __builtin_shufflevector(x, y, 2, 6, 3, 7);
}
static inline void transpose4(qf *r0, qf *r1, qf *r2, qf *r3)
{
    const qf p = qf_zip_low(*r0, *r2), q = qf_zip_low(*r1, *r3), s = qf_zip_high(*r0, *r2),
             t = qf_zip_high(*r1, *r3);
    *r0 = qf_zip_low(p, q);
    *r1 = qf_zip_high(p, q);
    *r2 = qf_zip_low(s, t);
    *r3 = qf_zip_high(s, t);
}

// ---- Sixteen lanes ----

static inline vf vf_load(const float *p)
{
    vf r;
    memcpy(&r, p, sizeof r);
    return r;
}
static inline vf vf_load_u(const float *p)
{
    return vf_load(p);
}
static inline void vf_store(float *p, vf x)
{
    memcpy(p, &x, sizeof x);
}
static inline void vf_store_u(float *p, vf x)
{
    vf_store(p, x);
}
static inline vf vf_set1(float x)
{
    const qf q = qf_set1(x);
    return (vf){q, q, q, q};
}
static inline vf vf_zero(void)
{
    return vf_set1(0.0f);
}
static inline vf vf_add(vf x, vf y)
{
    return (vf){x.a + y.a, x.b + y.b, x.c + y.c, x.d + y.d};
}
static inline vf vf_sub(vf x, vf y)
{
    return (vf){x.a - y.a, x.b - y.b, x.c - y.c, x.d - y.d};
}
static inline vf vf_mul(vf x, vf y)
{
    return (vf){x.a * y.a, x.b * y.b, x.c * y.c, x.d * y.d};
}
static inline vf vf_div(vf x, vf y)
{
    return (vf){x.a / y.a, x.b / y.b, x.c / y.c, x.d / y.d};
}
static inline vf vf_sqrt(vf x)
{
    return SGSI_EACH1(vf, qf_sqrt, x);
}
static inline vf vf_fma(vf x, vf y, vf z)
{
    return SGSI_EACH3(vf, qf_fma, x, y, z);
}
static inline vf vf_fnma(vf x, vf y, vf z)
{
    return SGSI_EACH3(vf, qf_fnma, x, y, z);
}
static inline vf vf_fms(vf x, vf y, vf z)
{
    return SGSI_EACH3(vf, qf_fms, x, y, z);
}
static inline vf vf_min(vf x, vf y)
{
    return SGSI_EACH2(vf, qf_min, x, y);
}
static inline vf vf_max(vf x, vf y)
{
    return SGSI_EACH2(vf, qf_max, x, y);
}

static inline vm vf_lt(vf x, vf y)
{
    return (vm){x.a < y.a, x.b < y.b, x.c < y.c, x.d < y.d};
}
static inline vm vf_le(vf x, vf y)
{
    return (vm){x.a <= y.a, x.b <= y.b, x.c <= y.c, x.d <= y.d};
}
static inline vm vf_gt(vf x, vf y)
{
    return (vm){x.a > y.a, x.b > y.b, x.c > y.c, x.d > y.d};
}
static inline vm vf_ge(vf x, vf y)
{
    return (vm){x.a >= y.a, x.b >= y.b, x.c >= y.c, x.d >= y.d};
}
static inline vf vf_select(vm m, vf x, vf y)
{
    return SGSI_EACH3(vf, qf_select, m, x, y);
}
static inline qf qf_abs(qf x)
{
    return (qf)((qi)x & INT32_MAX);
}
static inline vf vf_abs(vf x)
{
    return SGSI_EACH1(vf, qf_abs, x);
}
static inline vf vf_keep(vm m, vf x)
{
    return SGSI_EACH2(vf, qf_keep, m, x);
}
static inline vm vm_and(vm x, vm y)
{
    return (vm){x.a & y.a, x.b & y.b, x.c & y.c, x.d & y.d};
}
static inline vm vm_or(vm x, vm y)
{
    return (vm){x.a | y.a, x.b | y.b, x.c | y.c, x.d | y.d};
}
static inline vm vm_andnot(vm x, vm y)
{
    return (vm){x.a & ~y.a, x.b & ~y.b, x.c & ~y.c, x.d & ~y.d};
}
static inline vm vm_not(vm x)
{
    return (vm){~x.a, ~x.b, ~x.c, ~x.d};
}
static inline vm vm_none(void)
{
    return (vm){{0}, {0}, {0}, {0}};
}
static inline unsigned vm_bits(vm x)
{
    return qi_bits(x.a) | qi_bits(x.b) << 4 | qi_bits(x.c) << 8 | qi_bits(x.d) << 12;
}
static inline int vm_any(vm x)
{
    return qi_bits((x.a | x.b) | (x.c | x.d)) != 0;
}
static inline vm vm_from_bits(unsigned bits)
{
    const int32_t word = (int32_t)bits;
    const qi all = {word, word, word, word}, lane = {1, 2, 4, 8};
    return (vm){(all & lane) != 0, (all & lane << 4) != 0, (all & lane << 8) != 0,
                (all & lane << 12) != 0};
}
static inline void vf_store_masked(float *p, vm m, vf x)
{
    float lanes[16];
    vf_store(lanes, x);
    for (unsigned bits = vm_bits(m); bits; bits &= bits - 1)
        p[__builtin_ctz(bits)] = lanes[__builtin_ctz(bits)];
}

static inline vi vi_load(const int32_t *p)
{
    vi r;
    memcpy(&r, p, sizeof r);
    return r;
}
static inline vi vi_load_u(const int32_t *p)
{
    return vi_load(p);
}
static inline void vi_store(int32_t *p, vi x)
{
    memcpy(p, &x, sizeof x);
}
static inline vi vi_set1(int32_t x)
{
    const qi q = {x, x, x, x};
    return (vi){q, q, q, q};
}
static inline qi qi_add(qi x, qi y)
{
    return (qi)((qu)x + (qu)y);
}
static inline qi qi_sub(qi x, qi y)
{
    return (qi)((qu)x - (qu)y);
}
static inline vi vi_add(vi x, vi y)
{
    return SGSI_EACH2(vi, qi_add, x, y);
}
static inline vi vi_sub(vi x, vi y)
{
    return SGSI_EACH2(vi, qi_sub, x, y);
}
static inline vi vi_sll(vi x, int n)
{
    return (vi){(qi)((qu)x.a << n), (qi)((qu)x.b << n), (qi)((qu)x.c << n), (qi)((qu)x.d << n)};
}
static inline vi vi_sra(vi x, int n)
{
    return (vi){x.a >> n, x.b >> n, x.c >> n, x.d >> n};
}
static inline vf vi_as_vf(vi x)
{
    return (vf){(qf)x.a, (qf)x.b, (qf)x.c, (qf)x.d};
}
static inline vi vf_as_vi(vf x)
{
    return (vi){(qi)x.a, (qi)x.b, (qi)x.c, (qi)x.d};
}
static inline qf qi_to_qf(qi x)
{
    return __builtin_convertvector(x, qf);
}
static inline vf vi_to_vf(vi x)
{
    return SGSI_EACH1(vf, qi_to_qf, x);
}
static inline vi vf_to_vi(vf x)
{
    return SGSI_EACH1(vi, qf_round, x);
}
static inline qf qf_load_u8(const uint8_t *p)
{
    return qi_to_qf((qi){p[0], p[1], p[2], p[3]});
}
static inline vf vf_load_u8(const uint8_t *p)
{
    return (vf){qf_load_u8(p), qf_load_u8(p + 4), qf_load_u8(p + 8), qf_load_u8(p + 12)};
}

// table[i % 8].
static inline vi vi_lookup8(const int32_t table[8], vi i)
{
    int32_t lanes[16];
    vi_store(lanes, i);
    for (int k = 0; k < 16; ++k)
        lanes[k] = table[lanes[k] & 7];
    return vi_load(lanes);
}

// ---- Half of the lanes, and sums over the lanes: see simd_halves.h ----

typedef struct vh {
    qf a, b;
} vh;

static inline vh vh_load(const float *p)
{
    vh r;
    memcpy(&r, p, sizeof r);
    return r;
}
static inline vh vh_zero(void)
{
    return (vh){qf_set1(0.0f), qf_set1(0.0f)};
}
static inline vh vh_add(vh x, vh y)
{
    return (vh){x.a + y.a, x.b + y.b};
}
static inline vh vh_mul(vh x, vh y)
{
    return (vh){x.a * y.a, x.b * y.b};
}
static inline vh vh_fma(vh x, vh y, vh z)
{
    return (vh){qf_fma(x.a, y.a, z.a), qf_fma(x.b, y.b, z.b)};
}
static inline vh vh_fnma(vh x, vh y, vh z)
{
    return (vh){qf_fnma(x.a, y.a, z.a), qf_fnma(x.b, y.b, z.b)};
}
static inline void vf_halves(vf x, vh halves[2])
{
    halves[0] = (vh){x.a, x.b}, halves[1] = (vh){x.c, x.d};
}
static inline vf vf_join(const vh halves[2])
{
    return (vf){halves[0].a, halves[0].b, halves[1].a, halves[1].b};
}

// Adds the sum over the lanes of x[k] to row[k], by the tree of vf_sum.
static inline void vh_add_sums(float *row, const vh x[16])
{
    for (int k = 0; k < 16; k += 4) {
        qf r[4], sum;
        for (int j = 0; j < 4; ++j)
            r[j] = x[k + j].a + x[k + j].b;
        transpose4(&r[0], &r[1], &r[2], &r[3]);
        memcpy(&sum, row + k, sizeof sum);
        sum += (r[0] + r[2]) + (r[1] + r[3]);
        memcpy(row + k, &sum, sizeof sum);
    }
}

// Transposes 16 rows of 16 lanes in place.
static inline void vf_transpose16(vf r[16])
{
    qf q[16][4];
    memcpy(q, r, sizeof q);
    for (int i = 0; i < 4; ++i)
        for (int k = 0; k < 4; ++k)
            transpose4(&q[4 * i][k], &q[4 * i + 1][k], &q[4 * i + 2][k], &q[4 * i + 3][k]);
    for (int i = 0; i < 16; ++i)
        r[i] =
            (vf){q[i % 4][i / 4], q[4 + i % 4][i / 4], q[8 + i % 4][i / 4], q[12 + i % 4][i / 4]};
}

// m ? min(y, x) : x.
static inline vf vf_min_where(vm m, vf x, vf y)
{
    return vf_select(m, vf_min(y, x), x);
}

// The lanes converted to int16; every value must fit.
static inline void vi_store_i16(int16_t *p, vi x)
{
    int32_t lanes[16];
    vi_store(lanes, x);
    for (int i = 0; i < 16; ++i)
        p[i] = (int16_t)lanes[i];
}

// Compresses the lanes of m to p and returns their number. May overwrite all sixteen words at p.
static inline unsigned vi_compress_store(int32_t *p, vm m, vi x)
{
    int32_t lanes[16] __attribute__((aligned(64)));
    vi_store(lanes, x);
    unsigned count = 0;
    for (unsigned bits = vm_bits(m); bits; bits &= bits - 1)
        p[count++] = lanes[__builtin_ctz(bits)];
    return count;
}
