// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// JSON files named by the user.

#include <jansson.h>

// The root of a JSON file. Duplicate keys are an error. NULL after printing the error with its
// line.
json_t *read_json(const char *path);
// Why json_load_file failed: "PATH: line 3: ..." or "PATH: cannot be read: ...". Call it directly
// after the failure, because it uses errno. Release with free().
char *json_load_fault(const char *path, const json_error_t *error);
