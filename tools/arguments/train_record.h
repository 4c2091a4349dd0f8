// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The record of `sparegs train` in OUT/config.json: written at the start, read by --resume.

#include <jansson.h>

#include "arguments/train_options.h"

// OUT/config.json: versions, machine settings and under "options" every option as used.
json_t *train_config(const char *scene_path, const train_values *values, const scene_values *scene,
                     const common_values *common);

// Options that are not on the command line take the values that the run to resume recorded. Texts
// stay owned by `stored`, or by `values`. False after printing the error: a value is invalid.
bool train_config_recall(const command_line *line, const char *config_path, const json_t *stored,
                         train_values *values, scene_values *scene);

// True if a run with the config `stored` can be resumed with the config `now`: the options that
// affect the result are equal or may change. Otherwise prints the option that differs. options:
// those of `now`.
bool train_config_agrees(const char *config_path, const json_t *stored, const json_t *now,
                         const sgs_train_options *options);
// Copies the "resumed" list of `stored` to `now` and appends an entry for this continuation: its
// iteration, and the former values of the options that changed. Warns about iterations of
// --save-at that the run in `folder` has passed without a model.
void train_config_record(const char *folder, const json_t *stored, json_t *now, int iteration);
