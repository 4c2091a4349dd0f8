// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Records of a run about its data set: the names of the held-out images in config.json, and the
// cameras in cameras.json. Later commands compare the scene with them.

#include <jansson.h>
#include <stdbool.h>

#include "run/run_folder.h"
#include "sparegs/scene.h"
#include "sparegs/trainer.h"

// Adds the names of the held-out views to a config as "test_images". Names that are not UTF-8
// cannot be recorded; the list is then omitted, and the options define the split.
void run_record_split(json_t *config, const sgs_scene *scene);

// Adds the settings that follow from the options and the photos as "milestones".
void run_record_milestones(json_t *config, const sgs_trainer *trainer, const sgs_scene *scene);

// True if the scene still has every held-out image of the config, or the config has no list.
// False after printing the error.
bool run_record_split_agrees(const char *config_path, const json_t *config, const sgs_scene *scene);

// Warns if the scene is not the one that the run was trained on: most of its views have another
// camera in OUT/cameras.json, or none.
void run_record_check_scene(const char *folder, const sgs_scene *scene);

// Number of views of the split that the run in `folder` was trained on: those in its cameras.json
// that its config does not name as held out. -1 if the run recorded neither list.
ptrdiff_t run_record_trained(const char *folder, const json_t *config, const sgs_scene *scene,
                             sgs_split split);

// True if a run continues with the initial model that it started from, or a checkpoint has replaced
// the model; otherwise prints the error.
bool run_record_init_agrees(const char *config_path, const json_t *stored, const json_t *now,
                            bool replaced);

// The reason in summary.json. Cannot fail.
const char *run_record_stop_reason(sgs_stop_reason stop);

// True if summary.json is that of a whole run: all iterations, or an equilibrium. `summary` may be
// NULL.
bool run_record_is_complete(const json_t *summary);

// The member "seconds" of summary.json: phases of the training, loading and checkpoints; "project"
// is a part of "forward".
json_t *run_record_seconds(const sgs_train_seconds *seconds, double load, double checkpoint);

// Claims OUT for a new run or to continue one, whose config.json *stored receives. False after
// printing the error.
bool run_record_claim(run_folder *folder, const char *out, bool resume, bool overwrite,
                      json_t **stored);
