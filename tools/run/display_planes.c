// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/display_planes.h"

#include <stdlib.h>

#include "sparegs/metrics.h"

float *photo_flatten(const sgs_photo *photo, const float background[3])
{
    const size_t pixels = (size_t)photo->width * (size_t)photo->height;
    float *planes = malloc(3 * pixels * sizeof *planes);
    for (size_t i = 0; planes && i < pixels; ++i) {
        const float alpha = photo->channels > 3 ? sgs_photo_value(photo, 3 * pixels + i) : 1.0F;
        for (size_t c = 0; c < 3; ++c)
            planes[c * pixels + i] =
                alpha * sgs_photo_value(photo, c * pixels + i) + (1.0F - alpha) * background[c];
    }
    return planes;
}

sgs_status planes_quantise(float *const color[3], sgs_space space, int width, int height,
                           sgs_image8 *out)
{
    const size_t pixels = (size_t)width * (size_t)height;
    for (size_t c = 0; c < 3 && space == SGS_SPACE_LINEAR; ++c)
        for (size_t i = 0; i < pixels; ++i)
            color[c][i] = sgs_srgb_encode(color[c][i]);
    return sgs_image8_from_planes((const float *const *)color, NULL, NULL, width, height, out);
}
