// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// ZIP compression after "OpenEXR File Layout": even bytes are moved before odd bytes, each byte is
// replaced by its difference from the previous one plus 128, and the result is deflated.
//
// OpenEXR's own code is not used: OpenEXR 3.1 uses zlib; libdeflate, used since OpenEXR 3.2, is
// three times as fast at the same size. Deep files need this code in any case (exr_deep.c).

#include "image/exr_zip.h"

#include <libdeflate.h>

#include "base/core.h"

struct sgsi_exr_zip {
    int threads, level;
    size_t largest;
    uint8_t *spare;                           // [threads][largest]
    struct libdeflate_compressor **deflaters; // [threads]
};

sgsi_exr_zip *sgsi_exr_zip_create(int threads, int level, size_t largest)
{
    sgsi_exr_zip *zip = sgsi_calloc(1, sizeof *zip);
    if (!zip)
        return NULL;
    zip->level = level;
    if (sgsi_exr_zip_reserve(zip, threads, largest))
        return zip;
    sgsi_exr_zip_destroy(zip);
    return NULL;
}

void sgsi_exr_zip_destroy(sgsi_exr_zip *zip)
{
    for (int k = 0; zip && k < zip->threads; ++k)
        libdeflate_free_compressor(zip->deflaters[k]);
    if (zip) {
        sgsi_free(zip->deflaters);
        sgsi_free(zip->spare);
    }
    sgsi_free(zip);
}

static bool add_threads(sgsi_exr_zip *zip, int threads)
{
    if (!sgsi_grow((void **)&zip->deflaters, (size_t)zip->threads, (size_t)threads,
                   sizeof *zip->deflaters))
        return false;
    for (; zip->threads < threads; ++zip->threads) {
        zip->deflaters[zip->threads] = libdeflate_alloc_compressor(zip->level);
        if (!zip->deflaters[zip->threads])
            return false;
    }
    return true;
}

bool sgsi_exr_zip_reserve(sgsi_exr_zip *zip, int threads, size_t largest)
{
    if (threads <= zip->threads && largest <= zip->largest)
        return true;
    if (threads > zip->threads && !add_threads(zip, threads))
        return false;
    sgsi_free(zip->spare);
    largest = largest > zip->largest ? largest : zip->largest;
    zip->spare = sgsi_alloc((size_t)zip->threads * largest, 1);
    zip->largest = zip->spare ? largest : 0;
    return zip->spare != NULL;
}

size_t sgsi_exr_zip_pack(sgsi_exr_zip *zip, int thread, const uint8_t *raw, size_t count,
                         uint8_t *out)
{
    uint8_t *const even = zip->spare + (size_t)thread * zip->largest, *const odd =
                                                                          even + (count + 1) / 2;
    for (size_t i = 0; i < count / 2; ++i) {
        even[i] = raw[2 * i];
        odd[i] = raw[2 * i + 1];
    }
    if (count & 1)
        even[count / 2] = raw[count - 1];
    for (size_t i = count; i-- > 1;)
        even[i] = (uint8_t)(even[i] - even[i - 1] + 128);
    return count > 1 ? libdeflate_zlib_compress(zip->deflaters[thread], even, count, out, count - 1)
                     : 0;
}

bool sgsi_exr_zip_unpack(const uint8_t *packed, size_t size, uint8_t *scratch, uint8_t *out,
                         size_t count)
{
    struct libdeflate_decompressor *inflater = libdeflate_alloc_decompressor();
    size_t used = 0;
    const bool done = inflater && !libdeflate_zlib_decompress_ex(inflater, packed, size, scratch,
                                                                 count, &used, NULL);
    libdeflate_free_decompressor(inflater);
    if (!done || used != size)
        return false;
    for (size_t i = 1; i < count; ++i)
        scratch[i] = (uint8_t)(scratch[i] + scratch[i - 1] - 128);
    const uint8_t *const even = scratch, *const odd = scratch + (count + 1) / 2;
    for (size_t i = 0; i < count; ++i)
        out[i] = i & 1 ? odd[i / 2] : even[i / 2];
    return true;
}
