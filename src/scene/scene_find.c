// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Locates the parts of a scene. Places, in the order they are tried:
//     COLMAP       sparse/N, sparse, colmap/sparse/N, colmap/sparse, N, the folder itself
//     transforms   transforms_train.json (NeRF synthetic), transforms.json (nerfstudio), or a path
//                  to such a file
// A COLMAP model precedes a transforms file, except below `colmap`: there, nerfstudio keeps the
// model that its transforms.json was made from, without the split, masks and axes of that file. The
// mapper writes a COLMAP model per connected component (sparse/0, sparse/1, ...); the one with the
// most registered images is used.

#include "scene/scene_find.h"

#include <dirent.h>
#include <errno.h>
#include <search.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "base/compare.h"
#include "base/core.h"
#include "image/mask.h"
#include "scene/colmap.h"

void sgsi_scene_files_free(sgsi_scene_files *files)
{
    sgsi_free(files->model_path);
    sgsi_free(files->image_folder);
    sgsi_free(files->mask_root);
    *files = (sgsi_scene_files){0};
}

static sgs_status no_memory(const char *path)
{
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to list the folder", path);
}

// Finds the best model in base/0, base/1, ..., else in base itself; else *found is NULL.
static sgs_status find_model(const char *base, char **found)
{
    bool present;
    *found = NULL;
    DIR *folder = opendir(base);
    if (!folder && errno == ENOTDIR) // hides no model; reported if no scene is found
        return SGS_STATUS_OK;
    sgs_status status = sgsi_find_folder(base, &present);
    if (!folder)
        return status || !present ? status : sgsi_fail(SGS_STATUS_IO, "%s: cannot be listed", base);
    size_t models = 0, best_images = 0;
    long best_number = 0;
    for (struct dirent *entry; !status && (entry = readdir(folder));) {
        const size_t digits = strspn(entry->d_name, "0123456789");
        if (digits == 0 || digits > 9 || entry->d_name[digits])
            continue;
        char *path = sgsi_format("%s/%s", base, entry->d_name);
        if (!path)
            status = no_memory(base);
        else if (sgsi_is_folder(path))
            status = sgsi_find_folder(path, &present);
        if (!path || status || !sgsi_colmap_present(path)) {
            sgsi_free(path);
            continue;
        }
        const size_t images = sgsi_colmap_image_count(path);
        const long number = strtol(entry->d_name, NULL, 10);
        if (models++ == 0 || images > best_images ||
            (images == best_images && number < best_number)) {
            sgsi_free(*found);
            *found = path;
            best_images = images;
            best_number = number;
        } else {
            sgsi_free(path);
        }
    }
    closedir(folder);
    if (!status && models > 1)
        sgsi_warn("%s: contains %zu models; using the largest, %ld with %zu images", base, models,
                  best_number, best_images);
    if (!status && !*found && sgsi_colmap_present(base) && !(*found = sgsi_strdup(base)))
        status = no_memory(base);
    return status;
}

static int is_named_images(const struct dirent *entry)
{
    return !strncmp(entry->d_name, "images", 6);
}

// Lists the folders below `path` whose names start with "images", for an error.
static void list_image_folders(const char *path, char *text, size_t size)
{
    struct dirent **entries = NULL;
    const int count = scandir(path, &entries, is_named_images, alphasort);
    size_t used = 0;
    text[0] = 0;
    for (int i = 0; i < count; ++i) {
        char *entry = sgsi_format("%s/%s", path, entries[i]->d_name);
        const bool folder = entry && sgsi_is_folder(entry); // images.bin is not
        sgsi_free(entry);
        if (folder && used + strlen(entries[i]->d_name) + 3 < size)
            used += (size_t)snprintf(text + used, size - used, "%s%s", used ? ", " : "",
                                     entries[i]->d_name);
        free(entries[i]);
    }
    free(entries);
}

// Parent folder of `path` by name: links are not resolved, so masks are searched next to the link.
static char *parent_folder(const char *path)
{
    size_t end = strlen(path);
    while (end > 1 && path[end - 1] == '/')
        --end;
    size_t begin = end;
    while (begin && path[begin - 1] != '/')
        --begin;
    if (end - begin == 2 && !strncmp(path + begin, "..", 2))
        return sgsi_format("%.*s/..", (int)end, path);
    while (begin > 1 && path[begin - 1] == '/')
        --begin;
    return begin ? sgsi_format("%.*s", (int)begin, path) : sgsi_strdup(".");
}

static sgs_status fail_images(const char *path, const char *name)
{
    char others[256];
    list_image_folders(path, others, sizeof others);
    if (others[0])
        return sgsi_fail(SGS_STATUS_IO,
                         "%s: no image folder '%s'; choose one of %s with option images_dir", path,
                         name, others);
    return sgsi_fail(SGS_STATUS_IO,
                     "%s: no image folder '%s'; create it or choose another with option images_dir",
                     path, name);
}

// model_only: `path` is a model itself (sparse/0), with the photos next to `sparse`.
static sgs_status find_images(const char *path, const char *images_dir, bool model_only,
                              sgsi_scene_files *files)
{
    static const char *const places[] = {"", "/..", "/../..", "/colmap"};
    const char *name = images_dir ? images_dir : "images";
    for (size_t i = 0; i < sizeof places / sizeof *places; ++i) {
        if ((i == 1 || i == 2) && !model_only)
            continue;
        char *candidate =
            name[0] == '/' ? sgsi_strdup(name) : sgsi_format("%s%s/%s", path, places[i], name);
        if (!candidate)
            return no_memory(path);
        bool found;
        const sgs_status status = sgsi_find_folder(candidate, &found);
        if (status) {
            sgsi_free(candidate);
            return status;
        }
        if (found) {
            files->image_folder = candidate;
            files->mask_root = parent_folder(candidate);
            return files->mask_root ? SGS_STATUS_OK : no_memory(path);
        }
        sgsi_free(candidate);
    }
    return fail_images(path, name);
}

// Folders of models below the scene, in the order of the search.
enum { BASES = 3 };
#define NERFSTUDIO_BASE "/colmap/sparse"
static const char *const model_bases[BASES] = {"/sparse", NERFSTUDIO_BASE, ""};

static bool is_scene(const char *path)
{
    static const char *const parts[] = {"sparse/0", "sparse", "colmap/sparse/0", ""};
    static const char *const files[] = {"transforms_train.json", "transforms.json"};
    bool found = false;
    for (size_t i = 0; i < sizeof parts / sizeof *parts && !found; ++i) {
        char *part = sgsi_format("%s/%s", path, parts[i]);
        found = part && sgsi_colmap_present(part);
        sgsi_free(part);
    }
    for (size_t i = 0; i < sizeof files / sizeof *files && !found; ++i) {
        char *file = sgsi_format("%s/%s", path, files[i]);
        found = file && sgsi_is_file(file);
        sgsi_free(file);
    }
    return found;
}

static int is_visible(const struct dirent *entry)
{
    return entry->d_name[0] != '.';
}

// The first scene, by name, in the folders below `path`, such as COLMAP's dense/0; NULL if there is
// none. `depth` limits the search.
static char *find_nested_scene(const char *path, int depth)
{
    enum { LISTED = 200 };
    struct dirent **entries = NULL;
    const int count = scandir(path, &entries, is_visible, alphasort);
    char *found = NULL;
    for (int i = 0; i < count; ++i) {
        const bool listed = !found && i < LISTED;
        char *folder = listed ? sgsi_format("%s/%s", path, entries[i]->d_name) : NULL;
        if (folder && sgsi_is_folder(folder) && is_scene(folder)) {
            found = folder;
            folder = NULL;
        } else if (folder && depth > 1 && sgsi_is_folder(folder)) {
            found = find_nested_scene(folder, depth - 1);
        }
        sgsi_free(folder);
        free(entries[i]);
    }
    free(entries);
    return found;
}

// Reports an incompletely copied model; otherwise that no scene was found.
static sgs_status report_missing(const char *path)
{
    for (size_t i = 0; i < BASES; ++i) {
        bool found;
        char *base = sgsi_format("%s%s", path, model_bases[i]);
        const sgs_status status = base ? sgsi_find_folder(base, &found) : no_memory(path);
        sgsi_free(base);
        if (status)
            return status;
    }
    static const char *const places[] = {"sparse/0/", "sparse/", "colmap/sparse/0/", ""};
    static const char *const kinds[] = {"bin", "txt"};
    for (size_t i = 0; i < 8; ++i) {
        const char *place = places[i / 2], *kind = kinds[i % 2];
        char *cameras = sgsi_format("%s/%scameras.%s", path, place, kind);
        char *images = sgsi_format("%s/%simages.%s", path, place, kind);
        const bool has_cameras = cameras && sgsi_is_file(cameras),
                   has_images = images && sgsi_is_file(images);
        sgs_status status = SGS_STATUS_OK;
        if (has_cameras != has_images)
            status =
                sgsi_fail(SGS_STATUS_IO, "%s: missing, although %s exists; copy the complete model",
                          has_cameras ? images : cameras, has_cameras ? cameras : images);
        sgsi_free(cameras);
        sgsi_free(images);
        if (status)
            return status;
    }
    char *nested = find_nested_scene(path, 2);
    if (nested) {
        const sgs_status status = sgsi_fail(
            SGS_STATUS_IO, "%s: no scene found, but there is one in %s; specify this folder", path,
            nested);
        sgsi_free(nested);
        return status;
    }
    return sgsi_fail(
        SGS_STATUS_IO,
        "%s: no scene found: neither a COLMAP model (cameras and images, .bin or .txt, in "
        "sparse/0, sparse or colmap/sparse/0) nor transforms_train.json or transforms.json; "
        "'sparegs reconstruct' estimates the cameras of photos",
        path);
}

// The transforms file of the folder; *found is NULL without one.
static sgs_status find_json(const char *path, char **found)
{
    static const char *const names[] = {"transforms_train.json", "transforms.json"};
    sgs_status status = SGS_STATUS_OK;
    *found = NULL;
    for (size_t i = 0; i < 2 && !*found && !status; ++i) {
        bool present = false;
        char *candidate = sgsi_format("%s/%s", path, names[i]);
        status = candidate ? sgsi_find_file(candidate, &present) : no_memory(path);
        if (present)
            *found = candidate;
        else
            sgsi_free(candidate);
    }
    return status;
}

static sgs_status find_in_file(const char *path, sgsi_scene_files *files)
{
    static const char *const models[] = {".ply", ".spz", ".sog", ".splat", ".ksplat"};
    const char *extension = strrchr(path, '.');
    if (!extension || strcasecmp(extension, ".json")) {
        bool model = false;
        for (size_t i = 0; i < sizeof models / sizeof *models; ++i)
            model = model || (extension && !strcasecmp(extension, models[i]));
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "%s: is a %s, not a scene; specify a scene folder or a transforms.json",
                         path, model ? "file of 3D Gaussians" : "file");
    }
    files->model_path = sgsi_strdup(path);
    files->image_folder = parent_folder(path);
    return files->model_path && files->image_folder ? SGS_STATUS_OK : no_memory(path);
}

// Uses the transforms file of the folder, if any, unless a model in `base` takes precedence.
static sgs_status choose_json(const char *path, const char *base, sgsi_scene_files *files)
{
    char *json;
    const bool model_first = files->model_path && strcmp(base, NERFSTUDIO_BASE) != 0;
    const sgs_status status = find_json(path, &json);
    if (model_first && json)
        sgsi_warn("%s: ignored, because the COLMAP model %s is used; to use this file, with its "
                  "split and masks, specify its path",
                  json, files->model_path);
    if (!model_first && json) {
        sgsi_free(files->model_path);
        files->model_path = json;
        files->image_folder = sgsi_strdup(path);
        return files->image_folder ? SGS_STATUS_OK : no_memory(path);
    }
    sgsi_free(json);
    return model_first && status != SGS_STATUS_OUT_OF_MEMORY ? SGS_STATUS_OK : status;
}

static sgs_status find_in_folder(const char *path, const char *images_dir, sgsi_scene_files *files)
{
    const char *last = "";
    for (size_t i = 0; i < BASES && !files->model_path; ++i) {
        last = model_bases[i];
        char *base = sgsi_format("%s%s", path, last);
        const sgs_status status = base ? find_model(base, &files->model_path) : no_memory(path);
        sgsi_free(base);
        if (status)
            return status;
    }
    const sgs_status status = choose_json(path, last, files);
    if (status || files->image_folder)
        return status;
    if (!files->model_path)
        return report_missing(path);
    files->colmap = true;
    return find_images(path, images_dir, !*last, files);
}

sgs_status sgsi_scene_find(const char *path, const char *images_dir, sgsi_scene_files *files)
{
    bool found = true;
    *files = (sgsi_scene_files){0};
    sgs_status status = sgsi_is_file(path) ? SGS_STATUS_OK : sgsi_find_folder(path, &found);
    if (status)
        return status;
    if (sgsi_is_file(path))
        status = find_in_file(path, files);
    else if (found)
        status = find_in_folder(path, images_dir, files);
    else
        status = sgsi_fail(SGS_STATUS_IO,
                           "%s: no such folder; specify a data set of COLMAP or with a "
                           "transforms.json",
                           path);
    if (!status && !files->colmap) {
        files->mask_root = sgsi_strdup(files->image_folder);
        status = files->mask_root ? SGS_STATUS_OK : no_memory(path);
    }
    if (status)
        sgsi_scene_files_free(files);
    return status;
}

sgs_status sgsi_scene_choose_images(const sgsi_scene_files *files, const char *images_dir,
                                    char **chosen)
{
    *chosen = NULL;
    if (files->colmap || !images_dir)
        return SGS_STATUS_OK;
    char *path = images_dir[0] == '/' ? sgsi_strdup(images_dir)
                                      : sgsi_format("%s/%s", files->image_folder, images_dir);
    if (!path)
        return no_memory(files->image_folder);
    bool found;
    const sgs_status status = sgsi_find_folder(path, &found);
    if (found) {
        *chosen = path;
        return SGS_STATUS_OK;
    }
    sgsi_free(path);
    return status ? status : fail_images(files->image_folder, images_dir);
}

// The path of `stem` with the first of these extensions that exists, or NULL.
static char *find_extension(const char *folder, const char *stem, int length)
{
    static const char *const extensions[] = {"jpg", "JPG", "jpeg", "JPEG", "png",  "PNG", "exr",
                                             "hdr", "tif", "tiff", "TIF",  "TIFF", "EXR", "HDR"};
    for (size_t i = 0; i < sizeof extensions / sizeof *extensions; ++i) {
        char *path = sgsi_format("%s/%.*s.%s", folder, length, stem, extensions[i]);
        if (path && sgsi_is_file(path))
            return path;
        sgsi_free(path);
    }
    return NULL;
}

char *sgsi_scene_image_path(const char *folder, const char *name)
{
    char *path = sgsi_format("%s/%s", folder, name), *other = NULL;
    const char *dot = strrchr(name, '.');
    if (!path || sgsi_is_file(path))
        return path;
    if (!sgsi_image_name_has_format(name)) // "0001", "frame.0001"
        other = find_extension(folder, name, (int)strlen(name));
    if (!other && dot && !strchr(dot, '/'))
        other = find_extension(folder, name, (int)(dot - name));
    if (!other)
        return path;
    sgsi_free(path);
    return other;
}

enum { MAX_DEPTH = 8, EXAMPLES = 3 };

typedef struct search {
    const sgsi_file_search *what;
    sgsi_unknown_files *unknown;
    char *examples[EXAMPLES]; // the first ones by name: readdir is unordered
    void *visited;            // tree of folder_id
    char **links;             // to folders, searched after all other folders
    size_t link_count, link_capacity;
} search;

typedef struct folder_id {
    dev_t device;
    ino_t inode;
} folder_id;

// A raw file next to its JPEG is not another photo: only the extension may differ.
static bool is_known(const search *s, const char *name)
{
    const size_t length = (size_t)(strrchr(name, '.') + 1 - name); // with the dot
    size_t low = 0, high = s->what->known_count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (strncmp(s->what->known[middle], name, length) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    for (; low < s->what->known_count && !strncmp(s->what->known[low], name, length); ++low)
        if (!strpbrk(s->what->known[low] + length, "./"))
            return true;
    return false;
}

// Compares an unknown file with the missing photos up to the first one that is explained.
static void compare_missing(search *s, const char *name)
{
    sgsi_unknown_files *u = s->unknown;
    for (size_t i = 0; i < s->what->missing_count; ++i) {
        const bool same = s->what->missing[i] == u->missing;
        const sgsi_name_difference difference = sgsi_name_compare(s->what->missing[i], name);
        if (difference != SGSI_NAME_DIFFERS && (!same || strcmp(name, u->similar) < 0)) {
            char *copy = sgsi_strdup(name);
            if (!copy)
                return;
            sgsi_free(u->similar);
            u->similar = copy;
            u->missing = s->what->missing[i];
            u->difference = difference;
            return;
        }
        if (same)
            return;
    }
}

// Takes ownership of `name`.
static void add_unknown(search *s, char *name)
{
    ++s->unknown->count;
    compare_missing(s, name);
    for (int i = 0; i < EXAMPLES && name; ++i) {
        if (!s->examples[i] || strcmp(name, s->examples[i]) < 0) {
            char *earlier = s->examples[i];
            s->examples[i] = name;
            name = earlier;
        }
    }
    sgsi_free(name);
}

static int id_order(const void *a, const void *b)
{
    const folder_id *x = a, *y = b;
    return x->device != y->device ? (x->device > y->device) - (x->device < y->device)
                                  : (x->inode > y->inode) - (x->inode < y->inode);
}

static bool first_visit(search *s, const char *path)
{
    struct stat info;
    folder_id *id = stat(path, &info) ? NULL : sgsi_alloc(1, sizeof *id);
    if (!id)
        return false;
    *id = (folder_id){.device = info.st_dev, .inode = info.st_ino};
    folder_id **node = tsearch(id, &s->visited, id_order);
    const bool first = node && *node == id;
    if (!first)
        sgsi_free(id);
    return first;
}

// Takes ownership of `name`.
static void add_link(search *s, char *name)
{
    if (s->link_count == s->link_capacity) {
        const size_t capacity = s->link_capacity ? 2 * s->link_capacity : 16;
        if (!sgsi_grow((void **)&s->links, s->link_count, capacity, sizeof *s->links)) {
            sgsi_free(name);
            return;
        }
        s->link_capacity = capacity;
    }
    s->links[s->link_count++] = name;
}

static bool is_link(const char *path)
{
    struct stat info;
    return !lstat(path, &info) && S_ISLNK(info.st_mode);
}

// Links between folders can form cycles, and many paths can lead to one folder: each folder is
// searched once.
static void search_folder(search *s, const char *below, int depth)
{
    char *path = sgsi_format("%s/%s", s->what->folder, below);
    DIR *folder = path && first_visit(s, path) ? opendir(path) : NULL;
    for (struct dirent *entry; folder && (entry = readdir(folder));) {
        if (entry->d_name[0] == '.')
            continue;
        char *name = sgsi_format("%s%s%s", below, *below ? "/" : "", entry->d_name);
        char *full = name ? sgsi_format("%s/%s", s->what->folder, name) : NULL;
        if (full && sgsi_is_folder(full) && depth < MAX_DEPTH) {
            if (is_link(full)) {
                add_link(s, name);
                name = NULL;
            } else {
                search_folder(s, name, depth + 1);
            }
        } else if (full && sgsi_image_name_has_format(name) &&
                   (s->what->masks || !sgs_mask_is_name(name)) && sgsi_is_file(full) &&
                   !is_known(s, name)) {
            add_unknown(s, name);
            name = NULL;
        }
        sgsi_free(name);
        sgsi_free(full);
    }
    if (folder)
        closedir(folder);
    sgsi_free(path);
}

// Photos behind links out of the data set cannot be read.
static void search_link(search *s, const char *name)
{
    char *path = sgsi_format("%s/%s", s->what->folder, name);
    int depth = 1;
    for (const char *c = name; *c; ++c)
        depth += *c == '/';
    if (path && !sgsi_roots_check(s->what->roots, path, NULL))
        search_folder(s, name, depth);
    sgsi_free(path);
}

void sgsi_scene_find_unknown(const sgsi_file_search *what, sgsi_unknown_files *unknown)
{
    search s = {.what = what, .unknown = unknown};
    *unknown = (sgsi_unknown_files){0};
    search_folder(&s, "", 0);
    for (size_t begin = 0, end; begin < s.link_count; begin = end) {
        end = s.link_count;
        qsort(s.links + begin, end - begin, sizeof *s.links, sgsi_compare_strings);
        for (size_t i = begin; i < end; ++i)
            search_link(&s, s.links[i]);
    }
    for (size_t i = 0; i < s.link_count; ++i)
        sgsi_free(s.links[i]);
    sgsi_free(s.links);
    tdestroy(s.visited, sgsi_free);
    size_t used = 0;
    for (int i = 0; i < EXAMPLES; ++i) {
        if (s.examples[i] && used < sizeof unknown->examples) {
            const int n = snprintf(unknown->examples + used, sizeof unknown->examples - used,
                                   "%s%s", i ? ", " : "", s.examples[i]);
            used += n > 0 ? (size_t)n : 0;
        }
        sgsi_free(s.examples[i]);
    }
}
