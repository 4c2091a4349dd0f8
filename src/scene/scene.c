// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Loads a scene: camera files (scene_find.c, colmap.c, transforms.c) and photographs.
//
// Steps: find the files; read cameras and points; sort views by name; read the headers of the
// photographs and fit each camera to the size of its photograph after downscaling; read the
// photographs; drop views without one; split; measure the extent. Photographs are read in parallel.
// A view depends on its own files only, and warnings are sent afterwards in view order, so the
// result and the messages do not depend on the number of threads.
//
// As in 3DGS: the maximum width of 1600 pixels, every N-th of the sorted names as test set, and the
// extent. Differences: images are area-averaged instead of bicubic; intrinsics are scaled to the
// image's actual size per axis instead of keeping the field of view; views without a photograph are
// dropped before the split.

#include "sparegs/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "scene/colmap.h"
#include "base/core.h"
#include "image/image_oiio.h"
#include "image/mask.h"
#include "base/path_sandbox.h"
#include "base/progress_calls.h"
#include "image/photo.h"
#include "scene/scene_find.h"
#include "scene/scene_split.h"
#include "scene/scene_store.h"
#include "sparegs/image.h"
#include "base/threads.h"
#include "scene/transforms.h"

enum { AUTOMATIC_WIDTH = 1600, MAX_WARNINGS = 5, WHITE_VIEWS = 16 };

// State of a view while it is loaded.
typedef struct slot {
    sgs_status status;
    char *error;
    int file_width, file_height; // before downscaling
    int width, height;           // after downscaling
    int channels;
    bool linear;  // the file holds linear light
    size_t bytes; // decoded size of the photograph
    bool halves;  // it is kept in half floats
    size_t lens;  // index into loader.lenses
    bool dropped; // not among options.kept
    sgsi_photo_report report;
} slot;

// Mask of the pixels for which a lens has rays. Most views share one.
typedef struct lens_mask {
    sgs_camera camera;
    uint16_t *valid_mask; // NULL = all
} lens_mask;

typedef struct loader {
    sgs_scene_options *options;
    sgsi_progress progress;
    sgsi_scene_files files;
    sgsi_dataset dataset;
    slot *slots; // parallel to dataset.frames
    sgsi_roots roots;
    size_t top_folder; // transforms: length of the folder that all names begin with
    bool mask_folder;  // a mask folder exists
    lens_mask *lenses;
    size_t lens_count;
    bool limited; // the photographs exceed the image cache
    // If limited: of the views that are kept, and their decoded sizes.
    sgsi_photo_source *sources;
    size_t *bytes;
    sgs_scene *scene;
} loader;

sgs_scene_options sgs_scene_options_default(void)
{
    return (sgs_scene_options){.struct_size = sizeof(sgs_scene_options), .load_images = true};
}

static void free_view(sgs_view *view)
{
    sgsi_free(view->name);
    sgsi_free(view->image_path);
    sgsi_free(view->mask_path);
    sgsi_photo_free(&view->image);
}

void sgs_scene_destroy(sgs_scene *scene)
{
    if (!scene)
        return;
    sgsi_scene_store_destroy(scene->store);
    for (size_t i = 0; i < scene->view_count; ++i)
        free_view(&scene->views[i]);
    sgsi_free(scene->views);
    sgsi_free(scene->points);
    sgsi_free(scene->colors);
    sgsi_free(scene->path);
    sgsi_free(scene->model_path);
    sgsi_free(scene->colorspace);
    sgsi_free(scene);
}

// ---- Photographs --------------------------------------------------------------------------------

static void reduced_size(int downscale, slot *s)
{
    s->width = s->file_width;
    s->height = s->file_height;
    if (downscale == 0 && s->file_width > AUTOMATIC_WIDTH) {
        s->width = AUTOMATIC_WIDTH;
        s->height = (int)((long long)s->file_height * AUTOMATIC_WIDTH / s->file_width);
    } else if (downscale > 1) {
        s->width = s->file_width / downscale;
        s->height = s->file_height / downscale;
    }
    s->width = s->width < 1 ? 1 : s->width;
    s->height = s->height < 1 ? 1 : s->height;
}

// Completes a camera without size (see sgsi_frame) and fits it to its photograph.
static sgs_status fit_camera(const sgsi_frame *frame, const slot *s, const sgs_view *view,
                             sgs_camera *out)
{
    sgs_camera camera = frame->camera;
    if (camera.width == 0) {
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
    *out = sgs_camera_resized(&camera, s->width, s->height);
    if (sgs_camera_validate(out))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: camera of '%s': %s", view->image_path, view->name,
                         sgs_last_error());
    return SGS_STATUS_OK;
}

static void keep_error(slot *s)
{
    if (s->status)
        s->error =
            sgsi_strdup(sgs_last_error()); // thread-local; the calling thread reports it later
}

// Only cameras are requested: photographs and masks are not accessed.
static bool cameras_only(const loader *l)
{
    return l->options->cameras_only && !l->options->load_images;
}

static void set_size(const loader *l, slot *s, int width, int height)
{
    s->file_width = width;
    s->file_height = height;
    reduced_size(l->options->downscale, s);
}

// Reads size and format of the photograph. If its pixels are not loaded, also checks that the file
// is complete.
static void probe_photo(const loader *l, size_t i)
{
    slot *s = &l->slots[i];
    const char *path = l->scene->views[i].image_path, *mask = l->scene->views[i].mask_path;
    sgsi_image_info info = {0};
    s->status = sgsi_roots_check(&l->roots, path);
    if (!s->status && mask)
        s->status = sgsi_roots_check(&l->roots, mask);
    if (s->status) {
        keep_error(s);
        return;
    }
    if (!l->options->load_images)
        s->status = sgsi_image_check_complete(path);
    if (!s->status)
        s->status = sgsi_oiio_describe(path, l->options->colorspace, &info);
    if (!s->status)
        s->status = sgsi_photo_check_window(path, &info, &l->dataset.frames[i].camera);
    set_size(l, s, info.width, info.height);
    s->channels = info.channels;
    s->linear = info.linear;
    l->scene->views[i].orientation = info.orientation;
    s->bytes = sgsi_photo_bytes(&info, l->options->space, s->width, s->height);
    s->halves = !sgsi_photo_is_8bit(&info, l->options->space);
    keep_error(s);
}

// Without photographs, the size is that of the camera or else that of the options.
static void probe(const loader *l, size_t i)
{
    slot *s = &l->slots[i];
    const sgs_camera *camera = &l->dataset.frames[i].camera;
    if (cameras_only(l) && camera->width > 0) {
        set_size(l, s, camera->width, camera->height);
        return;
    }
    probe_photo(l, i);
    const bool is_given = l->options->view_width > 0 && l->options->view_height > 0;
    if (cameras_only(l) && is_given && s->status && s->status != SGS_STATUS_OUT_OF_MEMORY) {
        sgsi_free(s->error);
        s->error = NULL;
        s->status = SGS_STATUS_OK;
        set_size(l, s, l->options->view_width, l->options->view_height);
    }
}

static void probe_view(void *context, size_t i, int thread)
{
    loader *l = context;
    (void)thread;
    if (sgsi_progress_cancelled(&l->progress))
        return;
    probe(l, i);
    sgsi_progress_advance(&l->progress);
}

static sgsi_photo_source source_of(const loader *l, size_t i)
{
    const slot *s = &l->slots[i];
    const sgs_view *view = &l->scene->views[i];
    return (sgsi_photo_source){.image_path = view->image_path,
                               .mask_path = view->mask_path,
                               .file_width = s->file_width,
                               .file_height = s->file_height,
                               .width = s->width,
                               .height = s->height,
                               .invert_mask = l->options->invert_masks,
                               .alpha = l->options->alpha,
                               .colorspace = l->scene->colorspace,
                               .space = l->options->space,
                               .white_point = l->scene->white_point,
                               .lens = l->lenses[s->lens].valid_mask};
}

static void load_view(void *context, size_t i, int thread)
{
    loader *l = context;
    slot *s = &l->slots[i];
    sgs_view *view = &l->scene->views[i];
    (void)thread;
    if (s->status || s->dropped || sgsi_progress_cancelled(&l->progress)) {
        sgsi_progress_advance(&l->progress);
        return;
    }
    const sgsi_photo_source source = source_of(l, i);
    s->status = sgsi_photo_load(&source, &view->image, &s->report);
    keep_error(s);
    if (l->limited) // loaded only to check the file
        sgsi_photo_release(&view->image);
    sgsi_progress_advance(&l->progress);
}

// Finds the entry of view i's camera, or adds one.
static sgs_status find_lens(loader *l, size_t i)
{
    const sgs_camera *camera = &l->scene->views[i].camera;
    size_t k = l->lens_count;
    while (k > 0 && !sgs_camera_equal(&l->lenses[k - 1].camera, camera))
        --k;
    if (k == 0) {
        k = ++l->lens_count;
        l->lenses[k - 1].camera = *camera;
        const sgs_status status = sgsi_mask_of_lens(camera, &l->lenses[k - 1].valid_mask);
        if (status)
            return status;
    }
    l->slots[i].lens = k - 1;
    return SGS_STATUS_OK;
}

typedef struct light_job {
    const loader *loader;
    size_t views[WHITE_VIEWS];
    sgsi_light *lights; // one per view
} light_job;

static void add_light(void *context, size_t i, int thread)
{
    (void)thread;
    const light_job *job = context;
    const loader *l = job->loader;
    // A file that cannot be read is reported when it is loaded.
    (void)sgsi_light_add(&job->lights[i], l->scene->views[job->views[i]].image_path,
                         l->options->colorspace);
}

// White point: the 99 % quantile of the light in a sample of the linear photographs.
static sgs_status measure_white_point(loader *l)
{
    light_job job = {.loader = l};
    size_t linear = 0, taken = 0, seen = 0;
    l->scene->white_point = l->options->white_point > 0 ? l->options->white_point : 1;
    for (size_t i = 0; i < l->scene->view_count; ++i)
        linear += l->slots[i].linear;
    l->scene->linear_images = linear;
    if (l->options->white_point > 0 || !linear ||
        !(l->options->load_images || l->options->measure_white_point))
        return SGS_STATUS_OK;
    const size_t step = (linear + WHITE_VIEWS - 1) / WHITE_VIEWS;
    for (size_t i = 0; i < l->scene->view_count; ++i)
        if (l->slots[i].linear && seen++ % step == 0)
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

// Fits the cameras and reads the photographs.
static sgs_status load_views(loader *l)
{
    sgs_scene *scene = l->scene;
    sgs_status status = SGS_STATUS_OK;
    l->progress.total = scene->view_count * (l->options->load_images ? 2 : 1);
    sgsi_parallel_for(scene->view_count, 1, probe_view, l);
    if (sgsi_progress_cancelled(&l->progress))
        return sgsi_scene_cancelled(scene->path);
    for (size_t i = 0; i < scene->view_count && !status; ++i)
        if (!l->slots[i].status)
            status = fit_camera(&l->dataset.frames[i], &l->slots[i], &scene->views[i],
                                &scene->views[i].camera);
    if (!status)
        status = measure_white_point(l);
    if (status || !l->options->load_images)
        return status;
    l->lenses = sgsi_calloc(scene->view_count, sizeof *l->lenses);
    if (!l->lenses)
        return sgsi_scene_no_memory(scene->path);
    for (size_t i = 0; i < scene->view_count && !status; ++i)
        if (!l->slots[i].status)
            status = find_lens(l, i);
    size_t bytes = 0;
    for (size_t i = 0; i < scene->view_count; ++i)
        bytes += l->slots[i].dropped ? 0 : l->slots[i].bytes;
    l->limited = l->options->image_cache && bytes > l->options->image_cache;
    if (l->limited) {
        l->sources = sgsi_calloc(scene->view_count, sizeof *l->sources);
        l->bytes = sgsi_calloc(scene->view_count, sizeof *l->bytes);
        if (!l->sources || !l->bytes)
            return sgsi_scene_no_memory(scene->path);
    }
    if (!status)
        sgsi_parallel_for(scene->view_count, 1, load_view, l);
    return !status && sgsi_progress_cancelled(&l->progress) ? sgsi_scene_cancelled(scene->path)
                                                            : status;
}

// The image cache takes ownership of the lens masks, which it applies at each decoding.
static sgs_status open_store(loader *l)
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
    return sgsi_scene_store_create(l->sources, l->bytes, l->scene->view_count,
                                   l->options->image_cache, planes, l->lens_count,
                                   &l->scene->store);
}

static int frame_order(const void *a, const void *b)
{
    const sgsi_frame *x = a, *y = b;
    return strcmp(x->name, y->name);
}

// Uses the mask that the camera file names for a view.
static sgs_status use_named_mask(const loader *l, size_t i)
{
    const char *folder = l->files.image_folder, *name = l->dataset.frames[i].mask;
    char *path = sgsi_format("%s/%s", folder, name);
    if (!path)
        return sgsi_scene_no_memory(l->scene->path);
    l->scene->views[i].mask_path = path;
    if (sgsi_is_file(path))
        return SGS_STATUS_OK;
    return sgsi_fail(
        SGS_STATUS_IO,
        "%s: no such mask, named by %s for '%s'; use option masks_dir none to ignore masks", path,
        l->files.model_path, l->scene->views[i].name);
}

// Length of the part of a name that is the image folder: names in transforms.json include it.
static size_t image_folder_length(const loader *l, const char *name)
{
    return strncmp(name, "images/", 7) ? l->top_folder : 7;
}

// Finds the masks of all views. Mask folders are next to the image folder; option masks_dir
// overrides masks named in camera files.
static sgs_status find_masks(loader *l)
{
    const char *folder = l->options->masks_dir;
    if ((folder && !strcmp(folder, "none")) || cameras_only(l))
        return SGS_STATUS_OK;
    const char *root = l->files.mask_root;
    char *given = !folder            ? NULL
                  : folder[0] == '/' ? sgsi_strdup(folder)
                                     : sgsi_format("%s/%s", root, folder);
    sgs_status status = !folder || given ? SGS_STATUS_OK : sgsi_scene_no_memory(l->scene->path);
    if (given && !sgsi_is_folder(given))
        status =
            sgsi_fail(SGS_STATUS_IO,
                      "%s: no such mask folder; use option masks_dir none to ignore masks", given);
    static const char *const usual[] = {"masks", "mask"};
    for (size_t k = 0; k < (given ? 1 : 2) && !status; ++k) {
        char *place = given ? sgsi_strdup(given) : sgsi_format("%s/%s", root, usual[k]);
        if (!place)
            status = sgsi_scene_no_memory(l->scene->path);
        sgsi_roots_add(&l->roots, place);
        l->mask_folder = l->mask_folder || (place && sgsi_is_folder(place));
        sgsi_free(place);
    }
    for (size_t i = 0; i < l->scene->view_count && !status; ++i) {
        sgs_view *view = &l->scene->views[i];
        status = !folder && l->dataset.frames[i].mask
                     ? use_named_mask(l, i)
                     : sgsi_mask_find(root, folder, view->image_path, view->name,
                                      image_folder_length(l, view->name), &view->mask_path);
    }
    sgsi_free(given);
    return status;
}

// Creates the views, sorted by name, with the paths of their photographs and masks.
static sgs_status make_views(loader *l)
{
    sgs_scene *scene = l->scene;
    const size_t count = l->dataset.frame_count;
    qsort(l->dataset.frames, count, sizeof *l->dataset.frames, frame_order);
    scene->views = sgsi_calloc(count, sizeof *scene->views);
    l->slots = sgsi_calloc(count, sizeof *l->slots);
    if (!scene->views || !l->slots)
        return sgsi_scene_no_memory(scene->path);
    scene->view_count = count;
    char *chosen;
    sgs_status status = sgsi_scene_choose_images(
        &l->files, cameras_only(l) ? NULL : l->options->images_dir, &chosen);
    if (status)
        return status;
    l->top_folder = l->files.colmap ? 0 : sgsi_dataset_top_folder(&l->dataset);
    sgsi_roots_add(&l->roots, scene->path);
    sgsi_roots_add(&l->roots, l->files.image_folder);
    sgsi_roots_add(&l->roots, chosen);
    if (!l->files.colmap)
        status = sgsi_dataset_add_roots(&l->dataset, l->files.image_folder, &l->roots);
    for (size_t i = 0; i < count && !status; ++i) {
        sgsi_frame *frame = &l->dataset.frames[i];
        sgs_view *view = &scene->views[i];
        *view = (sgs_view){.name = frame->name, .pose = frame->pose, .split = frame->split};
        frame->name = NULL;
        const size_t skip = chosen ? image_folder_length(l, view->name) : 0;
        view->image_path =
            sgsi_scene_image_path(chosen ? chosen : l->files.image_folder, view->name + skip);
        status = view->image_path ? SGS_STATUS_OK : sgsi_scene_no_memory(scene->path);
    }
    sgsi_free(chosen);
    return status ? status : find_masks(l);
}

// Counts for the warnings about all views.
typedef struct view_tally {
    size_t masked_out, masked_files, broken, mismatched; // masked_files: of masked_out, by a file
    const char *first_mismatched;                        // name
    bool downscaled;
} view_tally;

// Errors that do not merely skip a view: out of memory, a bad mask, an unknown colorspace, cameras
// without any size.
static sgs_status check_fatal(const loader *l)
{
    size_t failed = 0;
    for (size_t i = 0; i < l->scene->view_count; ++i) {
        const slot *s = &l->slots[i];
        failed += s->status != SGS_STATUS_OK;
        if (s->status == SGS_STATUS_OUT_OF_MEMORY || s->report.mask_failed ||
            (s->status == SGS_STATUS_UNSUPPORTED && l->options->colorspace))
            return sgsi_fail(s->status, "%s", s->error ? s->error : "no memory for the images");
    }
    if (cameras_only(l) && failed == l->scene->view_count)
        return sgsi_fail(SGS_STATUS_IO,
                         "%s: no image size, and no photographs to take it from; add 'w' and 'h', "
                         "or give it with option view_width",
                         l->scene->model_path);
    return SGS_STATUS_OK;
}

// True if the view has a photograph with valid pixels; warns otherwise.
static bool is_usable(loader *l, size_t i, view_tally *tally)
{
    sgs_scene *scene = l->scene;
    const slot *s = &l->slots[i];
    const sgs_view *view = &scene->views[i];
    if (s->report.pixels_broken && tally->broken++ < MAX_WARNINGS)
        sgsi_warn("%s: ignored %zu pixel(s) with infinite or NaN values", view->image_path,
                  s->report.pixels_broken);
    scene->pixels_broken += s->report.pixels_broken;
    if (s->status) {
        if (scene->images_missing++ < MAX_WARNINGS)
            sgsi_warn("%s; the view is skipped", s->error ? s->error : view->image_path);
        return false;
    }
    if (view->image.width && !view->image.kept) {
        if (tally->masked_out++ < MAX_WARNINGS)
            sgsi_warn("%s: mask excludes every pixel; the view is skipped",
                      view->mask_path ? view->mask_path : view->image_path);
        tally->masked_files += view->mask_path != NULL;
        return false;
    }
    return true;
}

static bool has_camera_aspect(const loader *l, size_t i)
{
    const slot *s = &l->slots[i];
    const sgs_camera *camera = &l->dataset.frames[i].camera;
    if (!camera->width)
        return true;
    const double stretch = (double)s->file_width * camera->height / s->file_height / camera->width;
    return !(fabs(stretch - 1) > 0.02);
}

// Moves view i to index `to` and adds it to the totals of the scene.
static void keep_view(loader *l, size_t i, size_t to, view_tally *tally)
{
    sgs_scene *scene = l->scene;
    const slot *s = &l->slots[i];
    const sgs_view *view = &scene->views[i];
    l->slots[to].dropped = s->dropped;
    if (s->dropped) {
        scene->views[to] = *view;
        return;
    }
    if (!has_camera_aspect(l, i) && tally->mismatched++ == 0)
        tally->first_mismatched = view->name;
    tally->downscaled |= l->options->downscale == 0 && s->width != s->file_width;
    scene->has_alpha |= s->channels == 4;
    scene->masks += view->mask_path != NULL;
    scene->photo_bytes += s->bytes;
    scene->float_images += s->halves;
    if (l->limited) {
        l->sources[to] = source_of(l, i);
        l->bytes[to] = s->bytes;
    }
    scene->views[to] = *view;
}

static sgs_status report_no_views(const loader *l, size_t count, const view_tally *tally)
{
    const sgs_scene *scene = l->scene;
    if (tally->masked_out)
        return sgsi_fail(
            SGS_STATUS_INVALID_ARGUMENT,
            "%s: masks exclude every pixel of every image; masks inverted? (option invert_masks)",
            scene->path);
    return sgsi_fail(
        SGS_STATUS_IO, "%s: none of the %zu registered images can be read; first error: %s",
        l->files.image_folder, count, l->slots[0].error ? l->slots[0].error : "unknown error");
}

static void warn_about_views(const loader *l, const view_tally *tally)
{
    sgs_scene *scene = l->scene;
    const size_t used = scene->masks;
    scene->masks += tally->masked_files;
    if (!scene->masks && l->mask_folder)
        sgsi_warn(
            "%s: the mask folder contains no mask named after an image (STEM.png, NAME.png or "
            "STEM_mask.png)",
            scene->path);
    if (scene->masks && used < scene->view_count)
        sgsi_warn("%s: %zu of %zu images have no mask; all of their pixels are used", scene->path,
                  scene->view_count - used, scene->view_count);
    if (tally->downscaled)
        sgsi_warn(
            "%s: images wider than %d px are reduced to %d px; use option downscale 1 to keep "
            "their size",
            scene->path, AUTOMATIC_WIDTH, AUTOMATIC_WIDTH);
    if (tally->mismatched)
        sgsi_warn("%s: aspect ratio of %zu image(s), first '%s', differs from their camera; were "
                  "they rotated or cropped?",
                  scene->path, tally->mismatched, tally->first_mismatched);
    sgsi_scene_warn_centers(scene);
}

// Drops the views without a usable photograph.
static sgs_status drop_unusable_views(loader *l)
{
    sgs_scene *scene = l->scene;
    const size_t count = scene->view_count;
    view_tally tally = {0};
    const sgs_status status = check_fatal(l);
    if (status)
        return status;
    size_t kept = 0;
    for (size_t i = 0; i < count; ++i) {
        if (is_usable(l, i, &tally))
            keep_view(l, i, kept++, &tally);
        else
            free_view(&scene->views[i]);
    }
    scene->view_count = kept;
    if (scene->images_missing > MAX_WARNINGS)
        sgsi_warn("%s: %zu of %zu registered images cannot be read and are skipped", scene->path,
                  scene->images_missing, count);
    if (!kept)
        return report_no_views(l, count, &tally);
    warn_about_views(l, &tally);
    return SGS_STATUS_OK;
}

static int text_order(const void *a, const void *b)
{
    return strcmp(*(const char *const *)a, *(const char *const *)b);
}

// Marks the views that options.kept does not name.
static sgs_status mark_dropped(loader *l)
{
    const size_t count = l->options->kept_count;
    if (!l->options->kept)
        return SGS_STATUS_OK;
    const char **names = sgsi_alloc(count ? count : 1, sizeof *names);
    if (!names)
        return sgsi_scene_no_memory(l->scene->path);
    memcpy(names, l->options->kept, count * sizeof *names);
    qsort(names, count, sizeof *names, text_order);
    for (size_t i = 0; i < l->scene->view_count; ++i)
        l->slots[i].dropped =
            !bsearch(&l->scene->views[i].name, names, count, sizeof *names, text_order);
    sgsi_free(names);
    return SGS_STATUS_OK;
}

// Drops the marked views, which have counted for the extent.
static sgs_status drop_marked_views(loader *l)
{
    sgs_scene *scene = l->scene;
    const size_t count = scene->view_count;
    size_t kept = 0;
    for (size_t i = 0; i < count; ++i) {
        if (l->slots[i].dropped) {
            free_view(&scene->views[i]);
            continue;
        }
        if (l->limited) {
            l->sources[kept] = l->sources[i];
            l->bytes[kept] = l->bytes[i];
        }
        scene->views[kept++] = scene->views[i];
    }
    scene->view_count = kept;
    if (kept)
        return SGS_STATUS_OK;
    return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: none of the %zu views is in the block",
                     scene->path, count);
}

// Counts the photographs without a pose. Runs before views are dropped: unreadable images have a
// pose.
static sgs_status count_unposed(loader *l)
{
    sgs_scene *scene = l->scene;
    if (!l->files.colmap || cameras_only(l))
        return SGS_STATUS_OK; // without COLMAP, the folder also contains depth maps and other
                              // splits
    const char **known = sgsi_alloc(scene->view_count, sizeof *known);
    if (!known)
        return sgsi_scene_no_memory(scene->path);
    const size_t prefix = strlen(l->files.image_folder) + 1;
    for (size_t i = 0; i < scene->view_count; ++i)
        known[i] = scene->views[i].image_path + prefix;
    qsort(known, scene->view_count, sizeof *known, text_order);
    char examples[256];
    scene->images_unposed = sgsi_scene_count_unknown(l->files.image_folder, &l->roots, known,
                                                     scene->view_count, examples, sizeof examples);
    sgsi_free(known);
    if (scene->images_unposed)
        sgsi_warn("%s: ignored %zu image(s) without a pose in the model: %s%s",
                  l->files.image_folder, scene->images_unposed, examples,
                  scene->images_unposed > 3 ? ", ..." : "");
    return SGS_STATUS_OK;
}

// ---- Loading ------------------------------------------------------------------------------------

static sgs_status load(loader *l)
{
    sgs_scene *scene = l->scene;
    sgs_status status = sgsi_scene_find(
        scene->path, l->options->cameras_only ? "." : l->options->images_dir, &l->files);
    if (status)
        return status;
    scene->model_path = sgsi_strdup(l->files.model_path);
    if (l->options->colorspace)
        scene->colorspace = sgsi_strdup(l->options->colorspace);
    if (!scene->model_path || (l->options->colorspace && !scene->colorspace))
        return sgsi_scene_no_memory(scene->path);
    status = l->files.colmap ? sgsi_colmap_read(scene->model_path, &l->dataset)
                             : sgsi_transforms_read(scene->model_path, &l->dataset);
    if (status)
        return status;
    scene->format = l->dataset.format;
    scene->space = l->options->space;
    scene->alpha = l->options->alpha;
    scene->white_point = 1;
    scene->point_count = l->dataset.point_count;
    scene->points = l->dataset.points;
    scene->colors = l->dataset.colors;
    l->dataset.points = NULL;
    l->dataset.colors = NULL;
    status = make_views(l);
    if (status)
        return status;
    scene->digest = sgsi_scene_digest(scene);
    status = mark_dropped(l);
    if (!status)
        status = load_views(l);
    if (!status)
        status = count_unposed(l);
    if (!status)
        status = drop_unusable_views(l);
    if (!status)
        status = sgsi_scene_split(scene, l->options, l->dataset.has_split);
    if (!status)
        status = sgsi_scene_measure_extent(scene);
    if (!status)
        status = drop_marked_views(l);
    if (!status)
        status = open_store(l);
    scene->white_background =
        l->dataset.white_background && scene->has_alpha && l->options->alpha == SGS_ALPHA_OVER;
    return status;
}

sgs_status sgs_scene_load(const char *path, const sgs_scene_options *options, sgs_scene **scene)
{
    sgs_scene_options own = sgs_scene_options_default();
    loader l = {.options = &own};
    *scene = NULL;
    sgs_status status = sgsi_options_read(options, "sgs_scene_options", &own, sizeof own);
    if (!status && (!path || !*path))
        status = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "scene path is missing");
    if (!status)
        status = sgsi_scene_options_check(path, &own);
    if (!status && own.cameras_only && own.load_images)
        status = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                           "%s: option cameras_only requires load_images false", path);
    if (status)
        return status;
    sgsi_progress_begin(&l.progress, own.progress, own.progress_user, 0);
    l.scene = sgsi_calloc(1, sizeof *l.scene);
    if (l.scene)
        l.scene->path = sgsi_strdup(path);
    status = l.scene && l.scene->path ? load(&l) : sgsi_scene_no_memory(path);
    for (size_t i = 0; l.slots && i < l.dataset.frame_count; ++i)
        sgsi_free(l.slots[i].error);
    sgsi_free(l.slots);
    sgsi_progress_end(&l.progress);
    sgsi_free(l.sources);
    sgsi_free(l.bytes);
    for (size_t i = 0; i < l.lens_count; ++i)
        sgsi_free(l.lenses[i].valid_mask);
    sgsi_free(l.lenses);
    sgsi_dataset_free(&l.dataset);
    sgsi_roots_free(&l.roots);
    sgsi_scene_files_free(&l.files);
    if (status) {
        sgs_scene_destroy(l.scene);
        return status;
    }
    *scene = l.scene;
    return SGS_STATUS_OK;
}
