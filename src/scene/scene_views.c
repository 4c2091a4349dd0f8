// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Views of a scene: names, paths and masks before the photos are read; afterwards, which of
// them are dropped.

#include "scene/scene_loader.h"

#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "base/base_name.h"
#include "base/compare.h"
#include "base/core.h"
#include "image/mask.h"
#include "scene/scene_split.h"
#include "scene/transforms.h"

enum { MAX_WARNINGS = 5 };
#define LENS_FIELDS "k1, k2, p1, p2, cx, cy"

void sgsi_view_free(sgs_view *view)
{
    sgsi_free(view->name);
    sgsi_free(view->image_path);
    sgsi_free(view->mask_path);
    sgsi_photo_free(&view->image);
}

static int frame_order(const void *a, const void *b)
{
    const sgsi_frame *x = a, *y = b;
    return strcmp(x->name, y->name);
}

// Uses the mask that the camera file names for a view.
static sgs_status use_named_mask(const sgsi_scene_loader *l, size_t i)
{
    const char *folder = l->files.image_folder, *name = l->dataset.frames[i].mask;
    char *path = sgsi_format("%s/%s", folder, name);
    if (!path)
        return sgsi_scene_no_memory(l->scene->path);
    l->scene->views[i].mask_path = path;
    bool found;
    const sgs_status status = sgsi_find_file(path, &found);
    if (status || found)
        return status;
    return sgsi_fail(SGS_STATUS_IO, "%s: no such mask, named by %s for '%s'", path,
                     l->files.model_path, l->scene->views[i].name);
}

// Length of the part of a name that is the image folder: names in transforms.json include it.
static size_t image_folder_length(const sgsi_scene_loader *l, const char *name)
{
    return strncmp(name, "images/", 7) ? l->top_folder : 7;
}

// Adds a folder of masks if it exists. Takes ownership of `path`; NULL: no memory.
static sgs_status add_mask_folder(sgsi_scene_loader *l, char *path, bool *found)
{
    *found = false;
    sgs_status status = path ? sgsi_find_folder(path, found) : sgsi_scene_no_memory(l->scene->path);
    if (!status)
        status = sgsi_roots_add(&l->roots, path);
    if (!status && *found)
        l->mask_folders[l->mask_folder_count++] = path;
    else
        sgsi_free(path);
    return status;
}

// The first folder in `root` with this name in other case, as programs on Windows write it; a new
// string, or NULL.
static char *find_other_case(const char *root, const char *name)
{
    char *best = NULL;
    DIR *folder = opendir(root);
    for (struct dirent *entry; folder && (entry = readdir(folder));) {
        if (strcasecmp(entry->d_name, name) != 0)
            continue;
        char *path = sgsi_format("%s/%s", root, entry->d_name);
        if (path && sgsi_is_folder(path) && (!best || strcmp(path, best) < 0)) {
            sgsi_free(best);
            best = path;
        } else {
            sgsi_free(path);
        }
    }
    if (folder)
        closedir(folder);
    return best;
}

// Finds the folders of the masks, which are next to the image folder.
static sgs_status find_mask_folders(sgsi_scene_loader *l)
{
    static const char *const usual[] = {"masks", "mask"};
    const char *given = l->options->masks_dir, *root = l->files.mask_root;
    sgs_status status = SGS_STATUS_OK;
    bool found = false;
    if (given) {
        char *path = given[0] == '/' ? sgsi_strdup(given) : sgsi_format("%s/%s", root, given);
        status = add_mask_folder(l, path, &found);
        return status || found
                   ? status
                   : sgsi_fail(SGS_STATUS_IO, "%s%s%s: no such mask folder",
                               given[0] == '/' ? "" : root, given[0] == '/' ? "" : "/", given);
    }
    for (size_t k = 0; k < 2 && !status; ++k) {
        status = add_mask_folder(l, sgsi_format("%s/%s", root, usual[k]), &found);
        char *other = status || found ? NULL : find_other_case(root, usual[k]);
        if (other)
            status = add_mask_folder(l, other, &found);
    }
    return status;
}

// True if the photos are in this folder, which may also have their masks, or below it.
static bool holds_photos(const sgsi_scene_loader *l, const char *folder)
{
    char *masks = realpath(folder, NULL), *photo = realpath(l->scene->views[0].image_path, NULL);
    const size_t length = masks ? strlen(masks) : 0;
    const bool holds = masks && photo && !strncmp(photo, masks, length) && photo[length] == '/';
    free(masks);
    free(photo);
    return holds;
}

// Masks that match no image are a mistake in their names.
static sgs_status check_mask_names(const sgsi_scene_loader *l)
{
    const sgs_scene *scene = l->scene;
    for (size_t i = 0; i < scene->view_count; ++i)
        if (scene->views[i].mask_path)
            return SGS_STATUS_OK;
    for (size_t k = 0; k < l->mask_folder_count; ++k) {
        const sgsi_file_search search = {
            .folder = l->mask_folders[k], .roots = &l->roots, .masks = true};
        const char *name = scene->views[0].name + image_folder_length(l, scene->views[0].name);
        sgsi_unknown_files files;
        if (holds_photos(l, l->mask_folders[k]))
            continue;
        sgsi_scene_find_unknown(&search, &files);
        if (files.count)
            return sgsi_fail(SGS_STATUS_IO,
                             "%s: none of its %zu images is named after an image of the scene; it "
                             "contains %s; a mask must be named after its image, for example "
                             "%.*s.png",
                             l->mask_folders[k], files.count, files.examples,
                             sgsi_stem_length(name), name);
    }
    return SGS_STATUS_OK;
}

// Finds the masks of all views. Option masks_dir overrides masks named in camera files.
static sgs_status find_masks(sgsi_scene_loader *l)
{
    const char *given = l->options->masks_dir;
    if ((given && !strcmp(given, "none")) || sgsi_loader_cameras_only(l))
        return SGS_STATUS_OK;
    sgs_status status = find_mask_folders(l);
    unsigned extensions = 0;
    for (size_t k = 0; k < l->mask_folder_count; ++k)
        extensions |= sgsi_mask_extensions(l->mask_folders[k]);
    const sgsi_mask_places places = {.folders = (const char *const *)l->mask_folders,
                                     .folder_count = l->mask_folder_count,
                                     .extensions = extensions,
                                     .beside = !given};
    for (size_t i = 0; i < l->scene->view_count && !status; ++i) {
        sgs_view *view = &l->scene->views[i];
        status = !given && l->dataset.frames[i].mask
                     ? use_named_mask(l, i)
                     : sgsi_mask_find(&places, view->image_path, view->name,
                                      image_folder_length(l, view->name), &view->mask_path,
                                      &l->slots[i].dynamic_mask);
    }
    if (!status)
        status = check_mask_names(l);
    return status == SGS_STATUS_IO
               ? sgsi_fail(status, "%s; use option masks_dir none to ignore masks",
                           sgs_last_error())
               : status;
}

// Fails if a folder of the photo may not be searched: its other photos are not missing either.
// Other errors concern this photo only; reading it reports them.
static sgs_status check_searchable(const char *image_path)
{
    bool found;
    struct stat info;
    return stat(image_path, &info) && errno == EACCES ? sgsi_find_file(image_path, &found)
                                                      : SGS_STATUS_OK;
}

sgs_status sgsi_loader_make_views(sgsi_scene_loader *l)
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
        &l->files, sgsi_loader_cameras_only(l) ? NULL : l->options->images_dir, &chosen);
    if (status)
        return status;
    l->top_folder = l->files.colmap ? 0 : sgsi_dataset_top_folder(&l->dataset);
    const char *const folders[] = {scene->path, l->files.image_folder, chosen};
    for (size_t k = 0; k < sizeof folders / sizeof *folders && !status; ++k)
        status = sgsi_roots_add(&l->roots, folders[k]);
    if (!l->files.colmap && !status)
        status = sgsi_dataset_add_roots(&l->dataset, l->files.image_folder, &l->roots);
    for (size_t i = 0; i < count && !status; ++i) {
        sgsi_frame *frame = &l->dataset.frames[i];
        sgs_view *view = &scene->views[i];
        *view = (sgs_view){.name = frame->name, .pose = frame->pose, .split = frame->split};
        frame->name = NULL;
        const size_t skip = chosen ? image_folder_length(l, view->name) : 0;
        view->image_path =
            sgsi_scene_image_path(chosen ? chosen : l->files.image_folder, view->name + skip);
        if (!view->image_path)
            status = sgsi_scene_no_memory(scene->path);
        else if (!sgsi_loader_cameras_only(l))
            status = check_searchable(view->image_path);
    }
    sgsi_free(chosen);
    return status ? status : find_masks(l);
}

// Counts for the warnings about all views.
typedef struct view_tally {
    size_t kept, scene_linear;                           // views in use; their scene-linear photos
    size_t masked_out, masked_files, broken, mismatched; // masked_files: of masked_out, by a file
    size_t rayless;                                      // views whose lens has no ray
    size_t emptied;      // of masked_files: masks without a valid pixel
    char *first_emptied; // its path, or NULL without memory
    size_t lens_warnings;
    const char *first_mismatched; // name
    int first_orientation;        // of its file
    const char *first_linear;     // path of its file
    const char *spaces[8];        // distinct colour spaces of the photos; more are not listed
    bool downscaled;
} view_tally;

// Errors that do not merely skip a view: out of memory, a bad mask, an unknown colorspace, cameras
// without any size.
static sgs_status check_fatal(const sgsi_scene_loader *l)
{
    size_t failed = 0;
    for (size_t i = 0; i < l->scene->view_count; ++i) {
        const sgsi_view_slot *s = &l->slots[i];
        failed += s->status != SGS_STATUS_OK;
        if (s->status == SGS_STATUS_OUT_OF_MEMORY || s->report.mask_failed ||
            (s->status == SGS_STATUS_UNSUPPORTED && l->options->colorspace))
            return sgsi_fail(s->status, "%s",
                             s->error ? s->error : "not enough memory for the images");
    }
    if (sgsi_loader_cameras_only(l) && failed == l->scene->view_count)
        return sgsi_fail(SGS_STATUS_IO,
                         "%s: no image size, and no photos to take it from; add 'w' and 'h', "
                         "or give it with option view_width",
                         l->scene->model_path);
    return SGS_STATUS_OK;
}

// False if the lens has no ray; warns, once per lens, of that and of a perspective lens with few.
// The image circle of a fisheye lens leaves the corners out.
static bool has_rays(sgsi_scene_loader *l, size_t i, view_tally *tally)
{
    const sgs_view *view = &l->scene->views[i];
    sgsi_lens_mask *lens = &l->lenses[l->slots[i].lens];
    const double all = (double)view->camera.width * view->camera.height;
    const double lost = 1 - (double)lens->rays / all;
    const bool is_rare = lost > 0.05 && !sgs_camera_is_fisheye(view->camera.model);
    if (!lens->reported && (!lens->rays || is_rare) && tally->lens_warnings++ < MAX_WARNINGS) {
        if (lens->rays)
            sgsi_warn("%s: the lens of the camera of '%s' has no ray for %.1f %% of the pixels, "
                      "which are not used; check " LENS_FIELDS,
                      l->scene->model_path, view->name, 100 * lost);
        else
            sgsi_warn("%s: the lens of the camera of '%s' has no ray for any pixel, and its images "
                      "are skipped; check " LENS_FIELDS,
                      l->scene->model_path, view->name);
    }
    lens->reported = true;
    tally->rayless += !lens->rays;
    return lens->rays > 0;
}

// True if the view has a photo with valid pixels; warns otherwise.
static bool is_usable(sgsi_scene_loader *l, size_t i, view_tally *tally)
{
    sgs_scene *scene = l->scene;
    const sgsi_view_slot *s = &l->slots[i];
    const sgs_view *view = &scene->views[i];
    if (s->report.pixels_nonfinite && tally->broken++ < MAX_WARNINGS)
        sgsi_warn("%s: ignored %zu pixel(s) with infinite or NaN values", view->image_path,
                  s->report.pixels_nonfinite);
    scene->pixels_nonfinite += s->report.pixels_nonfinite;
    if (s->status) {
        if (scene->images_missing++ < MAX_WARNINGS)
            sgsi_warn("%s; the view is skipped", s->error ? s->error : view->image_path);
        return false;
    }
    if (l->lenses && !has_rays(l, i, tally))
        return false;
    if (view->image.width && !view->image.kept) {
        if (tally->masked_out++ < MAX_WARNINGS)
            sgsi_warn("%s: mask excludes every pixel; the view is skipped",
                      view->mask_path ? view->mask_path : view->image_path);
        tally->masked_files += view->mask_path != NULL;
        if (s->report.mask.excludes_all && tally->emptied++ == 0)
            tally->first_emptied = sgsi_strdup(view->mask_path);
        return false;
    }
    return true;
}

// Warns once per kind of note: of the first photo, and of the number of the others.
static void warn_of_notes(const sgsi_scene_loader *l)
{
    for (int k = 0; k < SGSI_NOTES; ++k) {
        size_t found = 0, first = 0;
        for (size_t i = 0; i < l->scene->view_count; ++i)
            if (l->slots[i].notes[k] && !l->slots[i].status && !l->slots[i].dropped && found++ == 0)
                first = i;
        char others[64] = "";
        if (found > 1)
            snprintf(others, sizeof others, " (and %zu other image%s)", found - 1,
                     found == 2 ? "" : "s");
        if (found)
            sgsi_warn("%s: %s%s", l->scene->views[first].image_path, l->slots[first].notes[k],
                      others);
    }
}

// Warns if inverted masks exclude no pixel: the option then does what it should undo, for example
// to masks that are black by mistake.
static void warn_of_inversion(const sgsi_scene_loader *l)
{
    size_t masks = 0, excluding = 0, dynamic = 0;
    for (size_t i = 0; i < l->scene->view_count; ++i)
        if (l->scene->views[i].mask_path && !l->slots[i].status && !l->slots[i].dropped) {
            ++masks;
            dynamic += l->slots[i].dynamic_mask;
            excluding += l->slots[i].report.mask.excludes;
        }
    if (l->options->invert_masks && l->options->load_images && masks && !excluding)
        sgsi_warn("%s: with option invert_masks, no mask excludes a pixel; are the masks empty? "
                  "%s is valid without this option, %s with it",
                  l->scene->path, dynamic == masks ? "Black" : "White",
                  dynamic == masks ? "white" : "black");
}

// Warns once of masks whose alpha channel counts instead of their colours.
static void warn_of_cutouts(const sgsi_scene_loader *l)
{
    size_t found = 0, first = 0;
    for (size_t i = 0; i < l->scene->view_count; ++i)
        if (l->slots[i].report.mask.by_alpha && found++ == 0)
            first = i;
    char others[64] = "";
    if (found > 1)
        snprintf(others, sizeof others, " (also in %zu other mask%s)", found - 1,
                 found == 2 ? "" : "s");
    if (found)
        sgsi_warn("%s: alpha is used as the mask%s, because the colours are not those of a mask",
                  l->scene->views[first].mask_path, others);
}

static bool has_camera_aspect(const sgsi_scene_loader *l, size_t i)
{
    const sgsi_view_slot *s = &l->slots[i];
    const sgs_camera *camera = &l->dataset.frames[i].camera;
    if (!camera->width)
        return true;
    const double stretch = (double)s->file_width * camera->height / s->file_height / camera->width;
    return !(fabs(stretch - 1) > 0.02);
}

// Moves view i to index `to` and adds it to the totals of the scene.
static void keep_view(sgsi_scene_loader *l, size_t i, size_t to, view_tally *tally)
{
    sgs_scene *scene = l->scene;
    const sgsi_view_slot *s = &l->slots[i];
    const sgs_view *view = &scene->views[i];
    l->slots[to].dropped = s->dropped;
    if (s->dropped) {
        scene->views[to] = *view;
        return;
    }
    if (!has_camera_aspect(l, i) && tally->mismatched++ == 0) {
        tally->first_mismatched = view->name;
        tally->first_orientation = view->orientation;
    }
    if (s->width > 0 && s->file_width > scene->reduction * s->width)
        scene->reduction = (double)s->file_width / s->width;
    tally->downscaled |= l->options->downscale == 0 && s->width != s->file_width;
    ++tally->kept;
    tally->scene_linear += s->scene_linear;
    if (s->scene_linear && !tally->first_linear)
        tally->first_linear = view->image_path;
    for (size_t k = 0; *s->space && k < sizeof tally->spaces / sizeof *tally->spaces; ++k) {
        if (!tally->spaces[k])
            tally->spaces[k] = s->space;
        if (!strcmp(tally->spaces[k], s->space))
            break;
    }
    scene->has_alpha |= s->channels == 4;
    scene->masks += view->mask_path != NULL;
    scene->photo_bytes += s->bytes;
    scene->float_images += s->halves;
    if (l->limited) {
        l->sources[to] = sgsi_loader_source(l, i);
        l->bytes[to] = s->bytes;
    }
    scene->views[to] = *view;
}

static sgs_status report_no_views(const sgsi_scene_loader *l, size_t count, const view_tally *tally)
{
    const sgs_scene *scene = l->scene;
    if (tally->rayless && !tally->masked_out)
        return sgsi_fail(
            SGS_STATUS_FORMAT,
            "%s: the lens has no ray for any pixel of %zu image(s); check " LENS_FIELDS,
            scene->model_path, tally->rayless);
    if (tally->emptied && tally->emptied == tally->masked_out)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "%s: masks exclude every pixel of every image, %s for example; correct "
                         "them, or ignore masks with option masks_dir none",
                         scene->path, tally->first_emptied ? tally->first_emptied : "the first");
    if (tally->masked_out)
        return sgsi_fail(
            SGS_STATUS_INVALID_ARGUMENT,
            "%s: masks exclude every pixel of every image; masks inverted? (option invert_masks)",
            scene->path);
    return sgsi_fail(SGS_STATUS_IO, "%s: none of the %zu registered images can be read; %s%s",
                     l->files.image_folder, count, l->name_hint ? "" : "first error: ",
                     l->name_hint        ? l->name_hint
                     : l->slots[0].error ? l->slots[0].error
                                         : "unknown error");
}

// Lists the colour spaces of the photos; warns of photos of both kinds.
static void describe_colors(sgs_scene *scene, const view_tally *tally)
{
    for (size_t k = 0; k < sizeof tally->spaces / sizeof *tally->spaces && tally->spaces[k]; ++k) {
        char *longer = k ? sgsi_format("%s, %s", scene->color_spaces, tally->spaces[k])
                         : sgsi_strdup(tally->spaces[k]);
        sgsi_free(scene->color_spaces);
        scene->color_spaces = longer;
        if (!longer)
            return;
    }
    scene->linear_images = tally->scene_linear;
    if (tally->first_linear && tally->scene_linear < tally->kept)
        sgsi_warn("%s: %zu of %zu images are scene-linear (first %s) and use the white level; the "
                  "others are display-encoded; use images of one kind, or name the colour space of "
                  "all with option colorspace",
                  scene->path, tally->scene_linear, tally->kept, tally->first_linear);
}

static void warn_about_views(const sgsi_scene_loader *l, const view_tally *tally)
{
    sgs_scene *scene = l->scene;
    const size_t used = scene->masks;
    scene->masks += tally->masked_files;
    if (!scene->masks && l->mask_folder_count)
        sgsi_warn(
            "%s: the mask folder contains no mask named after an image (STEM, NAME or STEM_mask, "
            "as PNG, JPEG or TIFF)",
            scene->path);
    if (scene->masks && used < scene->view_count)
        sgsi_warn("%s: %zu of %zu images have no mask; all of their pixels are used", scene->path,
                  scene->view_count - used, scene->view_count);
    if (tally->downscaled)
        sgsi_warn(
            "%s: images wider than %d px are reduced to %d px; use option downscale 1 to keep "
            "their size",
            scene->path, SGSI_AUTOMATIC_WIDTH, SGSI_AUTOMATIC_WIDTH);
    if (tally->mismatched && tally->first_orientation >= 5) // width and height are exchanged
        sgsi_warn(
            "%s: aspect ratio of %zu image(s), first '%s', differs from their camera; its EXIF "
            "orientation %d is not applied: rotate the pixels of the photos by it, or estimate "
            "the cameras of the photos as they are stored",
            scene->path, tally->mismatched, tally->first_mismatched, tally->first_orientation);
    else if (tally->mismatched)
        sgsi_warn("%s: aspect ratio of %zu image(s), first '%s', differs from their camera; were "
                  "they rotated or cropped?",
                  scene->path, tally->mismatched, tally->first_mismatched);
    describe_colors(scene, tally);
    sgsi_scene_warn_centers(scene);
}

sgs_status sgsi_loader_drop_unusable(sgsi_scene_loader *l)
{
    sgs_scene *scene = l->scene;
    const size_t count = scene->view_count;
    view_tally tally = {0};
    sgs_status status = check_fatal(l);
    if (status)
        return status;
    warn_of_notes(l);
    warn_of_inversion(l);
    warn_of_cutouts(l);
    size_t kept = 0;
    for (size_t i = 0; i < count; ++i) {
        if (is_usable(l, i, &tally))
            keep_view(l, i, kept++, &tally);
        else
            sgsi_view_free(&scene->views[i]);
    }
    scene->view_count = kept;
    if (scene->images_missing > MAX_WARNINGS)
        sgsi_warn("%s: %zu of %zu registered images cannot be read and are skipped", scene->path,
                  scene->images_missing, count);
    if (kept && l->name_hint)
        sgsi_warn("%s: %s", l->files.image_folder, l->name_hint);
    if (!kept)
        status = report_no_views(l, count, &tally);
    else
        warn_about_views(l, &tally);
    sgsi_free(tally.first_emptied);
    return status;
}

sgs_status sgsi_loader_mark_dropped(sgsi_scene_loader *l)
{
    const size_t count = l->options->kept_count;
    if (!l->options->kept)
        return SGS_STATUS_OK;
    const char **names = sgsi_alloc(count ? count : 1, sizeof *names);
    if (!names)
        return sgsi_scene_no_memory(l->scene->path);
    memcpy(names, l->options->kept, count * sizeof *names);
    qsort(names, count, sizeof *names, sgsi_compare_strings);
    for (size_t i = 0; i < l->scene->view_count; ++i)
        l->slots[i].dropped =
            !bsearch(&l->scene->views[i].name, names, count, sizeof *names, sgsi_compare_strings);
    sgsi_free(names);
    return SGS_STATUS_OK;
}

sgs_status sgsi_loader_drop_marked(sgsi_scene_loader *l)
{
    sgs_scene *scene = l->scene;
    const size_t count = scene->view_count;
    size_t kept = 0;
    for (size_t i = 0; i < count; ++i) {
        if (l->slots[i].dropped) {
            sgsi_view_free(&scene->views[i]);
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

// Writes how to find a missing photo that resembles a file without a pose, or NULL without memory.
static char *explain_name(const sgsi_scene_loader *l, const sgsi_unknown_files *unknown)
{
    const char *given = l->options->images_dir ? l->options->images_dir : "images",
               *missing = unknown->missing, *similar = unknown->similar;
    const size_t lengths[2] = {strlen(missing), strlen(similar)};
    const size_t extra =
        lengths[0] > lengths[1] ? lengths[0] - lengths[1] : lengths[1] - lengths[0];
    if (unknown->difference != SGSI_NAME_FOLDER)
        return sgsi_format(
            "image '%s' of the model and the file '%s' differ only in %s; rename the "
            "files",
            missing, similar, sgsi_name_difference_text(unknown->difference));
    if (lengths[0] < lengths[1])
        return sgsi_format(
            "image '%s' of the model is the file '%s'; use option images_dir %s/%.*s", missing,
            similar, given, (int)(extra - 1), similar);
    // The image folder ends with the folders that the names begin with, or another one does.
    const size_t end = strlen(given);
    if (end == extra - 1 && !strncmp(given, missing, end))
        return sgsi_format("image '%s' of the model is the file '%s' of the folder; use option "
                           "images_dir .",
                           missing, similar);
    return sgsi_format("image '%s' of the model is the file '%s' of the folder; with option "
                       "images_dir, use the folder that contains '%.*s'",
                       missing, similar, (int)(extra - 1), missing);
}

// The first missing photos, for a comparison with the files that are there.
static size_t list_missing(const sgsi_scene_loader *l, const char *missing[], size_t limit)
{
    const size_t prefix = strlen(l->files.image_folder) + 1;
    size_t found = 0;
    for (size_t i = 0; i < l->scene->view_count && found < limit; ++i) {
        const char *path = l->scene->views[i].image_path;
        if (l->slots[i].status && !sgsi_is_file(path))
            missing[found++] = path + prefix;
    }
    return found;
}

sgs_status sgsi_loader_count_unposed(sgsi_scene_loader *l)
{
    enum { COMPARED = 16 };
    sgs_scene *scene = l->scene;
    if (!l->files.colmap || sgsi_loader_cameras_only(l))
        return SGS_STATUS_OK; // without COLMAP, the folder also contains depth maps and other
                              // splits
    const char **known = sgsi_alloc(scene->view_count, sizeof *known), *missing[COMPARED];
    if (!known)
        return sgsi_scene_no_memory(scene->path);
    const size_t prefix = strlen(l->files.image_folder) + 1;
    for (size_t i = 0; i < scene->view_count; ++i)
        known[i] = scene->views[i].image_path + prefix;
    qsort(known, scene->view_count, sizeof *known, sgsi_compare_strings);
    const sgsi_file_search search = {.folder = l->files.image_folder,
                                     .roots = &l->roots,
                                     .known = known,
                                     .known_count = scene->view_count,
                                     .missing = missing,
                                     .missing_count = list_missing(l, missing, COMPARED)};
    sgsi_unknown_files unknown;
    sgsi_scene_find_unknown(&search, &unknown);
    scene->images_unposed = unknown.count;
    sgsi_free(known);
    if (unknown.similar)
        l->name_hint = explain_name(l, &unknown);
    sgsi_free(unknown.similar);
    if (unknown.count)
        sgsi_warn("%s: ignored %zu image(s) without a pose in the model: %s%s",
                  l->files.image_folder, unknown.count, unknown.examples,
                  unknown.count > 3 ? ", ..." : "");
    return SGS_STATUS_OK;
}
