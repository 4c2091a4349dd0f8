// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Commit moves the earlier manifest to STAGE/old first, then every earlier file to STAGE/old and
// the new one from STAGE/new to its place, and the new manifest last. After a failure the renames
// are undone in reverse order. The earlier files are deleted only after the last rename.

#include "storage/model_folder.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/core.h"
#include "sparegs/output_file.h"

static sgs_status fail_memory(const sgsi_model_folder *folder)
{
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", folder->path);
}

enum { PATH_ROOM = 4096 };

// BASE/NAME or, with a part, BASE/PART/NAME. Empty, which no file has as its name, if it is too
// long.
static void join(char path[PATH_ROOM], const char *base, const char *part, const char *name)
{
    const int length = snprintf(path, PATH_ROOM, "%s/%s%s%s", base, part, *part ? "/" : "", name);
    if (length < 0 || length >= PATH_ROOM)
        *path = 0;
}

static sgs_status make_parent(const char *path)
{
    char parent[PATH_ROOM];
    const char *slash = strrchr(path, '/');
    snprintf(parent, sizeof parent, "%.*s", slash ? (int)(slash - path) : 0, path);
    return sgsi_make_folder(parent);
}

// Removes the folder of a file, if the name has one and it is empty.
static void remove_parent(const char *base, const char *part, const char *name)
{
    char path[PATH_ROOM];
    join(path, base, part, name);
    char *slash = strchr(name, '/') ? strrchr(path, '/') : NULL;
    if (!slash)
        return;
    *slash = 0;
    rmdir(path);
}

sgs_status sgsi_model_folder_open(sgsi_model_folder *folder, const char *path, const char *manifest)
{
    *folder = (sgsi_model_folder){.path = sgsi_strdup(path), .manifest = sgsi_strdup(manifest)};
    char *target = sgsi_format("%s/%s", path, manifest);
    if (!folder->path || !folder->manifest || !target) {
        sgsi_free(target);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    }
    folder->was_made = !sgsi_is_folder(path);
    sgs_status status = sgsi_make_folder(path);
    if (!status)
        status = sgsi_temporary_create(target, target, &folder->stage, NULL);
    sgsi_free(target);
    return status;
}

static sgs_status add_file(sgsi_model_folder *folder, const char *name, bool is_new)
{
    if (folder->count == folder->capacity) {
        const size_t capacity = 2 * folder->capacity + 16;
        if (!sgsi_grow((void **)&folder->files, folder->count, capacity, sizeof *folder->files))
            return fail_memory(folder);
        folder->capacity = capacity;
    }
    sgsi_model_folder_file *file = &folder->files[folder->count++];
    *file = (sgsi_model_folder_file){.is_new = is_new};
    snprintf(file->name, sizeof file->name, "%s", name);
    return SGS_STATUS_OK;
}

sgs_status sgsi_model_folder_put(sgsi_model_folder *folder, const char *name, const uint8_t *bytes,
                                 size_t size)
{
    char path[PATH_ROOM];
    join(path, folder->stage, "new", name);
    sgs_status status = make_parent(path);
    if (!status)
        status = add_file(folder, name, true);
    if (!status)
        status = sgs_output_file_write(path, bytes, size);
    const size_t length = strlen(path);
    if (status == SGS_STATUS_IO && !strncmp(sgs_last_error(), path, length)) // names the final file
        sgsi_record_error("%s/%s%s", folder->path, name, sgs_last_error() + length);
    return status;
}

sgs_status sgsi_model_folder_drop(sgsi_model_folder *folder, const char *name)
{
    struct stat info;
    char path[PATH_ROOM];
    join(path, folder->path, "", name);
    bool is_known = lstat(path, &info) || S_ISDIR(info.st_mode);
    for (size_t k = 0; k < folder->count && !is_known; ++k)
        is_known = !strcmp(folder->files[k].name, name);
    return is_known ? SGS_STATUS_OK : add_file(folder, name, false);
}

// ---- Commit ----

// Renames between the folder and STAGE/`part`. `missing` receives true, if it is not NULL, where
// there is nothing to move.
static sgs_status move_file(const sgsi_model_folder *folder, const char *part, const char *name,
                            bool to_stage, bool *missing)
{
    char staged[PATH_ROOM], placed[PATH_ROOM];
    join(staged, folder->stage, part, name);
    join(placed, folder->path, "", name);
    struct stat info;
    if (to_stage && !lstat(placed, &info) && S_ISDIR(info.st_mode))
        return sgsi_fail(SGS_STATUS_IO,
                         "%s: is a folder and cannot be replaced; remove it or write to another "
                         "folder",
                         placed);
    const sgs_status status = make_parent(to_stage ? staged : placed);
    if (status || !rename(to_stage ? placed : staged, to_stage ? staged : placed))
        return status;
    if (errno != ENOENT || !missing)
        return sgsi_fail(SGS_STATUS_IO, "%s: cannot be replaced: %s", placed, strerror(errno));
    *missing = true;
    return SGS_STATUS_OK;
}

static sgs_status set_aside(const sgsi_model_folder *folder, sgsi_model_folder_file *file)
{
    bool missing = false;
    const sgs_status status = move_file(folder, "old", file->name, true, &missing);
    file->is_aside = !status && !missing;
    return status;
}

static sgs_status place(const sgsi_model_folder *folder, sgsi_model_folder_file *file)
{
    const sgs_status status = move_file(folder, "new", file->name, false, NULL);
    file->is_placed = !status;
    return status;
}

static void undo_file(const sgsi_model_folder *folder, sgsi_model_folder_file *file)
{
    if (file->is_placed)
        file->is_placed = move_file(folder, "new", file->name, true, NULL) != SGS_STATUS_OK;
    if (file->is_aside && !file->is_placed)
        file->is_aside = move_file(folder, "old", file->name, false, NULL) != SGS_STATUS_OK;
}

// Keeps the error message of the failure that is undone.
static void undo(sgsi_model_folder *folder, sgsi_model_folder_file *manifest)
{
    char *sentence = sgsi_strdup(sgs_last_error());
    for (size_t k = folder->count; k-- > 0;)
        if (&folder->files[k] != manifest)
            undo_file(folder, &folder->files[k]);
    undo_file(folder, manifest);
    for (size_t k = 0; k < folder->count; ++k)
        remove_parent(folder->path, "", folder->files[k].name);
    if (sentence)
        sgsi_record_error("%s", sentence);
    sgsi_free(sentence);
}

// Makes the new files in subfolders durable before the manifest names them.
static void sync_parents(const sgsi_model_folder *folder)
{
    for (size_t k = 0; k < folder->count; ++k) {
        const char *name = folder->files[k].name, *slash = strrchr(name, '/');
        const size_t length = slash ? (size_t)(slash - name) + 1 : 0;
        char path[PATH_ROOM];
        if (!slash || (k && !strncmp(folder->files[k - 1].name, name, length)))
            continue;
        join(path, folder->path, "", name); // fits: the staged path is longer
        path[strlen(path) - strlen(slash)] = 0;
        sgsi_folder_sync(path);
    }
}

sgs_status sgsi_model_folder_commit(sgsi_model_folder *folder)
{
    sgsi_model_folder_file *manifest = folder->files;
    while (strcmp(manifest->name, folder->manifest))
        ++manifest;
    sgs_status status = set_aside(folder, manifest);
    for (size_t k = 0; k < folder->count && !status; ++k) {
        sgsi_model_folder_file *file = &folder->files[k];
        if (file == manifest)
            continue;
        status = set_aside(folder, file);
        if (!status && file->is_new)
            status = place(folder, file);
    }
    if (!status) {
        sync_parents(folder);
        status = place(folder, manifest);
    }
    if (status) {
        undo(folder, manifest);
        return status;
    }
    sgsi_folder_sync(folder->path);
    for (size_t k = 0; k < folder->count; ++k) {
        const sgsi_model_folder_file *file = &folder->files[k];
        char old[PATH_ROOM];
        join(old, folder->stage, "old", file->name);
        if (file->is_aside)
            unlink(old);
        remove_parent(folder->path, "", file->name);
    }
    folder->was_made = false;
    return SGS_STATUS_OK;
}

void sgsi_model_folder_close(sgsi_model_folder *folder)
{
    static const char *const parts[] = {"new", "old", ""};
    char path[PATH_ROOM];
    for (size_t k = 0; k < folder->count; ++k) {
        const sgsi_model_folder_file *file = &folder->files[k];
        join(path, folder->stage, "new", file->name);
        if (file->is_new && !file->is_placed)
            unlink(path);
        remove_parent(folder->stage, "new", file->name);
        remove_parent(folder->stage, "old", file->name);
    }
    for (size_t k = 0; k < sizeof parts / sizeof *parts && folder->stage; ++k) {
        join(path, folder->stage, "", parts[k]);
        rmdir(path);
    }
    if (folder->was_made)
        rmdir(folder->path);
    sgsi_free(folder->files);
    sgsi_free(folder->path);
    sgsi_free(folder->stage);
    sgsi_free(folder->manifest);
    *folder = (sgsi_model_folder){0};
}
