// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The SPARE-GS region of every primitive of a stored model, from the records of the run.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "run/region_file.h"
#include "sparegs/gaussians.h"

typedef struct region_map {
    int iteration; // of the structural update; 0 = none recorded, and no columns
    size_t count;  // rows of the model
    // [count] voxel number, (z * grid + y) * grid + x; SGS_NO_PRIMITIVE: empty at the update.
    uint32_t *region;
    float *slack; // [count] of that region, before the update; 0 without region
} region_map;

// Reads the regions of the last update up to `iteration` of a run. Release with region_map_free.
// False after printing the error.
bool region_map_read(const char *folder, int iteration, const sgs_gaussians *model,
                     region_map *map);
// The same from a history in memory.
bool region_map_make(const region_history *history, int iteration, const sgs_gaussians *model,
                     region_map *map);
void region_map_free(region_map *map);
