// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "blocks/block_plan.h"

#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli/json_file.h"
#include "cli/json_output.h"
#include "cli/progress.h"

// The scene's digest as text.
static void digest_text(const sgs_scene *scene, char text[17])
{
    snprintf(text, 17, "%016" PRIx64, scene->digest);
}

// Three numbers; null for an infinite bound.
static json_t *bounds_json(const float bounds[3])
{
    json_t *list = json_array();
    for (int k = 0; k < 3; ++k)
        json_array_append_new(list, json_number((double)bounds[k]));
    return list;
}

json_t *block_plan_json(const sgs_scene *scene, const sgs_blocks *blocks,
                        const sgs_block_options *options)
{
    char digest[17];
    digest_text(scene, digest);
    json_t *list = json_array();
    for (size_t b = 0; b < blocks->count; ++b) {
        const sgs_block *block = &blocks->blocks[b];
        json_t *entry = json_object(), *views = json_array();
        for (size_t v = 0; v < block->view_count; ++v)
            json_array_append_new(views, json_string(scene->views[block->views[v]].name));
        json_object_set_new(entry, "low", bounds_json(block->box.low));
        json_object_set_new(entry, "high", bounds_json(block->box.high));
        json_object_set_new(entry, "points", json_integer((json_int_t)block->points));
        json_object_set_new(entry, "views", views);
        json_array_append_new(list, entry);
    }
    json_t *root = json_object();
    json_object_set_new(root, "schema", json_integer(1));
    char *real = realpath(scene->path, NULL); // jobs may run in another folder
    json_set_path(root, "scene", "%s", real ? real : scene->path);
    free(real);
    json_object_set_new(root, "scene_hash", json_string(digest));
    json_object_set_new(root, "margin", json_number(options->margin));
    json_object_set_new(root, "share", json_number(options->share));
    json_object_set_new(root, "blocks", list);
    return root;
}

// Reads three bounds, finite numbers or null for `infinite`.
static bool read_bounds(const json_t *list, float infinite, float bounds[3])
{
    bool valid = json_array_size(list) == 3;
    for (size_t k = 0; k < 3 && valid; ++k) {
        const json_t *value = json_array_get(list, k);
        bounds[k] = json_is_null(value) ? infinite : (float)json_number_value(value);
        valid = json_is_null(value) || (json_is_number(value) && isfinite(bounds[k]));
    }
    return valid;
}

static bool read_block(const json_t *entry, sgs_box *box)
{
    const json_t *views = json_object_get(entry, "views");
    bool valid = read_bounds(json_object_get(entry, "low"), -INFINITY, box->low) &&
                 read_bounds(json_object_get(entry, "high"), INFINITY, box->high) &&
                 json_array_size(views) > 0;
    for (int k = 0; k < 3; ++k)
        valid = valid && box->low[k] < box->high[k];
    for (size_t v = 0; v < json_array_size(views); ++v)
        valid = valid && json_is_string(json_array_get(views, v));
    return valid;
}

bool block_plan_read(const char *path, block_plan *plan)
{
    *plan = (block_plan){.root = read_json(path)};
    if (!plan->root)
        return false;
    const json_t *list = json_object_get(plan->root, "blocks");
    const char *scene = json_string_value(json_object_get(plan->root, "scene_hash"));
    const size_t count = json_array_size(list);
    bool valid = scene && strlen(scene) == 16 && count > 1 && count <= SGS_BLOCKS_MAX &&
                 json_integer_value(json_object_get(plan->root, "schema")) == 1;
    plan->boxes = valid ? calloc(count, sizeof *plan->boxes) : NULL;
    for (size_t b = 0; b < count && plan->boxes && valid; ++b)
        valid = read_block(json_array_get(list, b), &plan->boxes[b]);
    if (!valid || !plan->boxes) {
        fail_run("%s: not a plan of blocks; write it with 'sparegs split'", path);
        block_plan_free(plan);
        return false;
    }
    plan->count = count;
    snprintf(plan->scene, sizeof plan->scene, "%s", scene);
    return true;
}

void block_plan_free(block_plan *plan)
{
    json_decref(plan->root);
    free(plan->boxes);
    *plan = (block_plan){0};
}

bool block_plan_has(const block_plan *plan, const char *path, int block)
{
    if (block >= 0 && (size_t)block < plan->count)
        return true;
    fail_run("%s: has no block %d; its blocks are 0 to %zu", path, block, plan->count - 1);
    return false;
}

void block_plan_record(const block_plan *plan, const char *path, int block, json_t *config)
{
    json_t *record = json_object();
    json_set_path(record, "plan", "%s", path);
    json_object_set_new(record, "index", json_integer(block));
    json_object_set_new(record, "scene_hash", json_string(plan->scene));
    json_object_set_new(config, "block", record);
}

size_t block_plan_count(const sgs_gaussians *model, const sgs_box *box)
{
    size_t count = 0;
    for (size_t i = 0; i < model->count; ++i) {
        float params[SGS_PARAM_COUNT];
        sgs_gaussians_get(model, i, params);
        count += sgs_box_contains(box, params + SGS_PARAM_MEAN);
    }
    return count;
}

const json_t *block_plan_views(const block_plan *plan, size_t block)
{
    return json_object_get(json_array_get(json_object_get(plan->root, "blocks"), block), "views");
}

size_t block_plan_find(const block_plan *plan, const float point[3])
{
    size_t block = 0;
    while (block + 1 < plan->count && !sgs_box_contains(&plan->boxes[block], point))
        ++block;
    return block;
}

bool block_plan_is_of(const block_plan *plan, const char *path, const sgs_scene *scene)
{
    char digest[17];
    digest_text(scene, digest);
    if (!strcmp(digest, plan->scene))
        return true;
    fail_run("%s: the plan does not match the scene %s: cameras or points differ; run 'sparegs "
             "split' again",
             path, scene->path);
    return false;
}
