// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A scene from the caller's memory. Pixels are converted like decoded files (image/photo.c): 8-bit
// sRGB stays 8-bit if the scene's space is sRGB, all other pixels become half floats in the scene's
// space; then alpha, mask and lens define the valid pixels.

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "base/progress_calls.h"
#include "base/threads.h"
#include "image/half.h"
#include "image/mask.h"
#include "image/photo.h"
#include "scene/scene_split.h"
#include "sparegs/scene.h"
#include "storage/model_rows.h"

enum { WHITE_VIEWS = 16 };
static const char path[] = "scene in memory";

// A source and its derived data; sorted by name.
typedef struct entry {
    const sgs_view_source *source;
    char *name;
    const uint16_t *lens; // pixels with a ray, or NULL = all
    size_t pixels_nonfinite;
    sgs_status status;
} entry;

typedef struct creator {
    sgs_scene_options options;
    sgsi_progress progress;
    entry *entries;
    sgs_scene *scene;
    uint16_t **lenses; // one per distinct camera, in the order of the views
    size_t lens_count;
} creator;

// ---- Pixels ----

static ptrdiff_t value_bytes(const sgs_view_source *source)
{
    static const ptrdiff_t sizes[] = {1, 2, 4};
    return sizes[source->pixel_type];
}

static ptrdiff_t channel_step(const sgs_view_source *source)
{
    return source->channel_stride ? source->channel_stride : value_bytes(source);
}

static const uint8_t *pixel_at(const sgs_view_source *source, int x, int y)
{
    const ptrdiff_t step =
        source->pixel_stride ? source->pixel_stride : value_bytes(source) * source->channels;
    const ptrdiff_t row = source->row_stride ? source->row_stride : step * source->camera.width;
    return (const uint8_t *)source->pixels + y * row + x * step;
}

// False when a channel is not finite.
static bool read_pixel(const sgs_view_source *source, int x, int y, float value[4])
{
    const uint8_t *at = pixel_at(source, x, y);
    bool finite = true;
    for (int c = 0; c < source->channels; ++c, at += channel_step(source)) {
        uint16_t half;
        switch (source->pixel_type) {
        case SGS_PIXEL_UINT8:
            value[c] = (float)*at / 255.0f;
            break;
        case SGS_PIXEL_HALF:
            memcpy(&half, at, sizeof half);
            // Unlike those of photos, they may be negative, subnormal or not finite.
            value[c] = sgsi_float16_to(half);
            break;
        default:
            memcpy(&value[c], at, sizeof value[c]);
        }
        finite = finite && isfinite(value[c]);
    }
    return finite;
}

static void copy_bytes(const sgs_view_source *source, sgs_photo *photo)
{
    const size_t plane = (size_t)photo->width * (size_t)photo->height;
    for (int y = 0; y < photo->height; ++y)
        for (int x = 0; x < photo->width; ++x) {
            const uint8_t *from = pixel_at(source, x, y);
            uint8_t *to = photo->pixels + (size_t)y * (size_t)photo->width + (size_t)x;
            for (int c = 0; c < photo->channels; ++c)
                // NOLINTNEXTLINE(clang-analyzer-core.NullDereference): the caller allocated it
                to[(size_t)c * plane] = from[c * channel_step(source)];
        }
}

static sgs_status convert_pixels(const creator *c, entry *e, sgs_photo *photo)
{
    const sgs_view_source *source = e->source;
    const size_t plane = (size_t)photo->width * (size_t)photo->height;
    sgs_status status = SGS_STATUS_OK;
    for (int y = 0; y < photo->height && !status; ++y)
        for (int x = 0; x < photo->width && !status; ++x) {
            float value[4] = {0, 0, 0, 1};
            uint16_t *to = photo->halves + (size_t)y * (size_t)photo->width + (size_t)x;
            if (!read_pixel(source, x, y, value)) {
                ++e->pixels_nonfinite;
                memset(value, 0, sizeof value);
                status = sgsi_mask_begin(photo);
                if (!status)
                    sgsi_mask_drop(photo, photo->width, photo->height, x, y);
            }
            for (size_t k = 0; k < 3; ++k)
                to[k * plane] = sgsi_half_from_float(sgsi_photo_encode(
                    value[k], photo->is_hdr, c->options.space, c->scene->white_point));
            if (photo->channels == 4)
                to[3 * plane] = sgsi_half_from_float(value[3] < 1.0f ? value[3] : 1.0f);
        }
    return status;
}

static sgs_status apply_mask(const creator *c, const sgs_view_source *source, sgs_photo *photo)
{
    if (!source->mask)
        return SGS_STATUS_OK;
    const ptrdiff_t step = source->mask_pixel_stride ? source->mask_pixel_stride : 1;
    const ptrdiff_t row = source->mask_row_stride ? source->mask_row_stride : step * photo->width;
    const sgs_status status = sgsi_mask_begin(photo);
    for (int y = 0; y < photo->height && !status; ++y)
        for (int x = 0; x < photo->width; ++x)
            if ((source->mask[y * row + x * step] >= 128) == c->options.invert_masks)
                sgsi_mask_drop(photo, photo->width, photo->height, x, y);
    return status;
}

static void make_photo(void *context, size_t i, int thread)
{
    (void)thread;
    creator *c = context;
    entry *e = &c->entries[i];
    const sgs_view_source *source = e->source;
    sgs_photo *photo = &c->scene->views[i].image;
    if (!source->pixels || sgsi_progress_cancelled(&c->progress)) {
        sgsi_progress_advance(&c->progress);
        return;
    }
    const bool linear = source->pixel_type != SGS_PIXEL_UINT8;
    const bool bytes = !linear && c->options.space == SGS_SPACE_SRGB;
    *photo = (sgs_photo){.width = source->camera.width,
                         .height = source->camera.height,
                         .channels = source->channels,
                         .is_hdr = linear};
    const size_t values = (size_t)photo->width * (size_t)photo->height * (size_t)photo->channels;
    if (bytes)
        photo->pixels = sgsi_alloc(values, sizeof *photo->pixels);
    else
        photo->halves = sgsi_alloc(values, sizeof *photo->halves);
    if (!photo->pixels && !photo->halves)
        e->status = SGS_STATUS_OUT_OF_MEMORY;
    else if (bytes)
        copy_bytes(source, photo);
    else
        e->status = convert_pixels(c, e, photo);
    if (!e->status)
        e->status = sgsi_photo_use_alpha(photo, c->options.alpha);
    if (!e->status)
        e->status = apply_mask(c, source, photo);
    if (!e->status)
        e->status = sgsi_mask_intersect(photo, e->lens);
    if (!e->status)
        sgsi_mask_finish(photo);
    sgsi_progress_advance(&c->progress);
}

// As for files, the white point is the 99 % quantile of the light in a sample of the linear views.
static sgs_status measure_white_point(creator *c)
{
    sgs_scene *scene = c->scene;
    size_t linear = 0, seen = 0;
    scene->white_point = c->options.white_point > 0 ? c->options.white_point : 1;
    for (size_t i = 0; i < scene->view_count; ++i)
        linear +=
            c->entries[i].source->pixels && c->entries[i].source->pixel_type != SGS_PIXEL_UINT8;
    scene->linear_images = linear;
    if (c->options.white_point > 0 || !linear)
        return SGS_STATUS_OK;
    sgsi_light *light = sgsi_calloc(1, sizeof *light);
    if (!light)
        return sgsi_scene_no_memory(path);
    const size_t step = (linear + WHITE_VIEWS - 1) / WHITE_VIEWS;
    for (size_t i = 0; i < scene->view_count; ++i) {
        const sgs_view_source *source = c->entries[i].source;
        if (!source->pixels || source->pixel_type == SGS_PIXEL_UINT8 || seen++ % step)
            continue;
        for (int y = 0; y < source->camera.height; ++y)
            for (int x = 0; x < source->camera.width; ++x) {
                float value[4] = {0};
                if (read_pixel(source, x, y, value))
                    sgsi_light_add_value(light, fmaxf(value[0], fmaxf(value[1], value[2])));
            }
    }
    scene->white_point = sgsi_light_quantile(light, 0.99);
    sgsi_free(light);
    return SGS_STATUS_OK;
}

// ---- Checks ----

static bool fits(ptrdiff_t stride, ptrdiff_t bytes)
{
    return !stride || stride >= bytes || stride <= -bytes;
}

static sgs_status check_source(const entry *e)
{
    const sgs_view_source *s = e->source;
    const char *wrong = NULL;
    if (sgs_camera_validate(&s->camera))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "view '%s': camera: %s", e->name,
                         sgs_last_error());
    if (sgs_pose_validate(&s->pose))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "view '%s': %s", e->name, sgs_last_error());
    if (s->split != SGS_SPLIT_TRAIN && s->split != SGS_SPLIT_TEST)
        wrong = "split is neither SGS_SPLIT_TRAIN nor SGS_SPLIT_TEST";
    if (s->pixels && (unsigned)s->pixel_type > SGS_PIXEL_FLOAT)
        wrong = "pixel_type is unknown";
    else if (s->pixels && s->channels != 3 && s->channels != 4)
        wrong = "channels is neither 3 nor 4";
    else if (s->pixels &&
             (!fits(s->channel_stride, value_bytes(s)) || !fits(s->pixel_stride, value_bytes(s)) ||
              !fits(s->row_stride, value_bytes(s))))
        wrong = "a stride is smaller than a value";
    return wrong ? sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "view '%s': %s", e->name, wrong)
                 : SGS_STATUS_OK;
}

static int by_name(const void *a, const void *b)
{
    return strcmp(((const entry *)a)->name, ((const entry *)b)->name);
}

static sgs_status make_entries(creator *c, const sgs_view_source *views, size_t count)
{
    if (!views || !count)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: no views", path);
    c->entries = sgsi_calloc(count, sizeof *c->entries);
    c->scene->views = sgsi_calloc(count, sizeof *c->scene->views);
    if (!c->entries || !c->scene->views)
        return sgsi_scene_no_memory(path);
    c->scene->view_count = count;
    for (size_t i = 0; i < count; ++i) {
        entry *e = &c->entries[i];
        e->source = &views[i];
        e->name = views[i].name ? sgsi_strdup(views[i].name) : sgsi_format("view_%06zu", i);
        if (!e->name)
            return sgsi_scene_no_memory(path);
        const sgs_status status = check_source(e);
        if (status)
            return status;
    }
    qsort(c->entries, count, sizeof *c->entries, by_name);
    for (size_t i = 1; i < count; ++i)
        if (!strcmp(c->entries[i - 1].name, c->entries[i].name))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "view '%s': name is used twice",
                             c->entries[i].name);
    for (size_t i = 0; i < count; ++i) {
        const sgs_view_source *source = c->entries[i].source;
        sgs_view *view = &c->scene->views[i];
        view->name = c->entries[i].name;
        c->entries[i].name = NULL;
        view->image_path = sgsi_strdup(view->name);
        if (!view->image_path)
            return sgsi_scene_no_memory(path);
        view->camera = view->file_camera = source->camera;
        view->pose = source->pose;
        sgs_pose_orthonormalize(&view->pose);
        view->split = source->split;
    }
    return SGS_STATUS_OK;
}

static sgs_status copy_points(sgs_scene *scene, const float *points, const uint8_t *colors,
                              size_t count)
{
    if (!count)
        return SGS_STATUS_OK;
    if (!points)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: points is NULL", path);
    for (size_t i = 0; i < 3 * count; ++i)
        if (!isfinite(points[i]))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: point %zu is not finite", path,
                             i / 3);
    scene->points = sgsi_alloc(count, 3 * sizeof *scene->points);
    scene->colors = sgsi_alloc(count, 3 * sizeof *scene->colors);
    if (!scene->points || !scene->colors)
        return sgsi_scene_no_memory(path);
    memcpy(scene->points, points, 3 * count * sizeof *points);
    if (colors)
        memcpy(scene->colors, colors, 3 * count);
    else
        memset(scene->colors, 128, 3 * count);
    scene->point_count = count;
    return SGS_STATUS_OK;
}

// ---- The scene ----

static sgs_status find_lenses(creator *c)
{
    sgs_scene *scene = c->scene;
    c->lenses = sgsi_calloc(scene->view_count, sizeof *c->lenses);
    if (!c->lenses)
        return sgsi_scene_no_memory(path);
    for (size_t i = 0; i < scene->view_count; ++i) {
        const bool same =
            i && sgs_camera_equal(&scene->views[i - 1].camera, &scene->views[i].camera);
        if (!same) {
            size_t rays;
            const sgs_status status =
                sgsi_mask_of_lens(&scene->views[i].camera, 0, &c->lenses[c->lens_count++], &rays);
            if (status)
                return status;
            if (!rays)
                return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                                 "view '%s': its lens has no ray for any pixel; check k1, k2, p1, "
                                 "p2, cx, cy",
                                 scene->views[i].name);
        }
        c->entries[i].lens = c->lenses[c->lens_count - 1];
    }
    return SGS_STATUS_OK;
}

static sgs_status make_photos(creator *c)
{
    sgs_scene *scene = c->scene;
    sgs_status status = find_lenses(c);
    if (!status)
        status = measure_white_point(c);
    if (status)
        return status;
    sgsi_parallel_for(scene->view_count, 1, make_photo, c);
    if (sgsi_progress_cancelled(&c->progress))
        return sgsi_scene_cancelled(path);
    for (size_t i = 0; i < scene->view_count; ++i) {
        const sgs_photo *photo = &scene->views[i].image;
        if (c->entries[i].status)
            return sgsi_scene_no_memory(path);
        if (photo->width && !photo->kept)
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "view '%s': mask excludes every pixel",
                             scene->views[i].name);
        scene->has_alpha |= c->entries[i].source->channels == 4;
        scene->masks += c->entries[i].source->mask != NULL;
        scene->pixels_nonfinite += c->entries[i].pixels_nonfinite;
        const bool linear = c->entries[i].source->pixel_type != SGS_PIXEL_UINT8;
        const sgsi_image_info info = {.channels = c->entries[i].source->channels,
                                      .bytes = !linear,
                                      .linear = linear,
                                      .scene_linear = linear};
        if (!photo->width)
            continue;
        scene->photo_bytes += sgsi_photo_bytes(&info, scene->space, photo->width, photo->height);
        scene->float_images += !sgsi_photo_is_8bit(&info, scene->space);
    }
    return SGS_STATUS_OK;
}

static sgs_status create(creator *c, const sgs_view_source *views, size_t view_count,
                         const float *points, const uint8_t *colors, size_t point_count)
{
    sgs_scene *scene = c->scene;
    const bool selects = c->options.test_every || c->options.test_images || c->options.held_out;
    scene->format = SGS_SCENE_MEMORY;
    scene->space = c->options.space;
    scene->reduction = 1;
    scene->alpha = c->options.alpha;
    scene->path = sgsi_strdup(path);
    scene->model_path = sgsi_strdup(path);
    if (!scene->path || !scene->model_path)
        return sgsi_scene_no_memory(path);
    sgs_status status = make_entries(c, views, view_count);
    if (!status)
        status = copy_points(scene, points, colors, point_count);
    if (!status)
        status = make_photos(c);
    c->options.use_dataset_split = true; // of the sources, unless an option defines the split
    if (!status)
        status = sgsi_scene_split(scene, &c->options, !selects);
    if (status)
        return status;
    scene->digest = sgsi_scene_digest(scene);
    return sgsi_scene_measure_extent(scene);
}

sgs_status sgs_scene_create(const sgs_view_source *views, size_t view_count, const float *points,
                            const uint8_t *colors, size_t point_count,
                            const sgs_scene_options *options, sgs_scene **scene)
{
    creator c = {.options = sgs_scene_options_default()};
    *scene = NULL;
    sgs_status status =
        sgsi_options_read(options, "sgs_scene_options", &c.options, sizeof c.options);
    if (!status)
        status = sgsi_scene_options_check(path, &c.options);
    if (status)
        return status;
    c.scene = sgsi_calloc(1, sizeof *c.scene);
    if (!c.scene)
        return sgsi_scene_no_memory(path);
    sgsi_progress_begin(&c.progress, c.options.progress, c.options.progress_user, view_count);
    status = create(&c, views, view_count, points, colors, point_count);
    sgsi_progress_end(&c.progress);
    for (size_t i = 0; c.entries && i < c.scene->view_count; ++i)
        sgsi_free(c.entries[i].name);
    sgsi_free(c.entries);
    for (size_t i = 0; i < c.lens_count; ++i)
        sgsi_free(c.lenses[i]);
    sgsi_free(c.lenses);
    if (status) {
        sgs_scene_destroy(c.scene);
        return status;
    }
    *scene = c.scene;
    return SGS_STATUS_OK;
}
