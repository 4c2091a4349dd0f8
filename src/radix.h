// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Sorting by the bits of a positive float, which order like the float itself.

#include <stddef.h>
#include <stdint.h>

// Sorts by the upper 32 bits, stable: least significant digit first, three digits of 11 bits. Both buffers hold `count`
// keys; the sorted ones are in the returned buffer, which is `spare`.
static inline uint64_t *sgsi_radix_sort(uint64_t *keys, uint64_t *spare, size_t count)
{
    uint64_t *from = keys, *to = spare;
    for (int shift = 32; shift < 64; shift += 11) {
        uint32_t begin[2048] = {0};
        for (size_t i = 0; i < count; ++i)
            ++begin[from[i] >> shift & 2047];
        uint32_t total = 0;
        for (int k = 0; k < 2048; ++k) {
            const uint32_t size = begin[k];
            begin[k] = total;
            total += size;
        }
        for (size_t i = 0; i < count; ++i)
            to[begin[from[i] >> shift & 2047]++] = from[i];
        uint64_t *const swap = from;
        from = to;
        to = swap;
    }
    return from;
}
