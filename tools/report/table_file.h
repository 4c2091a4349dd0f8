// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Reads the tables of a run, train.csv and spare.csv.

#include <jansson.h>

// The rows of FOLDER/NAME as lists of numbers, without the header. The list is empty if the file
// does not exist, and after a warning, which ends with `effect`, if it is damaged or cannot be
// read. An unfinished last line, of a run that was killed or is running, is skipped.
json_t *table_file_rows(const char *folder, const char *name, const char *effect);
