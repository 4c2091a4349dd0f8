// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Traces one view: projects the primitives, updates the BVH, gathers and blends tile by tile, and
// runs the backward pass. Owns projected records, bounds, hit lists, gradient sums and scratch
// memory. Independent of losses, optimisers and files.

#include "trace/kernels.h"

typedef struct sgsi_tracer sgsi_tracer;

// Wall-clock seconds of the most recent calls, by phase.
typedef struct sgsi_trace_seconds {
    double project, bvh_refit, bvh_build, gather, forward, backward, reduce;
    double gather_cpu, forward_cpu; // CPU time of all threads; 0 unless the tracer is profiled
} sgsi_trace_seconds;

// Work done by the most recent forward (and backward) pass.
typedef struct sgsi_trace_counts {
    uint64_t callbacks;        // primitives reported by the BVH, with repetitions
    uint64_t distinct;         // without repetitions in a macrotile; 0 unless profiled
    uint64_t gathered;         // candidates of all macrotiles: may hit one of their tiles
    uint64_t candidates;       // candidates of all tiles
    uint64_t evaluations;      // (block, primitive) pairs evaluated by the forward pass
    uint64_t block_hits;       // see sgsi_tile_list
    uint64_t fallback_gathers; // macrotiles gathered again because a depth bound was too near
} sgsi_trace_counts;

// Cost of a tile in the forward pass.
typedef struct sgsi_tile_cost {
    float seconds; // without its share of the gather
    uint32_t candidates, evaluations;
} sgsi_tile_cost;

// Framebuffer of the forward pass: planes [height][stride], stride >= width. Depth planes and hits
// may be NULL.
typedef struct sgsi_planes {
    int width, height;
    size_t stride;
    float *color[3], *transmittance;
    float *depth_mean, *depth_median, *depth_first, *hits;
    float *candidates;   // of the tile of each pixel, or NULL
    const sgsi_aov *aov; // further AOVs, or NULL
} sgsi_planes;

// Fails as sgsi_bvh_create; *tracer is then NULL.
sgs_status sgsi_tracer_create(sgsi_tracer **tracer);
void sgsi_tracer_destroy(sgsi_tracer *tracer); // accepts NULL

// Computes projected records and bounds of the model's primitives for a view. visible_count and
// radius_max [capacity] accumulate statistics; both may be NULL. Fails with INVALID_ARGUMENT (a
// camera too far from the origin) or OUT_OF_MEMORY.
sgs_status sgsi_tracer_project(sgsi_tracer *tracer, const sgs_gaussians *model,
                               const sgsi_view *view, uint32_t *visible_count, float *radius_max);

// Updates the BVH to the projected bounds: builds if `rebuild` or if the count changed, else
// refits. Fails as sgsi_bvh_build.
sgs_status sgsi_tracer_commit(sgsi_tracer *tracer, bool rebuild, sgsi_bvh_quality quality);

// Frees what the next projection and passes would replace, to leave the memory to another phase.
void sgsi_tracer_forget(sgsi_tracer *tracer);

// Makes later forward passes write the cost of each tile to costs [tiles], owned by the caller.
// NULL disables this.
void sgsi_tracer_watch_tiles(sgsi_tracer *tracer, sgsi_tile_cost *costs);

// Makes later forward passes measure CPU time and count distinct callbacks, which costs time.
void sgsi_tracer_set_profiled(sgsi_tracer *tracer, bool profiled);

// The packet that queries the BVH for a macrotile of the view, up to the distance `far`.
sgsi_packet sgsi_macrotile_packet(const sgsi_view *view, int macrotile, float far);

// Gathers and blends. depth_bound [tiles] or NULL: per tile, the distance at which the previous
// visit of this view was opaque (INFINITY if unknown); read, then replaced. The image does not
// depend on it. keep_lists: required for a backward pass. Fails with OUT_OF_MEMORY; planes and
// depth bounds are then undefined.
sgs_status sgsi_tracer_forward(sgsi_tracer *tracer, const sgsi_view *view, sgsi_planes *planes,
                               float *depth_bound, bool keep_lists);

// Forward pass over the tile rows [first, last) only, without depth bounds or lists. first and last
// must be multiples of the rays' macrotile_side; last may also be the number of tile rows. Other
// pixels are not written.
sgs_status sgsi_tracer_forward_rows(sgsi_tracer *tracer, const sgsi_view *view, sgsi_planes *planes,
                                    int first, int last);

// Several processes: each projects rows of its own and traces a piece of the cells over the records
// that it receives from all.

// Room for `count` primitives that other tracers have projected; the caller fills all of it.
// rows: the row of each primitive in the whole model, which decides between equal distances. The
// arrays are valid until the next call.
typedef struct sgsi_received {
    float *projected;    // [count][16]
    sgsi_bounds *bounds; // [count]
    uint32_t *rows;      // [count]
} sgsi_received;
sgs_status sgsi_tracer_receive(sgsi_tracer *tracer, size_t count, sgsi_received *received);
const uint32_t *sgsi_tracer_rows(const sgsi_tracer *tracer); // [count], of the last call

// A piece of the work: later forward passes and backward passes work on the cells [first, last) of
// rays->cells only. Other pixels and depth bounds are not written. A backward pass then keeps
// records, the sums per (cell, primitive), instead of adding them. NULL: all cells. Set it for each
// view.
typedef struct sgsi_tracer_piece {
    size_t first, last;
} sgsi_tracer_piece;
void sgsi_tracer_set_piece(sgsi_tracer *tracer, const sgsi_tracer_piece *piece);

// The records of the last backward pass of a piece, by bucket of primitives; those of a primitive
// are in one bucket, in the order of the cells.
typedef struct sgsi_sum_list {
    const uint32_t *ids; // [count]: of the primitives
    const float *sums;   // [count][16], 16-byte aligned
    size_t count;
} sgsi_sum_list;
size_t sgsi_tracer_buckets(const sgsi_tracer *tracer);
// Buckets with any number of threads.
size_t sgsi_tracer_buckets_max(const sgsi_tracer *tracer);
sgsi_sum_list sgsi_tracer_records(const sgsi_tracer *tracer, size_t bucket);

// Adds the records of all pieces, one list per piece in the order of the curve, to the gradient
// sums of this tracer, whose primitives the ids name. Fills `touched`. Fails with FORMAT if an id
// is out of range, or OUT_OF_MEMORY.
sgs_status sgsi_tracer_fold(sgsi_tracer *tracer, const sgsi_sum_list *lists, int count);

// Gradients of the last forward pass, which must have kept its lists: fills the gradient sums and
// `touched`. Fails with OUT_OF_MEMORY.
sgs_status sgsi_tracer_backward(sgsi_tracer *tracer, const sgsi_view *view,
                                const sgsi_planes *planes, float *const d_color[3],
                                float *d_transmittance);
// Enables SGSI_GRAD_SUM_ABS in later backward passes.
void sgsi_tracer_collect_abs_grad(sgsi_tracer *tracer, bool wanted);

// Scores of primitives for density control, over the last forward pass, as sgsi_tracer_backward.
// Replaces the gradient sums by the columns SGSI_SCORE_* (model/score_slots.h) and fills `touched`.
// Only the sizes of `planes` are read.
sgs_status sgsi_tracer_score(sgsi_tracer *tracer, const sgsi_view *view, const sgsi_planes *planes,
                             const sgsi_score_planes *score);

// Owned by the tracer; valid until the next call that replaces them.
const float *sgsi_tracer_grad_sums(const sgsi_tracer *tracer); // [capacity][16]
// [capacity / 16]: 1 if a primitive of the block has gradient sums; the sums of others are invalid.
const uint8_t *sgsi_tracer_touched(const sgsi_tracer *tracer);
// [capacity / 16]: bit i of a block is set if the projected radius of its primitive i is > 0.
const uint16_t *sgsi_tracer_visible(const sgsi_tracer *tracer);
const sgsi_bounds *sgsi_tracer_bounds(const sgsi_tracer *tracer); // [capacity]
const float *sgsi_tracer_projected(const sgsi_tracer *tracer);    // [capacity][16]
sgsi_trace_seconds sgsi_tracer_seconds(const sgsi_tracer *tracer);
sgsi_trace_counts sgsi_tracer_counts(const sgsi_tracer *tracer);
// [tiles], of the last forward pass, if it kept its lists.
const sgsi_tile_list *sgsi_tracer_lists(const sgsi_tracer *tracer);

// Makes room for `capacity` primitives in all arrays of a scratch. Growing discards the contents.
// Both return false if out of memory; _grow allocates exactly `capacity`, without headroom.
bool sgsi_scratch_reserve(sgsi_scratch *scratch, size_t capacity);
bool sgsi_scratch_grow(sgsi_scratch *scratch, size_t capacity);
void sgsi_scratch_free(sgsi_scratch *scratch);

// Fails with INVALID_ARGUMENT if a value is out of range.
sgs_status sgsi_render_options_check(const sgs_render_options *options);
// Sets up a view from a camera's rays and a pose. options->filter_3d must be NULL or padded to a
// multiple of 16.
void sgsi_view_set(sgsi_view *view, const sgsi_rays *rays, const sgs_pose *pose,
                   const sgs_render_options *options);
