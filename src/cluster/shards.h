// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The division of a model's rows among ranks, and the lists of what they send each other in a view.
// A rank owns every ranks-th group of 256 rows: their parameters, moments and statistics. It
// projects its rows and sends each record to the ranks whose cells the primitive may overlap
// (sgsi_router); these return the sums of its gradient per cell. Pure functions on arrays of the
// caller, without communication.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/image_cells.h"
#include "base/row_groups.h"
#include "sparegs/status.h"

// ---- Messages ----

enum {
    SGSI_SHARD_RECORD = 88, // bytes of a projected record: 15 floats, a box of 6, the row
    SGSI_SHARD_CENTER = 8,  // bytes of a projected mean, for scores from views
    SGSI_SHARD_SUM = 68     // bytes of the gradient of a primitive in a cell: 16 sums, the row
};

// Bytes of a message of `count` items of `item` bytes, padded to the unit of a transport.
// sgsi_shard_items returns the count again; it requires items of at least 64 bytes, so that the
// padding is shorter than an item.
size_t sgsi_shard_bytes(size_t count, size_t item);
size_t sgsi_shard_items(size_t bytes, size_t item);

typedef struct sgsi_router sgsi_router;

// Fails with OUT_OF_MEMORY. Destroy accepts NULL.
sgs_status sgsi_router_create(int ranks, sgsi_router **router);
void sgsi_router_destroy(sgsi_router *router);

// Sets the view: cones [cells] of the cells along the curve, in the axes of the spheres below, and
// the cut: rank r has the cells [cut[r], cut[r + 1]). Fails with OUT_OF_MEMORY.
sgs_status sgsi_router_set(sgsi_router *router, const sgsi_cone *cones, size_t cells,
                           const size_t *cut);

// Words of a set of ranks: bit r % 64 of word r / 64.
size_t sgsi_router_words(const sgsi_router *router);

// The set of ranks with a cell whose cone a sphere may touch; `center` is relative to the camera.
// Conservative: the sphere is enlarged by 1e-4 of its distance. *guess: 0, or what the last call
// for a sphere nearby has set; the result does not depend on it. Thread-safe. Cannot fail.
void sgsi_router_find(const sgsi_router *router, const float center[3], float radius,
                      uint32_t *guess, uint64_t *ranks);

// The places of this rank's rows that each rank receives.
typedef struct sgsi_send_lists {
    uint32_t *places; // rank after rank, ascending in each
    size_t *begin;    // [ranks + 1]: where the list of a rank begins
    size_t *chunks;   // workspace
    size_t capacity, chunk_capacity;
    int ranks;
} sgsi_send_lists;

// The lists for rows with the sets of ranks found [rows][words]. Grows a zeroed or used struct.
// Fails with OUT_OF_MEMORY.
sgs_status sgsi_send_lists_make(sgsi_send_lists *lists, const uint64_t *found, size_t rows,
                                int ranks);
void sgsi_send_lists_free(sgsi_send_lists *lists);
