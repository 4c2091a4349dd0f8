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

// Rows that the optimiser did not update, and the first of them, if it is known.
typedef struct sgsi_rejected {
    uint64_t rows, first; // first: UINT64_MAX = unknown
    float mean[3];
} sgsi_rejected;

// True if the next report would warn.
bool sgsi_skip_is_due(const sgsi_skipped *skipped);
// Finds the first row that the kernel rejects in the input of the last step.
void sgsi_find_rejected(const sgsi_optimize *input, sgsi_rejected *rejected);
// Counts the rows and warns.
void sgsi_skip_gradients(sgsi_skipped *skipped, int iteration, const char *view,
                         const sgsi_rejected *rejected);
