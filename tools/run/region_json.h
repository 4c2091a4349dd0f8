// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// One region at one structural update as JSON, for `explain --json` and the viewer.

#include <jansson.h>

#include "sparegs/trainer.h"

// The centre of a voxel, world units.
void region_center(const sgs_regions *update, uint32_t voxel, double center[3]);
// A new object: iteration, voxel, center, count, quota, slack, weight, demand, capacity, gradient,
// visibility, densified, removed, redundant.
json_t *region_json(const sgs_regions *update, const sgs_region *r);
