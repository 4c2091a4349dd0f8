// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Which region of SPARE-GS every primitive of a stored model belongs to, from what the run
// recorded.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/gaussians.h"

typedef struct region_map {
    int iteration;    // of the structural update, 0 = none is recorded and there are no columns
    size_t count;     // rows of the model
    uint32_t *region; // [count] voxel number, (z * grid + y) * grid + x; SGS_NO_PRIMITIVE: it held
                      // none at the update
    float *slack;     // [count] of that region, before the update; 0 without region
} region_map;

// Regions of the last update up to `iteration` in the folder of a run. `map` is to be freed. False
// after printing the error.
bool region_map_read(const char *folder, int iteration, const sgs_gaussians *model,
                     region_map *map);
void region_map_free(region_map *map);
