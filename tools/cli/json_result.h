// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Output of a command with --json on stdout: exactly one JSON object, with "schema" first. It is
// printed at the end, so that a command that fails after its result is known can add "error" to it.
// tools/manual/json.md describes the members.

#include <jansson.h>
#include <stdbool.h>

// Version of the layout of all JSON output. Increases if a member is removed or changes its
// meaning, not if one is added.
enum { JSON_SCHEMA = 1 };

// A new object that begins with "schema".
json_t *json_result_new(void);

// Keeps `root` as the result of the command. Steals the reference; adds "schema" if it is missing.
void json_result_set(json_t *root);

// The kept result, which is then no longer the result of the command; release it with json_decref.
json_t *json_result_take(void);

// Keeps the message of an error, without "sparegs: ", replacing an earlier one.
void json_result_error(const char *message);

// Prints the result to stdout. With a failed status an object with "error" is printed, or "error"
// is added to the result, if `json` (the command line had --json). False if stdout could not be
// written; stdout is not flushed.
bool json_result_print(int status, bool json);
