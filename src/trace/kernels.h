// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The kernels: all code that runs per primitive, per tile or per hit. kernel_*.inl is compiled once
// per instruction set and called through a table.

#include "trace/trace.h"

// ---- Per view: parameters -> projected records, bounds, visibility statistics ----

typedef struct sgsi_project {
    const float *params; // model layout
    size_t count;
    sgsi_view view;
    float *projected;    // [capacity][16]
    sgsi_bounds *bounds; // [capacity]
    // Statistics of 3DGS, both NULL or both [capacity]. visible_count: += 1 if the projected radius
    // is > 0 and the footprint overlaps the image. radius_max: largest radius so far, pixels.
    uint32_t *visible_count;
    float *radius_max;
    uint16_t *visible; // [capacity / 16] or NULL: bit i of a block is set if its radius is > 0
} sgsi_project;

// ---- Per tile ----

enum { SGSI_SENTINELS = 16 }; // extra entries of every scratch array beyond its capacity

// Scratch memory of one thread. All arrays have the same capacity, in primitives. An entry is a
// candidate of a 4x4 block; the forward pass keeps those that are block hits (sgsi_tile_list).
typedef struct sgsi_scratch {
    void *memory; // holds all arrays
    size_t capacity;

    // Candidates of a macrotile.
    float *macrotile_projected;   // [capacity][16]: records in the macrotile's frame
    uint32_t *macrotile_ids;      // [capacity]
    uint32_t *macrotile_tiles;    // [capacity]: bits SGSI_OVERLAPS and SGSI_IN_BOUND of each tile
    uint32_t *macrotile_distance; // [capacity]: bits of the float |delta|
    uint32_t *macrotile_order;    // [capacity]: indices into macrotile_projected, near to far

    // Candidates of a tile.
    float *tile_projected; // [capacity][16]: records in the macrotile's frame
    uint32_t *tile_ids;    // [capacity]

    // Entries of the tile's 16 blocks.
    int32_t *entry_keys;  // [16][capacity]: sort keys
    uint32_t *entries;    // [16][capacity]: indices into tile_projected
    uint64_t *sort_spare; // [2][capacity]
    uint32_t *order;      // [16][capacity]: indices into tile_projected, in block order
    uint32_t entry_count[SGSI_BLOCKS]; // entries in `order`

    // Rows of the current block, one row of 16 lanes per evaluated entry: [capacity][16].
    float *alpha, *t, *transmittance, *prefix, *t_before;
    float *a, *b, *e, *q, *behind; // backward only
    float *sums;                   // [count][16]: sums of the tile, owned by the caller
    // Groups of rows out of order: the group, and how many groups before it are not all in front.
    struct {
        uint32_t group, back;
    } * swapped; // [capacity]
    uint32_t swapped_count;
} sgsi_scratch;

// Bits of a macrotile's first tile; tile k has them shifted left by k.
#define SGSI_IN_BOUND 0x1u     // overlaps the tile in front of its depth bound
#define SGSI_OVERLAPS 0x10000u // overlaps the tile at any distance

// Depth bounds are compared with lower bounds on t, which round. All tests against a distance
// beyond which nothing is visible multiply it by this margin.
#define SGSI_DEPTH_MARGIN 1.0001f

// The tiles of a macrotile that lie in the image, and their depth bounds.
typedef struct sgsi_macrotile {
    const sgsi_tile_rays *tiles[SGSI_MACROTILE_SIDE * SGSI_MACROTILE_SIDE];
    float far[SGSI_MACROTILE_SIDE * SGSI_MACROTILE_SIDE]; // depth bound of each tile
    int count;
    bool complete;     // keep candidates behind the depth bounds
    float compact_box; // share of the support that assigns a primitive to a tile
} sgsi_macrotile;

// The block hits of one block, as passed to sgsi_aov.visit. Arrays are [row][16 lanes]. A hit
// counts if alpha > 0 and transmittance * (1 - alpha) >= transmittance_min. Valid during the call
// only.
typedef struct sgsi_block_hits {
    int x, y;       // upper left pixel; lane i is pixel (x + i % 4, y + i / 4)
    unsigned valid; // mask of the lanes with a ray
    uint32_t count; // rows
    const float *alpha, *transmittance;
    const float *t;         // in units of the lane's |d|
    const uint32_t *order;  // [count]: index into `projected`
    const float *projected; // [][SGSI_PROJECTED_FLOATS]
    float unit[16];         // one unit of t as a distance, along the ray or along the camera axis
    float transmittance_min;
    uint64_t *spare; // [count] scratch of the callback
} sgsi_block_hits;

// AOVs beyond colour and distances. Planes have the stride of the target; each may be NULL.
typedef struct sgsi_aov {
    float *normal[3], *position[3]; // world axes
    uint32_t *primitive;
    // [count][4]: normal of each primitive, world axes; NULL without a plane of `normal`.
    const float *normals;
    // Of the view; required by `position`.
    float rotation[9], center[3], center_low[3];
    bool axis_depth; // measure distances along the camera axis
    // Called by all threads for each block with its hits; may be NULL.
    void (*visit)(void *context, const sgsi_block_hits *hits);
    void *context;
} sgsi_aov;

// Input and output of the tile kernels.
typedef struct sgsi_tile_target {
    const sgsi_tile_rays *rays;
    int width, height;
    size_t stride;                                         // floats per row
    float *color[3], *transmittance;                       // forward, required
    float *depth_mean, *depth_median, *depth_first, *hits; // forward, each may be NULL
    const float *d_color[3], *d_transmittance;             // backward
    const float *projected;                                // backward: records of the view
    const sgsi_aov *aov;                                   // forward, may be NULL
    float near_distance;
    // Out: largest distance at which a pixel became opaque; INFINITY if one did not.
    float stop_distance;
    uint64_t evaluations; // incremented: block evaluations
} sgsi_tile_target;

// Input of the scoring kernel besides a tile's lists.
typedef struct sgsi_score_planes {
    const float *weight;  // [height][stride]: weight of each pixel
    const float *centers; // [count][2]: projected means, pixels; NULL disables distances
} sgsi_score_planes;

typedef struct sgsi_kernels {
    const char *name;
    // Projects the blocks [begin, end) of 16 primitives.
    void (*project)(const sgsi_project *input, size_t begin, size_t end);
    // Filters ids[0..count), readable up to a multiple of 16. Keeps primitives that can hit one of
    // the tiles, in front of its depth bound unless the macrotile is complete. Writes
    // macrotile_projected, _ids, _tiles and _distance; returns the number kept.
    size_t (*macrotile_filter)(sgsi_scratch *scratch, const float *projected, const uint32_t *ids,
                               size_t count, const sgsi_macrotile *macrotile);
    // Copies the candidates of macrotile_order[0..count) that have a bit of `tile` set in
    // macrotile_tiles to tile_projected and tile_ids. Returns their number.
    size_t (*tile_take)(sgsi_scratch *scratch, size_t count, unsigned tile);
    // Builds the block lists, sorted along each block's centre ray.
    void (*tile_sort)(sgsi_scratch *scratch, const sgsi_tile_rays *rays, size_t count);
    // Blends all blocks; compacts each block's list to its block hits.
    void (*tile_forward)(sgsi_scratch *scratch, sgsi_tile_target *target);
    // Writes the gradient sums of a list's primitives to scratch->sums[0..count).
    void (*tile_backward)(sgsi_scratch *scratch, const sgsi_tile_list *list,
                          sgsi_tile_target *target);
    // The same, including SGSI_GRAD_SUM_ABS.
    void (*tile_backward_abs_grad)(sgsi_scratch *scratch, const sgsi_tile_list *list,
                                   sgsi_tile_target *target);
    // Writes the columns SGSI_SCORE_* (model/score_slots.h) to scratch->sums[0..count).
    void (*tile_score)(sgsi_scratch *scratch, const sgsi_tile_list *list, sgsi_tile_target *target,
                       const sgsi_score_planes *planes);
} sgsi_kernels;

extern const sgsi_kernels sgsi_kernels_baseline;
#ifdef SGSI_AVX_KERNELS
extern const sgsi_kernels sgsi_kernels_avx2;
extern const sgsi_kernels sgsi_kernels_avx512;
#endif

// The table of the selected instruction set.
const sgsi_kernels *sgsi_kernels_get(void);
