// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Fields of up to 25 bits, the most significant bit first, without gaps.

#include <stddef.h>
#include <stdint.h>

static inline size_t sgsi_bit_bytes(size_t count, int bits)
{
    return (count * (size_t)bits + 7) / 8;
}

// Field i of a stream of equal fields; the bytes are zero before.
static inline void sgsi_bits_put(uint8_t *bytes, size_t i, int bits, uint32_t value)
{
    for (int k = 0; k < bits; ++k) {
        const size_t at = i * (size_t)bits + (size_t)k;
        bytes[at / 8] |= (uint8_t)((value >> (bits - 1 - k) & 1) << (7 - at % 8));
    }
}

static inline uint32_t sgsi_bits_get(const uint8_t *bytes, size_t i, int bits)
{
    uint32_t value = 0;
    for (int k = 0; k < bits; ++k) {
        const size_t at = i * (size_t)bits + (size_t)k;
        value = value << 1 | (bytes[at / 8] >> (7 - at % 8) & 1);
    }
    return value;
}

// Bits of the largest of `count` values 0..count - 1, at least 1.
static inline int sgsi_bit_width(size_t count)
{
    int bits = 1;
    while (count > (size_t)1 << bits)
        ++bits;
    return bits;
}
