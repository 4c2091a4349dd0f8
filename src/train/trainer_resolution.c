// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Training views at a reduced size, for pipelines that render small images first. The views of one
// scale are made together when the scale changes and kept until the next change. Photographs of
// half-float numbers are not reduced: a run with any of them stays at full resolution.

#include <math.h>

#include "base/core.h"
#include "sparegs/image.h"
#include "train/trainer_state.h"

void sgsi_small_images_free(sgsi_small_images *images)
{
    for (size_t i = 0; images->photos && i < images->count; ++i) {
        sgsi_free(images->photos[i].pixels);
        sgsi_free(images->photos[i].valid_mask);
    }
    sgsi_free(images->photos);
    *images = (sgsi_small_images){0};
}

static sgs_image8 pixels_of(const sgs_photo *photo)
{
    return (sgs_image8){.width = photo->width,
                        .height = photo->height,
                        .channels = photo->channels,
                        .pixels = photo->pixels};
}

static void view_size(void *context, size_t i, int *width, int *height)
{
    const sgs_trainer *trainer = context;
    const sgs_camera *camera = &trainer->scene->views[trainer->train_views[i]].camera;
    *width = camera->width;
    *height = camera->height;
}

static sgs_status photo_of_bytes(const sgs_trainer *trainer, size_t i, const sgs_photo **photo)
{
    const sgs_status status = sgs_scene_photo(trainer->scene, trainer->train_views[i], photo);
    if (status || (*photo)->pixels)
        return status;
    return sgsi_fail(SGS_STATUS_UNSUPPORTED, "%s: no bytes", trainer->scene->path);
}

static sgs_status view_pixels(void *context, size_t i, sgs_image8 *image)
{
    const sgs_photo *photo;
    const sgs_status status = photo_of_bytes(context, i, &photo);
    if (!status)
        *image = pixels_of(photo);
    return status;
}

sgs_status sgsi_trainer_resolution_plan(sgs_trainer *trainer)
{
    if (!trainer->pipeline->resolution)
        return SGS_STATUS_OK;
    trainer->resolution = (sgsi_resolution){0}; // full resolution from iteration 0
    const sgsi_image_source images = {trainer, trainer->train_view_count, view_size, view_pixels};
    const sgs_status status =
        sgsi_resolution_plan(&images, trainer->schedule.densify_until, &trainer->resolution);
    if (status == SGS_STATUS_UNSUPPORTED) {
        sgsi_warn(
            "%s: some photographs are no bytes; DashGaussian trains at full resolution throughout",
            trainer->scene->path);
        return sgsi_trainer_set_resolution(trainer, 1);
    }
    if (status)
        return status;
    trainer->schedule.lr_begin = trainer->resolution.decay_begin;
    return sgsi_trainer_set_resolution(trainer, sgsi_resolution_at(&trainer->resolution, 1));
}

// A small pixel counts when every pixel that it covers does.
static void reduce_keep(const sgs_photo *from, sgs_photo *to)
{
    const size_t words = ((size_t)to->width + 15) / 16;
    to->kept = 0;
    for (int y = 0; y < to->height; ++y)
        for (int x = 0; x < to->width; ++x) {
            bool all = true;
            for (int v = y * from->height / to->height; v * to->height < (y + 1) * from->height;
                 ++v)
                for (int u = x * from->width / to->width; u * to->width < (x + 1) * from->width;
                     ++u)
                    all = all && sgsi_photo_counts(from, u, v);
            to->valid_mask[(size_t)y * words + (size_t)x / 16] |=
                (uint16_t)((unsigned)all << (x % 16));
            to->kept += all;
        }
}

static sgs_status reduce_view(sgs_trainer *trainer, size_t i, int scale, sgs_photo *out)
{
    const sgs_photo *photo;
    sgs_status status = photo_of_bytes(trainer, i, &photo);
    if (status)
        return status;
    const sgs_image8 image = pixels_of(photo);
    sgs_image8 small;
    status = sgsi_image8_triangle(&image, scale, &small);
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
        sgsi_calloc(((size_t)out->width + 15) / 16 * (size_t)out->height, sizeof *out->valid_mask);
    if (!out->valid_mask)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for a mask of %dx%d pixels",
                         out->width, out->height);
    reduce_keep(photo, out);
    return SGS_STATUS_OK;
}

// The training views at a scale; none at scale 1. On failure there are none.
static sgs_status make_small_images(sgs_trainer *trainer, int scale, sgsi_small_images *images)
{
    *images = (sgsi_small_images){.scale = scale};
    if (scale <= 1)
        return SGS_STATUS_OK;
    images->photos = sgsi_calloc(trainer->train_view_count, sizeof *images->photos);
    if (!images->photos)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for %zu views at a smaller size",
                         trainer->train_view_count);
    images->count = trainer->train_view_count;
    sgs_status status = SGS_STATUS_OK;
    for (size_t i = 0; i < images->count && !status; ++i)
        status = reduce_view(trainer, i, scale, &images->photos[i]);
    if (status)
        sgsi_small_images_free(images);
    return status;
}

void sgsi_trainer_adopt_resolution(sgs_trainer *trainer, sgsi_small_images *images)
{
    if (!images->scale)
        return;
    sgsi_small_images_free(&trainer->small_images);
    trainer->small_images = *images;
    trainer->progress.resolution = images->scale;
    trainer->progress.reset_since_check = 1; // losses of different sizes do not compare
    sgsi_trainer_forget_depths(trainer);
}

static bool is_in_force(const sgs_trainer *trainer, int scale)
{
    return trainer->progress.resolution == scale && (scale == 1 || trainer->small_images.photos);
}

sgs_status sgsi_trainer_set_resolution(sgs_trainer *trainer, int scale)
{
    sgsi_small_images images;
    if (is_in_force(trainer, scale))
        return SGS_STATUS_OK;
    const sgs_status status = make_small_images(trainer, scale, &images);
    if (!status)
        sgsi_trainer_adopt_resolution(trainer, &images);
    return status;
}

sgs_status sgsi_trainer_next_resolution(sgs_trainer *trainer, int iteration,
                                        sgsi_small_images *images)
{
    const sgsi_schedule *schedule = &trainer->schedule;
    *images = (sgsi_small_images){0};
    if (!trainer->pipeline->resolution || iteration <= schedule->resolution_from ||
        iteration % schedule->resolution_interval)
        return SGS_STATUS_OK;
    const int scale = sgsi_resolution_at(&trainer->resolution, iteration);
    return is_in_force(trainer, scale) ? SGS_STATUS_OK : make_small_images(trainer, scale, images);
}
