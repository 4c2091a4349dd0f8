// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The JSON on stdout. Error messages have the form "FILE: what is wrong; what to do"; "error" holds
// the parts.

#include "cli/json_result.h"

#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "cli/json_output.h"
#include "cli/standard_output.h"
#include "cli/usage_error.h"

static json_t *result;
static char error_message[2048];

json_t *json_result_new(void)
{
    json_t *root = json_object();
    json_object_set_new(root, "schema", json_integer(JSON_SCHEMA));
    return root;
}

void json_result_set(json_t *root)
{
    if (!json_object_get(root, "schema")) {
        json_t *whole = json_result_new();
        json_object_update(whole, root);
        json_decref(root);
        root = whole;
    }
    json_decref(result);
    result = root;
}

json_t *json_result_take(void)
{
    json_t *taken = result;
    result = NULL;
    return taken;
}

void json_result_error(const char *message)
{
    snprintf(error_message, sizeof error_message, "%s", message);
}

// Length of the file name at the start of a message, 0 if it names none: the longest part before
// ": " that exists, else the first one that looks like a path.
static size_t file_length(const char *message)
{
    size_t existing = 0, first = 0;
    for (const char *at = message; (at = strstr(at, ": ")); at += 2) {
        char path[sizeof error_message];
        struct stat info;
        const size_t length = (size_t)(at - message);
        snprintf(path, sizeof path, "%.*s", (int)length, message);
        if (!stat(path, &info))
            existing = length;
        if (at == strstr(message, ": ") && strpbrk(path, "/.") && strncmp(path, "--", 2) &&
            !strchr(path, ' '))
            first = length;
    }
    return existing ? existing : first;
}

static json_t *error_json(int status)
{
    const size_t file = file_length(error_message);
    const char *message = error_message + (file ? file + 2 : 0);
    const char *semicolon = strstr(message, "; ");
    const char *code = status == EXIT_USAGE    ? "usage"
                       : status == EXIT_FAILED ? "failed"
                                               : "interrupted";
    const char *text = *message                ? message
                       : status == EXIT_FAILED ? "the command failed"
                                               : "stopped by a signal";
    json_t *error = json_object();
    json_object_set_new(error, "code", json_string(code));
    json_t *path = file ? json_stringn(error_message, file) : NULL; // NULL if it is not UTF-8
    json_object_set_new(error, "file", path ? path : json_null());
    json_object_set_new(
        error, "message",
        json_message(text, semicolon && *message ? (size_t)(semicolon - message) : strlen(text)));
    json_object_set_new(error, "hint",
                        semicolon ? json_message(semicolon + 2, strlen(semicolon + 2))
                                  : json_null());
    return error;
}

bool json_result_print(int status, bool json)
{
    if (json && status != EXIT_DONE) {
        if (!result)
            result = json_result_new();
        json_object_set_new(result, "error", error_json(status));
    }
    if (!result)
        return true;
    char *text = json_dumps(result, JSON_INDENT(1) | JSON_REAL_PRECISION(9));
    const bool printed = text != NULL;
    if (printed) {
        stdout_write(text);
        stdout_write("\n");
    }
    free(text);
    json_decref(result);
    result = NULL;
    return printed;
}
