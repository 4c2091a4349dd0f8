// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Morton order (Z curve): points near in space have near codes.

#include <stdint.h>

static inline uint64_t sgsi_spread_bits(uint64_t v) // 21 bits, two zeros between each
{
    v &= 0x1FFFFF;
    v = (v | v << 32) & UINT64_C(0x1F00000000FFFF);
    v = (v | v << 16) & UINT64_C(0x1F0000FF0000FF);
    v = (v | v << 8) & UINT64_C(0x100F00F00F00F00F);
    v = (v | v << 4) & UINT64_C(0x10C30C30C30C30C3);
    return (v | v << 2) & UINT64_C(0x1249249249249249);
}

static inline uint64_t sgsi_gather_bits(uint64_t v) // the inverse: every third of 63 bits
{
    v &= UINT64_C(0x1249249249249249);
    v = (v | v >> 2) & UINT64_C(0x10C30C30C30C30C3);
    v = (v | v >> 4) & UINT64_C(0x100F00F00F00F00F);
    v = (v | v >> 8) & UINT64_C(0x1F0000FF0000FF);
    v = (v | v >> 16) & UINT64_C(0x1F00000000FFFF);
    return (v | v >> 32) & 0x1FFFFF;
}

// Morton code of a mean in the box of all means.
static inline uint64_t sgsi_morton_code(const float mean[3], const float low[3],
                                        const float inv_size[3])
{
    uint64_t code = 0;
    for (int k = 0; k < 3; ++k) {
        const float unit = (mean[k] - low[k]) * inv_size[k];
        const uint64_t cell =
            unit > 0.0f ? (unit < 1.0f ? (uint64_t)(unit * 2097152.0f) : 2097151) : 0; // NaN: 0
        code |= sgsi_spread_bits(cell) << k;
    }
    return code;
}
