// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "storage/unpack.h"

#include <libdeflate.h>
#include <zstd.h>
#include <zstd_errors.h>

#include "base/core.h"

enum { FIRST_FACTOR = 4, MIN_BUFFER = 4096 };

typedef enum attempt { ATTEMPT_DONE, ATTEMPT_TOO_SMALL, ATTEMPT_CORRUPT } attempt;

static attempt try_deflate(struct libdeflate_decompressor *decompressor, sgsi_packing packing,
                           const uint8_t *in, size_t size, uint8_t *out, size_t room, size_t *used)
{
    const enum libdeflate_result result =
        packing == SGSI_PACKING_GZIP
            ? libdeflate_gzip_decompress(decompressor, in, size, out, room, used)
            : libdeflate_deflate_decompress(decompressor, in, size, out, room, used);
    if (result == LIBDEFLATE_SUCCESS)
        return ATTEMPT_DONE;
    return result == LIBDEFLATE_INSUFFICIENT_SPACE ? ATTEMPT_TOO_SMALL : ATTEMPT_CORRUPT;
}

static attempt try_zstd(const uint8_t *in, size_t size, uint8_t *out, size_t room, size_t *used)
{
    *used = ZSTD_decompress(out, room, in, size);
    if (!ZSTD_isError(*used))
        return ATTEMPT_DONE;
    return ZSTD_getErrorCode(*used) == ZSTD_error_dstSize_tooSmall ? ATTEMPT_TOO_SMALL
                                                                   : ATTEMPT_CORRUPT;
}

sgs_status sgsi_unpack(sgsi_packing packing, const char *path, const char *what, const uint8_t *in,
                       size_t size, size_t most, uint8_t **out, size_t *out_size)
{
    struct libdeflate_decompressor *decompressor =
        packing == SGSI_PACKING_ZSTD ? NULL : libdeflate_alloc_decompressor();
    size_t room = size < most / FIRST_FACTOR ? FIRST_FACTOR * size : most;
    attempt result = ATTEMPT_TOO_SMALL;
    bool no_memory = packing != SGSI_PACKING_ZSTD && !decompressor;
    *out = NULL;
    room = room < MIN_BUFFER && MIN_BUFFER < most ? MIN_BUFFER : room;
    while (!no_memory) {
        *out = sgsi_alloc(room + 1, 1);
        no_memory = !*out;
        if (no_memory)
            break;
        result = packing == SGSI_PACKING_ZSTD
                     ? try_zstd(in, size, *out, room, out_size)
                     : try_deflate(decompressor, packing, in, size, *out, room, out_size);
        if (result != ATTEMPT_TOO_SMALL || room == most)
            break;
        sgsi_free(*out);
        *out = NULL;
        room = room < most / 2 ? 2 * room : most;
    }
    libdeflate_free_decompressor(decompressor);
    if (!no_memory && result == ATTEMPT_DONE)
        return SGS_STATUS_OK;
    sgsi_free(*out);
    *out = NULL;
    if (no_memory)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to decompress %s", path,
                         what);
    if (result == ATTEMPT_TOO_SMALL)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s decompresses to more than %zu bytes", path,
                         what, most);
    return sgsi_fail(SGS_STATUS_FORMAT,
                     "%s: %s cannot be decompressed; the file is truncated or "
                     "corrupt",
                     path, what);
}

sgs_status sgsi_pack(sgsi_packing packing, int level, const uint8_t *in, size_t size, uint8_t **out,
                     size_t *out_size)
{
    struct libdeflate_compressor *compressor =
        packing == SGSI_PACKING_ZSTD ? NULL : libdeflate_alloc_compressor(level);
    const size_t bound = packing == SGSI_PACKING_ZSTD
                             ? ZSTD_compressBound(size)
                             : libdeflate_gzip_compress_bound(compressor, size);
    *out_size = 0;
    *out = sgsi_alloc(bound, 1);
    if (*out && packing == SGSI_PACKING_ZSTD) {
        *out_size = ZSTD_compress(*out, bound, in, size, level);
        *out_size = ZSTD_isError(*out_size) ? 0 : *out_size;
    } else if (*out && compressor) {
        *out_size = packing == SGSI_PACKING_GZIP
                        ? libdeflate_gzip_compress(compressor, in, size, *out, bound)
                        : libdeflate_deflate_compress(compressor, in, size, *out, bound);
    }
    libdeflate_free_compressor(compressor);
    if (*out_size)
        return SGS_STATUS_OK;
    sgsi_free(*out);
    *out = NULL;
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to compress %zu bytes", size);
}
