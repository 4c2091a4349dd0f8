// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Values in a plan of an experiment: their texts, and paths, which are relative to the plan's
// folder.

#include <jansson.h>
#include <stdbool.h>

#include "options/options.h"

// The path, seen from the working folder. Release with free().
char *plan_path_resolve(const char *plan, const char *path);

// Resolves the value of an option that is a path, and checks that an input exists. *text is
// replaced; release it with free(). `name` of the option is for the error. False after printing it.
bool plan_path_option(const char *plan, const char *name, option_path kind, char **text);

// The argument for a string, a number, or a list of them, joined by commas; NULL for other values.
// Release with free().
char *plan_value_text(const json_t *value);
