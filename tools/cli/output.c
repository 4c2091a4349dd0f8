// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Output files and paths. A file is replaced by writing a temporary file in the same folder,
// flushing it to disk and renaming it, so that a full disk or a killed process leaves the old file
// intact.

#include "cli/output.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "cli/input_file.h"
#include "cli/json_file.h"
#include "cli/json_result.h"
#include "cli/progress.h"
#include "cli/recorded_options.h"
#include "sparegs/model_file.h"
#include "sparegs/run.h"

enum { STORED_DIGITS = 9 }; // of the numbers in JSON files

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

bool make_folder(const char *path)
{
    char *partial = format_text("%s", path);
    for (char *at = partial + 1;; ++at) {
        if (at[-1] && *at != '/' && *at)
            continue;
        const char kept = *at;
        *at = 0;
        if (mkdir(partial, 0777) && errno != EEXIST) {
            fail_file(partial, "cannot be created", errno);
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
        return fail_file(path, "cannot be created", errno);
    if (!S_ISDIR(info.st_mode))
        return fail_file(path, "is not a folder", ENOTDIR);
    return true;
}

// An output is renamed to its name at the end. That would remove a device such as /dev/null.
static bool check_replaceable(const char *path)
{
    struct stat info;
    if (stat(path, &info) || S_ISREG(info.st_mode) || S_ISDIR(info.st_mode))
        return true;
    fail_run("%s: is a device or a pipe; choose the name of a file", path);
    return false;
}

bool make_folder_of(const char *path)
{
    const char *slash = strrchr(path, '/');
    if (!check_replaceable(path))
        return false;
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
    char *probe = format_text("%s/.sparegs.%ld", folder, (long)getpid());
    FILE *stream = fopen(probe, "wb");
    const bool written = stream && fputs("probe\n", stream) >= 0 && !fflush(stream);
    const int code = written ? 0 : errno;
    if (stream) {
        fclose(stream);
        unlink(probe);
    }
    free(probe);
    return code;
}

bool check_writable(const char *folder)
{
    const int code = probe_folder(folder);
    return !code || fail_file(folder, "folder is not writable", code);
}

char *output_target(const char *path)
{
    struct stat info;
    if (lstat(path, &info) || !S_ISLNK(info.st_mode))
        return format_text("%s", path);
    char *target = realpath(path, NULL);
    if (!target)
        fail_run("%s: is a symbolic link that cannot be followed: %s; remove it or choose another "
                 "name",
                 path, strerror(errno));
    return target;
}

bool check_output(const char *path)
{
    struct stat info = {0};
    if (!stat(path, &info) && S_ISDIR(info.st_mode))
        return fail_file(path, "cannot be written", EISDIR);
    char *target = check_replaceable(path) ? output_target(path) : NULL;
    if (!target)
        return false;
    char *folder = format_text("%s%s", *target == '/' ? "" : "./", target);
    free(target);
    do { // the nearest folder that exists
        char *slash = strrchr(folder, '/');
        slash[slash == folder] = 0;
    } while (stat(folder, &info) && strcmp(folder, "/") && strcmp(folder, "."));
    const int code = S_ISDIR(info.st_mode) ? probe_folder(folder) : ENOTDIR;
    if (code)
        fail_run("%s: cannot be written: %s: %s", path, folder, strerror(code));
    free(folder);
    return !code;
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

bool write_text(const char *path, const char *text)
{
    char *target = check_replaceable(path) ? output_target(path) : NULL;
    if (!target)
        return false;
    char *temporary = format_text("%s.tmp.%ld", target, (long)getpid());
    errno = 0;
    FILE *stream = fopen(temporary, "wb");
    bool written = stream && fputs(text, stream) >= 0 && !fflush(stream) && !fsync(fileno(stream));
    int code = errno;
    if (stream && fclose(stream) && written) {
        code = errno;
        written = false;
    }
    if (written && rename(temporary, target)) {
        code = errno;
        written = false;
    }
    if (!written && stream)
        unlink(temporary);
    free(temporary);
    free(target);
    return written || fail_file(path, "cannot be written", code);
}

json_t *json_as_stored(const json_t *value)
{
    char *text = json_dumps(value, JSON_ENCODE_ANY | JSON_REAL_PRECISION(STORED_DIGITS));
    json_t *stored = text ? json_loads(text, JSON_DECODE_ANY, NULL) : NULL;
    free(text);
    return stored;
}

bool write_json(const char *path, json_t *root)
{
    char *text = json_dumps(root, JSON_INDENT(1) | JSON_REAL_PRECISION(STORED_DIGITS));
    json_decref(root);
    if (!text)
        return fail_file(path, "cannot be written", ENOMEM);
    char *lines = format_text("%s\n", text);
    const bool written = write_text(path, lines);
    free(lines);
    free(text);
    return written;
}

bool print_json(json_t *root)
{
    json_result_set(root);
    return true;
}

static json_t *reported; // {"files": [paths]}; NULL: each path is printed as a line

void report_file(const char *path)
{
    if (!reported) {
        puts(path);
        return;
    }
    json_array_append_new(json_object_get(reported, "files"), json_text(path));
}

void reported_files_begin(void)
{
    reported = json_pack("{s:[]}", "files");
}

void reported_files_set(const char *name, json_t *value)
{
    if (reported)
        json_object_set_new(reported, name, value);
    else
        json_decref(value);
}

json_t *reported_files_take(void)
{
    json_t *files = json_incref(json_object_get(reported, "files"));
    json_object_set_new(reported, "files", json_array());
    return files;
}

void reported_files_restore(json_t *files)
{
    json_array_extend(json_object_get(reported, "files"), files);
    json_decref(files);
}

void reported_files_list(void)
{
    size_t i;
    json_t *path;
    json_array_foreach(json_object_get(reported, "files"), i, path)
    {
        const char *text = json_string_value(path);
        puts(text ? text : "(a path that is not UTF-8)");
    }
    json_decref(reported);
    reported = NULL;
}

bool reported_files_print(void)
{
    json_t *root = reported;
    reported = NULL;
    return print_json(root);
}

static char *complete; // result that is complete although stdout cannot be written

void stdout_set_complete(const char *what)
{
    free(complete);
    complete = format_text("%s", what);
}

bool stdout_is_whole(void)
{
    const int code = fflush(stdout) ? errno : 0;
    if (!code && !ferror(stdout))
        return true;
    fail_run("standard output: cannot be written: %s%s%s", code ? strerror(code) : "disk full?",
             complete ? "; " : "", complete ? complete : "");
    return false;
}

void json_set_path(json_t *object, const char *name, const char *format, ...)
{
    char path[4096];
    va_list args;
    va_start(args, format);
    vsnprintf(path, sizeof path, format, args);
    va_end(args);
    json_object_set_new(object, name, json_text(path));
}

json_t *json_text(const char *text)
{
    json_t *value = json_string(text);
    return value ? value : json_null();
}

json_t *json_message(const char *text, size_t length)
{
    json_t *value = json_stringn(text, length);
    char *copy = value ? NULL : strndup(text, length);
    for (char *at = copy; at && *at; ++at)
        if ((unsigned char)*at >= 0x80)
            *at = '?';
    if (copy)
        value = json_string(copy);
    free(copy);
    return value ? value : json_null();
}

json_t *json_number(double value)
{
    return isfinite(value) ? json_real(value) : json_null();
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

// ---- MODEL ----

static bool is_folder(const char *path)
{
    struct stat info;
    return !stat(path, &info) && S_ISDIR(info.st_mode);
}

// The model in a folder such as point_cloud/iteration_7000, or NULL. Release with free().
static char *iteration_model(const char *folder)
{
    char *path = format_text("%s/point_cloud.ply", folder);
    if (is_folder(folder) && file_exists(path) && !is_folder(path))
        return path;
    free(path);
    return NULL;
}

bool model_is(const char *model)
{
    sgs_model_format format;
    char *ply = iteration_model(model);
    free(ply);
    if (ply)
        return true;
    // A file that is missing is a model by its name.
    if (sgs_model_format_detect(model, &format) ||
        (!is_folder(model) && sgs_model_format_of_name(model, &format)))
        return true;
    char *clouds = format_text("%s/point_cloud", model);
    const bool is = is_folder(clouds);
    free(clouds);
    return is;
}

// The run folder OUT of a folder OUT/point_cloud/iteration_N, or NULL. Release with free().
static char *run_of_iteration(const char *folder)
{
    static const char middle[] = "/point_cloud";
    char *run = realpath(folder, NULL), *slash = run ? strrchr(run, '/') : NULL;
    if (slash)
        *slash = 0;
    const size_t length = run ? strlen(run) : 0, tail = sizeof middle - 1;
    const bool is = length > tail && !strcmp(run + length - tail, middle);
    free(run);
    return is ? format_text("%s/../..", folder) : NULL;
}

// Reads RUN/config.json if it exists. Takes `run`, which may be NULL.
static void read_run_config(char *run, model_path *located)
{
    char *config = run ? format_text("%s/config.json", run) : NULL;
    if (config && file_exists(config)) {
        json_error_t error;
        located->config = load_json(config, 0, &error);
        if (!located->config) {
            char *fault = json_load_fault(config, &error);
            print_warning("%s; its options are ignored", fault);
            free(fault);
        } else {
            recorded_options_check(located->config, config);
        }
    }
    free(config);
    located->run = run;
}

bool model_locate(const char *model, model_path *located)
{
    *located = (model_path){0};
    if (!file_exists(model)) {
        fail_run("%s: no such model; specify a model file or a run folder", model);
        return false;
    }
    sgs_model_format format;
    if (!is_folder(model) || sgs_model_format_detect(model, &format)) {
        located->ply_path = format_text("%s", model);
        return true;
    }
    located->ply_path = iteration_model(model);
    if (located->ply_path) {
        read_run_config(run_of_iteration(model), located);
        return true;
    }
    char path[4096];
    if (sgs_run_model_path(model, path, sizeof path, &located->iteration)) {
        fail_library();
        return false;
    }
    located->ply_path = format_text("%s", path);
    read_run_config(format_text("%s", model), located);
    return true;
}

void model_path_free(model_path *located)
{
    free(located->ply_path);
    free(located->run);
    json_decref(located->config);
    *located = (model_path){0};
}

json_t *config_option(const json_t *config, const char *name)
{
    return config ? json_object_get(json_object_get(config, "options"), name) : NULL;
}
