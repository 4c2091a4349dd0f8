// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cli/json_output.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli/output.h"
#include "cli/progress.h"

enum { STORED_DIGITS = 9 }; // of the numbers in files

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

char *json_joined(const json_t *list, char *(*text_of)(const json_t *value))
{
    char *joined = format_text("%s", "");
    for (size_t k = 0; k < json_array_size(list); ++k) {
        char *item = text_of(json_array_get(list, k)),
             *longer = format_text("%s%s%s", joined, k ? "," : "", item ? item : "");
        free(item);
        free(joined);
        joined = longer;
    }
    return joined;
}

json_t *json_number(double value)
{
    return isfinite(value) ? json_real(value) : json_null();
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
    if (!text) {
        fail_run("%s: cannot be written: %s", path, strerror(ENOMEM));
        return false;
    }
    char *lines = format_text("%s\n", text);
    const bool written = write_text(path, lines);
    free(lines);
    free(text);
    return written;
}
