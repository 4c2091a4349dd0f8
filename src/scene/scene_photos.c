// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Photos of a scene: their sizes, the cameras fitted to them, their pixels, the white point,
// and the image cache. They are read in parallel; a limit on the memory of their decoding can
// reduce the number that are decoded at the same time.

#include "scene/scene_loader.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "image/image_oiio.h"
#include "image/mask.h"
#include "scene/scene_split.h"
#include "scene/scene_store.h"
#include "sparegs/image.h"
#include "sparegs/runtime.h"

enum { WHITE_VIEWS = 16 };

static void reduced_size(int downscale, sgsi_view_slot *s)
{
    s->width = s->file_width;
    s->height = s->file_height;
    if (downscale == 0 && s->file_width > SGSI_AUTOMATIC_WIDTH) {
        s->width = SGSI_AUTOMATIC_WIDTH;
        s->height = (int)((long long)s->file_height * SGSI_AUTOMATIC_WIDTH / s->file_width);
    } else if (downscale > 1) {
        s->width = s->file_width / downscale;
        s->height = s->file_height / downscale;
    }
    s->width = s->width < 1 ? 1 : s->width;
    s->height = s->height < 1 ? 1 : s->height;
}

// Completes a camera without size (see sgsi_frame) and fits it to its photo.
static sgs_status fit_camera(const sgsi_frame *frame, sgsi_view_slot *s, sgs_view *view)
{
    sgs_camera camera = frame->camera;
    if (camera.width == 0 && camera.model == SGS_CAMERA_EQUIRECTANGULAR) {
        camera = sgs_camera_equirectangular(s->file_width, s->file_height);
    } else if (camera.width == 0) {
        camera.width = s->file_width;
        camera.height = s->file_height;
        double *const focal = camera.params; // NaN where an angle takes its place
        const double from_x = 0.5 * s->file_width / tan(0.5 * frame->angle_x),
                     from_y = 0.5 * s->file_height / tan(0.5 * frame->angle_y);
        if (frame->angle_x > 0 || frame->angle_y > 0)
            focal[0] = frame->angle_x > 0 ? from_x : from_y;
        if (isnan(focal[1]))
            focal[1] = frame->angle_y > 0 ? from_y : focal[0];
        if (isnan(camera.params[2]))
            camera.params[2] = 0.5 * s->file_width;
        if (isnan(camera.params[3]))
            camera.params[3] = 0.5 * s->file_height;
    }
    view->camera = sgs_camera_resized(&camera, s->width, s->height);
    view->file_camera = sgs_camera_resized(&camera, s->file_width, s->file_height);
    s->circle = frame->circle * s->width / camera.width;
    if (sgs_camera_validate(&view->camera) || sgs_camera_validate(&view->file_camera))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: camera of '%s': %s", view->image_path, view->name,
                         sgs_last_error());
    return SGS_STATUS_OK;
}

static void keep_error(sgsi_view_slot *s)
{
    if (s->status)
        s->error =
            sgsi_strdup(sgs_last_error()); // thread-local; the calling thread reports it later
}

static void set_size(const sgsi_scene_loader *l, sgsi_view_slot *s, int width, int height)
{
    s->file_width = width;
    s->file_height = height;
    reduced_size(l->options->downscale, s);
}

// Reads size and format of the photo. If its pixels are not loaded, also checks that the file
// is complete, unless the options exclude that.
static void probe_photo(const sgsi_scene_loader *l, size_t i)
{
    sgsi_view_slot *s = &l->slots[i];
    const char *path = l->scene->views[i].image_path, *mask = l->scene->views[i].mask_path;
    sgsi_image_info info = {0};
    s->status = sgsi_roots_check(&l->roots, path, "images_dir");
    if (!s->status && mask)
        s->status = sgsi_roots_check(&l->roots, mask, "masks_dir");
    if (s->status) {
        keep_error(s);
        return;
    }
    if (!l->options->load_images && !l->options->headers_only)
        s->status = sgsi_image_check_complete(path, false);
    if (!s->status)
        s->status = sgsi_oiio_describe(path, l->options->colorspace, &info);
    bool display = false;
    if (!s->status)
        s->status = sgsi_photo_choose_window(path, &info, &l->dataset.frames[i].camera, &display);
    l->scene->views[i].display_window = display;
    if (display && !s->status)
        info = sgsi_photo_display(&info);
    set_size(l, s, info.width, info.height);
    for (int k = 0; k < SGSI_NOTES; ++k) // without memory, the warning is omitted
        s->notes[k] = info.notes[k][0] ? sgsi_strdup(info.notes[k]) : NULL;
    s->channels = info.channels;
    s->scene_linear = info.scene_linear;
    memcpy(s->space, info.space, sizeof s->space);
    l->scene->views[i].orientation = info.orientation;
    s->bytes = sgsi_photo_bytes(&info, l->options->space, s->width, s->height);
    s->decode_bytes = sgsi_photo_decode_bytes(&info);
    s->halves = !sgsi_photo_is_8bit(&info, l->options->space);
    keep_error(s);
}

// Without photos, the size is that of the camera or else that of the options.
static void probe(const sgsi_scene_loader *l, size_t i)
{
    sgsi_view_slot *s = &l->slots[i];
    const sgs_camera *camera = &l->dataset.frames[i].camera;
    if (sgsi_loader_cameras_only(l) && camera->width > 0) {
        set_size(l, s, camera->width, camera->height);
        return;
    }
    probe_photo(l, i);
    const bool is_given = l->options->view_width > 0 && l->options->view_height > 0;
    if (sgsi_loader_cameras_only(l) && is_given && s->status &&
        s->status != SGS_STATUS_OUT_OF_MEMORY) {
        sgsi_free(s->error);
        s->error = NULL;
        s->status = SGS_STATUS_OK;
        set_size(l, s, l->options->view_width, l->options->view_height);
    }
}

static void probe_view(void *context, size_t i, int thread)
{
    sgsi_scene_loader *l = context;
    (void)thread;
    if (sgsi_progress_cancelled(&l->progress))
        return;
    probe(l, i);
    sgsi_progress_advance(&l->progress);
}

sgsi_photo_source sgsi_loader_source(const sgsi_scene_loader *l, size_t i)
{
    const sgsi_view_slot *s = &l->slots[i];
    const sgs_view *view = &l->scene->views[i];
    return (sgsi_photo_source){.image_path = view->image_path,
                               .mask_path = view->mask_path,
                               .file_width = s->file_width,
                               .file_height = s->file_height,
                               .display_window = view->display_window,
                               .width = s->width,
                               .height = s->height,
                               .invert_mask = l->options->invert_masks,
                               .dynamic_mask = s->dynamic_mask,
                               .alpha = l->options->alpha,
                               .colorspace = l->scene->colorspace,
                               .space = l->options->space,
                               .white_point = l->scene->white_point,
                               .lens = l->lenses[s->lens].valid_mask,
                               .decode_limit = l->decode_limit,
                               .decode_bytes = s->decode_bytes};
}

static void load_view(void *context, size_t i, int thread)
{
    sgsi_scene_loader *l = context;
    sgsi_view_slot *s = &l->slots[i];
    sgs_view *view = &l->scene->views[i];
    (void)thread;
    if (s->status || s->dropped || sgsi_progress_cancelled(&l->progress)) {
        sgsi_progress_advance(&l->progress);
        return;
    }
    const sgsi_photo_source source = sgsi_loader_source(l, i);
    s->status = sgsi_photo_load(&source, &view->image, &s->report);
    keep_error(s);
    if (l->limited && !s->cached) // loaded only to check the file
        sgsi_photo_release(&view->image);
    sgsi_progress_advance(&l->progress);
}

// Finds the entry of view i's camera and image circle, or adds one.
static sgs_status find_lens(sgsi_scene_loader *l, size_t i)
{
    const sgs_camera *camera = &l->scene->views[i].camera;
    size_t k = l->lens_count;
    const double circle = l->slots[i].circle;
    while (k > 0 && !(sgs_camera_equal(&l->lenses[k - 1].camera, camera) &&
                      l->lenses[k - 1].circle == circle))
        --k;
    if (k == 0) {
        k = ++l->lens_count;
        l->lenses[k - 1].camera = *camera;
        l->lenses[k - 1].circle = circle;
        const sgs_status status =
            sgsi_mask_of_lens(camera, circle, &l->lenses[k - 1].valid_mask, &l->lenses[k - 1].rays);
        if (status)
            return status;
    }
    l->slots[i].lens = k - 1;
    return SGS_STATUS_OK;
}

static sgs_status find_lenses(sgsi_scene_loader *l)
{
    l->lenses = sgsi_calloc(l->scene->view_count, sizeof *l->lenses);
    sgs_status status = l->lenses ? SGS_STATUS_OK : sgsi_scene_no_memory(l->scene->path);
    for (size_t i = 0; i < l->scene->view_count && !status; ++i)
        if (!l->slots[i].status)
            status = find_lens(l, i);
    return status;
}

typedef struct light_job {
    const sgsi_scene_loader *loader;
    size_t views[WHITE_VIEWS];
    sgsi_light *lights; // one per view
} light_job;

static void add_light(void *context, size_t i, int thread)
{
    (void)thread;
    const light_job *job = context;
    const sgsi_scene_loader *l = job->loader;
    const sgs_view *view = &l->scene->views[job->views[i]];
    // A file that cannot be read is reported when it is loaded.
    (void)sgsi_light_add(&job->lights[i], view->image_path, l->options->colorspace,
                         view->display_window);
}

// White point: the 99 % quantile of the light in a sample of the scene-linear photos.
static sgs_status measure_white_point(sgsi_scene_loader *l)
{
    light_job job = {.loader = l};
    size_t linear = 0, taken = 0, seen = 0;
    l->scene->white_point = l->options->white_point > 0 ? l->options->white_point : 1;
    for (size_t i = 0; i < l->scene->view_count; ++i)
        linear += l->slots[i].scene_linear;
    l->scene->linear_images = linear;
    if (l->options->white_point > 0 || !linear ||
        !(l->options->load_images || l->options->measure_white_point))
        return SGS_STATUS_OK;
    const size_t step = (linear + WHITE_VIEWS - 1) / WHITE_VIEWS;
    for (size_t i = 0; i < l->scene->view_count; ++i)
        if (l->slots[i].scene_linear && seen++ % step == 0)
            job.views[taken++] = i;
    job.lights = sgsi_calloc(taken, sizeof *job.lights);
    if (!job.lights)
        return sgsi_scene_no_memory(l->scene->path);
    sgsi_parallel_for(taken, 1, add_light, &job);
    for (size_t i = 1; i < taken; ++i)
        for (size_t k = 0; k < SGSI_LIGHT_BINS; ++k)
            job.lights[0].bins[k] += job.lights[i].bins[k];
    l->scene->white_point = sgsi_light_quantile(&job.lights[0], 0.99);
    sgsi_free(job.lights);
    return SGS_STATUS_OK;
}

static void count_decoding(sgsi_scene_loader *l)
{
    const uint64_t share = sgs_machine_memory() / 8;
    const size_t given = l->options->decode_memory;
    l->scene->decode_limit = given ? given : share < SIZE_MAX ? (size_t)share : SIZE_MAX;
    for (size_t i = 0; i < l->scene->view_count; ++i)
        if (!l->slots[i].dropped && l->slots[i].decode_bytes > l->scene->decode_bytes)
            l->scene->decode_bytes = l->slots[i].decode_bytes;
}

// Marks the first photos that fit into the image cache.
static void mark_cached(sgsi_scene_loader *l)
{
    size_t left = l->options->image_cache;
    for (size_t i = 0; i < l->scene->view_count; ++i) {
        sgsi_view_slot *s = &l->slots[i];
        s->cached = !s->status && !s->dropped && s->bytes <= left;
        left -= s->cached ? s->bytes : 0;
    }
}

sgs_status sgsi_loader_read_photos(sgsi_scene_loader *l)
{
    sgs_scene *scene = l->scene;
    sgs_status status = SGS_STATUS_OK;
    l->progress.total = scene->view_count * (l->options->load_images ? 2 : 1);
    sgsi_parallel_for(scene->view_count, 1, probe_view, l);
    count_decoding(l);
    if (sgsi_progress_cancelled(&l->progress))
        return sgsi_scene_cancelled(scene->path);
    for (size_t i = 0; i < scene->view_count && !status; ++i)
        if (!l->slots[i].status)
            status = fit_camera(&l->dataset.frames[i], &l->slots[i], &scene->views[i]);
    if (!status)
        status = measure_white_point(l);
    if (!status && !sgsi_loader_cameras_only(l))
        status = find_lenses(l);
    if (status || !l->options->load_images)
        return status;
    size_t bytes = 0;
    for (size_t i = 0; i < scene->view_count; ++i)
        bytes += l->slots[i].dropped ? 0 : l->slots[i].bytes;
    l->limited = l->options->image_cache && bytes > l->options->image_cache;
    l->decode_limit = sgsi_decode_limit_create(scene->decode_limit);
    if (!l->decode_limit)
        return sgsi_scene_no_memory(scene->path);
    if (l->limited) {
        mark_cached(l);
        l->sources = sgsi_calloc(scene->view_count, sizeof *l->sources);
        l->bytes = sgsi_calloc(scene->view_count, sizeof *l->bytes);
        if (!l->sources || !l->bytes)
            return sgsi_scene_no_memory(scene->path);
    }
    sgsi_parallel_for(scene->view_count, 1, load_view, l);
    return sgsi_progress_cancelled(&l->progress) ? sgsi_scene_cancelled(scene->path)
                                                 : SGS_STATUS_OK;
}

sgs_status sgsi_loader_open_store(sgsi_scene_loader *l)
{
    if (!l->limited)
        return SGS_STATUS_OK;
    uint16_t **planes = sgsi_calloc(l->lens_count, sizeof *planes);
    if (!planes)
        return sgsi_scene_no_memory(l->scene->path);
    for (size_t i = 0; i < l->lens_count; ++i) {
        planes[i] = l->lenses[i].valid_mask;
        l->lenses[i].valid_mask = NULL;
    }
    sgs_scene *scene = l->scene;
    sgsi_decode_limit *decode_limit = l->decode_limit;
    l->decode_limit = NULL;
    const sgs_status status =
        sgsi_scene_store_create(l->sources, l->bytes, scene->view_count, l->options->image_cache,
                                planes, l->lens_count, decode_limit, &scene->store);
    for (size_t i = 0; i < scene->view_count && !status; ++i) {
        sgs_photo *photo = &scene->views[i].image;
        if (photo->pixels || photo->halves)
            sgsi_photo_cache_put(sgsi_scene_store_cache(scene->store), i, photo);
    }
    return status;
}
