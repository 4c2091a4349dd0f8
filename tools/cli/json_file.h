// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// JSON files named by the user or found in a folder.

#include <jansson.h>

// json_load_file for files that open_input accepts; line 0 means that it cannot be opened.
json_t *load_json(const char *path, size_t flags, json_error_t *error);

// The root of a JSON file. Duplicate keys are an error. NULL after printing the error with its
// line.
json_t *read_json(const char *path);
// Why load_json failed: "PATH: line 3: ..." or "PATH: cannot be read: ...". Release with free().
char *json_load_fault(const char *path, const json_error_t *error);
