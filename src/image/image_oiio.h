// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// C interface to OpenImageIO, which only image_oiio.cpp and oiio_color.h include. No exception
// leaves these functions.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/image.h"

#ifdef __cplusplus
extern "C" {
#endif

// See sgs_image8_read. is_mask: samples above 0 become at least 1, such as the labels 1 to 128 of a
// mask of 16 bits, which are otherwise rounded to 0.
sgs_status sgsi_oiio_read(const char *path, bool is_mask, sgs_image8 *image);

// Size and channels (3 or 4, as from sgsi_oiio_read), from the header only.
sgs_status sgsi_oiio_probe(const char *path, int *width, int *height, int *channels);

// What the user should check in a photo's file: which of several layers with colours it is; a
// colour space that is unknown or contradicts others; an ICC profile that is not applied.
enum { SGSI_NOTE_LAYER, SGSI_NOTE_COLOR, SGSI_NOTE_PROFILE, SGSI_NOTES, SGSI_NOTE_SIZE = 256 };
enum { SGSI_SPACE_SIZE = 64 };

// Properties of a photo's file that affect its decoding.
typedef struct sgsi_image_info {
    int width, height;
    int channels; // 3, or 4 with alpha
    bool bytes;   // 8-bit samples
    bool linear;  // sgsi_oiio_read_rows returns linear light; otherwise sRGB-encoded values
    // Values of the file are in proportion to light, so that the white level of the scene applies
    // to them. false: they are encoded for display, 1 is white, also if `linear`.
    bool scene_linear;
    // Of the picture that the file holds a part of, or that is a part of it (EXR: of the display
    // window); usually those of the pixels.
    int full_width, full_height;
    bool is_exr;
    int left, top;   // of an EXR file: position of the data window in the display window
    int orientation; // Exif, 1 to 8, of the file; not applied. 1 = upright, or not recorded
    char space[SGSI_SPACE_SIZE]; // name of the colour space: of the file, or `colorspace`
    char notes[SGSI_NOTES][SGSI_NOTE_SIZE]; // for warnings that name the file; "" = none
} sgsi_image_info;

// Reads the header. `colorspace` overrides the file's colour space; NULL = use the file's, or if
// absent linear for floats and sRGB for integers. Fails with UNSUPPORTED for colour spaces unknown
// to OpenImageIO (the error lists the known ones), for EXR files whose chromaticities are no
// primaries, and for files without colour channels (the error lists the channels).
sgs_status sgsi_oiio_describe(const char *path, const char *colorspace, sgsi_image_info *info);

// Receives a row of pixels, top row first: [width][channels], colour premultiplied by alpha. NaN
// and infinities are passed on.
typedef void (*sgsi_row_fn)(void *context, int y, const float *row);

// Decodes a photo row by row and converts its colour space; linear light has the primaries of
// Rec. 709, so that colours outside of its gamut have negative channels. On failure some rows may
// have been passed to `take`.
sgs_status sgsi_oiio_read_rows(const char *path, const char *colorspace, sgsi_row_fn take,
                               void *context);

// In image.c. Fails if the image file is truncated, or a PNG file is damaged. pixels: whether they
// will be decoded; otherwise, damage of their data is not looked for.
sgs_status sgsi_image_check_complete(const char *path, bool pixels);

// In image.c. sgsi_oiio_read of a file that is complete.
sgs_status sgsi_image_read_checked(const char *path, bool is_mask, sgs_image8 *image);

// Encodes a PNG to new memory (sgsi_free). `path` is used in errors only. `description`: its text
// chunk Description, or NULL.
sgs_status sgsi_oiio_png_encode(const char *path, const sgs_image8 *image, const char *description,
                                uint8_t **bytes, size_t *size);

// Encodes channels, sorted by name, as an EXR with DWAA compression to new memory (sgsi_free), for
// its chunks: OpenEXRCore compresses with DWAA only from version 3.2. The header has no attributes,
// and the names of channels that end in Y are changed so that these channels stay lossless. Names
// have at most 254 characters. `path` is used in errors only.
sgs_status sgsi_oiio_dwaa_encode(const char *path, const sgs_exr_info *info,
                                 const sgs_exr_channel *channels, int channel_count,
                                 uint8_t **bytes, size_t *size);

#ifdef __cplusplus
}
#endif
