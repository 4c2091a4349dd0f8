// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Interface between loss.c and the loss kernel: the job of one evaluation, the scratch memory of
// one thread, the prototypes of the compiled variants. Included by src/loss/ only.

#include <stddef.h>

#include "base/image_cells.h"
#include "loss/loss.h"

enum {
    LOSS_RADIUS = 5,                                    // the window has 2 * 5 + 1 taps
    LOSS_BLOCK_WIDTH = SGSI_CELL_SIDE * SGSI_CELL_TILE, // output columns per item, at most
    LOSS_ITEM_CELLS = 2,
    LOSS_RING = 16,   // rows kept of each plane: 4 current ones and 10 of overlap
    LOSS_MARGIN = 16, // columns on both sides of the block in every source plane
    LOSS_SOURCE_PITCH = LOSS_BLOCK_WIDTH + 2 * LOSS_MARGIN,
    LOSS_MAP_PITCH = LOSS_BLOCK_WIDTH + LOSS_MARGIN,
};

// Constants of one evaluation, shared by all items.
typedef struct sgsi_loss_job {
    const sgsi_loss_input *input;
    sgsi_loss_output *output;
    const float *column_weight; // [width] share of the window inside the image; 1 in the interior
    const float *row_weight;    // [height]
    float window[LOSS_RADIUS + 1]; // normalised weights by distance from the centre
    float l1_scale, ssim_scale;    // (1 - lambda) / (3 H W), 2 lambda / (3 H W)
    float ceiling;                 // upper clamp of the image: 1, or 1e9 for HDR
    float alpha_scale;             // weight / (H W), 0 without the term
} sgsi_loss_job;

// Scratch of one thread; the rings are indexed by row & (LOSS_RING - 1). Every row starts at a
// multiple of 64 bytes.
typedef struct sgsi_loss_scratch {
    _Alignas(64) float source[4][LOSS_RING]
                             [LOSS_SOURCE_PITCH]; // I - 1/2, e, (I - 1/2)^2 + (G - 1/2)^2, e^2
    float moment[4][4][LOSS_SOURCE_PITCH];        // the same after the vertical pass, four rows
    float map[3][LOSS_MAP_PITCH];                 // one row of the three derivative planes
    float smooth[3][LOSS_RING][LOSS_BLOCK_WIDTH]; // the same after the horizontal pass
    unsigned inside[LOSS_MAP_PITCH / 16 + 1];     // lanes of a map vector inside the image
    unsigned own[LOSS_ITEM_CELLS][LOSS_MAP_PITCH / 16 + 1]; // lanes of a map vector inside a cell
    _Alignas(
        64) float edge[LOSS_MAP_PITCH]; // column_weight of each map column, 0 outside the image
} sgsi_loss_scratch;

// One cell, or two neighbours of a row that share a halo; the results are those of separate calls.
typedef struct sgsi_loss_item {
    int count; // of cells
    sgsi_cell_rect cell[LOSS_ITEM_CELLS];
    sgsi_loss_sums *sums[LOSS_ITEM_CELLS];
} sgsi_loss_item;

typedef void (*sgsi_loss_kernel)(const sgsi_loss_job *job, const sgsi_loss_item *item,
                                 sgsi_loss_scratch *scratch);

void sgsi_loss_block_baseline(const sgsi_loss_job *job, const sgsi_loss_item *item,
                              sgsi_loss_scratch *scratch);
void sgsi_loss_block_avx2(const sgsi_loss_job *job, const sgsi_loss_item *item,
                          sgsi_loss_scratch *scratch);
void sgsi_loss_block_avx512(const sgsi_loss_job *job, const sgsi_loss_item *item,
                            sgsi_loss_scratch *scratch);
