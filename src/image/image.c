// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// 8-bit photos: reading, exact area averaging, PNG. Files are decoded by OpenImageIO through
// image_oiio.h.
//
// Area averaging uses integers. In units of 1 / out_width of a source pixel, source column x covers
// [x out_width, (x+1) out_width) and output column i covers [i width, (i+1) width). The overlaps
// are the weights; they sum to `width`, and only the final division rounds. With straight alpha,
// colours are weighted by alpha so that hidden colours of transparent pixels do not bleed in;
// compositing then commutes with averaging.

#include "sparegs/image.h"

#include <libdeflate.h>
#include <stdio.h>
#include <string.h>

#include "base/big_endian.h"
#include "base/core.h"
#include "image/image_oiio.h"
#include "sparegs/output_file.h"

// Returns the marker that ends a scan. In entropy-coded data, 0xff is followed by 0 or a restart
// marker only.
static int scan_end(FILE *stream)
{
    int c = getc_unlocked(stream);
    while (c != EOF) {
        if (c != 0xff) {
            c = getc_unlocked(stream);
            continue;
        }
        c = getc_unlocked(stream);
        if (c != 0 && c != 0xff && !(c >= 0xd0 && c <= 0xd7))
            return c;
    }
    return EOF;
}

// Parses the segments of a JPEG file (ITU T.81, annex B) after its first two bytes. Returns true if
// the file ends before the end-of-image marker; data that cameras append after it is ignored.
static bool jpeg_ends_early(FILE *stream)
{
    int marker = 0xd8;
    while (marker != 0xd9) {
        if (marker != 0xd8) {
            const int high = getc_unlocked(stream), low = getc_unlocked(stream);
            if (low == EOF || fseek(stream, high * 256L + low - 2, SEEK_CUR))
                return true;
        }
        if (marker == 0xda) {
            marker = scan_end(stream);
        } else {
            marker = getc_unlocked(stream);
            if (marker != EOF && marker != 0xff)
                return false; // not a segment: left to the decoder
            while (marker == 0xff)
                marker = getc_unlocked(stream);
        }
        if (marker == EOF)
            return true;
    }
    return false;
}

// CRC-32 of the type and the content of a chunk, which it reads. False if the file ends before.
static bool chunk_crc(FILE *stream, const uint8_t type[4], size_t size, uint32_t *crc)
{
    uint8_t block[1 << 14];
    *crc = libdeflate_crc32(0, type, 4);
    while (size) {
        const size_t part = size < sizeof block ? size : sizeof block;
        if (fread(block, 1, part, stream) != part)
            return false;
        *crc = libdeflate_crc32(*crc, block, part);
        size -= part;
    }
    return true;
}

typedef enum soundness { SOUND, TRUNCATED, DAMAGED, FOREIGN } soundness;

// A type that libpng does not end with an error: four letters, and a critical chunk of PNG. FOREIGN
// are those of other formats, such as CgBI of iOS.
static soundness check_type(const uint8_t type[4], bool first, bool *critical)
{
    static const char *const known[] = {"IHDR", "PLTE", "IDAT"};
    for (int k = 0; k < 4; ++k)
        if ((type[k] | 0x20) < 'a' || (type[k] | 0x20) > 'z')
            return DAMAGED;
    *critical = !(type[0] & 0x20);
    bool is_known = !*critical;
    for (size_t k = 0; k < sizeof known / sizeof *known; ++k)
        is_known = is_known || !memcmp(type, known[k], 4);
    if (!is_known)
        return !memcmp(type, "CgBI", 4) ? FOREIGN : DAMAGED;
    return first == !memcmp(type, "IHDR", 4) ? SOUND : DAMAGED;
}

// Reads the chunks up to IEND. With `pixels` also the checksums of the pixels, otherwise only those
// of other critical chunks. *at: begin of the damaged chunk.
static soundness check_png(FILE *stream, bool pixels, size_t *at)
{
    uint8_t head[8], stored[4];
    *at = 0;
    if (fseek(stream, 0, SEEK_SET) || fread(head, 1, sizeof head, stream) != sizeof head)
        return TRUNCATED;
    if (memcmp(head + 4, "\r\n\x1a\n", 4) != 0) // by a transfer as text
        return DAMAGED;
    *at = 8;
    bool has_pixels = false;
    while (fread(head, 1, sizeof head, stream) == sizeof head) {
        const uint8_t *type = head + 4;
        const size_t size = sgsi_big_endian32(head);
        bool critical;
        uint32_t crc;
        if (*at > 8 && !memcmp(type, "IEND", 4))
            return has_pixels ? SOUND : DAMAGED;
        const soundness named = check_type(type, *at == 8, &critical);
        if (size > INT32_MAX || named)
            return named ? named : DAMAGED;
        const bool is_pixels = !memcmp(type, "IDAT", 4);
        has_pixels = has_pixels || is_pixels;
        if (!critical || (is_pixels && !pixels)) {
            if (fseek(stream, (long)size + 4, SEEK_CUR))
                return TRUNCATED;
        } else {
            if (!chunk_crc(stream, type, size, &crc) ||
                fread(stored, 1, sizeof stored, stream) != sizeof stored)
                return TRUNCATED;
            if (crc != sgsi_big_endian32(stored))
                return DAMAGED;
        }
        *at += size + 12;
    }
    return TRUNCATED;
}

// Fails before decoders run: those of JPEG fill the missing part with grey without an error, which
// would then be trained; libpng prints errors to the terminal.
sgs_status sgsi_image_check_complete(const char *path, bool pixels)
{
    FILE *stream;
    size_t size, at = 0;
    if (sgsi_file_open(path, &stream, &size))
        return SGS_STATUS_OK; // the decoder reports the reason
    uint8_t start[4] = {0};
    const size_t got = fread(start, 1, sizeof start, stream);
    soundness found = SOUND;
    if (got == 4 && start[0] == 0xff && start[1] == 0xd8)
        found = fseek(stream, 2, SEEK_SET) || jpeg_ends_early(stream) ? TRUNCATED : SOUND;
    else if (got == 4 && !memcmp(start, "\x89PNG", 4))
        found = check_png(stream, pixels, &at);
    fclose(stream);
    if (found == TRUNCATED)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: the image file is truncated; copy it again", path);
    if (found == FOREIGN)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: a PNG file of iOS (CgBI), which is not standard; convert it", path);
    return found == SOUND
               ? SGS_STATUS_OK
               : sgsi_fail(SGS_STATUS_FORMAT,
                           "%s: byte %zu: the image file is damaged; copy it again", path, at);
}

sgs_status sgsi_image_read_checked(const char *path, bool is_mask, sgs_image8 *image)
{
    *image = (sgs_image8){0};
    const sgs_status status = sgsi_image_check_complete(path, true);
    return status ? status : sgsi_oiio_read(path, is_mask, image);
}

sgs_status sgs_image8_read(const char *path, sgs_image8 *image)
{
    return sgsi_image_read_checked(path, false, image);
}

sgs_status sgs_image8_probe(const char *path, int *width, int *height)
{
    int channels;
    const sgs_status status = sgsi_image_check_complete(path, false);
    return status ? status : sgsi_oiio_probe(path, width, height, &channels);
}

void sgs_image8_free(sgs_image8 *image)
{
    sgsi_free(image->pixels);
    *image = (sgs_image8){0};
}

// Weight of source cell `index` for output cell `out`, in units of 1 / out_size source cells.
static uint64_t overlap(uint64_t index, uint64_t out, uint64_t size, uint64_t out_size)
{
    const uint64_t begin = index * out_size > out * size ? index * out_size : out * size;
    const uint64_t end =
        (index + 1) * out_size < (out + 1) * size ? (index + 1) * out_size : (out + 1) * size;
    return end > begin ? end - begin : 0;
}

// Sums the source rows under output row `out_y`: sums[x] = sum of weight * value (* alpha if
// given).
static void sum_rows(const sgs_image8 *image, const uint8_t *plane, const uint8_t *alpha,
                     uint64_t out_y, uint64_t out_height, uint64_t *sums)
{
    const size_t width = (size_t)image->width;
    const uint64_t height = (uint64_t)image->height;
    memset(sums, 0, width * sizeof *sums);
    for (uint64_t y = out_y * height / out_height;
         y < height && y * out_height < (out_y + 1) * height; ++y) {
        const uint64_t weight = overlap(y, out_y, height, out_height);
        const uint8_t *row = plane + y * width;
        if (!alpha) {
            for (size_t x = 0; x < width; ++x)
                // NOLINTNEXTLINE(clang-analyzer-core.NullDereference): row is in the image's plane
                sums[x] += weight * row[x];
            continue;
        }
        const uint8_t *alpha_row = alpha + y * width;
        for (size_t x = 0; x < width; ++x)
            sums[x] += weight * row[x] * alpha_row[x];
    }
}

// Sums the columns under each output column.
static void sum_columns(const uint64_t *sums, uint64_t width, uint64_t out_width, uint64_t *out)
{
    for (uint64_t i = 0; i < out_width; ++i) {
        out[i] = 0;
        for (uint64_t x = i * width / out_width; x < width && x * out_width < (i + 1) * width; ++x)
            out[i] += overlap(x, i, width, out_width) * sums[x];
    }
}

// Fast path for blocks of k x k pixels without alpha; same result. All areas are k^2, so (S + k^2 /
// 2) / k^2 is a multiplication and a shift: with m = ceil(2^32 / k^2), n m >> 32 = n / k^2 for
// every n below 2^32 / k^2 (Granlund and Montgomery 1994, theorem 4.2), and n is below 256 k^2.
enum { WHOLE_FACTOR_MAX = 16 };

static void downscale_whole(const sgs_image8 *image, size_t factor, sgs_image8 *out,
                            uint32_t *row_sums)
{
    const size_t width = (size_t)image->width, out_width = (size_t)out->width,
                 out_height = (size_t)out->height;
    const uint32_t area = (uint32_t)(factor * factor);
    const uint64_t reciprocal = ((UINT64_C(1) << 32) + area - 1) / area;
    for (size_t row = 0; row < out_height * (size_t)image->channels; ++row) {
        const uint8_t *in = image->pixels + row * factor * width;
        uint8_t *to = out->pixels + row * out_width;
        for (size_t x = 0; x < width; ++x)
            row_sums[x] = in[x];
        for (size_t k = 1; k < factor; ++k)
            for (size_t x = 0; x < width; ++x)
                row_sums[x] += in[k * width + x];
        for (size_t x = 0; x < out_width; ++x) {
            uint32_t sum = area / 2;
            for (size_t k = 0; k < factor; ++k)
                sum += row_sums[x * factor + k];
            to[x] = (uint8_t)(sum * reciprocal >> 32);
        }
    }
}

// The factor of the fast path, or 0 if it does not apply.
static size_t whole_factor(const sgs_image8 *image, const sgs_image8 *out)
{
    const int factor = image->width / out->width;
    const bool whole = factor * out->width == image->width && factor * out->height == image->height;
    return whole && factor <= WHOLE_FACTOR_MAX && image->channels < 4 ? (size_t)factor : 0;
}

static void downscale(const sgs_image8 *image, sgs_image8 *out, uint64_t *row_sums, uint64_t *sums,
                      uint64_t *alpha_sums)
{
    const size_t plane = (size_t)image->width * (size_t)image->height;
    const size_t out_width = (size_t)out->width, out_plane = out_width * (size_t)out->height;
    const uint64_t area = (uint64_t)image->width * (uint64_t)image->height;
    const uint8_t *alpha = image->channels == 4 ? image->pixels + 3 * plane : NULL;
    for (int y = 0; y < out->height; ++y) {
        if (alpha) {
            sum_rows(image, alpha, NULL, (uint64_t)y, (uint64_t)out->height, row_sums);
            sum_columns(row_sums, (uint64_t)image->width, out_width, alpha_sums);
        }
        for (int c = 0; c < image->channels; ++c) {
            const uint8_t *in = image->pixels + (size_t)c * plane;
            uint8_t *to = out->pixels + (size_t)c * out_plane + (size_t)y * out_width;
            const bool weighted = alpha && c < 3;
            sum_rows(image, in, weighted ? alpha : NULL, (uint64_t)y, (uint64_t)out->height,
                     row_sums);
            sum_columns(row_sums, (uint64_t)image->width, out_width, sums);
            for (size_t x = 0; x < out_width; ++x) {
                const uint64_t divisor = weighted ? alpha_sums[x] : area;
                to[x] = divisor ? (uint8_t)((sums[x] + divisor / 2) / divisor) : 0;
            }
        }
    }
}

sgs_status sgs_image8_downscale(const sgs_image8 *image, int out_width, int out_height,
                                sgs_image8 *out)
{
    *out = (sgs_image8){0};
    if (out_width < 1 || out_height < 1 || out_width > image->width || out_height > image->height)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "cannot reduce an image of %d x %d pixels to %d x %d", image->width,
                         image->height, out_width, out_height);
    const size_t width = (size_t)image->width;
    uint64_t *row_sums = sgsi_alloc(width + 2 * (size_t)out_width, sizeof *row_sums);
    uint8_t *pixels = sgsi_alloc((size_t)out_width * (size_t)out_height, (size_t)image->channels);
    if (!row_sums || !pixels) {
        sgsi_free(row_sums);
        sgsi_free(pixels);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory to reduce an image to %d x %d", out_width, out_height);
    }
    *out = (sgs_image8){
        .width = out_width, .height = out_height, .channels = image->channels, .pixels = pixels};
    const size_t factor = whole_factor(image, out);
    if (factor)
        downscale_whole(image, factor, out, (uint32_t *)row_sums);
    else
        downscale(image, out, row_sums, row_sums + width, row_sums + width + out_width);
    sgsi_free(row_sums);
    return SGS_STATUS_OK;
}

sgs_status sgs_png_write(const char *path, const sgs_image8 *image)
{
    return sgs_png_write_described(path, image, NULL);
}

sgs_status sgs_png_write_described(const char *path, const sgs_image8 *image,
                                   const char *description)
{
    if (image->channels != 1 && image->channels != 3 && image->channels != 4)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: %d channels are not supported in a PNG",
                         path, image->channels);
    if (image->width < 1 || image->height < 1 || !image->pixels)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: cannot write an empty image as PNG",
                         path);
    uint8_t *bytes;
    size_t size;
    sgs_status status = sgsi_oiio_png_encode(path, image, description, &bytes, &size);
    if (status)
        return status;
    status = sgs_output_file_write(path, bytes, size);
    sgsi_free(bytes);
    return status;
}
