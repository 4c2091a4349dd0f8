// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The image of one view on several ranks (cluster/rank_calls.h). Every rank traces and
// differentiates its own cells; pixels around the cells of others and sums per cell are exchanged
// between the stages of train_view.h. Primitives and gradients: view_shards.h.

#include "train/train_view.h"

enum { SGSI_TILE_BYTES = 4 * SGSI_TILE * SGSI_TILE * sizeof(float) }; // of a tile in a message

// Work of a cell in arbitrary units, the same on every machine, from the costs of the tiles.
double sgsi_cell_cost(const sgsi_cells *cells, const sgsi_tile_cost *tiles, size_t cell);

// Memory for the cuts of all views; call after the views are created. With fewer than two ranks it
// only sets views->ranks. Fails with OUT_OF_MEMORY or UNSUPPORTED (Embree); the views can then only
// be freed.
sgs_status sgsi_view_ranks_create(sgsi_train_views *views, sgs_ranks *ranks);
void sgsi_view_ranks_free(sgsi_train_views *views);

// The functions below are collective, except the first three.

// Divides the cells of the view by the costs of its last visit.
void sgsi_view_ranks_cut(sgsi_train_views *views, const sgsi_train_view *view);
// The cells of this rank in the present view.
sgsi_tracer_piece sgsi_view_ranks_piece(const sgsi_train_views *views);
const size_t *sgsi_view_ranks_begin(const sgsi_train_views *views); // [ranks + 1]: cells
// After the forward pass: the pixels of other ranks that this one needs (view->need).
sgs_status sgsi_view_ranks_image(sgsi_train_views *views, const sgsi_train_view *view);
// After loss and exposure (NULL without): their sums per cell, depth bounds and costs of all cells.
sgs_status sgsi_view_ranks_sums(sgsi_train_views *views, const sgsi_train_view *view,
                                sgsi_loss_sums *loss, double (*exposure)[SGSI_EXPOSURE]);
