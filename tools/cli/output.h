// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Output files of the commands: folders, atomic text and JSON files, CSV tables that a resumed run
// continues, and the lookup of MODEL (a model file or a run folder). Functions that return bool
// print their error before they return false.

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include "sparegs/scene.h"

// printf into a new string; release with free(). Exits if out of memory.
char *format_text(const char *format, ...) __attribute__((format(printf, 1, 2)));

// Creates a folder and its parents. Succeeds if it exists.
bool make_folder(const char *path);
// Creates the parent folder of a file. Fails if the file exists and is a device or a pipe, which
// the output would replace.
bool make_folder_of(const char *path);
// Checks that files can be created in a folder by creating and removing one.
bool check_writable(const char *folder);
// The same for a file that will be written, in the nearest folder above it that exists.
bool check_output(const char *path);
bool file_exists(const char *path);
// The first of the numbers 1 to 9999 for which FOLDER/STEM_NNNN.ENDING does not exist; 0 after
// printing the error.
int free_number(const char *folder, const char *stem, const char *ending);

// The file that an output to `path` replaces: where `path` is a symbolic link, the file it points
// to. NULL after printing the error. Release with free().
char *output_target(const char *path);
// Writes a temporary file and renames it: the old file stays until the new one is complete.
bool write_text(const char *path, const char *text);
// Writes indented JSON with a final newline. Steals the reference to `root`.
bool write_json(const char *path, json_t *root);
// A copy with numbers as write_json stores them. NULL without memory.
json_t *json_as_stored(const json_t *value);
// Makes `root` the result that is printed to stdout when the command ends (json_result.h). Steals
// the reference; always true.
bool print_json(json_t *root);
// Reports a written file on stdout: its path as a line, or, between reported_files_begin and
// reported_files_print, as an entry of {"files": [...]}. Not thread-safe.
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
// Flushes stdout. False after printing the error if anything could not be written.
bool stdout_is_whole(void);
// Adds to that error which result is complete without stdout.
void stdout_set_complete(const char *what);
// Sets a member to a path, as printf; null if that is not UTF-8.
void json_set_path(json_t *object, const char *name, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
// A text, such as a path or the name of an image; null if it is NULL or not UTF-8.
json_t *json_text(const char *text);
// The first bytes of a message. If it is not UTF-8, '?' replaces the bytes outside of ASCII.
json_t *json_message(const char *text, size_t length);
// A number with up to 9 digits, or null for infinity and NaN.
json_t *json_number(double value);

// Opens a CSV for appending. A new one gets `header`; an existing one keeps the rows whose first
// column is at most `last_iteration` (0: none). NULL after printing the error.
FILE *csv_open(const char *path, const char *header, int last_iteration);

// A resolved MODEL argument. The struct owns ply_path, a file of any model format or a SOG folder,
// and run, the run folder or NULL: MODEL, or the one that holds the iteration MODEL. config is the
// parsed config.json of the run or NULL.
typedef struct model_path {
    char *ply_path, *run;
    json_t *config;
    int iteration; // of a run folder; 0 for a file
} model_path;

// True if MODEL is a model file, a SOG folder or a folder with point_cloud/.
bool model_is(const char *model);
bool model_locate(const char *model, model_path *located);
void model_path_free(model_path *located);

// The member `name` of config's "options", or NULL. Accepts NULL.
json_t *config_option(const json_t *config, const char *name);
