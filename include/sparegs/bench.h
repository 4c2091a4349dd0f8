// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Measuring: scenes made by seed, the training iteration taken apart into its phases, and the
// limits of the machine it runs on. Trains nothing: the model is put back after every iteration.
// Writes no files.
//
// The measured iteration is the trainer's own, as it runs between two structural updates once all
// SH bands are active: project, refit, gather and blend with the depth depth_bounds of the last
// visit, loss, backward, chain rule and sparse Adam.

#include "sparegs/gaussians.h"
#include "sparegs/runtime.h"
#include "sparegs/scene.h"
#include "sparegs/trainer.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { SGS_BENCH_VIEWS = 3 };

// A scene made inside the program: surfaces covered with thin discs, a far shell, floaters; sizes
// log-normal in pixels; half of the opacities below 0.1. Views of 800x608 pixels on an arc.
typedef struct sgs_bench_scene {
    const char *name; // constant string
    sgs_gaussians *model;
    size_t view_count;
    sgs_view views[SGS_BENCH_VIEWS]; // cameras and poses; no images
} sgs_bench_scene;

// Names of the scenes ("sparse-32k", "dense-500k", "dense-2m"); NULL from the number of scenes on.
SGS_API const char *sgs_bench_scene_name(size_t index);
// What it stands for, in a sentence; NULL likewise.
SGS_API const char *sgs_bench_scene_text(size_t index);

// Makes the scene of that name; the same for every machine and number of threads. Fails with
// INVALID_ARGUMENT for an unknown name. On failure *scene is NULL.
SGS_API sgs_status sgs_bench_scene_create(const char *name, uint64_t seed, sgs_bench_scene **scene);
SGS_API void sgs_bench_scene_destroy(sgs_bench_scene *scene); // accepts NULL

// ---- One model and its views under the clock ----

// Means over the views of one repetition. Seconds are wall clock.
typedef struct sgs_bench_sample {
    double build;     // BVH from nothing
    double refit;     // BVH follows the bounds of another view
    double gather;    // traversal, tests against the tiles, sorting of candidates
    double forward;   // project, order, blend; without gather
    double backward;  // gradients per primitive, reduced; without the chain rule
    double loss;      // loss and its gradient
    double optimizer; // chain rule, statistics, Adam
    double iteration; // everything but `build`
    double project;   // part of forward: parameters to records and bounds
    double reduce;    // part of backward: sums of the tiles to sums of the primitives
    double serial;    // part of iteration: outside parallel loops
    double
        waiting; // part of iteration: mean over the threads of the wait for the last one of a loop
} sgs_bench_sample;

// Means over the views, of the last repetition.
typedef struct sgs_bench_counts {
    double primitives, pixels, tiles;
    double hits;             // counted hits of all rays (before the stop rule ends a ray)
    double gathered;         // candidates of the macrotiles: what the BVH named and may meet a tile
    double candidates;       // candidates of the tiles
    double evaluations;      // (block of 4x4 pixels, primitive) pairs evaluated in the forward pass
    double block_hits;       // pairs with a hit in some pixel
    double fallback_gathers; // macrotiles gathered again because a depth depth_bound was too near
    sgs_train_bytes bytes;   // moved, by phase
    // Floating-point operations that the formulas need, however they are computed: responses,
    // blending and gradients of the pairs above over all 16 lanes; no ordering, no bookkeeping.
    double forward_flops, backward_flops;
    // Bytes that those pairs read and write of the tile's own copies of its candidates and their
    // sums, which are larger than a first cache and live in the second.
    double forward_l2_bytes, backward_l2_bytes;
    double build_bytes; // boxes read, tree written
} sgs_bench_counts;

typedef struct sgs_bench sgs_bench;

// Copies the model and takes cameras and poses of the views (1..16; images are not needed: the
// photographs are renders with noise). Renders and trains every view once to warm up. On failure
// *bench is NULL.
SGS_API sgs_status sgs_bench_create(const sgs_gaussians *model, const sgs_view *views,
                                    size_t view_count, sgs_bench **bench);
SGS_API void sgs_bench_destroy(sgs_bench *bench); // accepts NULL

// One repetition under the present settings (sgs_threads_set, sgs_isa_set): a build, then an
// iteration per view.
SGS_API sgs_status sgs_bench_run(sgs_bench *bench, sgs_bench_sample *sample);
SGS_API sgs_bench_counts sgs_bench_counts_get(const sgs_bench *bench);

// The pieces of a repetition, for whoever wants to know what happens when: the build, an iteration
// of the next view (its times are added to *sample; as many iterations as views see each once), and
// back to the model as it was, without which the next iteration would see a moved one.
SGS_API sgs_status sgs_bench_build(sgs_bench *bench, sgs_bench_sample *sample);
SGS_API sgs_status sgs_bench_step(sgs_bench *bench, sgs_bench_sample *sample);
SGS_API void sgs_bench_restore(sgs_bench *bench);

// ---- How far it scales ----

typedef struct sgs_scaling {
    double seconds, serial,
        waiting;  // wall clock of some iterations: all, outside loops, waiting inside
    double bytes; // moved in them
    int threads;  // they ran on
    int cores;    // that these had; 0 = one each
    // Part of seconds that goes macrotile by macrotile (gather and forward), and how many
    // macrotiles a view has: more cores than that have nothing to do then. 0 = cut as fine as one
    // likes.
    double macrotile_seconds, macrotiles;
} sgs_scaling;

// Predicted speed-up of `cores` over one core with `memory_gbs` 10^9 bytes per second for all of
// them: the work, (seconds - serial - waiting) * threads (or the cores these had, if fewer), is
// shared evenly, that of the macrotiles in whole macrotiles, but never faster than the memory
// delivers the bytes; the serial part stays (Amdahl). 1 for times that are not positive.
SGS_API double sgs_scaling_predict(const sgs_scaling *scaling, int cores, double memory_gbs);

// ---- What the machine can do ----

typedef struct sgs_machine_limits {
    double tsc_ghz;    // time-stamp counter; 0 where there is none
    double fma_gflops; // per core: fused multiply-adds in registers, two operations each
    double l2_gbs;     // per core: loads from a buffer of half the L2 cache, 10^9 bytes per second
    double memory_gbs; // all threads together: the best of reading and of updating in place (read +
                       // written bytes)
    double memory_read_gbs, memory_update_gbs;
    size_t l2_bytes;
} sgs_machine_limits;

// Measures with the present instruction set and number of threads; takes about a second and 64 MB
// per thread (at least 256 MB). Fails with OUT_OF_MEMORY.
SGS_API sgs_status sgs_machine_limits_measure(sgs_machine_limits *limits);

#ifdef __cplusplus
}
#endif
