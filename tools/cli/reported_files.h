// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Output on stdout: the written files, as lines or as JSON, and errors of the stream. Not
// thread-safe.

#include <jansson.h>
#include <stdbool.h>

// Reports a written file on stdout: its path as a line, or, between reported_files_begin and
// reported_files_print, as an entry of {"files": [...]}.
void report_file(const char *path);
void reported_files_begin(void);
bool reported_files_print(void);
// The paths reported since reported_files_begin, which are forgotten; as strings, null where a path
// is not valid UTF-8. reported_files_restore reports such paths again.
json_t *reported_files_take(void);
void reported_files_restore(json_t *files);
// Prints the paths as lines, as without reported_files_begin.
void reported_files_list(void);
// Adds a member next to "files". Steals the reference; ignored without reported_files_begin.
void reported_files_set(const char *name, json_t *value);

// Makes `root` the result that is printed to stdout when the command ends (json_result.h). Steals
// the reference; always true.
bool print_json(json_t *root);
// Flushes stdout. False after printing the error if anything could not be written. It is no error
// that the reader of a pipe has closed it, as `head` does.
bool stdout_is_whole(void);
// Adds to that error which result is complete without stdout.
void stdout_set_complete(const char *what);
