// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The state of `sparegs train`, and its results after the last iteration. Functions that return
// bool print their error before they return false.

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>

#include "options/options.h"
#include "arguments/shared_options.h"
#include "arguments/train_options.h"
#include "blocks/block_plan.h"
#include "run/evaluate.h"
#include "run/rank_clock.h"
#include "run/run_folder.h"
#include "sparegs/metrics.h"
#include "sparegs/trainer.h"
#include "viewer/training_view.h"

typedef struct training {
    common_values common;
    scene_values data;
    train_values values;
    command_line *line;
    const char *scene_path;
    sgs_scene *scene;
    sgs_lpips *lpips; // NULL without --lpips
    sgs_trainer *trainer;
    training_view *view; // NULL without --view
    bool view_lost;      // with several ranks: no memory to collect the model for it
    run_folder folder;
    double started, load_seconds, train_seconds, longest_step;
    double iterating_since; // clock_seconds()
    sgs_stop_reason stop;
    // Valid after the trainer is destroyed.
    int iterations;
    size_t gaussians, most_gaussians;
    size_t memory_estimate; // at the largest number of primitives
    char *stop_text;
    sgs_train_seconds seconds;
    sgs_train_bytes bytes;
    sgs_train_skipped skipped;
    char hash[17];
    block_plan plan;       // of --region PLAN:K
    size_t region_count;   // primitives in --region
    char init_hash[17];    // of the model of --init
    bool init_is_replaced; // by a checkpoint; the model was not read
    char *init_moved;      // owned: its path after --overwrite, or NULL
    json_t *stored;        // the config of the run to resume
    char *checkpoint;      // the file that was loaded, or NULL
    json_t *traffic;       // between ranks, or NULL
    rank_clock clock;      // of the calls between ranks
    int own_iterations;    // of this process
    json_t *per_rank;      // on rank 0, or NULL
    double wall_seconds;   // of this command
    bool checkpoint_lost;  // saving the last one failed and was reported; evaluation continues
    bool trace_lost;       // the same for the file of --trace
    bool checkpoint_is_temporary; // without --checkpoint-every: for a stop during the evaluation
    split_score test, train;
} training;

// True if training stopped early with its state saved.
bool training_stopped_early(const training *run);
// Why training stopped, for people; "" after all iterations.
const char *training_stop_text(const training *run);

// Saves the last model and a checkpoint, and keeps what the results need of the trainer. Without
// --checkpoint-every the checkpoint of a run that did not stop early is temporary.
bool training_save(training *run);

// The model of --init for the trainer; *init stays NULL without --init. If a checkpoint replaces
// it, a placeholder of one primitive, and the recorded hash. Collective.
bool training_init_read(training *run, sgs_gaussians **init);
// With --resume: if --init names the recorded model, it gets the recorded path. A model of OUT is
// the one that --overwrite has moved.
void training_init_recall(training *run);
// False after printing the error if --overwrite would delete the model. Of rank 0.
bool training_init_stays(const training *run);
// Before --overwrite moves a model of OUT: --init becomes the path that it will have, which
// config.json records.
void training_init_follow(training *run);

// How the model is rendered.
drawing_values training_drawing(const training *run);

// Writes summary.json and prints the result. Of rank 0.
bool training_report(training *run);
