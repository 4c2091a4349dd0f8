// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// PNG files byte by byte, from the PNG specification (third edition) and RFC 1950 and 1951: grey or
// RGB of 8 or 16 bits, not compressed. Not written by our writer.

#include <stdint.h>

#include "support/scene_support.h"

typedef struct png_file {
    int width, height;
    int channels;            // 1 or 3
    int bits;                // 8 or 16
    uint32_t gama;           // value of the chunk gAMA: 100000 times the exponent; 0 = no chunk
    const uint16_t *samples; // [height][width][channels]
} png_file;

static inline void png_integer(buffer *b, uint32_t value)
{
    for (int k = 24; k >= 0; k -= 8)
        put_integer(b, value >> k & 255, 1);
}

// Ends the chunk whose type begins at `start` of the buffer: its length and its CRC-32.
static inline void png_end_chunk(buffer *b, size_t start)
{
    const size_t end = b->size;
    uint32_t crc = 0xffffffff;
    for (size_t i = start; i < end; ++i) {
        crc ^= (unsigned char)b->data[i];
        for (int k = 0; k < 8; ++k)
            crc = crc >> 1 ^ (crc & 1 ? 0xedb88320 : 0);
    }
    b->size = start - 4;
    png_integer(b, (uint32_t)(end - start - 4));
    b->size = end;
    png_integer(b, ~crc);
}

static inline size_t png_begin_chunk(buffer *b, const char *type)
{
    png_integer(b, 0);
    put_bytes(b, type, 4);
    return b->size - 4;
}

// One stored block of rows without a filter.
static inline void png_rows(buffer *b, const png_file *f)
{
    const size_t row = (size_t)f->width * (size_t)f->channels,
                 size = (row * (size_t)f->bits / 8 + 1) * (size_t)f->height;
    assert_true(size < 65536);
    put_bytes(b, "\x78\x01\x01", 3);
    put_integer(b, size, 2);
    put_integer(b, ~size & 0xffff, 2);
    const size_t first = b->size;
    for (int y = 0; y < f->height; ++y) {
        put_integer(b, 0, 1);
        for (size_t i = 0; i < row; ++i) {
            const uint16_t sample = f->samples[(size_t)y * row + i];
            if (f->bits == 16)
                put_integer(b, sample >> 8, 1);
            put_integer(b, sample & 255, 1);
        }
    }
    uint32_t low = 1, high = 0; // Adler-32
    for (size_t i = first; i < b->size; ++i) {
        low = (low + (unsigned char)b->data[i]) % 65521;
        high = (high + low) % 65521;
    }
    png_integer(b, high << 16 | low);
}

static inline void png_put(const temp_folder *folder, const char *name, const png_file *f)
{
    static buffer b;
    b.size = 0;
    put_bytes(&b, "\x89PNG\r\n\x1a\n", 8);
    size_t start = png_begin_chunk(&b, "IHDR");
    png_integer(&b, (uint32_t)f->width);
    png_integer(&b, (uint32_t)f->height);
    put_integer(&b, (uint64_t)f->bits, 1);
    put_integer(&b, f->channels == 1 ? 0 : 2, 1);
    put_bytes(&b, "\0\0", 3);
    png_end_chunk(&b, start);
    if (f->gama) {
        start = png_begin_chunk(&b, "gAMA");
        png_integer(&b, f->gama);
        png_end_chunk(&b, start);
    }
    start = png_begin_chunk(&b, "IDAT");
    png_rows(&b, f);
    png_end_chunk(&b, start);
    start = png_begin_chunk(&b, "IEND");
    png_end_chunk(&b, start);
    tree_put(folder, name, b.data, b.size);
}
