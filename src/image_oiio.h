// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The C face of OpenImageIO, which has none of its own. Only image_oiio.cpp knows OpenImageIO. No exception
// leaves these functions.

#include <stddef.h>
#include <stdint.h>

#include "sparegs/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

// As sgs_image8_read.
sgs_status sgsi_oiio_read(const char *path, sgs_image8 *image);

// Size and channels (3 or 4, as sgsi_oiio_read would deliver) from the header.
sgs_status sgsi_oiio_probe(const char *path, int *width, int *height, int *channels);

// The same for whole files only: refuses a truncated picture, as sgs_image8_read does. In image.c.
sgs_status sgsi_image8_probe(const char *path, int *width, int *height, int *channels);

// Encodes a PNG into fresh memory (sgsi_free). `path` is for messages only.
sgs_status sgsi_oiio_png_encode(const char *path, const sgs_image8 *image, uint8_t **bytes, size_t *size);

#ifdef __cplusplus
}
#endif
