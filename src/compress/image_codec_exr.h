// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The OpenEXR codec of image_codec.h, with the same contracts.

#include "compress/image_codec.h"

sgs_status sgsi_exr_image_encode(const sgsi_image16 *image, uint8_t **bytes, size_t *size);
bool sgsi_exr_image_decode(const uint8_t *bytes, size_t size, const sgsi_image16 *image);
