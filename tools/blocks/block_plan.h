// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// DIR/blocks.json, the plan of `sparegs split`: the boxes and views of the blocks of a scene. Read
// by `train --region` and `merge`.

#include <jansson.h>

#include "sparegs/blocks.h"
#include "sparegs/gaussians.h"

typedef struct block_plan {
    json_t *root;
    size_t count;   // blocks
    sgs_box *boxes; // [count]
    char scene[17]; // digest of the scene, 16 hex digits
} block_plan;

// The plan of a scene as JSON.
json_t *block_plan_json(const sgs_scene *scene, const sgs_blocks *blocks,
                        const sgs_block_options *options);

// Reads and checks a plan; free it with block_plan_free. False after printing the error; *plan is
// then zeroed.
bool block_plan_read(const char *path, block_plan *plan);
void block_plan_free(block_plan *plan); // accepts a zeroed one

// True if the plan has this block; otherwise prints the error, which names `path`.
bool block_plan_has(const block_plan *plan, const char *path, int block);

// Records in the config.json of a block's training which block of which plan it is.
void block_plan_record(const block_plan *plan, const char *path, int block, json_t *config);

// Number of primitives with centres in the box.
size_t block_plan_count(const sgs_gaussians *model, const sgs_box *box);

// The names of a block's views, a list of strings owned by the plan.
const json_t *block_plan_views(const block_plan *plan, size_t block);

// The block that contains a point.
size_t block_plan_find(const block_plan *plan, const float point[3]);

// True if the scene is the plan's; otherwise prints the error, which names `path`.
bool block_plan_is_of(const block_plan *plan, const char *path, const sgs_scene *scene);
