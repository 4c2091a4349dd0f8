// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cameras/usd_camera_file.h"

#include <stdlib.h>
#include <string.h>

#include "cli/input_file.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "sparegs/model_file.h"
#include "sparegs/usd_cameras.h"

bool usd_camera_file_is(const char *path)
{
    sgs_model_format format;
    return name_has_ending(path, ".usd|.usda|.usdc|.usdz") ||
           (sgs_model_format_detect(path, &format) && format == SGS_MODEL_USDA);
}

// Compares names of prims, without their paths.
static int compare_names(const void *a, const void *b)
{
    return strcmp(*(const char *const *)a, *(const char *const *)b);
}

static const char *prim_name(const sgs_usd_camera *camera)
{
    const char *slash = strrchr(camera->path, '/');
    return slash ? slash + 1 : camera->path;
}

// The names of all cameras, sorted; NULL without memory.
static const char **sorted_names(const sgs_usd_cameras *found)
{
    const char **names = malloc((found->count + 1) * sizeof *names);
    for (size_t i = 0; names && i < found->count; ++i)
        names[i] = prim_name(&found->cameras[i]);
    if (names)
        qsort(names, found->count, sizeof *names, compare_names);
    return names;
}

// The name if no other camera has it, else the path.
static const char *label_of(const sgs_usd_camera *camera, const char **names, size_t count)
{
    const char *name = prim_name(camera);
    const char **at = bsearch(&name, names, count, sizeof *names, compare_names);
    const bool shared =
        (at > names && !strcmp(at[-1], name)) || (at + 1 < names + count && !strcmp(at[1], name));
    return shared ? camera->path : name;
}

static char *view_name(const sgs_usd_camera *camera, const char *label, bool alone, int frame)
{
    if (alone && camera->has_samples)
        return format_text("frame_%05d", frame);
    return !alone && camera->is_animated ? format_text("%s_%05d", label, frame)
                                         : format_text("%s", label);
}

static void add_views(const sgs_usd_camera *camera, const char *label, bool alone,
                      camera_list *list)
{
    for (size_t i = 0; i < camera->view_count; ++i) {
        const sgs_usd_view *view = &camera->views[i];
        list->cameras[list->count++] =
            (named_camera){.name = view_name(camera, label, alone, view->frame),
                           .prim = camera->has_samples ? format_text("%s", label) : NULL,
                           .camera = view->camera,
                           .pose = view->pose,
                           .frame = view->frame};
    }
}

bool usd_camera_file_read(const char *path, int first, int width, int height, camera_list *list)
{
    *list = (camera_list){.first = first};
    if (width < 1) {
        fail_run("%s: cameras of OpenUSD have no image size; give it with --size", path);
        return false;
    }
    sgs_usd_cameras *found;
    if (sgs_usd_cameras_read(path, width, height, &found)) {
        fail_library();
        return false;
    }
    size_t total = 0;
    for (size_t i = 0; i < found->count; ++i)
        total += found->cameras[i].view_count;
    list->fps = found->fps;
    list->cameras = calloc(total + 1, sizeof *list->cameras);
    const char **names = sorted_names(found);
    const bool done = list->cameras && names;
    for (size_t i = 0; i < found->count && done; ++i)
        add_views(&found->cameras[i], label_of(&found->cameras[i], names, found->count),
                  found->count == 1, list);
    free(names);
    sgs_usd_cameras_destroy(found);
    if (!done) {
        fail_run("%s: not enough memory for %zu cameras", path, total);
        camera_list_free(list);
    }
    return done;
}

bool usd_camera_file_keep(const char *view, camera_list *list)
{
    const char *prim = NULL;
    size_t kept = 0;
    for (size_t i = 0; i < list->count && !prim; ++i)
        if (list->cameras[i].prim && sgs_view_name_match(list->cameras[i].prim, view) == 0)
            prim = list->cameras[i].prim;
    if (!prim)
        return false;
    for (size_t i = 0; i < list->count; ++i)
        if (!list->cameras[i].prim || strcmp(list->cameras[i].prim, prim))
            named_camera_free(&list->cameras[i]);
        else
            list->cameras[kept++] = list->cameras[i];
    list->count = kept;
    return true;
}

void usd_camera_file_number(camera_list *list)
{
    list->has_frames = list->count > 0;
    for (size_t i = 0; i < list->count && list->has_frames; ++i)
        list->has_frames =
            list->cameras[i].prim && !strcmp(list->cameras[i].prim, list->cameras[0].prim);
}
