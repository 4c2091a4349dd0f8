// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The way of one view: project the primitives, follow with the BVH, gather and blend tile by tile,
// and back again with gradients. Owns records, bounds, lists, sums and scratch; knows nothing of
// losses, optimisers or files.

#include "trace/kernels.h"

typedef struct sgsi_tracer sgsi_tracer;

// Wall-clock seconds of the last calls, by phase.
typedef struct sgsi_trace_seconds {
    double project, bvh_refit, bvh_build, gather, forward, backward, reduce;
} sgsi_trace_seconds;

// What the last forward (and backward) did.
typedef struct sgsi_trace_counts {
    uint64_t callbacks;   // primitives that the BVH named, some several times
    uint64_t gathered;    // candidates of all macrotiles: what may meet one of their tiles
    uint64_t candidates;  // candidates of all tiles
    uint64_t evaluations; // (block, primitive) pairs evaluated forward
    uint64_t
        block_hits; // pairs that count in some pixel, or hit one where distances or AOVs are drawn
    uint64_t fallback_gathers; // macrotiles gathered again because a depth depth_bound was too near
} sgsi_trace_counts;

// What a tile cost in the forward pass.
typedef struct sgsi_tile_cost {
    float seconds; // without its share of the gather
    uint32_t candidates, evaluations;
} sgsi_tile_cost;

// Image planes of the forward pass: [height][stride], stride >= width. The depth planes may be
// NULL.
typedef struct sgsi_planes {
    int width, height;
    size_t stride;
    float *color[3], *transmittance;
    float *depth_mean, *depth_median, *depth_first, *hits;
    const sgsi_aov *aov; // more of them, or NULL
} sgsi_planes;

sgs_status sgsi_tracer_create(sgsi_tracer **tracer);
void sgsi_tracer_destroy(sgsi_tracer *tracer); // accepts NULL

// Fills records and bounds of `count` primitives for a view. visible_count / radius_max [capacity]
// may be NULL.
sgs_status sgsi_tracer_project(sgsi_tracer *tracer, const sgs_gaussians *model,
                               const sgsi_view *view, uint32_t *visible_count, float *radius_max);

// Brings the BVH to the projected bounds: refit, or build when `rebuild` or when the count changed.
sgs_status sgsi_tracer_commit(sgsi_tracer *tracer, bool rebuild, sgsi_bvh_quality quality);

// Coming forward passes write each tile's cost to costs [tiles], owned by the caller; NULL ends
// that.
void sgsi_tracer_watch_tiles(sgsi_tracer *tracer, sgsi_tile_cost *costs);

// Gathers and blends. depth_bound [tiles] or NULL: per tile the distance behind which everything
// was hidden at the last visit (INFINITY: unknown); read, then replaced. keep_lists: needed before
// a backward pass.
sgs_status sgsi_tracer_forward(sgsi_tracer *tracer, const sgsi_view *view, sgsi_planes *planes,
                               float *depth_bound, bool keep_lists);

// The same for the rows of tiles [first, last) only, without depth_bounds and lists; first and last
// are multiples of the rays' macrotile_side (last: or the end). Other pixels are left alone.
sgs_status sgsi_tracer_forward_rows(sgsi_tracer *tracer, const sgsi_view *view, sgsi_planes *planes,
                                    int first, int last);

// Gradients of the last forward pass with lists: fills sums and touched; with SGSI_GRAD_SUM_ABS if
// sgsi_tracer_collect_abs_grad was told so.
sgs_status sgsi_tracer_backward(sgsi_tracer *tracer, const sgsi_view *view,
                                const sgsi_planes *planes, float *const d_color[3],
                                float *d_transmittance);
void sgsi_tracer_collect_abs_grad(sgsi_tracer *tracer, bool wanted);

// Instead of gradients, what a density control wants to know of the last forward pass with lists:
// fills slots SGSI_SCORE_ (pipeline.h) of sums, and touched. planes: sizes only.
sgs_status sgsi_tracer_score(sgsi_tracer *tracer, const sgsi_view *view, const sgsi_planes *planes,
                             const sgsi_score_planes *score);

const float *sgsi_tracer_grad_sums(const sgsi_tracer *tracer); // [capacity][16]
const uint8_t *sgsi_tracer_touched(const sgsi_tracer *tracer); // [capacity / 16]
const uint16_t *sgsi_tracer_visible(
    const sgsi_tracer *tracer); // [capacity / 16]: bits of the rows in view (projected radius > 0)
const sgsi_bounds *sgsi_tracer_bounds(const sgsi_tracer *tracer); // [capacity]
const float *sgsi_tracer_projected(const sgsi_tracer *tracer);    // [capacity][16]
sgsi_trace_seconds sgsi_tracer_seconds(const sgsi_tracer *tracer);
sgsi_trace_counts sgsi_tracer_counts(const sgsi_tracer *tracer);
const sgsi_tile_list *
sgsi_tracer_lists(const sgsi_tracer *tracer); // [tiles], of the last forward pass that kept them
const sgsi_bvh *sgsi_tracer_bvh(const sgsi_tracer *tracer);

// Scratch of the kernels for `capacity` primitives: grows all arrays together, contents are lost.
// False when out of memory.
bool sgsi_scratch_reserve(sgsi_scratch *scratch, size_t capacity);
bool sgsi_scratch_grow(sgsi_scratch *scratch, size_t capacity); // to exactly that, without spare
void sgsi_scratch_free(sgsi_scratch *scratch);

// Fills a view from a camera's rays and a pose. options->filter_3d must be padded to a multiple of
// 16 (or NULL).
void sgsi_view_set(sgsi_view *view, const sgsi_rays *rays, const sgs_pose *pose,
                   const sgs_render_options *options);
