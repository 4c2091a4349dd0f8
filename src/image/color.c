// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Pixel values: the sRGB transfer function (IEC 61966-2-1), extended above 1, and half floats.

#include <math.h>

#include "image/half.h"
#include "sparegs/image.h"

float sgs_srgb_encode(float linear)
{
    return linear <= 0.0031308f ? 12.92f * linear : 1.055f * powf(linear, 1.0f / 2.4f) - 0.055f;
}

float sgs_srgb_decode(float encoded)
{
    return encoded <= 0.04045f ? encoded / 12.92f : powf((encoded + 0.055f) / 1.055f, 2.4f);
}

float sgs_photo_value(const sgs_photo *photo, size_t at)
{
    return photo->halves ? sgsi_half_to_float(photo->halves[at])
                         : (float)photo->pixels[at] / 255.0f;
}
