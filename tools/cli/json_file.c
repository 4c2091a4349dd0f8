// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cli/json_file.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "cli/output.h"
#include "cli/progress.h"

char *json_load_fault(const char *path, const json_error_t *error)
{
    return error->line < 0 ? format_text("%s: cannot be read: %s", path, strerror(errno))
                           : format_text("%s: line %d: %s", path, error->line, error->text);
}

json_t *read_json(const char *path)
{
    json_error_t error;
    json_t *root = json_load_file(path, JSON_REJECT_DUPLICATES, &error);
    if (!root) {
        char *fault = json_load_fault(path, &error);
        fail_run("%s", fault);
        free(fault);
    }
    return root;
}
