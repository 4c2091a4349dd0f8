// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Handling of non-finite values in a training step. The kernel only counts them, with one
// comparison per row. This file finds the rows afterwards.

#include "optimize/optimize.h"

// Counts over the whole run; part of the checkpoint.
typedef struct sgsi_skipped {
    uint64_t steps;     // steps skipped because the loss was not finite
    uint64_t gradients; // rows not updated in a step because their gradient was not finite
    uint64_t reports;   // occasions to warn; only the 1st to 5th, 8th, 16th, 32nd, ... do
} sgsi_skipped;

// Counts a step whose loss is not finite and warns with iteration and view.
void sgsi_skip_step(sgsi_skipped *skipped, int iteration, const char *view, double loss);

// Counts `rows` rows that the optimiser did not update and warns with the first primitive among
// them.
void sgsi_skip_gradients(sgsi_skipped *skipped, int iteration, const char *view, size_t rows,
                         const sgsi_optimize *input);
