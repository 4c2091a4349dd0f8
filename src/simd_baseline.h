// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The sixteen lanes in portable C: plain loops that any compiler may vectorise. Included by simd.h
// only.

#include <math.h>
#include <string.h>

typedef struct vf {
    float x[16];
} vf;
typedef struct vi {
    int32_t x[16];
} vi;
typedef struct vm {
    int32_t x[16];
} vm; // 0 or -1

#define SGSI_LANES(type, expression)                                                               \
    type r;                                                                                        \
    for (int i = 0; i < 16; ++i)                                                                   \
        r.x[i] = (expression);                                                                     \
    return r

static inline vf vf_load(const float *p)
{
    vf r;
    memcpy(&r, p, sizeof r);
    return r;
}
static inline vf vf_load_u(const float *p)
{
    vf r;
    memcpy(&r, p, sizeof r);
    return r;
}
static inline void vf_store(float *p, vf a)
{
    memcpy(p, &a, sizeof a);
}
static inline void vf_store_u(float *p, vf a)
{
    memcpy(p, &a, sizeof a);
}
static inline void vf_store_masked(float *p, vm m, vf a)
{
    for (int i = 0; i < 16; ++i)
        if (m.x[i])
            p[i] = a.x[i];
}
static inline vf vf_set1(float a)
{
    SGSI_LANES(vf, a);
}
static inline vf vf_zero(void)
{
    SGSI_LANES(vf, 0.0f);
}
static inline vf vf_add(vf a, vf b)
{
    SGSI_LANES(vf, a.x[i] + b.x[i]);
}
static inline vf vf_sub(vf a, vf b)
{
    SGSI_LANES(vf, a.x[i] - b.x[i]);
}
static inline vf vf_mul(vf a, vf b)
{
    SGSI_LANES(vf, a.x[i] * b.x[i]);
}
static inline vf vf_div(vf a, vf b)
{
    SGSI_LANES(vf, a.x[i] / b.x[i]);
}
static inline vf vf_sqrt(vf a)
{
    SGSI_LANES(vf, sqrtf(a.x[i]));
}
static inline vf vf_fma(vf a, vf b, vf c)
{
    SGSI_LANES(vf, a.x[i] * b.x[i] + c.x[i]);
}
static inline vf vf_fnma(vf a, vf b, vf c)
{
    SGSI_LANES(vf, c.x[i] - a.x[i] * b.x[i]);
}
static inline vf vf_fms(vf a, vf b, vf c)
{
    SGSI_LANES(vf, a.x[i] * b.x[i] - c.x[i]);
}
static inline vf vf_min(vf a, vf b)
{
    SGSI_LANES(vf, a.x[i] < b.x[i] ? a.x[i] : b.x[i]);
}
static inline vf vf_max(vf a, vf b)
{
    SGSI_LANES(vf, a.x[i] > b.x[i] ? a.x[i] : b.x[i]);
}

static inline vm vf_lt(vf a, vf b)
{
    SGSI_LANES(vm, -(a.x[i] < b.x[i]));
}
static inline vm vf_le(vf a, vf b)
{
    SGSI_LANES(vm, -(a.x[i] <= b.x[i]));
}
static inline vm vf_gt(vf a, vf b)
{
    SGSI_LANES(vm, -(a.x[i] > b.x[i]));
}
static inline vm vf_ge(vf a, vf b)
{
    SGSI_LANES(vm, -(a.x[i] >= b.x[i]));
}
static inline vf vf_select(vm m, vf a, vf b)
{
    SGSI_LANES(vf, m.x[i] ? a.x[i] : b.x[i]);
}
static inline vf vf_keep(vm m, vf a)
{
    SGSI_LANES(vf, m.x[i] ? a.x[i] : 0.0f);
}
static inline vm vm_and(vm a, vm b)
{
    SGSI_LANES(vm, a.x[i] & b.x[i]);
}
static inline vm vm_or(vm a, vm b)
{
    SGSI_LANES(vm, a.x[i] | b.x[i]);
}
static inline vm vm_andnot(vm a, vm b)
{
    SGSI_LANES(vm, a.x[i] & ~b.x[i]);
}
static inline vm vm_not(vm a)
{
    SGSI_LANES(vm, ~a.x[i]);
}
static inline vm vm_none(void)
{
    SGSI_LANES(vm, 0);
}
static inline unsigned vm_bits(vm a)
{
    unsigned bits = 0;
    for (int i = 0; i < 16; ++i)
        bits |= (unsigned)(a.x[i] & 1) << i;
    return bits;
}
static inline int vm_any(vm a)
{
    return vm_bits(a) != 0;
}
static inline vm vm_from_bits(unsigned bits)
{
    SGSI_LANES(vm, -(int32_t)(bits >> i & 1));
}

static inline vi vi_load(const int32_t *p)
{
    vi r;
    memcpy(&r, p, sizeof r);
    return r;
}
static inline vi vi_load_u(const int32_t *p)
{
    vi r;
    memcpy(&r, p, sizeof r);
    return r;
}
static inline void vi_store(int32_t *p, vi a)
{
    memcpy(p, &a, sizeof a);
}
static inline vi vi_set1(int32_t a)
{
    SGSI_LANES(vi, a);
}
static inline vi vi_add(vi a, vi b)
{
    SGSI_LANES(vi, (int32_t)((uint32_t)a.x[i] + (uint32_t)b.x[i]));
}
static inline vi vi_sub(vi a, vi b)
{
    SGSI_LANES(vi, (int32_t)((uint32_t)a.x[i] - (uint32_t)b.x[i]));
}
static inline vi vi_sll(vi a, int n)
{
    SGSI_LANES(vi, (int32_t)((uint32_t)a.x[i] << n));
}
static inline vi vi_sra(vi a, int n)
{
    SGSI_LANES(vi, a.x[i] >> n);
}
static inline vf vi_as_vf(vi a)
{
    vf r;
    memcpy(&r, &a, sizeof r);
    return r;
}
static inline vi vf_as_vi(vf a)
{
    vi r;
    memcpy(&r, &a, sizeof r);
    return r;
}
static inline vf vi_to_vf(vi a)
{
    SGSI_LANES(vf, (float)a.x[i]);
}
static inline vi vf_to_vi(vf a)
{
    SGSI_LANES(vi, (int32_t)lrintf(a.x[i]));
}
static inline vf vf_load_u8(const uint8_t *p)
{
    SGSI_LANES(vf, (float)p[i]);
}

// Lane k of the result is the sum over the lanes of v[k], by the tree of vf_sum.
static inline vf vf_sum16(const vf v[16])
{
    vf r;
    for (int k = 0; k < 16; ++k) {
        float x[16];
        memcpy(x, &v[k], sizeof x);
        for (int stride = 8; stride; stride /= 2)
            for (int i = 0; i < stride; ++i)
                x[i] += x[i + stride];
        r.x[k] = x[0];
    }
    return r;
}

// Transposes 16 rows of 16 lanes in place.
static inline void vf_transpose16(vf r[16])
{
    for (int i = 0; i < 16; ++i)
        for (int k = 0; k < i; ++k) {
            const float kept = r[i].x[k];
            r[i].x[k] = r[k].x[i];
            r[k].x[i] = kept;
        }
}

// Masked arithmetic: m ? a op b : a.
static inline vf vf_mul_where(vm m, vf a, vf b)
{
    SGSI_LANES(vf, m.x[i] ? a.x[i] * b.x[i] : a.x[i]);
}
static inline vf vf_add_where(vm m, vf a, vf b)
{
    SGSI_LANES(vf, m.x[i] ? a.x[i] + b.x[i] : a.x[i]);
}
static inline vf vf_sub_where(vm m, vf a, vf b)
{
    SGSI_LANES(vf, m.x[i] ? a.x[i] - b.x[i] : a.x[i]);
}
static inline vf vf_min_where(vm m, vf a, vf b)
{
    SGSI_LANES(vf, m.x[i] && b.x[i] < a.x[i] ? b.x[i] : a.x[i]);
}

// Writes the lanes of m together to p and returns their number. All sixteen words from p on may be
// overwritten.
static inline unsigned vi_compress_store(int32_t *p, vm m, vi a)
{
    unsigned count = 0;
    for (int i = 0; i < 16; ++i)
        if (m.x[i])
            p[count++] = a.x[i];
    return count;
}

// ranks[i] = the number of keys[0..count) that stand before keys[i] in ascending order, equal ones
// in the order of the array. keys and ranks have room for a multiple of 32, 64-byte aligned; least
// and most are the extremes of each 32 keys: chunks whose ranges do not overlap are not compared,
// so nearly sorted keys cost little more than their own chunks.
static inline void simd_rank(const int16_t *keys, uint16_t *ranks, uint32_t count,
                             const int16_t *least, const int16_t *most)
{
    (void)least;
    (void)most;
    for (uint32_t i = 0; i < count; ++i) {
        uint32_t rank = 0;
        for (uint32_t j = 0; j < count; ++j)
            rank += j < i ? keys[j] <= keys[i] : keys[j] < keys[i];
        ranks[i] = (uint16_t)rank;
    }
}

// The lanes as int16, which they must fit.
static inline void vi_store_i16(int16_t *p, vi a)
{
    for (int i = 0; i < 16; ++i)
        p[i] = (int16_t)a.x[i];
}
