// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// sgs_finetune with the values of the command line and its progress. Writes no files.

#include "arguments/shared_options.h"
#include "sparegs/trainer.h"

// Replaces *model by the result of `iterations` steps on the training views of `scene`, whose
// images must be loaded. Shows progress. False after printing the error, or with
// interrupt_signal() set; *model is then unchanged.
bool finetune_model(sgs_gaussians **model, const sgs_scene *scene, const drawing_values *drawing,
                    int iterations, uint64_t seed);
