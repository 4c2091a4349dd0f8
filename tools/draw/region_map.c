// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A primitive belongs to the voxel that contains its current centre, or to the nearest voxel if it
// is outside of the grid, as in SPARE-GS. It may have moved since the update.

#include "draw/region_map.h"

#include <stdlib.h>

#include "cli/progress.h"
#include "run/region_file.h"
#include "sparegs/render.h"

static const sgs_regions *update_before(const region_history *history, int iteration)
{
    const sgs_regions *found = NULL;
    for (size_t i = 0; i < history->count && history->updates[i].iteration <= iteration; ++i)
        found = &history->updates[i];
    return found;
}

static bool fill(const sgs_regions *update, const sgs_gaussians *model, region_map *map)
{
    map->iteration = update->iteration;
    map->count = model->count;
    map->region = malloc((model->count + 1) * sizeof *map->region);
    map->slack = malloc((model->count + 1) * sizeof *map->slack);
    if (!map->region || !map->slack) {
        fail_run("not enough memory for the regions of %zu primitives", model->count);
        return false;
    }
    for (size_t i = 0; i < model->count; ++i) {
        double center[3];
        for (int k = 0; k < 3; ++k)
            center[k] = (double)*sgs_gaussians_at(model, i, k);
        const sgs_region *region = region_find(update, region_voxel(update, center, NULL));
        map->region[i] = region ? region->voxel : SGS_NO_PRIMITIVE;
        map->slack[i] = region ? region->slack : 0;
    }
    return true;
}

bool region_map_make(const region_history *history, int iteration, const sgs_gaussians *model,
                     region_map *map)
{
    *map = (region_map){0};
    const sgs_regions *update = update_before(history, iteration);
    return !update || fill(update, model, map);
}

bool region_map_read(const char *folder, int iteration, const sgs_gaussians *model, region_map *map)
{
    *map = (region_map){0};
    region_history history;
    if (!region_history_read(folder, &history))
        return false;
    const bool done = region_map_make(&history, iteration, model, map);
    region_history_free(&history);
    return done;
}

void region_map_free(region_map *map)
{
    free(map->region);
    free(map->slack);
    *map = (region_map){0};
}
