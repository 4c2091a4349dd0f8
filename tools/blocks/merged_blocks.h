// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The trained blocks of a plan: checks that all of them exist, are complete and belong to it, and
// joins their primitives. Writes nothing.

#include <jansson.h>

#include "blocks/block_plan.h"

typedef struct merged_blocks {
    char *folder, *plan_path;
    block_plan plan;
    json_t **configs;     // [plan.count] config.json of each block
    size_t *counts;       // [plan.count] primitives of each block
    int iteration;        // the largest of the blocks
    sgs_gaussians *model; // in the order of the blocks
    json_t *exposures;    // of the views, or NULL without --exposure
} merged_blocks;

// Reads the plan in `folder` and checks all of its blocks. False after printing the error, which
// names the block; free the result in any case.
bool merged_blocks_check(merged_blocks *merged, const char *folder);

// False after printing the error if a block was trained on a held-out view of the scene. Blocks
// that recorded no split are accepted.
bool merged_blocks_hold_out(const merged_blocks *merged, const sgs_scene *scene);

// Reads the blocks and joins them. A view that several blocks saw has the exposure of the first of
// them. A request to stop (interrupt.h) ends it early. False after printing the error.
bool merged_blocks_read(merged_blocks *merged);

void merged_blocks_free(merged_blocks *merged); // accepts a zeroed one
