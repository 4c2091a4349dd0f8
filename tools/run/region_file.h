// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// OUT/regions.bin: SPARE-GS's data of every region at every structural update of a run. Functions
// that return bool print their error before they return false.

#include <stdbool.h>

#include "sparegs/trainer.h"

// Removes the records after `iteration`, where the run resumes (0: all records).
bool region_file_cut(const char *folder, int iteration);
// Appends an update.
bool region_file_append(const char *folder, const sgs_regions *regions);

typedef struct region_history {
    size_t count;
    sgs_regions *updates; // [count] in order of iteration; owns their lists
} region_history;

// Reads OUT/regions.bin. Without the file (a run without SPARE-GS), count is 0.
bool region_history_read(const char *folder, region_history *history);
void region_history_free(region_history *history);

// The voxel that contains a point, or the nearest one for points outside of the grid, as SPARE-GS
// assigns primitives. `inside`, if not NULL: true if the point is in the grid.
uint32_t region_voxel(const sgs_regions *update, const double point[3], bool *inside);
// The region of a voxel, or NULL if it had no primitives at that update.
const sgs_region *region_find(const sgs_regions *update, uint32_t voxel);
