// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "arguments/scene_files.h"

#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "cli/json_file.h"
#include "cli/output.h"
#include "cli/progress.h"

typedef struct scene_file {
    dev_t device;
    ino_t inode;
    bool is_image; // a photo or a mask
} scene_file;

static const char *const colmap_names[] = {
    "cameras.bin", "cameras.txt", "images.bin", "images.txt", "points3D.bin", "points3D.txt",
    "frames.bin",  "frames.txt",  "rigs.bin",   "rigs.txt",   "points3D.ply", "project.ini",
};
static const char *const transforms_names[] = {"transforms.json", "transforms_train.json",
                                               "transforms_test.json", "transforms_val.json"};

static int by_inode(const void *a, const void *b)
{
    const scene_file *x = a, *y = b;
    return x->device != y->device ? (x->device > y->device) - (x->device < y->device)
                                  : (x->inode > y->inode) - (x->inode < y->inode);
}

scene_files scene_files_of(const sgs_scene *scene)
{
    return (scene_files){.scene = scene};
}

void scene_files_free(scene_files *files)
{
    free(files->found);
    *files = (scene_files){0};
}

static void add(scene_files *files, const char *path, bool is_image)
{
    struct stat info;
    if (path && !stat(path, &info) && S_ISREG(info.st_mode))
        files->found[files->count++] = (scene_file){info.st_dev, info.st_ino, is_image};
}

// The camera files in the folder of the model; names that a data set does not have are skipped.
static void add_model(scene_files *files)
{
    const char *model = files->scene->model_path, *slash = strrchr(model, '/');
    const bool colmap = files->scene->format == SGS_SCENE_COLMAP_BINARY ||
                        files->scene->format == SGS_SCENE_COLMAP_TEXT;
    const char *const *names = colmap ? colmap_names : transforms_names;
    const size_t count = colmap ? sizeof colmap_names / sizeof *colmap_names
                                : sizeof transforms_names / sizeof *transforms_names;
    const int length = colmap ? (int)strlen(model) : slash ? (int)(slash - model) : 0;
    for (size_t k = 0; k < count; ++k) {
        char *path = format_text("%.*s%s%s", length, model, colmap || slash ? "/" : "", names[k]);
        add(files, path, false);
        free(path);
    }
    add(files, model, false);
}

// The point cloud that a transforms.json names.
static void add_cloud(scene_files *files)
{
    const char *model = files->scene->model_path, *slash = strrchr(model, '/');
    json_t *root = load_json(model, 0, NULL);
    const char *name = json_string_value(json_object_get(root, "ply_file_path"));
    if (name) {
        char *path =
            format_text("%.*s%s", slash ? (int)(slash + 1 - model) : 0, slash ? model : "", name);
        add(files, path, false);
        free(path);
    }
    json_decref(root);
}

static void list(scene_files *files)
{
    const sgs_scene *scene = files->scene;
    const size_t most = 2 * scene->view_count + sizeof colmap_names / sizeof *colmap_names +
                        sizeof transforms_names / sizeof *transforms_names + 2;
    files->is_listed = true;
    files->found = calloc(most, sizeof *files->found);
    if (!files->found)
        exit(fail_run("not enough memory for the files of %s", scene->path));
    for (size_t v = 0; v < scene->view_count; ++v) {
        add(files, scene->views[v].image_path, true);
        add(files, scene->views[v].mask_path, true);
    }
    add_model(files);
    add_cloud(files);
    qsort(files->found, files->count, sizeof *files->found, by_inode);
}

bool scene_files_admit(scene_files *files, const char *path, const char *advice)
{
    struct stat info;
    if (!files->scene || files->scene->format == SGS_SCENE_MEMORY || stat(path, &info) ||
        !S_ISREG(info.st_mode))
        return true;
    if (!files->is_listed)
        list(files);
    const scene_file key = {.device = info.st_dev, .inode = info.st_ino};
    const scene_file *file =
        bsearch(&key, files->found, files->count, sizeof *files->found, by_inode);
    if (file)
        fail_run("%s: is %s; %s", path,
                 file->is_image ? "a photo or a mask of the scene" : "an input of this command",
                 advice);
    return !file;
}

bool scene_files_admit_outputs(const sgs_scene *scene, const command_line *line)
{
    scene_files files = scene_files_of(scene);
    bool admitted = true;
    size_t at = 0;
    for (const char *path; admitted && (path = option_next_output(line, &at));)
        admitted = scene_files_admit(&files, path, "choose another file");
    scene_files_free(&files);
    return admitted;
}
