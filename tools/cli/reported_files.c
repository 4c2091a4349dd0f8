// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cli/reported_files.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "cli/json_result.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/standard_output.h"

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
        stdout_flush();
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
    const int code = stdout_error();
    if (!code || code == EPIPE) // the reader has enough
        return true;
    fail_run("standard output: cannot be written: %s%s%s", strerror(code), complete ? "; " : "",
             complete ? complete : "");
    return false;
}
