// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The plan of a structural update: which old row each row of the new model comes from. Applied to
// parameters and moments, also by several processes, each of which has some of the rows.

#include "density/density.h"

typedef enum sgsi_plan_kind {
    SGSI_PLAN_KEEP,
    SGSI_PLAN_CLONE,
    SGSI_PLAN_CHILD_0,
    SGSI_PLAN_CHILD_1,
    SGSI_PLAN_FIXED
} sgsi_plan_kind;

typedef struct sgsi_plan_entry {
    uint64_t key; // Morton code, for the sort
    uint32_t row; // old row
    uint32_t kind;
} sgsi_plan_entry;

typedef struct sgsi_density_plan {
    sgsi_plan_entry *entries, *buffers[2]; // entries: one of the buffers
    size_t count;
} sgsi_density_plan;

void sgsi_plan_trim(sgsi_density_plan *plan); // frees the buffer that is not used
void sgsi_plan_free(sgsi_density_plan *plan); // accepts a zeroed one

// Replaces model and moments by the rows of the plan, with several processes by those that this
// one owns. Fails with OUT_OF_MEMORY; the model is then unusable. Collective with several
// processes.
sgs_status sgsi_density_apply(const sgsi_density_rows *rows, const sgsi_density_plan *plan,
                              const sgsi_row_moves *moves, const sgsi_density_options *options);

// The same for the parameters of a model without moments, in place; the plan may only keep rows.
// Fails with OUT_OF_MEMORY; the model is then unchanged.
sgs_status sgsi_density_reorder(sgs_gaussians *model, const sgsi_density_plan *plan);
