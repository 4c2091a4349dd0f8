// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What happens to numbers that are not finite in a training step. The hot path only counts them
// (the kernel compares one sum per row); finding out whose they are is left to here, after the
// fact.

#include "optimize/optimize.h"

// Counted over the whole run; part of the checkpoint.
typedef struct sgsi_skipped {
    uint64_t steps;     // whole steps, because the loss was not finite
    uint64_t gradients; // rows left alone in a step, because their gradient was not finite
    uint64_t reports;   // warnings that were due; the 1st to 5th, 8th, 16th, 32nd, ... are given
} sgsi_skipped;

// Counts a step whose loss is not finite and warns, naming iteration and view.
void sgsi_skip_step(sgsi_skipped *skipped, int iteration, const char *view, double loss);

// Counts `rows` rows that the optimiser left alone and warns, naming the first primitive among
// them.
void sgsi_skip_gradients(sgsi_skipped *skipped, int iteration, const char *view, size_t rows,
                         const sgsi_optimize *input);
