// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What must be equal on all ranks before they train one model.

#include "train/train_view.h"

// Refuses, on all ranks, a rank that differs from rank 0 in version, options, initial model, views
// and photos (training and held-out), median depth of the points, class of instruction sets or the
// values of the C library's functions; the message names the rank, its node and the difference.
// Collective.
sgs_status sgsi_rank_handshake(const sgsi_train_views *views, const sgs_gaussians *model,
                               double near_limit, sgs_ranks *ranks);
