// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Radix sort by the bits of positive floats, which have the same order as the floats.

#include <stddef.h>
#include <stdint.h>
#include <string.h>

// Stable counting sort of `from` into `to` by `bits` (at most 11) bits of key - base, starting at
// bit `shift`.
static inline void sgsi_radix_pass(const uint64_t *from, uint64_t *to, size_t count, uint64_t base,
                                   int shift, int bits)
{
    uint32_t begin[2048];
    const uint32_t buckets = 1u << bits;
    memset(begin, 0, buckets * sizeof *begin);
    for (size_t i = 0; i < count; ++i)
        ++begin[(from[i] - base) >> shift & (buckets - 1)];
    uint32_t total = 0;
    for (uint32_t k = 0; k < buckets; ++k) {
        const uint32_t size = begin[k];
        begin[k] = total;
        total += size;
    }
    for (size_t i = 0; i < count; ++i)
        to[begin[(from[i] - base) >> shift & (buckets - 1)]++] = from[i];
}

// Sorts by the upper 32 bits, which lie in [least, most], with a resolution of 2^-19 of that range
// or finer; closer keys keep their order. Both buffers hold `count` keys; the result is in `keys`.
static inline void sgsi_radix_sort(uint64_t *keys, uint64_t *spare, size_t count, uint32_t least,
                                   uint32_t most)
{
    const uint64_t base = (uint64_t)least << 32;
    int shift = 32;
    while ((most - least) >> (shift - 32) >= 1u << 20)
        ++shift;
    sgsi_radix_pass(keys, spare, count, base, shift, 10);
    sgsi_radix_pass(spare, keys, count, base, shift + 10, 10);
}
