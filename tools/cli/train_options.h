// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The options of `sparegs train`, their record in OUT/config.json, and the check that a resumed run
// uses the options that it was started with.

#include "cli/shared_options.h"
#include "sparegs/trainer.h"

typedef struct train_values {
    const char *output, *init, *trace;
    int iterations, schedule, pipeline, filter, optimizer, sh_degree;
    unsigned spare, spare_demand;
    int spare_phi, spare_target, taming_opacity;
    double compact_box, spare_budget, taming_multiplier, fastgs_loss, fastgs_gradient, fastgs_dense;
    uint64_t taming_count, dash_count;
    int spare_grid, spare_patience, spare_interval, checkpoint_every;
    double time_limit; // seconds, 0 = none
    double alpha_loss, spare_tau_alpha, spare_eps_loss, spare_eps_count;
    uint64_t max_gaussians, random_points, max_memory; // max_memory in bytes, 0 = no limit
    color_value background;
    integer_list save_at;
    bool resume, exposure;
} train_values;

// Four groups that fill one struct: output, training, base pipelines, SPARE-GS.
enum { TRAIN_GROUP_COUNT = 4 };
void train_groups(train_values *values, option_group groups[TRAIN_GROUP_COUNT]);

// Sets the defaults that depend on other options. Call once after parsing.
void train_resolve(train_values *values);

// The corresponding library options. init is NULL.
sgs_train_options train_library_options(const train_values *values, uint64_t seed);

// OUT/config.json: versions, machine settings and under "options" every option as used.
json_t *train_config(const char *scene_path, const train_values *values, const scene_values *scene,
                     const common_values *common);

// True if a run with the config `stored` can be resumed with the config `now`: the options that
// affect the result are equal or may change. Otherwise prints the option that differs.
bool train_config_agrees(const char *config_path, const json_t *stored, const json_t *now);
// Copies the "resumed" list of `stored` to `now` and appends an entry for this continuation: its
// iteration, and the former values of the options that changed.
void train_config_record(const json_t *stored, json_t *now, int iteration);
