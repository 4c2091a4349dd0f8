// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Radix sort by the bits of positive floats, which have the same order as the floats.

#include <stdbool.h>
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

// Sorts by all of the upper 32 bits; equal ones keep their order. Buffers as for sgsi_radix_sort.
static inline void sgsi_radix_sort_exact(uint64_t *keys, uint64_t *spare, size_t count)
{
    enum { DIGIT = 8 };
    for (int shift = 32; shift < 64; shift += 2 * DIGIT) {
        sgsi_radix_pass(keys, spare, count, 0, shift, DIGIT);
        sgsi_radix_pass(spare, keys, count, 0, shift + DIGIT, DIGIT);
    }
}

// Insertion sort by the whole key. Returns false once it has moved more than max_moves keys by one
// place: the keys are then partly sorted, and those with equal upper halves are in order among
// themselves if they were before.
static inline bool sgsi_insertion_sort(uint64_t *keys, size_t count, size_t max_moves)
{
    size_t moves = 0;
    for (size_t i = 1; i < count && moves <= max_moves; ++i) {
        const uint64_t key = keys[i];
        size_t at = i;
        for (; at && keys[at - 1] > key; --at)
            keys[at] = keys[at - 1];
        keys[at] = key;
        moves += i - at;
    }
    return moves <= max_moves;
}

// Sorts by the whole key. The upper halves lie in [least, most]; keys with equal upper halves must
// be in order. Insertion completes the radix sort. If a few keys stretch the range, so that many
// keys are closer than the resolution, insertion would take a time proportional to the square of
// their number; passes over all bits replace it.
static inline void sgsi_sort_keys(uint64_t *keys, uint64_t *spare, size_t count, uint32_t least,
                                  uint32_t most)
{
    enum { FEW = 96, MOVES_PER_KEY = 8 };
    if (count <= FEW) {
        sgsi_insertion_sort(keys, count, SIZE_MAX);
        return;
    }
    sgsi_radix_sort(keys, spare, count, least, most);
    if (!sgsi_insertion_sort(keys, count, MOVES_PER_KEY * count))
        sgsi_radix_sort_exact(keys, spare, count);
}
