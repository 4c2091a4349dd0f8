// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What several ranks would send each other in an iteration, from the lists of one process. Uses the
// cut, the routes and the owners of a real run: bytes and messages are those that it counts
// (sgs_ranks_traffic_get), in an iteration without structural update or scores from views.

#include "sparegs/ranks.h"
#include "trace/tracer.h"

// One iteration of one process.
typedef struct sgsi_rank_input {
    const sgsi_tracer *tracer; // after its backward pass
    const sgsi_view *view;
    size_t rows;                 // of the model
    const float *cell_costs;     // [cells] of the last visit of this view; NULL: cut by pixels
    const sgsi_tile_cost *tiles; // [tiles] of this forward pass (sgsi_tracer_watch_tiles)
    bool exposure;
} sgsi_rank_input;

// One rank.
typedef struct sgsi_rank_traffic {
    sgs_ranks_traffic sent[SGS_RANKS_PURPOSE_COUNT];
    uint64_t received[SGS_RANKS_PURPOSE_COUNT]; // bytes
    size_t primitives;                          // whose records it has, its own included
    size_t traced, hit;                         // of its own rows: in view, with a block hit
    double cost;                                // of its cells
} sgsi_rank_traffic;

// Fills traffic [ranks], for 2 or more. Fails with OUT_OF_MEMORY.
sgs_status sgsi_rank_traffic_predict(const sgsi_rank_input *input, int ranks,
                                     sgsi_rank_traffic *traffic);
