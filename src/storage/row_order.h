// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Orders of the primitives in a file.

#include <stddef.h>
#include <stdint.h>

#include "sparegs/gaussians.h"

// *order: [count] row numbers; the caller frees it with sgsi_free. Fail with OUT_OF_MEMORY.
// Along a Z curve over the box of the means, 21 bits per axis.
sgs_status sgsi_order_by_position(const sgs_gaussians *model, uint32_t **order);
// By decreasing importance [count], or opacity times volume if it is NULL.
sgs_status sgsi_order_by_importance(const sgs_gaussians *model, const float *importance,
                                    uint32_t **order);
