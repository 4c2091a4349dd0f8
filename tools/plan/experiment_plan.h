// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// PLAN.json of an experiment: scenes x pipelines x variants x seeds, expanded into runs. The whole
// plan is validated before the first run. Functions that return bool print their error before they
// return false.

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>

#include "plan/experiment_post.h"

typedef struct experiment_run {
    char *scene, *pipeline, *variant; // names
    int seed;
    char *folder;     // below the experiment's, e.g. runs/plush/3dgs/on/seed_0
    char **arguments; // of `sparegs train`, NULL-terminated; the folder is arguments[3]
    int argument_count;
    json_t *settings; // scene, pipeline, seed and merged options, as experiment.json stores them
    json_t *idle;     // names of options of the plan or scene that have no effect on this run
} experiment_run;

typedef struct experiment_plan {
    json_t *root; // the parsed file
    size_t count;
    experiment_run *runs;
    post_plan post; // steps after each training
} experiment_plan;

// A copy of options with '_' in their names, which the plan may spell with '-'.
json_t *experiment_plan_options(const json_t *options);

// The value of option --name of a run, or NULL.
const char *experiment_run_argument(const experiment_run *run, const char *name);
// Adds --name, with its value unless that is NULL. No effect if the plan sets it.
void experiment_run_add(experiment_run *run, const char *name, const char *value);
// Removes the options without effect on the run from `options`, which is changed.
void experiment_run_drop_idle(const experiment_run *run, json_t *options);

// `folder` is the output folder of the experiment.
bool experiment_plan_read(const char *path, const char *folder, experiment_plan *plan);
void experiment_plan_free(experiment_plan *plan);
