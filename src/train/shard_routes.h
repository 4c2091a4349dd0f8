// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Which ranks receive the projected records of a view. A function of the records, the rays and the
// cut of the cells, without communication.

#include "cluster/shards.h"
#include "trace/tracer.h"

typedef struct sgsi_shard_routes {
    int ranks;
    sgsi_router *router;
    sgsi_cone *cones;      // [cone_capacity]: of the cells, world axes
    uint64_t *found;       // [found_capacity]: sets of ranks
    sgsi_send_lists lists; // the result
    size_t cone_capacity, found_capacity;
} sgsi_shard_routes;

// Fails with OUT_OF_MEMORY; free also after a failure.
sgs_status sgsi_shard_routes_create(int ranks, sgsi_shard_routes *routes);
void sgsi_shard_routes_free(sgsi_shard_routes *routes); // accepts a zeroed one

// Lists, for each rank, the rows of [0, rows) that may overlap its cells: routes->lists. projected
// and bounds are those of sgsi_tracer_project for `view`; cut [ranks + 1] as in cluster/cut.h. A
// superset: a row in no list of a rank has no hit in its cells. Fails with OUT_OF_MEMORY.
sgs_status sgsi_shard_routes_find(sgsi_shard_routes *routes, const sgsi_view *view,
                                  const float *projected, const sgsi_bounds *bounds, size_t rows,
                                  const size_t *cut);
