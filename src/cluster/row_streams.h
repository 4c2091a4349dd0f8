// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Gathers arrays whose rows several ranks own in groups (base/row_groups.h), and distributes them
// again. An array is given by its whole size and the size of a group (> 0), both in bytes; the last
// group may be incomplete. `own`: the groups of this rank, one after the other. All functions but
// sgsi_row_array_bytes are collective and fail with OUT_OF_MEMORY or as another rank does.

#include "base/row_groups.h"
#include "cluster/rank_calls.h"
#include "sparegs/gaussians.h"

typedef struct sgsi_row_array {
    void *own;
    size_t group, total; // bytes: of a group, of the whole array
} sgsi_row_array;

enum { SGSI_BLOCK_BYTES = SGS_PARAM_COUNT * SGS_LANES * sizeof(float) };

// The parameters, or what has their layout, of `count` primitives of all ranks.
static inline sgsi_row_array sgsi_block_array(float *own, size_t count)
{
    return (sgsi_row_array){own, (size_t)SGSI_SHARD_ROWS / SGS_LANES * SGSI_BLOCK_BYTES,
                            (count + SGS_LANES - 1) / SGS_LANES * SGSI_BLOCK_BYTES};
}

// Bytes of `own`.
size_t sgsi_row_array_bytes(const sgsi_row_array *array, int rank, int ranks);

// Fills whole [total] on all ranks.
sgs_status sgsi_rows_gather(sgs_ranks *ranks, sgs_status own, sgs_ranks_purpose purpose,
                            const sgsi_row_array *array, void *whole);

// Passes the array to take() on rank 0, in order and in parts; other ranks only send. take() has no
// status: it records its failures in `context`, so that the other ranks can finish sending.
sgs_status sgsi_rows_collect(sgs_ranks *ranks, sgs_status own, const sgsi_row_array *array,
                             void (*take)(void *context, void *bytes, size_t size), void *context);

// The reverse: rank 0 receives the array from give(), and each rank the groups that it owns.
sgs_status sgsi_rows_distribute(sgs_ranks *ranks, sgs_status own, const sgsi_row_array *array,
                                void (*give)(void *context, void *bytes, size_t size),
                                void *context);
