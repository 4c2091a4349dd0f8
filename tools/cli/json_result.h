// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What a command with --json leaves on stdout: exactly one JSON object, with "schema" first. It is
// printed when the command has ended, so that a command that fails after its result is known can
// add "error" to it. tools/manual/json.md describes all of them.

#include <jansson.h>
#include <stdbool.h>

// Number of the layout of all JSON output. It grows when a member is removed or changes its
// meaning, not when one is added.
enum { JSON_SCHEMA = 1 };

// A new object that begins with "schema".
json_t *json_result_new(void);

// Keeps `root` as the result of the command. Steals the reference; adds "schema" if it is missing.
void json_result_set(json_t *root);

// The kept result, which is then no longer the result of the command; release it with json_decref.
json_t *json_result_take(void);

// Keeps the message of an error, without "sparegs: ". The last one counts.
void json_result_error(const char *message);

// Prints the result to stdout. With a failed status an object with "error" is printed, or "error"
// is added to the result, if `json` says that the command line had --json. False if stdout could
// not be written; stdout is not flushed.
bool json_result_print(int status, bool json);
