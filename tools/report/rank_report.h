// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Predictions of `sparegs bench --ranks` as text and JSON: what ranks send in an iteration, and the
// speed-up over one machine for several networks.

#include <jansson.h>

#include "sparegs/bench.h"

// One machine, in seconds of an iteration.
typedef struct rank_machine {
    double iteration, serial, refit; // serial and refit: parts of it
    double build;                    // of a BVH over all primitives, built as a rank builds its own
    double primitives;
} rank_machine;

// Measured: this machine. Large: 64 cores with 320 GB/s, predicted from it.
typedef struct rank_machines {
    rank_machine measured, large;
    int threads;
} rank_machines;

void rank_report_print(const sgs_rank_prediction *predictions, size_t count,
                       const rank_machines *machines);
json_t *rank_report_json(const sgs_rank_prediction *predictions, size_t count,
                         const rank_machines *machines);
