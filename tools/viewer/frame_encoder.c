// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// PNG: ISO/IEC 15948, 8-bit RGB, one IDAT. Each row has the filter Sub or Up, whichever has the
// smaller sum of absolute differences.

#include "viewer/frame_encoder.h"

#include <libdeflate.h>
#include <stdlib.h>
#include <string.h>
#include <turbojpeg.h>

enum { PNG_LEVEL = 3, SIDE_MAXIMUM = 65500 };

static bool is_encodable(const sgs_image8 *image)
{
    return image->channels == 3 && image->width > 0 && image->height > 0 &&
           image->width <= SIDE_MAXIMUM && image->height <= SIDE_MAXIMUM;
}

static void interleave(const sgs_image8 *image, size_t y, uint8_t *row)
{
    const size_t width = (size_t)image->width, pixels = width * (size_t)image->height;
    for (size_t c = 0; c < 3; ++c) {
        const uint8_t *plane = image->pixels + c * pixels + y * width;
        for (size_t x = 0; x < width; ++x)
            row[3 * x + c] = plane[x];
    }
}

bool encode_jpeg(const sgs_image8 *image, int quality, encoded_picture *out)
{
    *out = (encoded_picture){0};
    const size_t stride = 3 * (size_t)image->width;
    uint8_t *rows = is_encodable(image) ? malloc(stride * (size_t)image->height) : NULL;
    tjhandle handle = rows ? tjInitCompress() : NULL;
    unsigned char *bytes = NULL;
    unsigned long size = 0;
    bool done = handle != NULL;
    for (size_t y = 0; done && y < (size_t)image->height; ++y)
        interleave(image, y, rows + y * stride);
    done = done && !tjCompress2(handle, rows, image->width, 0, image->height, TJPF_RGB, &bytes,
                                &size, quality >= 90 ? TJSAMP_444 : TJSAMP_420, quality, 0);
    out->bytes = done ? malloc(size) : NULL;
    if (out->bytes) {
        memcpy(out->bytes, bytes, size);
        out->size = size;
    }
    tjFree(bytes);
    if (handle)
        tjDestroy(handle);
    free(rows);
    return out->bytes != NULL;
}

// ---- PNG ----

static uint8_t *put_number(uint8_t *at, uint32_t value)
{
    for (int k = 0; k < 4; ++k)
        at[k] = (uint8_t)(value >> (24 - 8 * k));
    return at + 4;
}

// Completes the chunk whose type is at `start` + 4 and whose data end at `end`.
static uint8_t *end_chunk(uint8_t *start, uint8_t *end)
{
    put_number(start, (uint32_t)(end - start - 8));
    return put_number(end, libdeflate_crc32(0, start + 4, (size_t)(end - start - 4)));
}

static unsigned long cost_of(const uint8_t *bytes, size_t count)
{
    unsigned long sum = 0;
    for (size_t i = 0; i < count; ++i)
        sum += bytes[i] < 128 ? bytes[i] : 256U - bytes[i];
    return sum;
}

// Writes filter types and filtered rows, [height][1 + 3 width]. work: 4 rows.
static void filter_rows(const sgs_image8 *image, uint8_t *work, uint8_t *out)
{
    enum { FILTER_SUB = 1, FILTER_UP = 2 };
    const size_t stride = 3 * (size_t)image->width;
    uint8_t *row = work, *above = work + stride, *sub = work + 2 * stride, *up = work + 3 * stride;
    memset(above, 0, stride);
    for (size_t y = 0; y < (size_t)image->height; ++y) {
        interleave(image, y, row);
        for (size_t i = 0; i < stride; ++i) {
            sub[i] = (uint8_t)(row[i] - (i < 3 ? 0 : row[i - 3]));
            up[i] = (uint8_t)(row[i] - above[i]);
        }
        const bool is_up = cost_of(up, stride) < cost_of(sub, stride);
        *out++ = is_up ? FILTER_UP : FILTER_SUB;
        memcpy(out, is_up ? up : sub, stride);
        out += stride;
        uint8_t *swapped = row;
        row = above;
        above = swapped;
    }
}

// Deflates the rows after the header at `bytes` and completes the file. Returns its size, 0 if it
// does not fit.
static size_t write_png(const sgs_image8 *image, const uint8_t *rows, size_t row_bytes,
                        uint8_t *bytes, size_t capacity, struct libdeflate_compressor *deflate)
{
    static const uint8_t magic[8] = {137, 'P', 'N', 'G', 13, 10, 26, 10};
    static const uint8_t format[5] = {8, 2, 0, 0, 0}; // 8 bits, RGB, deflate, no interlacing
    memcpy(bytes, magic, sizeof magic);
    uint8_t *chunk = bytes + sizeof magic;
    memcpy(chunk + 4, "IHDR", 4);
    uint8_t *at = put_number(chunk + 8, (uint32_t)image->width);
    at = put_number(at, (uint32_t)image->height);
    memcpy(at, format, sizeof format);
    chunk = end_chunk(chunk, at + sizeof format);
    memcpy(chunk + 4, "IDAT", 4);
    const size_t size = libdeflate_zlib_compress(deflate, rows, row_bytes, chunk + 8,
                                                 capacity - (size_t)(chunk + 8 - bytes));
    if (!size)
        return 0;
    chunk = end_chunk(chunk, chunk + 8 + size);
    memcpy(chunk + 4, "IEND", 4);
    return (size_t)(end_chunk(chunk, chunk + 8) - bytes);
}

bool encode_png(const sgs_image8 *image, encoded_picture *out)
{
    *out = (encoded_picture){0};
    if (!is_encodable(image))
        return false;
    const size_t stride = 3 * (size_t)image->width,
                 row_bytes = (stride + 1) * (size_t)image->height;
    struct libdeflate_compressor *deflate = libdeflate_alloc_compressor(PNG_LEVEL);
    uint8_t *rows = malloc(row_bytes), *work = malloc(4 * stride);
    // magic, IHDR, the frames of IDAT and IEND: 8 + 25 + 12 + 12 bytes
    const size_t capacity = deflate ? libdeflate_zlib_compress_bound(deflate, row_bytes) + 57 : 0;
    uint8_t *bytes = capacity ? malloc(capacity) : NULL;
    size_t size = 0;
    if (rows && work && bytes) {
        filter_rows(image, work, rows);
        size = write_png(image, rows, row_bytes, bytes, capacity - 16, deflate);
    }
    free(rows);
    free(work);
    if (deflate)
        libdeflate_free_compressor(deflate);
    if (!size) {
        free(bytes);
        return false;
    }
    *out = (encoded_picture){bytes, size};
    return true;
}

void encoded_picture_free(encoded_picture *picture)
{
    free(picture->bytes);
    *picture = (encoded_picture){0};
}
