// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "viewer/view_source.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "arguments/model_argument.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "processes/interrupt.h"
#include "run/model_filter.h"

// The scene's views as a list of cameras.
static bool list_views(const sgs_scene *scene, camera_list *list)
{
    list->cameras = calloc(scene->view_count + 1, sizeof *list->cameras);
    if (!list->cameras) {
        fail_run("not enough memory for %zu views", scene->view_count);
        return false;
    }
    for (size_t i = 0; i < scene->view_count; ++i)
        list->cameras[list->count++] =
            (named_camera){.name = format_text("%s", scene->views[i].name),
                           .camera = scene->views[i].camera,
                           .pose = scene->views[i].pose,
                           .orientation = scene->views[i].orientation};
    return true;
}

// The cameras that the run recorded, if the file exists.
static bool read_views(const char *folder, camera_list *list)
{
    char *path = format_text("%s/cameras.json", folder);
    const bool done = !file_exists(path) || camera_file_read(path, 0, list);
    free(path);
    return done;
}

bool view_renderer_create(const sgs_gaussians *model, sgs_renderer **renderer)
{
    if (sgs_renderer_create(model, renderer)) {
        fail_library();
        return false;
    }
    sgs_renderer_ray_limit_set(*renderer, VIEWER_RAY_BYTES);
    return true;
}

bool view_source_open(view_source *source, sgs_gaussians *model, const char *folder, int iteration)
{
    pthread_mutex_init(&source->lock, NULL);
    pthread_mutex_init(&source->history_lock, NULL);
    source->model = model;
    atomic_store(&source->iteration, iteration);
    atomic_store(&source->count, model->count);
    model_measure(model, source->center, &source->extent);
    source->is_run = folder != NULL;
    if (folder)
        source->folder = format_text("%s", folder);
    if (!view_renderer_create(model, &source->renderer))
        return false;
    if (folder && !region_history_read(folder, &source->history))
        return false;
    if (source->scene)
        return list_views(source->scene, &source->views);
    return !folder || read_views(folder, &source->views);
}

void view_source_close(view_source *source)
{
    sgs_renderer_destroy(source->renderer);
    sgs_gaussians_destroy(source->model);
    region_map_free(&source->regions);
    region_history_free(&source->history);
    camera_list_free(&source->views);
    free(source->folder);
    free(source->marks);
    source->renderer = NULL;
    source->model = NULL;
    source->folder = source->marks = NULL;
}

// With the lock held.
static bool copy_model(view_source *source, const sgs_gaussians *model, const float *filter_3d,
                       int iteration)
{
    sgs_gaussians *fused = NULL;
    bool done = !filter_3d || !sgs_gaussians_fuse_filter_3d(model, filter_3d, &fused);
    done = done && !sgs_gaussians_copy(source->model, fused ? fused : model);
    sgs_gaussians_destroy(fused);
    if (done) {
        atomic_store(&source->iteration, iteration);
        atomic_store(&source->count, model->count);
        source->regions_made = false;
        ++source->version;
        sgs_renderer_update(source->renderer);
        atomic_store(&source->wanted, false);
    }
    return done;
}

bool view_source_offer(view_source *source, const sgs_gaussians *model, const float *filter_3d,
                       int iteration)
{
    if (!atomic_load(&source->wanted) || pthread_mutex_trylock(&source->lock))
        return false;
    const bool done = copy_model(source, model, filter_3d, iteration);
    pthread_mutex_unlock(&source->lock);
    return done;
}

void view_source_expect_last(view_source *source)
{
    atomic_store(&source->replacing, true);
}

bool view_source_replace(view_source *source, const sgs_gaussians *model, const float *filter_3d,
                         int iteration)
{
    view_source_expect_last(source);
    while (pthread_mutex_trylock(&source->lock)) { // a file that is being written
        if (interrupt_signal())
            return false;
        nanosleep(&(struct timespec){.tv_nsec = 5000000}, NULL);
    }
    const bool done = copy_model(source, model, filter_3d, iteration);
    atomic_store(&source->replacing, false);
    pthread_mutex_unlock(&source->lock);
    return done;
}

void view_source_add_regions(view_source *source, const sgs_regions *update)
{
    region_history *history = &source->history;
    pthread_mutex_lock(&source->history_lock);
    sgs_regions *longer = realloc(history->updates, (history->count + 1) * sizeof *longer);
    sgs_region *list = malloc((update->count + 1) * sizeof *list);
    if (longer)
        history->updates = longer;
    if (longer && list) {
        memcpy(list, update->regions, update->count * sizeof *list);
        longer[history->count] = *update;
        longer[history->count++].regions = list;
    } else {
        free(list); // the viewer shows the earlier updates
    }
    pthread_mutex_unlock(&source->history_lock);
}

const region_map *view_source_regions(view_source *source)
{
    if (!source->regions_made) {
        region_map_free(&source->regions);
        pthread_mutex_lock(&source->history_lock);
        const int iteration = source->is_run ? source->iteration : 0;
        if (!region_map_make(&source->history, iteration, source->model, &source->regions))
            region_map_free(&source->regions);
        pthread_mutex_unlock(&source->history_lock);
        source->regions_made = true;
    }
    return &source->regions;
}

bool view_source_has_regions(view_source *source)
{
    pthread_mutex_lock(&source->history_lock);
    const bool has = source->history.count > 0;
    pthread_mutex_unlock(&source->history_lock);
    return has;
}
