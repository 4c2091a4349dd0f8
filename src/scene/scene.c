// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Loads a scene: camera files (scene_find.c, colmap.c, transforms.c), views (scene_views.c) and
// photos (scene_photos.c).
//
// Steps: find the files; read cameras and points; sort views by name; read the headers of the
// photos and fit each camera to the size of its photo after downscaling; read the
// photos; drop views without one; split; measure the extent. Photos are read in parallel.
// A view depends on its own files only, and warnings are sent afterwards in view order, so the
// result and the messages do not depend on the number of threads.
//
// As in 3DGS: the maximum width of 1600 pixels, every N-th of the sorted names as test set, and the
// extent. Differences: images are area-averaged instead of bicubic; intrinsics are scaled to the
// image's actual size per axis instead of keeping the field of view; views without a photo are
// dropped before the split.

#include "sparegs/scene.h"

#include "base/core.h"
#include "scene/colmap.h"
#include "scene/scene_loader.h"
#include "scene/scene_split.h"
#include "scene/scene_store.h"
#include "scene/transforms.h"

void sgs_scene_options_init(sgs_scene_options *options, size_t size)
{
    const sgs_scene_options defaults = {.load_images = true};
    sgsi_options_init(options, size, &defaults, sizeof defaults);
}

void sgs_scene_destroy(sgs_scene *scene)
{
    if (!scene)
        return;
    sgsi_scene_store_destroy(scene->store);
    for (size_t i = 0; i < scene->view_count; ++i)
        sgsi_view_free(&scene->views[i]);
    sgsi_free(scene->views);
    sgsi_free(scene->points);
    sgsi_free(scene->colors);
    sgsi_free(scene->path);
    sgsi_free(scene->model_path);
    sgsi_free(scene->colorspace);
    sgsi_free(scene->color_spaces);
    sgsi_free(scene);
}

static sgs_status load(sgsi_scene_loader *l)
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
    scene->reduction = 1;
    scene->point_count = l->dataset.point_count;
    scene->points = l->dataset.points;
    scene->colors = l->dataset.colors;
    l->dataset.points = NULL;
    l->dataset.colors = NULL;
    status = sgsi_loader_make_views(l);
    if (status)
        return status;
    scene->digest = sgsi_scene_digest(scene);
    status = sgsi_loader_mark_dropped(l);
    if (!status)
        status = sgsi_loader_read_photos(l);
    if (!status)
        status = sgsi_loader_count_unposed(l);
    if (!status)
        status = sgsi_loader_drop_unusable(l);
    if (!status)
        status = sgsi_scene_split(scene, l->options, l->dataset.has_split);
    if (!status)
        status = sgsi_scene_measure_extent(scene);
    if (!status)
        status = sgsi_loader_drop_marked(l);
    if (!status)
        status = sgsi_loader_open_store(l);
    scene->white_background =
        l->dataset.white_background && scene->has_alpha && l->options->alpha == SGS_ALPHA_OVER;
    return status;
}

sgs_status sgs_scene_load(const char *path, const sgs_scene_options *options, sgs_scene **scene)
{
    sgs_scene_options own = sgs_scene_options_default();
    sgsi_scene_loader l = {.options = &own};
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
    for (size_t i = 0; l.slots && i < l.dataset.frame_count; ++i) {
        sgsi_free(l.slots[i].error);
        for (int k = 0; k < SGSI_NOTES; ++k)
            sgsi_free(l.slots[i].notes[k]);
    }
    sgsi_free(l.slots);
    sgsi_free(l.name_hint);
    for (size_t i = 0; i < l.mask_folder_count; ++i)
        sgsi_free(l.mask_folders[i]);
    sgsi_progress_end(&l.progress);
    sgsi_free(l.sources);
    sgsi_free(l.bytes);
    for (size_t i = 0; i < l.lens_count; ++i)
        sgsi_free(l.lenses[i].valid_mask);
    sgsi_free(l.lenses);
    sgsi_decode_limit_destroy(l.decode_limit);
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
