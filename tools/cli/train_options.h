// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The options of `sparegs train`, their record in OUT/config.json, and the check that a resumed run
// uses the options that it was started with.

#include "cli/shared_options.h"
#include "sparegs/trainer.h"

typedef struct train_values {
    const char *output, *init, *trace, *lpips;
    int lpips_input;               // sgs_lpips_input
    const char *view, *view_token; // of the viewer, or NULL
    double view_share;             // percent
    int checkpoint_every;
    double time_limit;   // seconds, negative = none
    uint64_t max_memory; // bytes, 0 = no limit
    integer_list save_at;
    bool resume, overwrite;
    const char *region;        // of --region, or NULL
    char *region_plan;         // owned: the plan file, or NULL where --region is a box
    int region_block;          // its block
    sgs_train_options options; // of the library; init stays NULL
} train_values;

// Four groups that fill one struct: output, and the headings of the library's table
// (sparegs/option_descriptors.h).
enum { TRAIN_GROUP_COUNT = 4 };
void train_groups(train_values *values, option_group groups[TRAIN_GROUP_COUNT]);

// Sets what depends on other options: call once after parsing.
void train_resolve(train_values *values, const command_line *line, uint64_t seed);

// Resolves --region into options.region or region_plan. Returns -1 to continue, or an exit status.
int train_region_resolve(train_values *values);

// Checks that config.json can record the text options of the scene: later commands read them there,
// and would use other photographs, masks or another split without a message. Returns -1 to
// continue, or an exit status.
int train_scene_check(const scene_values *scene);

// Checks the combination of the parsed options. Returns -1 to continue, or an exit status.
int train_values_check(const train_values *values, const command_line *line);

// Warns about given options of SPARE-GS that others disable.
void train_warn_idle(const train_values *values, const command_line *line);

// OUT/config.json: versions, machine settings and under "options" every option as used.
json_t *train_config(const char *scene_path, const train_values *values, const scene_values *scene,
                     const common_values *common);

// True if a run with the config `stored` can be resumed with the config `now`: the options that
// affect the result are equal or may change. Otherwise prints the option that differs. options:
// those of `now`.
bool train_config_agrees(const char *config_path, const json_t *stored, const json_t *now,
                         const sgs_train_options *options);
// Copies the "resumed" list of `stored` to `now` and appends an entry for this continuation: its
// iteration, and the former values of the options that changed. Warns about iterations of
// --save-at that the run in `folder` has passed without a model.
void train_config_record(const char *folder, const json_t *stored, json_t *now, int iteration);
