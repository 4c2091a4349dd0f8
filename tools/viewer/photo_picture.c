// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "viewer/photo_picture.h"

#include "sparegs/metrics.h"

enum { QUALITY = 88, SIDE_THUMBNAIL = 160, SIDE_WHOLE = 4096 };

static int scaled(int length, int side, int longer)
{
    const int reduced = (int)((long long)length * side / longer);
    return reduced > 0 ? reduced : 1;
}

// The size of the view's camera, reduced to at most SIDE_WHOLE or SIDE_THUMBNAIL.
static void size_of(const sgs_scene *scene, size_t index, photo_use use, int *width, int *height)
{
    const int side = use == PHOTO_WHOLE ? SIDE_WHOLE : SIDE_THUMBNAIL;
    *width = scene->views[index].camera.width;
    *height = scene->views[index].camera.height;
    const int longer = *width > *height ? *width : *height;
    if (longer > side) {
        *width = scaled(*width, side, longer);
        *height = scaled(*height, side, longer);
    }
}

size_t photo_picture_bytes(const sgs_scene *scene, size_t index, photo_use use)
{
    enum { PIXEL_BYTES = 40 }; // the photo, its planes, 8-bit pixels and the encoder's
    int width, height;
    size_of(scene, index, use, &width, &height);
    return scene->decode_bytes + PIXEL_BYTES * (size_t)width * (size_t)height;
}

// The photo as it is displayed.
static bool read_displayed(const sgs_scene *scene, size_t index, const float background[3],
                           photo_use use, sgs_image8 *out)
{
    sgs_photo photo;
    int width, height;
    size_of(scene, index, use, &width, &height);
    if (sgs_scene_photo_read(scene, index, width, height, &photo))
        return false;
    const bool done = !sgs_image8_from_photo(&photo, background, scene->space, out);
    sgs_photo_free(&photo);
    return done;
}

bool photo_picture(const sgs_scene *scene, size_t index, const float background[3], photo_use use,
                   encoded_picture *out)
{
    const bool is_whole = use == PHOTO_WHOLE;
    sgs_image8 image;
    *out = (encoded_picture){0};
    if (!read_displayed(scene, index, background, use, &image))
        return false;
    const bool done = is_whole ? encode_png(&image, out) : encode_jpeg(&image, QUALITY, out);
    sgs_image8_free(&image);
    return done;
}

const char *photo_media_type(photo_use use)
{
    return use == PHOTO_WHOLE ? "image/png" : "image/jpeg";
}
