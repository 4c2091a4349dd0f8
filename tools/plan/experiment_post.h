// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The steps of an experiment after a training run: pruning or compression of the trained model at
// several operating points, and the quality of the result. Functions that return bool print their
// error before they return false.
//
//   "post": [{"prune": {"method": "refine"}},
//            {"prune": {"method": "pup", "ratio": [0.5, 0.8], "finetune": 500}, "name": "pup-500"},
//            {"compress": {"method": "sog"}, "variants": ["on"]}]
//
// Options are those of `sparegs prune` and `compress`. A list in "ratio" or "preset" gives the
// points; default: 0.3, 0.5 and 0.7, or the three presets. "variants" default to off and on; the
// name of a step to its kind and method. Paths are relative to the plan's folder.

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>

typedef struct post_point {
    char *step, *kind, *method, *point; // "prune-refine", "prune", "refine", "0.3"
    json_t *settings;                   // kind and options of the point
    const json_t *variants;             // borrowed from the plan; NULL: off and on
} post_point;

typedef struct post_plan {
    size_t count;
    post_point *points;
} post_plan;

// `root` is the parsed plan and must outlive *post. Checks names, options and values.
bool post_plan_read(const char *plan_path, const json_t *root, post_plan *post);
void post_plan_free(post_plan *post);

// True if the point is for runs of this variant.
bool post_applies(const post_point *point, const char *variant);

// A run that has completed its training.
typedef struct post_run {
    const char *folder, *scene_path, *model_hash;
    // Options of the run that apply to the commands, or NULL.
    const char *threads, *isa, *lpips, *lpips_input;
} post_run;

// The recorded result of a point for this run, or NULL: {"step", "kind", "method", "point",
// "settings", "model_hash", "gaussians", "bytes", "seconds", "decode_seconds", "test", "threads",
// "isa", "commit"}, with --lpips also {"lpips_input"}.
json_t *post_result(const post_point *point, const post_run *run);

// Prunes or compresses, evaluates, and records the result in RUN/post/STEP/POINT.json. The models
// are removed afterwards, compressed files stay. Returns a status as sub_command_run does.
int post_execute(const post_point *point, const post_run *run);
