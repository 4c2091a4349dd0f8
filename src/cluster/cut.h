// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The division of an image's cells among ranks: rank r has the cells [begin[r], begin[r + 1]) along
// the curve. The model does not depend on it.

#include "base/image_cells.h"

// cost [cells->count], or NULL to cut by pixels; begin [ranks + 1]. Pieces of nearly equal cost; a
// piece may be empty if there are few cells. Cannot fail.
void sgsi_cut_by_cost(const sgsi_cells *cells, const float *cost, int ranks, size_t *begin);

// The rank of each tile: owner [cells->tiles].
void sgsi_cut_owners(const sgsi_cells *cells, const size_t *begin, int ranks, uint16_t *owner);
// True if `rank` computes the loss of a pixel within ten pixels of the tile: it owns the tile or a
// neighbour.
bool sgsi_cut_reads_tile(const sgsi_cells *cells, const uint16_t *owner, size_t tile, int rank);

// Pieces of random sizes, also empty ones, for tests.
void sgsi_cut_randomly(const sgsi_cells *cells, uint64_t seed, int ranks, size_t *begin);
