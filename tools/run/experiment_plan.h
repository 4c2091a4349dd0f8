// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// PLAN.json of an experiment: scenes x pipelines x variants x seeds, unrolled into trainings.
// Everything in it is checked before anything runs. Functions that return bool have printed their
// error when they return false.

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>

typedef struct experiment_run {
    char *scene, *pipeline, *variant; // names
    int seed;
    char *folder;     // below the experiment's, e.g. runs/plush/3dgs/on/seed_0
    char **arguments; // of `sparegs train`, NULL-terminated; the folder is arguments[3]
    int argument_count;
    json_t *settings; // what it trains: scene, pipeline, seed and the merged options
} experiment_run;

typedef struct experiment_plan {
    json_t *root; // as read
    size_t count;
    experiment_run *runs;
} experiment_plan;

// `folder`: of the experiment; the runs write below it.
bool experiment_plan_read(const char *path, const char *folder, experiment_plan *plan);
void experiment_plan_free(experiment_plan *plan);
