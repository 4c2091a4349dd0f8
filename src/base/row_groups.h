// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Which rank owns which rows of a model that several processes share: groups of rows, assigned
// round-robin. A single process is rank 0 of 1.

#include <stddef.h>

// Rows of a group: whole blocks of 16; few, so that small models are divided.
enum { SGSI_SHARD_ROWS = 256 };

static inline int sgsi_shard_owner(size_t row, int ranks)
{
    return (int)(row / SGSI_SHARD_ROWS % (size_t)ranks);
}

// The place of a row among those of its owner. Places ascend with rows, and only the last group of
// the model may be incomplete: the rows of a rank are its places [0, sgsi_shard_count).
static inline size_t sgsi_shard_place(size_t row, int ranks)
{
    return row / SGSI_SHARD_ROWS / (size_t)ranks * SGSI_SHARD_ROWS + row % SGSI_SHARD_ROWS;
}

// The row at a place of a rank.
static inline size_t sgsi_shard_row(size_t place, int rank, int ranks)
{
    return (place / SGSI_SHARD_ROWS * (size_t)ranks + (size_t)rank) * SGSI_SHARD_ROWS +
           place % SGSI_SHARD_ROWS;
}

// Number of the rows [0, rows) that a rank owns.
static inline size_t sgsi_shard_count(size_t rows, int rank, int ranks)
{
    const size_t group = SGSI_SHARD_ROWS, turn = group * (size_t)ranks,
                 first = (size_t)rank * group, rest = rows % turn;
    const size_t last = rest < first ? 0 : rest - first < group ? rest - first : group;
    return rows / turn * group + last;
}
