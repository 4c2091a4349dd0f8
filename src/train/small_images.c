// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// All views are reduced when the scale changes and kept until the next change. If the scene has an
// image cache, they may not fit in memory: each is reduced when it is used. Half-float photos
// are not reduced: a run with any of them trains at full resolution.

#include "train/small_images.h"

#include "base/core.h"
#include "image/mask.h"
#include "image/photo.h"
#include "sparegs/image.h"

static sgs_image8 pixels_of(const sgs_photo *photo)
{
    return (sgs_image8){.width = photo->width,
                        .height = photo->height,
                        .channels = photo->channels,
                        .pixels = photo->pixels};
}

// The photos of a plan.
typedef struct plan_source {
    sgsi_train_views *views;
    uint8_t *bytes; // of a photo with alpha, over the background
} plan_source;

static void view_size(void *context, size_t i, int *width, int *height)
{
    const sgsi_train_views *views = ((const plan_source *)context)->views;
    const sgs_camera *camera = &views->scene->views[views->scene_views[i]].camera;
    *width = camera->width;
    *height = camera->height;
}

static sgs_status photo_8bit(const sgsi_train_views *views, size_t i, const sgs_photo **photo)
{
    const sgs_status status = sgsi_train_view_photo(views, i, photo);
    if (status || (*photo)->pixels)
        return status;
    return sgsi_fail(SGS_STATUS_UNSUPPORTED, "%s: photos are not 8-bit", views->scene->path);
}

// What the loss compares: colours of transparent pixels do not count.
static sgs_status view_pixels(void *context, size_t i, sgs_image8 *image)
{
    plan_source *source = context;
    const sgs_photo *photo;
    sgsi_train_views_prefetch(source->views, i); // they are read in order
    const sgs_status status = photo_8bit(source->views, i, &photo);
    if (status)
        return status;
    *image = pixels_of(photo);
    if (photo->channels < 4)
        return SGS_STATUS_OK;
    sgsi_free(source->bytes);
    source->bytes = sgsi_alloc((size_t)photo->width * (size_t)photo->height, 3);
    if (!source->bytes)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for an image of %dx%d pixels",
                         photo->width, photo->height);
    sgsi_photo_over_bytes(photo, source->views->options->background, source->bytes);
    image->channels = 3;
    image->pixels = source->bytes;
    return SGS_STATUS_OK;
}

static sgs_status advance(void *context)
{
    return sgsi_train_views_advance(((const plan_source *)context)->views);
}

sgs_status sgsi_small_images_plan(sgsi_train_views *views, int until, sgsi_resolution *plan)
{
    plan_source source = {views, NULL};
    const sgsi_image_source images = {&source, views->count, view_size, view_pixels, advance};
    const sgs_status status = sgsi_resolution_plan(&images, until, plan);
    sgsi_free(source.bytes);
    return status;
}

// First pixel that reduced pixel `at` covers, and the end of them; sides of up to 65536 pixels.
static int covered_begin(int at, int from, int to)
{
    return (int)((int64_t)at * from / to);
}

static int covered_end(int at, int from, int to)
{
    return (int)((((int64_t)at + 1) * from + to - 1) / to);
}

// True if all (or any) of the pixels that reduced pixel (x, y) covers are valid.
static bool is_valid(const sgs_photo *from, const sgs_photo *to, int x, int y, bool all)
{
    const int right = covered_end(x, from->width, to->width),
              bottom = covered_end(y, from->height, to->height);
    for (int v = covered_begin(y, from->height, to->height); v < bottom; ++v)
        for (int u = covered_begin(x, from->width, to->width); u < right; ++u)
            if (sgs_mask_is_valid(from->valid_mask, from->width, u, v) != all)
                return !all;
    return all;
}

// A reduced pixel is valid if all pixels that it covers are; if that leaves none, if any is.
static void reduce_mask(const sgs_photo *from, sgs_photo *to)
{
    const size_t words = sgs_mask_words(to->width);
    to->kept = 0;
    for (int all = 1; all >= 0 && !to->kept; --all)
        for (int y = 0; y < to->height; ++y)
            for (int x = 0; x < to->width; ++x) {
                const bool valid = is_valid(from, to, x, y, all);
                to->valid_mask[(size_t)y * words + (size_t)x / 16] |=
                    (uint16_t)((unsigned)valid << (x % 16));
                to->kept += valid;
            }
}

static sgs_status reduce_view(const sgsi_train_views *views, size_t i, int scale, sgs_photo *out)
{
    const sgs_photo *photo;
    sgs_status status = photo_8bit(views, i, &photo);
    if (status)
        return status;
    const sgs_image8 image = pixels_of(photo);
    sgs_image8 small;
    status = sgsi_image8_triangle(&image, photo->valid_mask, scale, &small);
    if (status)
        return status;
    *out = (sgs_photo){.width = small.width,
                       .height = small.height,
                       .channels = small.channels,
                       .pixels = small.pixels,
                       .kept = (size_t)small.width * (size_t)small.height};
    if (!photo->valid_mask)
        return SGS_STATUS_OK;
    out->valid_mask =
        sgsi_calloc(sgs_mask_words(out->width) * (size_t)out->height, sizeof *out->valid_mask);
    if (!out->valid_mask)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for a mask of %dx%d pixels",
                         out->width, out->height);
    reduce_mask(photo, out);
    return SGS_STATUS_OK;
}

sgs_status sgsi_small_images_make(const sgsi_train_views *views, int scale,
                                  sgsi_small_images *images)
{
    *images = (sgsi_small_images){0};
    if (scale == views->small_images.scale)
        return SGS_STATUS_OK;
    images->scale = scale;
    if (scale == 1)
        return SGS_STATUS_OK;
    const size_t count = views->scene->store ? 1 : views->count;
    images->photos = sgsi_calloc(count, sizeof *images->photos);
    if (!images->photos)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for %zu views at a smaller size", count);
    images->count = count;
    sgs_status status = SGS_STATUS_OK;
    for (size_t i = 0; i < count && !status; ++i)
        status = reduce_view(views, i, scale, &images->photos[i]);
    if (status)
        sgsi_small_images_free(images);
    return status;
}

void sgsi_small_images_free(sgsi_small_images *images)
{
    for (size_t i = 0; images->photos && i < images->count; ++i)
        sgsi_photo_free(&images->photos[i]);
    sgsi_free(images->photos);
    *images = (sgsi_small_images){0};
}

sgs_status sgsi_small_images_photo(const sgsi_train_views *views, size_t index,
                                   const sgs_photo **photo)
{
    const sgsi_small_images *images = &views->small_images;
    const bool cached = views->scene->store != NULL;
    *photo = &images->photos[cached ? 0 : index];
    if (!cached)
        return SGS_STATUS_OK;
    sgsi_photo_free(&images->photos[0]);
    return reduce_view(views, index, images->scale, &images->photos[0]);
}

bool sgsi_small_images_adopt(sgsi_train_views *views, sgsi_small_images *images)
{
    if (!images->scale)
        return false;
    sgsi_small_images_free(&views->small_images);
    views->small_images = *images;
    *images = (sgsi_small_images){0};
    return true;
}
