// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Selects the rows to keep of an initial cloud or model that exceeds the cap. Deterministic.

#include <stdint.h>

#include "sparegs/gaussians.h"

// Thins a point cloud to `wanted` points, 0 < wanted < n: removes points that are closest to
// another one, so that dense parts lose most and sparse parts remain. points [n][3], finite. chosen
// [n]: 1 = kept. Fails with OUT_OF_MEMORY.
sgs_status sgsi_thin_points(const float *points, size_t n, size_t wanted, uint8_t *chosen);

// Chooses the `wanted` primitives of largest opacity times cross section (the product of the two
// largest scales) among the eligible ones (NULL: all). chosen, eligible [model->count]. Fails with
// OUT_OF_MEMORY.
sgs_status sgsi_select_largest(const sgs_gaussians *model, const uint8_t *eligible, size_t wanted,
                               uint8_t *chosen);
