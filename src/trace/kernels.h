// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The kernels: everything that runs per primitive, per tile or per hit, compiled once per
// instruction set from kernel_*.inl and reached through one table.

#include "trace/trace.h"

// ---- per view: parameters -> records, bounds, visibility statistics ----
typedef struct sgsi_project {
    const float *params; // model layout
    size_t count;
    sgsi_view view;
    float *projected;        // [capacity][16]
    sgsi_bounds *bounds;     // [capacity]
    uint32_t *visible_count; // d_i: += 1 for a projected radius > 0 that meets the image; NULL = no
                             // statistics
    float *radius_max;       // rho_i, pixels
    uint16_t *visible;       // [capacity / 16]: bit i of a block: projected radius > 0; may be NULL
} sgsi_project;

// ---- per tile ----
enum { SGSI_SENTINELS = 16 }; // spare entries of every scratch array beyond its capacity

// Scratch of one thread; arrays grow together (capacity primitives).
typedef struct sgsi_scratch {
    void *memory; // that all arrays lie in
    size_t capacity;
    float *macrotile_projected;   // [capacity][16] candidates of a macrotile, in its frame
    uint32_t *macrotile_ids;      // [capacity]
    uint32_t *macrotile_side;     // [capacity]: bits SGSI_MEETS and SGSI_NEARER of each tile
    uint32_t *macrotile_distance; // [capacity]: bits of the float |delta|
    uint32_t *macrotile_order;    // [capacity]: indices into macrotile_projected, near to far
    float *tile_projected;        // [capacity][16] candidates of a tile, in the macrotile's frame
    uint32_t *tile_ids;           // [capacity]
    int32_t *entry_keys;          // [16][capacity]: per block, what its elements are ordered by
    uint32_t *entries;            // [16][capacity]: indices into tile_projected
    uint64_t *sort_spare;         // [2][capacity]
    uint32_t *order; // [16][capacity]: indices into tile_projected in the block's order
    float *alpha, *t, *transmittance, *prefix, *t_before; // elements of a block: [capacity][16]
    float *a, *b, *e, *q, *behind;                        // [capacity][16], backward only
    float *sums;                                          // [count][16] of the tile, the caller's
    struct {
        uint32_t group, back; // a group of elements, and how many before it are not all in front
    } * swapped;              // [capacity]
    uint32_t swapped_count;   // of the block
    uint32_t entry_count[SGSI_BLOCKS]; // elements in `order`
} sgsi_scratch;

// The tiles of a macrotile that lie in the image, and how far each must be looked.
#define SGSI_NEARER 0x1u // of a macrotile's first tile; the bits of the others lie above
#define SGSI_MEETS 0x10000u
typedef struct sgsi_macrotile {
    const sgsi_tile_rays *tiles[SGSI_MACROTILE_SIDE * SGSI_MACROTILE_SIDE];
    float far[SGSI_MACROTILE_SIDE * SGSI_MACROTILE_SIDE]; // what begins behind it is not NEARER
    int count;
    bool complete;     // keeps what MEETS a tile, not only what is NEARER
    float compact_box; // share of the support that brings a primitive into a tile
} sgsi_macrotile;

// The ordered elements of a block, for whoever wants to look at each hit. Arrays of [element][16
// lanes]; a hit counts where alpha > 0 and transmittance * (1 - alpha) >= transmittance_min. Valid
// during the call only.
typedef struct sgsi_block_hits {
    int x, y;       // upper left pixel; lane i is pixel (x + i % 4, y + i / 4)
    unsigned valid; // lanes with a ray
    uint32_t count; // elements
    const float *alpha, *transmittance;
    const float *t;         // in units of the lane's |d|
    const uint32_t *order;  // [element]: index into records
    const float *projected; // [][SGSI_PROJECTED_FLOATS]
    float unit[16];         // what one unit of t is, along the ray or along the axis
    float transmittance_min;
    uint64_t *spare; // room for `count` numbers
} sgsi_block_hits;

// What a drawing may ask for besides colours and distances. Planes have the stride of the target's;
// each may be NULL (of three, all or none).
typedef struct sgsi_aov {
    float *normal[3], *position[3]; // world
    uint32_t *primitive;
    const float *normals; // [count][4]: each primitive's normal in world axes; needed with `normal`
    float rotation[9], center[3]; // of the view; needed with `position`
    bool axis_depth;              // distances along the camera's axis
    void (*visit)(void *context,
                  const sgsi_block_hits *hits); // called by all threads; NULL = nobody looks
    void *context;
} sgsi_aov;

// One tile of an image to blend or to differentiate.
typedef struct sgsi_tile_target {
    const sgsi_tile_rays *rays;
    int width, height;
    size_t stride;                                         // floats per row
    float *color[3], *transmittance;                       // forward, always
    float *depth_mean, *depth_median, *depth_first, *hits; // forward, each may be NULL
    const float *d_color[3], *d_transmittance;             // backward
    const float *projected;                                // of the view; backward
    const sgsi_aov *aov;                                   // forward, NULL = nothing more
    float near_distance;
    float
        stop_distance; // out: largest distance at which a pixel stopped; INFINITY when one did not
    uint64_t evaluations, counted; // out, added to: block evaluations and counted hits
} sgsi_tile_target;

// What a scoring pass reads besides a tile's lists.
typedef struct sgsi_score_planes {
    const float *weight;  // of every pixel, [height][stride]
    const float *centers; // [count][2] projected means in pixels, or NULL: no distances
} sgsi_score_planes;

typedef struct sgsi_kernels {
    const char *name;
    // Blocks [begin, end) of 16 primitives.
    void (*project)(const sgsi_project *input, size_t begin, size_t end);
    // Keeps of ids[0..count) (readable up to a multiple of 16) those that can meet one of the
    // tiles, in front of its `far` unless the macrotile is complete: macrotile_projected,
    // macrotile_ids, macrotile_side, macrotile_distance. Returns their number.
    size_t (*macrotile_filter)(sgsi_scratch *scratch, const float *projected, const uint32_t *ids,
                               size_t count, const sgsi_macrotile *macrotile);
    // Takes those of macrotile_order[0..count) with a bit of `tile` in macrotile_side:
    // tile_projected, tile_ids. Returns their number.
    size_t (*tile_take)(sgsi_scratch *scratch, size_t count, unsigned tile);
    // Block lists in the order of the block's centre ray.
    void (*tile_sort)(sgsi_scratch *scratch, const sgsi_tile_rays *rays, size_t count);
    // Blends all blocks; compacts each block's list to the elements that count in some pixel.
    void (*tile_forward)(sgsi_scratch *scratch, sgsi_tile_target *target);
    // Adds to scratch->sums[0..count) for the lists of `list`.
    void (*tile_backward)(sgsi_scratch *scratch, const sgsi_tile_list *list,
                          sgsi_tile_target *target);
    // The same for sums of absolute gradients, SGSI_GRAD_SUM_ABS.
    void (*tile_backward_abs_grad)(sgsi_scratch *scratch, const sgsi_tile_list *list,
                                   sgsi_tile_target *target);
    // Adds to scratch->sums[0..count): weight, hits, T alpha, distance.
    void (*tile_score)(sgsi_scratch *scratch, const sgsi_tile_list *list, sgsi_tile_target *target,
                       const sgsi_score_planes *planes);
} sgsi_kernels;

extern const sgsi_kernels sgsi_kernels_baseline;
#ifdef SGSI_X86
extern const sgsi_kernels sgsi_kernels_avx2;
extern const sgsi_kernels sgsi_kernels_avx512;
#endif

// The table of the chosen instruction set.
const sgsi_kernels *sgsi_kernels_get(void);
