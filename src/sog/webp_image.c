// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "sog/webp_image.h"

#include <string.h>
#include <webp/decode.h>
#include <webp/encode.h>

#include "base/core.h"

// Of 0 (fast) to 9 (small).
enum { LOSSLESS_LEVEL = 4 };

sgs_status sgsi_webp_decode(const char *path, const char *name, const uint8_t *bytes, size_t size,
                            size_t most_pixels, sgsi_webp *image)
{
    WebPBitstreamFeatures features;
    *image = (sgsi_webp){0};
    if (WebPGetFeatures(bytes, size, &features) != VP8_STATUS_OK)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s is not a WebP image, or truncated", path, name);
    if (features.has_animation || features.format == 1)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED, "%s: %s is a lossy or animated WebP image", path,
                         name);
    const size_t pixels = (size_t)features.width * (size_t)features.height;
    if (pixels > most_pixels)
        return sgsi_fail(SGS_STATUS_LIMIT,
                         "%s: %s has %d x %d pixels, more than a file of this size can hold", path,
                         name, features.width, features.height);
    image->width = features.width;
    image->height = features.height;
    image->rgba = sgsi_alloc(pixels + 1, 4);
    if (!image->rgba)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for %s", path, name);
    if (WebPDecodeRGBAInto(bytes, size, image->rgba, 4 * pixels, 4 * features.width))
        return SGS_STATUS_OK;
    sgsi_webp_free(image);
    return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s cannot be decoded; it is truncated or corrupt",
                     path, name);
}

void sgsi_webp_free(sgsi_webp *image)
{
    sgsi_free(image->rgba);
    *image = (sgsi_webp){0};
}

sgs_status sgsi_webp_encode(const sgsi_webp *image, uint8_t **bytes, size_t *size)
{
    WebPConfig config;
    WebPPicture picture;
    WebPMemoryWriter writer;
    *bytes = NULL;
    if (image->width > WEBP_MAX_DIMENSION || image->height > WEBP_MAX_DIMENSION)
        return sgsi_fail(SGS_STATUS_LIMIT, "an image of %d x %d pixels exceeds the %d of WebP",
                         image->width, image->height, WEBP_MAX_DIMENSION);
    bool done = WebPConfigInit(&config) && WebPConfigLosslessPreset(&config, LOSSLESS_LEVEL) &&
                WebPPictureInit(&picture);
    config.exact = 1; // colours under alpha 0 are data
    WebPMemoryWriterInit(&writer);
    if (done) {
        picture.use_argb = 1;
        picture.width = image->width;
        picture.height = image->height;
        picture.writer = WebPMemoryWrite;
        picture.custom_ptr = &writer;
        done = WebPPictureImportRGBA(&picture, image->rgba, 4 * image->width) &&
               WebPEncode(&config, &picture);
        WebPPictureFree(&picture);
    }
    *bytes = done ? sgsi_alloc(writer.size + 1, 1) : NULL;
    if (*bytes) {
        memcpy(*bytes, writer.mem, writer.size);
        *size = writer.size;
    }
    WebPMemoryWriterClear(&writer);
    return *bytes
               ? SGS_STATUS_OK
               : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to compress %d x %d pixels",
                           image->width, image->height);
}
