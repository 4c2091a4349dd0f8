// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Sorting by the bits of a positive float, which order like the float itself.

#include <stddef.h>
#include <stdint.h>
#include <string.h>

// Stable counting sort of `from` into `to` by `bits` (at most 11) bits from `shift` on.
static inline void sgsi_radix_pass(const uint64_t *from, uint64_t *to, size_t count, int shift,
                                   int bits)
{
    uint32_t begin[2048];
    const uint32_t buckets = 1u << bits;
    memset(begin, 0, buckets * sizeof *begin);
    for (size_t i = 0; i < count; ++i)
        ++begin[from[i] >> shift & (buckets - 1)];
    uint32_t total = 0;
    for (uint32_t k = 0; k < buckets; ++k) {
        const uint32_t size = begin[k];
        begin[k] = total;
        total += size;
    }
    for (size_t i = 0; i < count; ++i)
        to[begin[from[i] >> shift & (buckets - 1)]++] = from[i];
}

// Sorts by the upper 32 bits, stable: least significant digit first, three digits of 11 bits. Both
// buffers hold `count` keys; the sorted ones are in the returned buffer, which is `spare`.
static inline uint64_t *sgsi_radix_sort(uint64_t *keys, uint64_t *spare, size_t count)
{
    sgsi_radix_pass(keys, spare, count, 32, 11);
    sgsi_radix_pass(spare, keys, count, 43, 11);
    sgsi_radix_pass(keys, spare, count, 54, 10);
    return spare;
}
