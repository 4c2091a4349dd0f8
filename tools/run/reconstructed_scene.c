// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A model is copied to SCENE/sparse/0.tmp.PID, flushed to disk and renamed to SCENE/sparse/0; the
// model that it replaces is SCENE/sparse/0.old.PID meanwhile.

#include "run/reconstructed_scene.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cli/output.h"
#include "cli/progress.h"

static const char *const model_files[] = {"cameras.bin", "points3D.bin", "images.bin"};
enum { MODEL_FILES = sizeof model_files / sizeof *model_files };

static bool is_model_file(const char *name)
{
    bool is = false;
    for (int k = 0; k < MODEL_FILES; ++k)
        is = is || !strcmp(name, model_files[k]);
    return is;
}

// ---- What is there ----

// Appends " SIZE:HASH" of a file to a text from format_text. NULL if it cannot be read.
static char *add_digest(char *text, const char *path)
{
    FILE *stream = fopen(path, "rb");
    unsigned char bytes[1 << 16];
    uint64_t hash = UINT64_C(0xcbf29ce484222325), size = 0;
    for (size_t got; stream && (got = fread(bytes, 1, sizeof bytes, stream)) > 0; size += got)
        for (size_t k = 0; k < got; ++k)
            hash = (hash ^ bytes[k]) * UINT64_C(0x100000001b3);
    const bool whole = stream && !ferror(stream);
    if (stream)
        fclose(stream);
    char *longer =
        whole ? format_text("%s%s%" PRIu64 ":%016" PRIx64, text, *text ? " " : "", size, hash)
              : NULL;
    free(text);
    return longer;
}

char *reconstructed_model_digest(const char *folder)
{
    char *text = format_text("%s", "");
    for (int k = 0; k < MODEL_FILES && text; ++k) {
        char *path = format_text("%s/%s", folder, model_files[k]);
        text = add_digest(text, path);
        free(path);
    }
    return text;
}

static bool is_known(const char *folder, const json_t *known)
{
    char *digest = reconstructed_model_digest(folder);
    size_t k;
    const json_t *entry;
    bool found = false;
    json_array_foreach(known, k, entry)
    {
        const char *text = json_string_value(entry);
        found = found || (digest && text && !strcmp(text, digest));
    }
    free(digest);
    return found;
}

static bool refuse(const char *path, const char *what)
{
    fail_run("%s: %s; move it away, or choose another folder with -o", path, what);
    return false;
}

static bool check_model(const char *folder, const json_t *known)
{
    static const char foreign[] = "was not written by reconstruct";
    struct stat info;
    if (lstat(folder, &info))
        return true; // an error other than ENOENT is that of a later write
    DIR *stream = S_ISDIR(info.st_mode) ? opendir(folder) : NULL;
    if (!stream)
        return refuse(folder, foreign);
    bool good = true, is_empty = true;
    for (const struct dirent *entry; good && (entry = readdir(stream));) {
        if (!strcmp(entry->d_name, ".") || !strcmp(entry->d_name, ".."))
            continue;
        is_empty = false;
        good = is_model_file(entry->d_name);
        if (!good) {
            char *path = format_text("%s/%s", folder, entry->d_name);
            refuse(path, foreign);
            free(path);
        }
    }
    closedir(stream);
    if (good && !is_empty && !is_known(folder, known))
        return refuse(folder, "was not written by reconstruct, or was changed later");
    return good;
}

// Sets *same if SCENE/images is the folder of the photos.
static bool check_images(const char *path, const char *photos, bool *same)
{
    char *real = realpath(path, NULL);
    struct stat info;
    *same = real && !strcmp(real, photos);
    free(real);
    return *same || lstat(path, &info) || S_ISLNK(info.st_mode) ||
           refuse(path, "is not a link to photos");
}

bool reconstructed_scene_check(const char *scene, const char *photos, const json_t *known)
{
    char *model = format_text("%s/sparse/0", scene), *images = format_text("%s/images", scene);
    bool same;
    const bool good = check_model(model, known) && check_images(images, photos, &same);
    free(model);
    free(images);
    return good;
}

// ---- Writing ----

static bool copy_file(const char *from, const char *to)
{
    FILE *in = fopen(from, "rb"), *out = in ? fopen(to, "wb") : NULL;
    char bytes[1 << 16];
    size_t got = 0;
    bool fine = out != NULL;
    while (fine && (got = fread(bytes, 1, sizeof bytes, in)) > 0)
        fine = fwrite(bytes, 1, got, out) == got;
    fine = fine && !ferror(in) && !fflush(out) && !fsync(fileno(out));
    int code = errno;
    if (out && fclose(out) && fine) {
        code = errno;
        fine = false;
    }
    if (in)
        fclose(in);
    if (!fine)
        fail_run("%s: cannot be copied to %s: %s", from, to, strerror(code));
    return fine;
}

static void remove_model(const char *folder)
{
    for (int k = 0; k < MODEL_FILES; ++k) {
        char *path = format_text("%s/%s", folder, model_files[k]);
        unlink(path);
        free(path);
    }
    rmdir(folder);
}

static void sync_folder(const char *path)
{
    const int descriptor = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    if (descriptor < 0)
        return;
    fsync(descriptor);
    close(descriptor);
}

// Renames `from` to `to` and removes the model that was there.
static bool exchange_model(const char *from, const char *to)
{
    char *old = format_text("%s.old.%ld", to, (long)getpid());
    bool done = !rename(to, old) || errno == ENOENT;
    if (done && rename(from, to)) {
        const int code = errno;
        rename(old, to);
        errno = code;
        done = false;
    }
    if (done)
        remove_model(old);
    else
        fail_run("%s: cannot be replaced: %s", to, strerror(errno));
    free(old);
    return done;
}

bool reconstructed_model_keep(const char *scene, const char *from)
{
    char *sparse = format_text("%s/sparse", scene), *model = format_text("%s/0", sparse);
    char *staged = format_text("%s.tmp.%ld", model, (long)getpid());
    bool done = make_folder(staged);
    for (int k = 0; k < MODEL_FILES && done; ++k) {
        char *source = format_text("%s/%s", from, model_files[k]);
        char *target = format_text("%s/%s", staged, model_files[k]);
        done = copy_file(source, target);
        free(source);
        free(target);
    }
    sync_folder(staged);
    done = done && exchange_model(staged, model);
    if (done)
        sync_folder(sparse);
    else
        remove_model(staged);
    free(sparse);
    free(model);
    free(staged);
    return done;
}

bool reconstructed_images_link(const char *scene, const char *photos)
{
    char *path = format_text("%s/images", scene);
    char *staged = format_text("%s.tmp.%ld", path, (long)getpid());
    bool same, done = check_images(path, photos, &same);
    if (done && !same && (symlink(photos, staged) || rename(staged, path))) {
        fail_run("%s: cannot create a symbolic link to %s: %s", path, photos, strerror(errno));
        unlink(staged);
        done = false;
    }
    free(path);
    free(staged);
    return done;
}
