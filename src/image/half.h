// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// IEEE 754 binary16. For photos: non-negative, finite and without subnormals, so that decoding is a
// shift and a multiplication. For files: any value.

#include <math.h>
#include <stdint.h>
#include <string.h>

#define SGSI_HALF_MAX 65504.0f
#define SGSI_HALF_MIN 6.103515625e-05f // smaller values become 0

// Rounds to the nearest half (ties to even). Values outside [0, SGSI_HALF_MAX] are clamped; NaN
// becomes 0.
static inline uint16_t sgsi_half_from_float(float value)
{
    if (!(value >= SGSI_HALF_MIN))
        return 0;
    value = value < SGSI_HALF_MAX ? value : SGSI_HALF_MAX;
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    bits += 0x0fff + (bits >> 13 & 1);
    return (uint16_t)((bits >> 13) - (112u << 10));
}

static inline float sgsi_half_to_float(uint16_t half)
{
    const uint32_t bits = (uint32_t)half << 13;
    float value;
    memcpy(&value, &bits, sizeof value);
    return value * 0x1p112f; // no subnormals; 0 stays 0
}

// Rounds to the nearest half (ties to even, with subnormals), in the default rounding mode. Values
// outside [-SGSI_HALF_MAX, SGSI_HALF_MAX] are clamped; NaN stays NaN.
static inline uint16_t sgsi_half_nearest(float value)
{
    const float size = fabsf(value);
    const uint16_t sign = signbit(value) ? 0x8000 : 0;
    if (isnan(value))
        return sign | 0x7e00;
    return (uint16_t)(sign | (size < SGSI_HALF_MIN ? (uint16_t)lrintf(size * 0x1p24f)
                                                   : sgsi_half_from_float(size)));
}
