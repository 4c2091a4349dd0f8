// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// From the decisions on the old rows to the plan of the new model (row_plan.h), in Morton order.

#include "density/row_plan.h"

// Lists the rows of the new model, the `fixed` ones last, and counts the changes in *result.
// Children and clones are never redundant, but the pipeline's own rule may remove them. Fails with
// OUT_OF_MEMORY; free *plan also then.
sgs_status sgsi_plan_make(const sgsi_density_columns *columns, size_t fixed,
                          sgsi_density_result *result, sgsi_density_plan *plan);
