// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Output files of the commands: folders, text files, and CSV tables that a resumed run continues.
// Functions that return bool print their error before they return false.

#include <stdbool.h>
#include <stdio.h>

#include "sparegs/output_file.h"

// printf into a new string; release with free(). Exits if out of memory.
char *format_text(const char *format, ...) __attribute__((format(printf, 1, 2)));

// Creates a folder and its parents. Succeeds if it exists.
bool make_folder(const char *path);
// Creates the parent folder of a file.
bool make_folder_of(const char *path);
// Checks that files can be created in a folder by creating and removing one.
bool check_writable(const char *folder);
// Checks that a file can be written there: in the nearest folder above it that exists, if it is not
// a folder (by its kind, or by a '/' at the end), a device, a pipe or a symbolic link that leads
// nowhere.
bool check_output(const char *path);
bool file_exists(const char *path);
// The first of the numbers 1 to 9999 for which FOLDER/STEM_NNNN.ENDING does not exist; 0 after
// printing the error.
int free_number(const char *folder, const char *stem, const char *ending);

// Creates the parent folder of a file and opens it (sparegs/output_file.h).
bool open_output(const char *path, sgs_output_file *file);
// Replaces the file when the new one is complete (sparegs/output_file.h).
bool write_text(const char *path, const char *text);

// Opens a CSV for appending. A new one gets `header`; an existing one keeps the rows whose first
// column is at most `last_iteration` (0: none). NULL after printing the error.
FILE *csv_open(const char *path, const char *header, int last_iteration);
