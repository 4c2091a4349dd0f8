// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The files that belong to a run or an experiment, which no other output may replace. Only names
// and marks of folders: run/run_folder.h reads and writes the files.

// The files and folders of a run. config.json marks the folder as a run. It is moved last, and
// first on the way back, so that a run in OUT/previous.next is complete if it has config.json.
enum { RUN_ENTRIES = 10 };
extern const char *const run_entries[RUN_ENTRIES];

// "a run" or "an experiment" if an output to `path` would replace, or become, a file of one: an
// entry of a run folder, anything in its checkpoint/, an existing model of an iteration, the
// results of an experiment. NULL otherwise: other files may be written to these folders.
// out: a folder that counts as a run even if it does not exist yet, or NULL.
const char *run_file_owner(const char *path, const char *out);

// The path that --overwrite gives to a file of the run in the folder `out`, or to the run itself:
// OUT/previous/... NULL for other paths, which stay. Release with free().
char *run_file_moved(const char *path, const char *out);
