// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// JSON files named by the user.

#include <jansson.h>

// The root of a JSON file. Duplicate keys are an error. NULL after printing the error with its
// line.
json_t *read_json(const char *path);
