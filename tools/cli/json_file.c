// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cli/json_file.h"

#include <errno.h>
#include <string.h>

#include "cli/progress.h"

json_t *read_json(const char *path)
{
    json_error_t error;
    json_t *root = json_load_file(path, JSON_REJECT_DUPLICATES, &error);
    if (!root && error.line < 0)
        fail_run("%s: cannot be read: %s", path, strerror(errno));
    else if (!root)
        fail_run("%s: line %d: %s", path, error.line, error.text);
    return root;
}
