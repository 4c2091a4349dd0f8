// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cli/output.h"

#include <errno.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cli/input_file.h"
#include "cli/progress.h"

char *format_text(const char *format, ...)
{
    char *text = NULL;
    va_list args;
    va_start(args, format);
    if (vasprintf(&text, format, args) < 0) {
        fputs("sparegs: out of memory\n", stderr);
        exit(1);
    }
    va_end(args);
    return text;
}

static bool fail_file(const char *path, const char *what, int code)
{
    fail_run("%s: %s: %s", path, what, code ? strerror(code) : "disk full?");
    return false;
}

static bool fail_folder(const char *path, const char *what, int code)
{
    fail_run("%s: %s: %s; choose another folder, or check the permissions", path, what,
             strerror(code));
    return false;
}

bool make_folder(const char *path)
{
    char *partial = format_text("%s", path);
    for (char *at = partial + 1;; ++at) {
        if (at[-1] && *at != '/' && *at)
            continue;
        const char kept = *at;
        *at = 0;
        if (mkdir(partial, 0777) && errno != EEXIST) {
            fail_folder(partial, "cannot be created", errno);
            free(partial);
            return false;
        }
        *at = kept;
        if (!kept)
            break;
    }
    free(partial);
    struct stat info;
    if (stat(path, &info))
        return fail_folder(path, "cannot be created", errno);
    if (!S_ISDIR(info.st_mode))
        return fail_folder(path, "is not a folder", ENOTDIR);
    return true;
}

bool make_folder_of(const char *path)
{
    const char *slash = strrchr(path, '/');
    if (!slash || slash == path)
        return true;
    char *folder = format_text("%.*s", (int)(slash - path), path);
    const bool made = make_folder(folder);
    free(folder);
    return made;
}

// Creates and removes a file in a folder. Returns 0, or errno.
static int probe_folder(const char *folder)
{
    char *probe = format_text("%s/.sparegs.XXXXXX", folder);
    const int descriptor = mkstemp(probe);
    const bool written = descriptor >= 0 && write(descriptor, "probe\n", 6) == 6;
    const int code = written ? 0 : errno;
    if (descriptor >= 0) {
        close(descriptor);
        unlink(probe);
    }
    free(probe);
    return code;
}

bool check_writable(const char *folder)
{
    const int code = probe_folder(folder);
    return !code || fail_folder(folder, "folder is not writable", code);
}

// False after printing the error for the name of a folder, also of one that does not exist: the
// file could be written, but not renamed to it.
static bool names_file(const char *path)
{
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
    const bool names = *name && strcmp(name, ".") != 0 && strcmp(name, "..") != 0;
    if (!names)
        fail_run("%s: is the name of a folder; specify the name of a file", path);
    return names;
}

// Where the file does not exist, the nearest folder above it that exists.
static bool check_new_output(const char *path)
{
    struct stat info;
    char *folder = format_text("%s%s", *path == '/' ? "" : "./", path);
    do {
        char *slash = strrchr(folder, '/');
        slash[slash == folder] = 0;
    } while (stat(folder, &info) && strcmp(folder, "/") && strcmp(folder, "."));
    const int code = S_ISDIR(info.st_mode) ? probe_folder(folder) : ENOTDIR;
    if (code)
        fail_run("%s: cannot be written: %s: %s", path, folder, strerror(code));
    free(folder);
    return !code;
}

bool check_output(const char *path)
{
    struct stat info;
    if (!names_file(path))
        return false;
    if (lstat(path, &info))
        return check_new_output(path);
    if (!stat(path, &info) && S_ISDIR(info.st_mode))
        return fail_file(path, "cannot be written", EISDIR);
    sgs_output_file file;
    const bool works = !sgs_output_file_open(&file, path);
    if (works)
        sgs_output_file_abort(&file);
    else
        fail_library();
    return works;
}

bool file_exists(const char *path)
{
    struct stat info;
    return !stat(path, &info);
}

int free_number(const char *folder, const char *stem, const char *ending)
{
    enum { LAST = 9999 };
    for (int n = 1; n <= LAST; ++n) {
        char *path = format_text("%s/%s_%04d.%s", folder, stem, n, ending);
        const bool taken = file_exists(path);
        free(path);
        if (!taken)
            return n;
    }
    fail_run("%s: %s_0001.%s to %s_%d.%s exist; move some of them away", folder, stem, ending, stem,
             LAST, ending);
    return 0;
}

bool open_output(const char *path, sgs_output_file *file)
{
    if (!names_file(path) || !make_folder_of(path))
        return false;
    const bool opened = !sgs_output_file_open(file, path);
    if (!opened)
        fail_library();
    return opened;
}

bool write_text(const char *path, const char *text)
{
    const bool written = !sgs_output_file_write(path, (const uint8_t *)text, strlen(text));
    if (!written)
        fail_library();
    return written;
}

// Copies the rows up to `last_iteration`. False if the table cannot be read to its end.
static bool copy_rows(FILE *table, int last_iteration, FILE *kept)
{
    char *line = NULL;
    size_t room = 0;
    for (bool first = true; getline(&line, &room, table) > 0; first = false) {
        const long iteration = strtol(line, NULL, 10);
        if (!first && iteration > 0 && iteration <= last_iteration && strchr(line, '\n'))
            fputs(line, kept);
    }
    const int code = errno;
    free(line);
    errno = code;
    return feof(table) && !ferror(table); // getline also ends where memory does
}

// The header and the rows up to `last_iteration` of an existing table. NULL with errno if it cannot
// be read.
static char *kept_rows(const char *path, const char *header, int last_iteration)
{
    FILE *table = open_input(path, NULL);
    if (!table)
        return errno == ENOENT ? format_text("%s\n", header) : NULL;
    char *text = NULL;
    size_t size = 0;
    FILE *kept = open_memstream(&text, &size);
    bool whole = kept && fprintf(kept, "%s\n", header) > 0;
    whole = whole && copy_rows(table, last_iteration, kept) && !ferror(kept);
    int code = errno;
    if (kept && fclose(kept) && whole) {
        code = errno;
        whole = false;
    }
    fclose(table);
    if (whole)
        return text;
    free(text);
    errno = code;
    return NULL;
}

FILE *csv_open(const char *path, const char *header, int last_iteration)
{
    char *text =
        last_iteration > 0 ? kept_rows(path, header, last_iteration) : format_text("%s\n", header);
    if (!text) {
        fail_file(path, "cannot be read", errno);
        return NULL;
    }
    const bool written = write_text(path, text);
    free(text);
    if (!written)
        return NULL;
    FILE *stream = fopen(path, "a");
    if (!stream)
        fail_file(path, "cannot be written", errno);
    return stream;
}
