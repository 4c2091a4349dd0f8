// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "viewer/photo_picture.h"

enum { QUALITY = 88 };

// Replaces straight alpha by the background.
static void composite(sgs_image8 *image, const float background[3])
{
    const size_t pixels = (size_t)image->width * (size_t)image->height;
    for (size_t c = 0; c < 3 && image->channels == 4; ++c)
        for (size_t i = 0; i < pixels; ++i) {
            const float alpha = (float)image->pixels[3 * pixels + i] / 255;
            uint8_t *value = &image->pixels[c * pixels + i];
            *value = (uint8_t)(alpha * (float)*value + 255 * (1 - alpha) * background[c] + 0.5F);
        }
    image->channels = 3;
}

bool photo_picture(const sgs_view *view, const float background[3], int side, encoded_picture *out)
{
    sgs_image8 image, small = {0};
    *out = (encoded_picture){0};
    if (sgs_image8_read(view->image_path, &image))
        return false;
    int width = view->camera.width < image.width ? view->camera.width : image.width,
        height = view->camera.height < image.height ? view->camera.height : image.height;
    const int longer = width > height ? width : height;
    if (longer > side) {
        width = width * side / longer > 0 ? width * side / longer : 1;
        height = height * side / longer > 0 ? height * side / longer : 1;
    }
    const bool same = width == image.width && height == image.height;
    bool done = same || !sgs_image8_downscale(&image, width, height, &small);
    if (done) {
        sgs_image8 shown = same ? image : small;
        composite(&shown, background);
        done = encode_jpeg(&shown, QUALITY, out);
    }
    sgs_image8_free(&image);
    sgs_image8_free(&small);
    return done;
}
