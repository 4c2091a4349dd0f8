// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Lossless WebP images that hold data: RGBA bytes, exact also where alpha is 0.

#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

typedef struct sgsi_webp {
    int width, height;
    uint8_t *rgba; // [height][width][4]
} sgsi_webp;

// most_pixels: larger images are refused before memory is allocated. `path` and `name` appear in
// errors. Release rgba with sgsi_webp_free. Fails with FORMAT, LIMIT or OUT_OF_MEMORY.
sgs_status sgsi_webp_decode(const char *path, const char *name, const uint8_t *bytes, size_t size,
                            size_t most_pixels, sgsi_webp *image);
void sgsi_webp_free(sgsi_webp *image);

// The caller frees *bytes with sgsi_free. Fails with OUT_OF_MEMORY or LIMIT (16383 pixels per
// side).
sgs_status sgsi_webp_encode(const sgsi_webp *image, uint8_t **bytes, size_t *size);
