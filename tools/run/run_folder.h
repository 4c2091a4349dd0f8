// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// OUT, the folder of a training run: models, tables and checkpoints. Functions that return bool
// print their error before they return false.

#include <jansson.h>
#include <stdbool.h>
#include <stdio.h>

#include "sparegs/model_file.h"
#include "sparegs/trainer.h"

typedef struct run_folder {
    const char *path;
    FILE *train_csv, *spare_csv, *sums_csv;
    size_t densified, pruned, spare_pruned; // counts since the last row of train.csv
    int lock, shared_lock;                  // descriptors that lock the folder
    bool was_locked; // before: sparegs wrote into the folder, which may have no config.json yet
    double checkpoint_seconds; // longest time to save a checkpoint
    double checkpoint_total;   // total time to save checkpoints
    double checkpoint_rate;    // most seconds per byte of a checkpoint
    double checkpoint_at;      // clock_seconds() after the last one; 0: none yet
    int checkpoint_intervals;  // between periodic checkpoints since then; counted by the caller
    json_t *config;            // owned; what run_folder_mark has written, or NULL
    const sgs_scene *scene;    // borrowed; the same
    bool was_lost;             // the folder was moved or removed, and there was a warning
} run_folder;

// Creates the folder, locks it until the process ends and checks that it is writable.
bool run_folder_prepare(run_folder *folder, const char *path);

// Removes the temporary files that a killed process left in the folder, which is locked:
// NAME.tmp.PID of the files of a run, and no other file. Ignores errors.
void run_folder_clean(const run_folder *folder);

// Removes the lock and, if it is then empty, the folder, unless the folder has output of a run.
void run_folder_leave(const run_folder *folder);

// True if the folder contains the config.json of an earlier run.
bool run_folder_is_used(const run_folder *folder);

// False after printing the error if a new run would replace models or other files of another
// program, or an earlier run without `overwrite`; then the message ends with the advice.
bool run_folder_admits(const run_folder *folder, bool overwrite, const char *advice);

// Makes room for a new run, in two steps. set_aside moves all files of the earlier run to
// OUT/previous.next; keep_previous renames that to OUT/previous and removes an older one. A run
// without results or checkpoint does not replace an older one. restore undoes set_aside.
// run_folder_prepare completes or undoes a move that a killed process left.
bool run_folder_set_aside(const run_folder *folder);
bool run_folder_keep_previous(const run_folder *folder);
void run_folder_restore(const run_folder *folder);

// True if the run in the folder wrote a model or a summary of at least one iteration.
bool run_folder_has_results(const run_folder *folder);

// True if the run in the folder has results or a checkpoint: keep_previous then removes an older
// OUT/previous.
bool run_folder_replaces_previous(const run_folder *folder);

// Opens the tables. Drops rows after `iteration`, where the run resumes, and rows of structural
// updates after `structure_iteration`.
bool run_folder_open_tables(run_folder *folder, int iteration, int structure_iteration);
void run_folder_close_tables(run_folder *folder);
// Writes cameras.json, input.ply unless the trainer started from a model (run_folder_share_cloud),
// and then config.json, which marks OUT as a run. From then on, the functions that save write these
// files again, and new tables, if OUT was moved or removed: otherwise the new OUT would be no run.
// The scene is borrowed until run_folder_unmark.
bool run_folder_mark(run_folder *folder, const sgs_scene *scene, const sgs_trainer *trainer,
                     json_t *config);
// Releases the config; at the end of the run.
void run_folder_unmark(run_folder *folder);
// Appends the row of the structural update of this step.
void run_folder_record_update(run_folder *folder, const sgs_step_info *info);
// Appends a row to train.csv when one is due; always if `last`.
void run_folder_record(run_folder *folder, const sgs_step_info *info, double seconds, bool last);

// Removes summary.json, which a resumed run no longer agrees with once it has trained further.
void run_folder_drop_summary(const run_folder *folder);

// OUT/point_cloud/iteration_N/point_cloud.ply, with the marks of the options.
bool run_folder_save_model(const run_folder *folder, const sgs_gaussians *model, int iteration,
                           const sgs_model_write_options *options);

// On all ranks; only rank 0 writes: input.ply of a trainer that started from a model and has made
// no step.
bool run_folder_share_cloud(const run_folder *folder, sgs_trainer *trainer);
// These two on all ranks; only rank 0 writes. The first saves the model of a trainer in parts;
// Mip-Splatting's 3D filter is fused into it and also saved separately; the colour maps of
// --exposure are those of the saved model. The second writes OUT/checkpoint/state.bin and keeps the
// previous one as state.previous.bin; the tables must be open.
bool run_folder_share_trained(run_folder *folder, const sgs_scene *scene, sgs_trainer *trainer,
                              int iteration);
bool run_folder_share_checkpoint(run_folder *folder, sgs_trainer *trainer);
bool run_folder_has_checkpoint(const run_folder *folder);
// Removes the files of run_folder_share_checkpoint. Cannot fail: what cannot be removed stays.
void run_folder_remove_checkpoint(const run_folder *folder);
// Iteration of the last checkpoint of the run in a folder, even if saving it failed; 0 without one.
// The file may have been removed since.
int run_folder_saved_iteration(const char *path);
// Primitives in the newest checkpoint; 0 when there is none or it cannot be read.
size_t run_folder_checkpoint_gaussians(const run_folder *folder);
// Loads the latest readable checkpoint; with several ranks it only checks it. Returns 1 if loaded,
// 0 if there is none, -1 after printing the error if none is readable or the latest belongs to
// other options or another scene. *loaded receives the path of the file, to be freed, or NULL.
int run_folder_load_checkpoint(const run_folder *folder, sgs_trainer *trainer, char **loaded);
// Then several ranks load it, given what rank 0 has found. False after printing the error.
bool run_folder_load_shared(sgs_trainer *trainer, const char *path, int found);
