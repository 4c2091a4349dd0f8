// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The results that are in the folder of an experiment before it starts: they must be those of the
// same plan, or of a part of it.

#include <stdbool.h>

#include "plan/experiment_plan.h"

// False after printing the error if results.json, results.csv or, with steps after the training,
// post.csv in `folder` are not those of an experiment, or if results.json has a run that the plan
// lacks.
bool earlier_results_admit(const char *folder, const experiment_plan *plan);

// Removes the post.csv of an earlier plan, if that file is one. Cannot fail: what cannot be removed
// stays.
void earlier_results_drop_post(const char *folder);
