// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Primitives and gradients of one view on several ranks, each of which owns some rows of the model
// (base/row_groups.h): owners send the projected records to the ranks whose cells they may overlap,
// and receive the gradient sums of these cells. All functions are collective.

#include "train/train_view.h"

// The tracer of the own rows, views->rows, and the lists. Fails with OUT_OF_MEMORY or UNSUPPORTED
// (Embree); free also after a failure. Not collective.
sgs_status sgsi_view_shards_create(sgsi_train_views *views);
void sgsi_view_shards_free(sgsi_train_views *views);

// After the projection by views->rows and the cut: the records that may overlap the cells of this
// rank become the primitives of views->tracer, with a new BVH. cut [ranks + 1] as in cluster/cut.h.
sgs_status sgsi_view_shards_send(sgsi_train_views *views, const sgsi_train_view *view,
                                 const size_t *cut);
// For scores: the projected means, own [rows][2], of those primitives. *centers is valid until the
// next call.
sgs_status sgsi_view_shards_centers(sgsi_train_views *views, const float *own,
                                    const float **centers);
// After the backward pass or a score: the sums of the own rows in views->rows.
sgs_status sgsi_view_shards_return(sgsi_train_views *views, const sgsi_train_view *view);
