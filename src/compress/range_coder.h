// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Binary range coder with adaptive probabilities (Martin 1979, with the carry propagation of LZMA).
// Integers only. A decoder that reads beyond the end sees zeros and sets `overrun`.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/core.h"

// Probability of a zero in 1 / 65536; adapts by 1 / 32.
typedef uint16_t sgsi_bit_model;
enum { SGSI_BIT_ADAPTATION = 5, SGSI_BIT_MIN = 512 };

typedef struct sgsi_range_encoder {
    uint8_t *bytes;
    size_t size, room;
    uint64_t low;
    uint32_t range;
    uint8_t cache;
    uint64_t pending; // bytes that a carry may still change
    bool failed;      // out of memory
} sgsi_range_encoder;

typedef struct sgsi_range_decoder {
    const uint8_t *bytes;
    size_t size, at;
    uint32_t range, code;
    bool overrun;
} sgsi_range_decoder;

static inline void sgsi_range_encode_begin(sgsi_range_encoder *e)
{
    *e = (sgsi_range_encoder){.range = UINT32_MAX, .pending = 1};
}

static inline void sgsi_range_put(sgsi_range_encoder *e, uint8_t byte)
{
    if (e->size == e->room) {
        const size_t room = e->room ? 2 * e->room : 65536;
        if (e->failed || !sgsi_grow((void **)&e->bytes, e->room, room, 1)) {
            e->failed = true;
            return;
        }
        e->room = room;
    }
    e->bytes[e->size++] = byte;
}

static inline void sgsi_range_shift(sgsi_range_encoder *e)
{
    if (e->low < 0xFF000000u || e->low > UINT32_MAX) {
        const uint8_t carry = (uint8_t)(e->low >> 32);
        do {
            sgsi_range_put(e, (uint8_t)(e->cache + carry));
            e->cache = 0xFF;
        } while (--e->pending);
        e->cache = (uint8_t)(e->low >> 24);
    }
    ++e->pending;
    e->low = (e->low & 0x00FFFFFFu) << 8;
}

// A model never reaches 0 or 1: both bits stay possible.
static inline void sgsi_bit_adapt(sgsi_bit_model *model, int bit)
{
    if (bit)
        *model = (uint16_t)(*model - ((*model - SGSI_BIT_MIN) >> SGSI_BIT_ADAPTATION));
    else
        *model = (uint16_t)(*model + ((65536 - SGSI_BIT_MIN - *model) >> SGSI_BIT_ADAPTATION));
}

static inline void sgsi_range_encode(sgsi_range_encoder *e, sgsi_bit_model *model, int bit)
{
    const uint32_t bound = (e->range >> 16) * *model;
    if (bit) {
        e->low += bound;
        e->range -= bound;
    } else {
        e->range = bound;
    }
    sgsi_bit_adapt(model, bit);
    while (e->range < 0x01000000u) {
        e->range <<= 8;
        sgsi_range_shift(e);
    }
}

// Completes the bytes; they are released with sgsi_free.
static inline void sgsi_range_encode_end(sgsi_range_encoder *e)
{
    for (int k = 0; k < 5; ++k)
        sgsi_range_shift(e);
}

static inline uint8_t sgsi_range_next(sgsi_range_decoder *d)
{
    if (d->at < d->size)
        return d->bytes[d->at++];
    d->overrun = true;
    return 0;
}

static inline void sgsi_range_decode_begin(sgsi_range_decoder *d, const uint8_t *bytes, size_t size)
{
    *d = (sgsi_range_decoder){.bytes = bytes, .size = size, .range = UINT32_MAX};
    for (int k = 0; k < 5; ++k)
        d->code = d->code << 8 | sgsi_range_next(d);
}

static inline int sgsi_range_decode(sgsi_range_decoder *d, sgsi_bit_model *model)
{
    const uint32_t bound = (d->range >> 16) * *model;
    const int bit = d->code >= bound;
    if (bit) {
        d->code -= bound;
        d->range -= bound;
    } else {
        d->range = bound;
    }
    sgsi_bit_adapt(model, bit);
    while (d->range < 0x01000000u) {
        d->range <<= 8;
        d->code = d->code << 8 | sgsi_range_next(d);
    }
    return bit;
}
