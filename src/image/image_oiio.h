// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The C face of OpenImageIO, which has none of its own. Only image_oiio.cpp knows OpenImageIO. No
// exception leaves these functions.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/image.h"

#ifdef __cplusplus
extern "C" {
#endif

// As sgs_image8_read.
sgs_status sgsi_oiio_read(const char *path, sgs_image8 *image);

// Size and channels (3 or 4, as sgsi_oiio_read would deliver) from the header.
sgs_status sgsi_oiio_probe(const char *path, int *width, int *height, int *channels);

// What a photograph's file holds, as far as reading it needs to know.
typedef struct sgsi_image_info {
    int width, height;
    int channels; // 3, or 4 with alpha
    bool bytes;   // 8-bit samples
    bool linear;  // sgsi_oiio_read_rows delivers linear light; else sRGB-encoded values
} sgsi_image_info;

// From the header. `colorspace` replaces what the file says of its colours, NULL = the file;
// without a word, floating point is linear and integers are sRGB. Fails with UNSUPPORTED for a
// colour space that OpenImageIO does not know (the error names those it knows) and for files
// without colour channels (it names the channels there are).
sgs_status sgsi_oiio_describe(const char *path, const char *colorspace, sgsi_image_info *info);

// One row of pixels, top row first: [width][channels], colour multiplied by alpha. Samples that are
// no numbers come as they are.
typedef void (*sgsi_row_fn)(void *context, int y, const float *row);

// Decodes a photograph into rows, converted from its colour space. On failure some rows may have
// been delivered.
sgs_status sgsi_oiio_read_rows(const char *path, const char *colorspace, sgsi_row_fn take,
                               void *context);

// Refuses pictures that were cut off, as sgs_image8_read does; and sgsi_oiio_probe for whole files
// only. In image.c.
sgs_status sgsi_image_refuse_truncated(const char *path);
sgs_status sgsi_image8_probe(const char *path, int *width, int *height, int *channels);

// Encodes a PNG into fresh memory (sgsi_free). `path` is for messages only.
sgs_status sgsi_oiio_png_encode(const char *path, const sgs_image8 *image, uint8_t **bytes,
                                size_t *size);

// Encodes an EXR of these channels into fresh memory (sgsi_free), DWAA compressed: OpenEXR's C
// library learned that only in version 3.2. Header as sgs_exr_write's. `path` is for messages only.
sgs_status sgsi_oiio_dwaa_encode(const char *path, const sgs_exr_info *info,
                                 const sgs_exr_channel *channels, int channel_count,
                                 uint8_t **bytes, size_t *size);

#ifdef __cplusplus
}
#endif
