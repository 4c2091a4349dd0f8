// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// OUT, the folder of a training run: its models, tables and checkpoints. Functions that return bool
// have printed their error when they return false.

#include <stdbool.h>
#include <stdio.h>

#include "sparegs/trainer.h"

typedef struct run_folder {
    const char *path;
    FILE *train_csv, *spare_csv, *sums_csv;
    size_t densified, pruned, spare_pruned; // sums since the last row of train.csv
    int lock;                               // descriptor that holds the folder against other runs
    double checkpoint_seconds;              // the longest that saving a checkpoint has taken
    double checkpoint_total;                // all of them together
} run_folder;

// Creates the folder, locks it against other runs until the process ends, removes what a killed run
// left half-written and proves that files can be written there.
bool run_folder_prepare(run_folder *folder, const char *path);

// Removes the folder if it is empty: nothing came of the run.
void run_folder_leave(const run_folder *folder);

// True if an earlier run left its config.json there.
bool run_folder_is_used(const run_folder *folder);

// Makes room for a new run, in two steps. set_aside moves all files of the earlier run to
// OUT/previous.next; keep_previous renames that to OUT/previous and removes the one before it.
// restore undoes set_aside. run_folder_prepare completes or undoes what a killed process left.
bool run_folder_set_aside(const run_folder *folder);
bool run_folder_keep_previous(const run_folder *folder);
void run_folder_restore(const run_folder *folder);

// True if the run in the folder wrote a model or a summary.
bool run_folder_has_results(const run_folder *folder);

// Opens the tables; rows beyond `iteration` (where the run continues) are dropped, and rows of
// structural updates beyond `updated`.
bool run_folder_open_tables(run_folder *folder, int iteration, int structure_iteration);
void run_folder_close_tables(run_folder *folder);
// Adds the row of the structural update that the step tells of.
void run_folder_record_update(run_folder *folder, const sgs_step_info *info);
// Adds the row of train.csv that this step earns; `last` adds the final one.
void run_folder_record(run_folder *folder, const sgs_step_info *info, double seconds, bool last);

// OUT/point_cloud/iteration_N/point_cloud.ply
bool run_folder_save_model(const run_folder *folder, const sgs_gaussians *model, int iteration);

// OUT/checkpoint/state.bin; the one before stays as state.previous.bin. The tables must be open.
bool run_folder_save_checkpoint(run_folder *folder, const sgs_trainer *trainer);
bool run_folder_has_checkpoint(const run_folder *folder);
// Primitives in the newest checkpoint; 0 when there is none or it cannot be read.
size_t run_folder_checkpoint_gaussians(const run_folder *folder);
// Loads the newest readable checkpoint: 1 loaded, 0 there is none, -1 there are some and none is
// readable, or the newest is of other options or another scene (printed).
int run_folder_load_checkpoint(const run_folder *folder, sgs_trainer *trainer);
