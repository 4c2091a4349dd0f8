// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The BVH as a measured thing: what its trees cost to build, to refit and to ask, how much of their
// answer was needed, and where in the image the work lies. Draws one view per call; writes no
// files.
//
// A packet of 16 cones of rays asks the tree for a macrotile of 2x2 tiles of 16x16 pixels; each
// primitive it names is a callback. What is left for a tile are its candidates; those are tested
// against its 16 blocks of 4x4 pixels, and a block evaluates what passes, until its pixels are
// opaque.

#include "sparegs/render.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum sgs_profile_kind {
    SGS_PROFILE_LOW,    // Morton order; every change is a rebuild
    SGS_PROFILE_MEDIUM, // binned surface-area heuristic; likewise
    SGS_PROFILE_HIGH,   // Embree's best; likewise
    SGS_PROFILE_REFIT,  // surface-area heuristic, refitted in between: what training uses
    SGS_PROFILE_AGED,   // the same after many refits
    SGS_PROFILE_KIND_COUNT
} sgs_profile_kind;

// "low", "medium", "high", "refit", "aged".
SGS_API const char *sgs_profile_kind_name(sgs_profile_kind kind);

typedef struct sgs_profile_options {
    size_t struct_size;               // set by sgs_profile_options_default()
    const sgs_render_options *render; // NULL = the defaults; filter_3d NULL, compact_box 1
    int refits;                       // age of the aged tree; 100
    double step;                      // length of an optimiser's step of the means, world units; 0
    int repeat;                       // timings are the least of so many; 3
    int samples;                      // rays followed without a tree; 64
    uint64_t seed;
} sgs_profile_options;

SGS_API sgs_profile_options sgs_profile_options_default(void);

typedef struct sgs_profile_tree {
    double build, refit; // wall-clock seconds; refit is 0 where a change is a rebuild
    double gather;       // core seconds for the view: traversal, tests, sorting of candidates
    double gather_with_depth_bound; // the same with the depth depth_bounds of an earlier visit, as
                                    // in training
    double bytes;                   // that Embree holds for the tree, by its memory monitor
    double callbacks;               // of the view
    double cost, overlap; // surface-area cost and overlap of the boxes, as bvh_cost.h defines them
} sgs_profile_tree;

typedef struct sgs_profile {
    int width, height, tiles_x, tiles_y;
    double primitives, rays; // rays: pixels with one
    sgs_profile_tree trees[SGS_PROFILE_KIND_COUNT];
    double forward; // core seconds for the view after the gather
    double noise;   // largest relative distance of a tree's two least gathers: what is not told
                    // apart; 0.1 for a single repetition
    double callbacks, candidates, block_tests, evaluations,
        block_hits; // of the view, with the refitted tree
    double listed;  // (tile, primitive) pairs with a hit
    double needed;  // (macrotile, primitive) pairs with a hit
    double hits;    // counted hits of all rays
    // Of the sampled rays, brute force over all primitives: hits until the ray stops, hits if rays
    // did not stop, share that stops; NaN without a sample.
    double sampled_hits, sampled_hits_unstopped, sampled_stopped;
    float *pixel_hits,
        *pixel_block_hits; // [height][width]: counted hits; elements kept by the pixel's block
    float *tile_candidates, *tile_evaluations, *tile_seconds; // [tiles_y][tiles_x]
} sgs_profile;

// Measures one view with the present threads and instruction set; the trees take turns, repetition
// by repetition. The aged tree was built when the means were a normal deviate of `step` *
// sqrt(`refits`) per axis away (the way of `refits` steps without a common direction) and refitted
// to the model as it is; a refit keeps the topology, so the refits in between leave no trace.
// Seconds are the least of the repetitions. render.filter_3d must be NULL. On failure *profile is
// NULL.
SGS_API sgs_status sgs_profile_view(const sgs_gaussians *model, const sgs_camera *camera,
                                    const sgs_pose *pose, const sgs_profile_options *options,
                                    sgs_profile **profile);
SGS_API void sgs_profile_destroy(sgs_profile *profile); // accepts NULL

// ---- Hardware counters, where the kernel allows them ----

typedef struct sgs_counters sgs_counters;
typedef struct sgs_counter_values {
    double cycles, instructions, cache_references, cache_misses,
        branch_misses; // -1: this machine does not count it
} sgs_counter_values;

// Opens the counters of this thread and of the threads that it starts from now on (so call it
// before anything that works in parallel), stopped at zero. NULL where the system refuses;
// sgs_last_error() says why.
SGS_API sgs_counters *sgs_counters_open(void);
SGS_API void sgs_counters_start(sgs_counters *counters);
SGS_API sgs_counter_values sgs_counters_stop(sgs_counters *counters);
SGS_API void sgs_counters_close(sgs_counters *counters); // accepts NULL

#ifdef __cplusplus
}
#endif
