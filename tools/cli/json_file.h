// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// JSON that a user names.

#include <jansson.h>

// The root of a file; a name twice in an object is an error. NULL after printing the error, with
// its line.
json_t *read_json(const char *path);
