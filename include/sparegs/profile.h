// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// BVH profiles: the cost to build, refit and query each kind of tree, the fraction of the results
// that leads to hits, and the distribution of the work over the image. One view per call; writes no
// files.
//
// A packet of 16 cone rays queries the tree for a macrotile of tiles of 16x16 pixels (2x2 tiles;
// one tile in small images). Each reported primitive is a callback. After filtering, a tile has
// candidates. They are tested against its 16 blocks of 4x4 pixels, and each block evaluates those
// that pass until its pixels are opaque.
//
// Measurement header: an application that renders or trains does not need it. Threads: one call at
// a time in the whole process, because other calls would disturb the times.

#include "sparegs/render.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum sgs_profile_kind {
    SGS_PROFILE_LOW,    // Morton order; rebuilt on every change
    SGS_PROFILE_MEDIUM, // binned surface-area heuristic; rebuilt on every change
    SGS_PROFILE_HIGH,   // Embree's highest quality; rebuilt on every change
    SGS_PROFILE_REFIT,  // surface-area heuristic, refitted between rebuilds, as in training
    SGS_PROFILE_AGED,   // the same after many refits
    SGS_PROFILE_KIND_COUNT
} sgs_profile_kind;

// "low", "medium", "high", "refit", "aged".
SGS_API const char *sgs_profile_kind_name(sgs_profile_kind kind);

typedef struct sgs_profile_options {
    size_t struct_size;               // set by sgs_profile_options_default()
    const sgs_render_options *render; // NULL = the defaults; filter_3d NULL, compact_box 1
    int refits;                       // number of refits of the aged tree, >= 0; 100
    double step;                      // length of a step of the means, world units, >= 0; 0
    int repeat;                       // repetitions, >= 1; the best time is reported; 3
    int samples;                      // rays sampled by brute force, 0..4096; 64
    uint64_t seed;
    // Pose of the view that the REFIT and AGED trees are built for before they are refitted to the
    // profiled one, as a tree of training is; same camera. NULL = the profiled pose.
    const sgs_pose *built_for;
} sgs_profile_options;

// Writes the defaults to a struct of `size` bytes, see status.h. Cannot fail.
SGS_API void sgs_profile_options_init(sgs_profile_options *options, size_t size);
static inline sgs_profile_options sgs_profile_options_default(void)
{
    sgs_profile_options options;
    sgs_profile_options_init(&options, sizeof options);
    return options;
}

typedef struct sgs_profile_tree {
    double build, refit; // wall-clock seconds; refit is 0 for kinds that are rebuilt
    double gather;       // CPU seconds for the view: traversal, tests, sorting of candidates
    // The same with the depth bounds of a previous visit, as in training.
    double gather_with_depth_bound;
    double bytes; // held by Embree for the tree, from its memory monitor
    // Primitives reported by the tree for the view, summed over the macrotiles. Embree splits a
    // packet that is wider than the native packets of the processor, or whose rays diverge, and
    // then reports primitives more than once; `distinct` counts them once per macrotile.
    double callbacks, distinct;
    // Of a tree built over the same boxes with the same settings, because Embree does not expose
    // its trees (bvh_cost.h): surface-area cost and overlap of the boxes; nodes with the leaves;
    // levels; leaves with 0, 1, ... 7 primitives; nodes that the packets of the view visit, boxes
    // that they test.
    double cost, overlap, nodes, leaves, depth, leaf_sizes[8], node_visits, box_tests;
} sgs_profile_tree;

typedef struct sgs_profile {
    int width, height, tiles_x, tiles_y;
    double primitives, rays; // rays: pixels with a ray
    // Primitives that rays of the view may hit; those of the others have degenerate (point) boxes.
    double traced;
    sgs_profile_tree trees[SGS_PROFILE_KIND_COUNT];
    double forward; // CPU seconds for the view after the gather
    // Largest relative difference of a tree's two best gather times; smaller differences are noise.
    // NaN for a single repetition, which gives no estimate.
    double noise;
    // For the view, with the refitted tree. gathered: distinct callbacks that may hit a tile of
    // their macrotile; candidates: pairs of such a primitive and a tile that it may hit.
    double callbacks, distinct, gathered, candidates, block_tests, evaluations;
    // (block, primitive), (tile, primitive) and (macrotile, primitive) pairs with a hit that counts
    // or ends a ray
    double block_hits;
    double tile_hits;
    double macrotile_hits;
    double hits; // counted hits of all rays
    // Means over the sampled rays, by brute force: hits until termination, hits without
    // termination, fraction of terminated rays. NaN without samples.
    double sampled_hits, sampled_hits_unterminated, sampled_terminated;
    // [height][width]: counted hits; block hits of the pixel's block.
    float *pixel_hits, *pixel_block_hits;
    float *tile_candidates, *tile_evaluations, *tile_seconds; // [tiles_y][tiles_x]
} sgs_profile;

// Profiles one view with the current threads and instruction set. The kinds alternate between
// repetitions; times are the best of the repetitions. The aged tree is built with the means
// displaced by a normal deviate of `step` * sqrt(`refits`) per axis (a random walk of `refits`
// steps) and then refitted to the model. Refits keep the topology, so one refit gives the same tree
// as many. Embree computes the costs on threads of its own, as many as sgs_threads_get, or as many
// as the CPU has cores while the program has a renderer or a trainer. Fails with INVALID_ARGUMENT
// (options, sgs_camera_validate, sgs_pose_validate), UNSUPPORTED (a lens without rays, filter_3d,
// compact_box), OUT_OF_MEMORY or INTERNAL (Embree); *profile is then NULL.
SGS_API sgs_status sgs_profile_view(const sgs_gaussians *model, const sgs_camera *camera,
                                    const sgs_pose *pose, const sgs_profile_options *options,
                                    sgs_profile **profile);
SGS_API void sgs_profile_destroy(sgs_profile *profile); // accepts NULL

// ---- Hardware counters, if the kernel permits them ----

typedef struct sgs_counters sgs_counters;
typedef struct sgs_counter_values {
    // -1: not counted by this machine.
    double cycles, instructions, cache_references, cache_misses, branch_misses;
} sgs_counter_values;

// Opens the counters of this thread and of threads it starts later, so call it before any parallel
// work. The counters are stopped at zero. Returns NULL if unavailable; sgs_last_error() gives the
// reason.
SGS_API sgs_counters *sgs_counters_open(void);
SGS_API void sgs_counters_start(sgs_counters *counters);
SGS_API sgs_counter_values sgs_counters_stop(sgs_counters *counters);
SGS_API void sgs_counters_close(sgs_counters *counters); // accepts NULL

#ifdef __cplusplus
}
#endif
