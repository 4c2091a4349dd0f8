// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Training of the primitives whose centres lie in a box, while the others stay unchanged. The rows
// in the box come first, so that code for a whole model works on the first rows. Centres never
// leave the box, so that this order holds between structural updates.

#include "sparegs/gaussians.h"
#include "sparegs/region.h"

// True if the centre of row i is in the box.
bool sgsi_region_has(const sgs_gaussians *model, size_t i, const sgs_box *box);

// Moves the rows whose centre is in the box before the others; both groups keep their order. *own:
// their number. Fails with OUT_OF_MEMORY; the model is then unchanged.
sgs_status sgsi_region_order(sgs_gaussians *model, const sgs_box *box, size_t *own);

// Moves centres of rows [0, own) that are outside of the box to its nearest point. Cannot fail.
void sgsi_region_clamp(sgs_gaussians *model, size_t own, const sgs_box *box);
