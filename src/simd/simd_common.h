// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Common code of the instruction sets without mask registers. Included by simd.h only, after the
// header that defines SIMD_KEYS.

#include <string.h>

// Masked arithmetic: m ? a op b : a.
static inline vf vf_mul_where(vm m, vf a, vf b)
{
    return vf_select(m, vf_mul(a, b), a);
}
static inline vf vf_add_where(vm m, vf a, vf b)
{
    return vf_select(m, vf_add(a, b), a);
}
static inline vf vf_sub_where(vm m, vf a, vf b)
{
    return vf_select(m, vf_sub(a, b), a);
}

// low < x <= high, for 0 <= low <= high.
static inline vm vf_between(vf x, vf low, vf high)
{
    return vm_and(vf_gt(x, low), vf_le(x, high));
}

typedef int16_t simd_keys __attribute__((vector_size(2 * SIMD_KEYS)));

// ranks[i] = position of keys[i] in ascending order, equal keys in the order of the array. keys and
// ranks have room for a multiple of 32 and are 64-byte aligned. least and most are the extremes of
// each 32 keys: chunks with disjoint ranges are not compared, so nearly sorted keys cost little
// more than their own chunks.
static inline void simd_rank(const int16_t *keys, uint16_t *ranks, uint32_t count,
                             const int16_t *least, const int16_t *most)
{
    const simd_keys zero = {0};
    simd_keys place = zero, key;
    for (int k = 0; k < SIMD_KEYS; ++k)
        place[k] = (int16_t)k;
    for (uint32_t begin = 0; begin < count; begin += SIMD_KEYS) {
        const uint32_t end = begin + SIMD_KEYS < count ? begin + SIMD_KEYS : count, c = begin / 32;
        memcpy(&key, keys + begin, sizeof key);
        simd_keys rank = zero + (int16_t)begin; // minus later ones: a comparison is 0 or -1
        for (uint32_t d = 0; d <= c; ++d) {
            if (d < c && most[d] <= least[c])
                continue;
            const uint32_t last = d < c ? 32 * d + 32 : begin;
            for (uint32_t j = 32 * d; j < last; ++j)
                rank += keys[j] > key;
        }
        for (uint32_t j = begin; j < end; ++j) // stable for equal keys
            rank -= (key > keys[j]) | ((key == keys[j]) & (place > (int16_t)(j - begin)));
        for (uint32_t d = c; 32 * d < count; ++d) {
            if (d > c && least[d] >= most[c])
                continue;
            const uint32_t first = d > c ? 32 * d : end,
                           last = 32 * d + 32 < count ? 32 * d + 32 : count;
            for (uint32_t j = first; j < last; ++j)
                rank -= key > keys[j];
        }
        memcpy(ranks + begin, &rank, sizeof rank);
    }
}
