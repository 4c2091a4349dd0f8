// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Lossless images of integers as JPEG XL, WebP or OpenEXR in memory.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/compress.h"

typedef struct sgsi_image16 {
    int width, height;
    int channels;     // 1 or 3
    bool wide;        // values above 255 occur
    uint16_t *pixels; // [height][width][channels]
} sgsi_image16;

// Whether the codec can store an image of this side.
bool sgsi_image_fits(sgs_image_codec codec, size_t side);

// OUT_OF_MEMORY, or INTERNAL if the library of the codec fails, both without a sentence. JPEG XL
// does not say that it has no memory. *bytes is released with free(), also after a failure.
sgs_status sgsi_image_encode(sgs_image_codec codec, const sgsi_image16 *image, uint8_t **bytes,
                             size_t *size);

// Fills image->pixels, which the caller allocated; the file must have exactly the size, channels
// and depth of `image`. False if not.
bool sgsi_image_decode(sgs_image_codec codec, const uint8_t *bytes, size_t size,
                       const sgsi_image16 *image);
