// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Pictures as bytes in memory, for a browser: JPEG (libjpeg-turbo) and lossless PNG.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/image.h"

typedef struct encoded_picture {
    uint8_t *bytes; // [size]
    size_t size;
} encoded_picture;

// image: 3 channels. quality: 1 to 100. Release with encoded_picture_free. False if encoding fails
// (no memory, or sides above 65500 pixels).
bool encode_jpeg(const sgs_image8 *image, int quality, encoded_picture *out);
bool encode_png(const sgs_image8 *image, encoded_picture *out);
void encoded_picture_free(encoded_picture *picture);
