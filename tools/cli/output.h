// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Files that the commands write and find again: folders, atomic text and JSON, CSV tables that a
// resumed run continues, and the way from MODEL (a PLY or a run's folder) to the PLY. Functions
// that return bool have printed their error when they return false.

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include "sparegs/scene.h"

// printf into a fresh string; release with free(). Ends the program when out of memory.
char *format_text(const char *format, ...) __attribute__((format(printf, 1, 2)));

// Creates a folder and its parents; fine if it is there.
bool make_folder(const char *path);
// Creates the folder a file is to stand in.
bool make_folder_of(const char *path);
// Proves that files can be created in a folder, by creating and removing one.
bool check_writable(const char *folder);
bool file_exists(const char *path);

// Writes beside the target and renames: the old file stays until the new one is complete.
bool write_text(const char *path, const char *text);
// Indented, with a final newline. Steals the reference to `root`.
bool write_json(const char *path, json_t *root);
// The same to stdout.
bool print_json(json_t *root);
// Tells on stdout of a file that is written: its path as a line, or, between told_files_begin and
// told_files_print, as an entry of {"files": [...]}. One thread at a time.
void tell_file(const char *path);
void told_files_begin(void);
bool told_files_print(void);
// Whether all that was printed on stdout has arrived; false after printing the error.
bool stdout_is_whole(void);
// A number with at most 9 digits, or null where JSON has none (infinity, NaN).
json_t *json_number(double value);

// Opens a CSV for appending. A fresh one gets `header`; an old one keeps its rows whose first
// column is at most `last_iteration` (0: none). NULL after printing the error.
FILE *csv_open(const char *path, const char *header, int last_iteration);

// MODEL as the commands take it. ply_path is owned by the struct; config is the parsed
// OUT/config.json or NULL.
typedef struct model_path {
    char *ply_path;
    json_t *config;
    int iteration; // of the run's folder, 0 for a bare PLY
} model_path;

// True if MODEL is a PLY file or holds a run's point_cloud folder.
bool model_is(const char *model);
bool model_locate(const char *model, model_path *located);
void model_path_free(model_path *located);

// The member `name` of config's "options", or NULL. Accepts NULL.
json_t *config_option(const json_t *config, const char *name);
