// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// OUT/regions.bin: what SPARE-GS held of every region at every structural update of a run.
// Functions that return bool have printed their error when they return false.

#include <stdbool.h>

#include "sparegs/trainer.h"

// Cuts what was recorded after `iteration`, where the run continues (0: everything).
bool region_file_cut(const char *folder, int iteration);
// Adds an update.
bool region_file_append(const char *folder, const sgs_regions *regions);

typedef struct region_history {
    size_t count;
    sgs_regions *updates; // [count] ascending iteration; their lists belong to the history
} region_history;

// Reads OUT/regions.bin; a run without SPARE-GS has none, and count is 0.
bool region_history_read(const char *folder, region_history *history);
void region_history_free(region_history *history);

// The voxel that holds a point, or, outside the grid, the nearest: SPARE-GS's rule for the centres
// of primitives. `inside` (or NULL): whether the grid holds it.
uint32_t region_voxel(const sgs_regions *update, const double point[3], bool *inside);
// The region of a voxel, or NULL: no primitives there at that update.
const sgs_region *region_find(const sgs_regions *update, uint32_t voxel);
