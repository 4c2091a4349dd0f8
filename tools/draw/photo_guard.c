// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "draw/photo_guard.h"

#include <stdlib.h>
#include <string.h>

#include "arguments/scene_files.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "draw/frame_files.h"
#include "options/options.h"

static const char advice[] = "choose another folder";

static const char *base_name(const char *path)
{
    const char *slash = strrchr(path, '/');
    return slash ? slash + 1 : path;
}

// True for STEM.png, STEM_photo.png, STEM.depth.png, STEM.deep.exr and the like.
static bool may_be_written(const char *name, const char *stem)
{
    const size_t length = strlen(stem);
    if (strncmp(name, stem, length) != 0 || (name[length] != '.' && name[length] != '_'))
        return false;
    const char *ending = strrchr(name, '.');
    return ending && (!strcmp(ending, ".png") || !strcmp(ending, ".exr"));
}

// Compares the names first: most files are other ones.
static bool spares(const char *folder, const char *stem, const char *input)
{
    if (!input || !may_be_written(base_name(input), base_name(stem)))
        return true;
    char *path =
        format_text("%s/%.*s%s", folder, (int)(base_name(stem) - stem), stem, base_name(input));
    const bool same = same_file(path, input);
    if (same)
        fail_run("%s: is a photo or a mask of the scene; %s", path, advice);
    free(path);
    return !same;
}

// By name, also for files that this command does not write: one with other AOVs would.
static bool admits_names(const sgs_scene *scene, const char *folder, const char *stem)
{
    bool admits = true;
    for (size_t v = 0; scene && v < scene->view_count && admits; ++v) {
        const sgs_view *view = &scene->views[v];
        admits = spares(folder, stem, view->image_path) && spares(folder, stem, view->mask_path);
    }
    return admits;
}

typedef struct frame_check {
    scene_files files;
    const char *film;
    bool film_exists; // it may be a link to a frame
} frame_check;

// A frame_files_fn.
static bool admits_frame(const char *path, void *context)
{
    frame_check *check = context;
    const char *film = check->film;
    if (film && (check->film_exists || !strcmp(base_name(film), base_name(path))) &&
        same_file(film, path)) {
        fail_run("%s: is a frame and the video; choose another file with --video", path);
        return false;
    }
    return scene_files_admit(&check->files, path, advice);
}

bool photo_guard_admits_frames(const sgs_scene *scene, const frame_outputs *outputs,
                               const camera_list *cameras)
{
    const char *folder = outputs->folder;
    scene = scene ? scene : cameras->scene;
    frame_check check = {.files = scene_files_of(scene),
                         .film = outputs->film,
                         .film_exists = outputs->film && file_exists(outputs->film)};
    bool admits =
        !outputs->film || scene_files_admit(&check.files, outputs->film, "choose another file");
    for (size_t i = 0; folder && i < cameras->count && admits; ++i) {
        const char *stem = cameras->cameras[i].stem;
        admits = admits_names(scene, folder, stem) &&
                 frame_files_each(folder, stem, outputs->aovs, outputs->png, outputs->deep,
                                  admits_frame, &check);
    }
    scene_files_free(&check.files);
    return admits;
}

bool photo_guard_admits_saved(const sgs_scene *scene, const char *folder, char *const *stems)
{
    static const char *const suffixes[] = {".png", "_photo.png", "_flip.png"};
    scene_files files = scene_files_of(scene);
    bool admits = true;
    for (size_t v = 0; v < scene->view_count && admits; ++v) {
        admits = admits_names(scene, folder, stems[v]);
        for (size_t k = 0; k < sizeof suffixes / sizeof *suffixes && admits; ++k) {
            char *path = format_text("%s/%s%s", folder, stems[v], suffixes[k]);
            admits = scene_files_admit(&files, path, advice);
            free(path);
        }
    }
    scene_files_free(&files);
    return admits;
}
