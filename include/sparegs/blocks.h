// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Division of a large scene into blocks that are trained separately (sgs_train_options.region), as
// in VastGaussian (Lin et al. 2024, section 4): cells with a similar amount of work, and for each
// cell the views that see enough of it, including its empty space. No training, no files.
//
// Threads: functions may be called from any thread, concurrently for different scenes.

#include "sparegs/region.h"
#include "sparegs/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { SGS_BLOCKS_MAX = 256, SGS_BLOCKS_MAX_SIGHT_LINES = 100000 };

typedef struct sgs_block_options {
    size_t struct_size; // set by sgs_block_options_default()
    int count;          // number of blocks, 2..SGS_BLOCKS_MAX; 2
    // Added on each side of a cell before views are assigned, in units of that side, 0..10; 0.2.
    double margin;
    // Fraction of a view's lines of sight that must cross the enlarged cell, 0..1; 0.1.
    double share;
    // Called after every view whose lines of sight were counted, or NULL. If it returns false,
    // sgs_blocks_plan fails with SGS_STATUS_CANCELLED.
    sgs_progress_fn progress;
    void *progress_user;
} sgs_block_options;

// Writes the defaults to a struct of `size` bytes, see status.h. Cannot fail.
SGS_API void sgs_block_options_init(sgs_block_options *options, size_t size);
static inline sgs_block_options sgs_block_options_default(void)
{
    sgs_block_options options;
    sgs_block_options_init(&options, sizeof options);
    return options;
}

typedef struct sgs_block {
    sgs_box box;       // the boxes of all blocks fill space without overlap
    size_t points;     // sparse points in the box
    size_t view_count; // > 0
    size_t *views;     // [view_count] indices into scene->views, ascending
} sgs_block;

typedef struct sgs_blocks {
    size_t count;
    sgs_block *blocks; // [count], owned; free them with sgs_blocks_free
} sgs_blocks;

// Bisects the box of the camera centres across its longest side, until there are options->count
// cells; each plane balances sqrt(views x sparse points) between its sides in proportion to their
// numbers of blocks. The photos need not be loaded. options NULL = the defaults.
//
// A view belongs to a block if enough of its lines of sight cross the enlarged cell: those from its
// centre to the sparse points in its image, occluded ones included. Counting only the points in the
// cell is not enough: primitives that grow in the empty space of a cell occlude what a camera sees
// through it. (The bundled scene in four blocks: 29.4 dB with a share of 0.25 instead of 27.2; 29.8
// dB with 0.1.) A view without points belongs to the block that contains its centre. Of more than
// SGS_BLOCKS_MAX_SIGHT_LINES points, every k-th one is used, with the smallest k that leaves no
// more, and all of them for views that contain none of these.
//
// Fails with INVALID_ARGUMENT (options; a scene without points, or with too few in some cell),
// OUT_OF_MEMORY or CANCELLED; *blocks is then zeroed.
SGS_API sgs_status sgs_blocks_plan(const sgs_scene *scene, const sgs_block_options *options,
                                   sgs_blocks *blocks);
SGS_API void sgs_blocks_free(sgs_blocks *blocks); // accepts a zeroed one

#ifdef __cplusplus
}
#endif
