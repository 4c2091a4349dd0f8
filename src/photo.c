// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Decode, reduce, mask: in this order, so that a mask speaks of the photograph's own pixels.

#include "photo.h"

#include "core.h"
#include "mask.h"
#include "sparegs/image.h"

void sgsi_photo_free(sgs_photo *photo)
{
    sgsi_free(photo->pixels);
    sgsi_free(photo->keep);
    *photo = (sgs_photo){0};
}

static sgs_status read_pixels(const sgsi_photo_source *source, sgs_image8 *image)
{
    sgs_status status = sgs_image8_read(source->image_path, image);
    if (status || (source->width == image->width && source->height == image->height))
        return status;
    sgs_image8 reduced;
    status = sgs_image8_downscale(image, source->width, source->height, &reduced);
    sgs_image8_free(image);
    *image = reduced;
    return status;
}

// The alpha channel as a mask. Its plane is the last one and simply stays behind unused.
static sgs_status mask_by_alpha(sgs_photo *photo)
{
    const size_t plane = (size_t)photo->width * (size_t)photo->height;
    const sgs_status status = sgsi_mask_begin(photo);
    for (size_t at = 0; !status && at < plane; ++at)
        if (photo->pixels[3 * plane + at] < 128)
            sgsi_mask_drop(photo, photo->width, photo->height, (int)(at % (size_t)photo->width),
                           (int)(at / (size_t)photo->width));
    return status;
}

sgs_status sgsi_photo_load(const sgsi_photo_source *source, sgs_photo *photo, bool *mask_failed)
{
    *photo = (sgs_photo){0};
    *mask_failed = false;
    sgs_image8 image;
    sgs_status status = read_pixels(source, &image);
    if (status)
        return status;
    *photo =
        (sgs_photo){.width = image.width, .height = image.height, .channels = image.channels, .pixels = image.pixels};
    if (photo->channels == 4 && source->alpha == SGS_ALPHA_MASK)
        status = mask_by_alpha(photo);
    if (photo->channels == 4 && source->alpha != SGS_ALPHA_OVER)
        photo->channels = 3;
    if (!status && source->mask_path) {
        status = sgsi_mask_apply_file(photo, source->mask_path, source->image_path, source->file_width,
                                      source->file_height, source->invert_mask);
        *mask_failed = status != SGS_STATUS_OK;
    }
    if (!status)
        status = sgsi_mask_intersect(photo, source->lens);
    if (status)
        sgsi_photo_free(photo);
    else
        sgsi_mask_finish(photo);
    return status;
}
