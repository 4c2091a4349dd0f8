// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cli/json_file.h"

#include <stdio.h>
#include <stdlib.h>

#include "cli/input_file.h"
#include "cli/output.h"
#include "cli/progress.h"

// Skips the byte order mark with which programs on Windows begin UTF-8 files. No other JSON begins
// with its first byte.
static void skip_byte_order_mark(FILE *stream)
{
    const int first = getc(stream);
    if (first == 0xef) {
        (void)getc(stream);
        (void)getc(stream);
    } else if (first != EOF) {
        ungetc(first, stream);
    }
}

json_t *load_json(const char *path, size_t flags, json_error_t *error)
{
    const char *reason = NULL;
    FILE *stream = open_input(path, &reason);
    if (!stream) {
        if (error) {
            *error = (json_error_t){.line = 0};
            snprintf(error->text, sizeof error->text, "%s", reason);
        }
        return NULL;
    }
    skip_byte_order_mark(stream);
    json_t *root = json_loadf(stream, flags, error);
    fclose(stream);
    return root;
}

char *json_load_fault(const char *path, const json_error_t *error)
{
    return error->line <= 0 ? format_text("%s: cannot be read: %s", path, error->text)
                            : format_text("%s: line %d: %s", path, error->line, error->text);
}

json_t *read_json(const char *path)
{
    json_error_t error;
    json_t *root = load_json(path, JSON_REJECT_DUPLICATES, &error);
    if (!root) {
        char *fault = json_load_fault(path, &error);
        fail_run("%s", fault);
        free(fault);
    }
    return root;
}
