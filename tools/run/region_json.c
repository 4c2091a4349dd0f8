// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/region_json.h"

#include "cli/json_output.h"

void region_center(const sgs_regions *update, uint32_t voxel, double center[3])
{
    const uint32_t grid = (uint32_t)update->grid,
                   at[3] = {voxel % grid, voxel / grid % grid, voxel / grid / grid};
    for (int k = 0; k < 3; ++k)
        center[k] = update->low[k] + (at[k] + 0.5) * update->voxel_size[k];
}

json_t *region_json(const sgs_regions *update, const sgs_region *r)
{
    json_t *object = json_object(), *point = json_array();
    double center[3];
    region_center(update, r->voxel, center);
    for (int k = 0; k < 3; ++k)
        json_array_append_new(point, json_number(center[k]));
    json_object_set_new(object, "iteration", json_integer(update->iteration));
    json_object_set_new(object, "voxel", json_integer(r->voxel));
    json_object_set_new(object, "center", point);
    json_object_set_new(object, "count", json_integer(r->count));
    const struct {
        const char *name;
        float value;
    } numbers[] = {{"quota", r->quota},          {"slack", r->slack},
                   {"weight", r->weight},        {"demand", r->demand},
                   {"capacity", r->capacity},    {"gradient", r->gradient},
                   {"visibility", r->visibility}};
    for (size_t k = 0; k < sizeof numbers / sizeof *numbers; ++k)
        json_object_set_new(object, numbers[k].name, json_number((double)numbers[k].value));
    json_object_set_new(object, "densified", json_integer(r->densified));
    json_object_set_new(object, "removed", json_integer(r->removed));
    json_object_set_new(object, "redundant", json_integer(r->redundant));
    return object;
}
