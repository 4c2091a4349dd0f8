// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// RUN/experiment.json: the settings with which an experiment started a run, and the sessions that
// trained it, each {"threads", "isa", "commit"}. The model does not depend on the number of
// threads; times do.

#include <jansson.h>
#include <stdbool.h>

#include "plan/experiment_plan.h"

// {"threads", "isa", "commit"} of a command that is started now with these options; NULL = not
// given.
json_t *session_of(const char *threads, const char *isa);

// A file of the run's folder, or NULL.
json_t *run_settings_load(const experiment_run *run, const char *name);

// False after printing the error if the run was started with other settings, or with an instruction
// set that computes other bits. True for a run that was not started.
bool run_settings_agree(const experiment_run *run);

// What finishing a session requires of its start.
typedef struct session_start {
    json_t *sessions; // recorded before it
    size_t resumes;   // of the training before it
    bool continues;
} session_start;

// Records the settings and the session before the run starts, or continues from a checkpoint: the
// training may outlive the experiment. False after printing the error.
bool run_settings_start(const experiment_run *run, bool continues, session_start *start);
// After run_settings_start: removes the session again unless the training has saved iterations in
// it; `saved`: the iteration of the last checkpoint, even if saving it failed. False after printing
// the error.
bool run_settings_finish(const experiment_run *run, session_start *start, int saved);

// The sessions in which the run was trained if there are several different ones, or if that of its
// summary is another: it may have evaluated only. Else NULL. Release with json_decref().
json_t *run_settings_sessions(const experiment_run *run, const json_t *summary);

// "threads 1, the remaining runs use 2": the first member of a session that differs between the
// training of this run and a session now. NULL if none does, or the run was not started. Release
// with free().
char *run_settings_change(const experiment_run *run);
