// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The options of `sparegs train`.

#include <limits.h>

#include "arguments/shared_options.h"
#include "sparegs/trainer.h"

enum { EVALUATE_ALL = INT_MAX };

typedef struct train_values {
    const char *output, *init, *trace, *lpips;
    int lpips_input;               // sgs_lpips_input
    int eval_train;                // images, EVALUATE_ALL = all
    const char *view, *view_token; // of the viewer, or NULL
    double view_share;             // percent
    int checkpoint_every;
    double time_limit;   // seconds, negative = none
    uint64_t max_memory; // bytes, 0 = no limit
    integer_list save_at;
    bool resume, overwrite;
    const char *region;        // of --region, or NULL
    char *region_text;         // owned: --region as recorded, or NULL
    char *region_plan;         // owned: the plan file, or NULL where --region is a box
    int region_block;          // its block
    sgs_train_options options; // of the library; init stays NULL
} train_values;

// Four groups that fill one struct: output, and the headings of the library's table
// (sparegs/option_descriptors.h).
enum { TRAIN_GROUP_COUNT = 4 };
void train_groups(train_values *values, option_group groups[TRAIN_GROUP_COUNT]);

// Sets what depends on other options: call once all values are known.
void train_resolve(train_values *values, const command_line *line, uint64_t seed);

// Resolves --region into options.region or region_plan. Returns -1 to continue, or an exit status.
int train_region_resolve(train_values *values);

// Checks that config.json can record the text options of the scene: later commands read them there,
// and would use other photos, masks or another split without a message. Returns -1 to
// continue, or an exit status.
int train_scene_check(const scene_values *scene);

// Checks -o, --resume and --overwrite. Returns -1 to continue, or an exit status.
int train_output_check(const train_values *values, const command_line *line);

// Checks the combination of the options. Returns -1 to continue, or an exit status.
int train_values_check(const train_values *values, const command_line *line);

// Warns about given options of SPARE-GS that others disable.
void train_warn_idle(const train_values *values, const command_line *line);
