// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Benchmarks: synthetic scenes generated from a seed, the phases of a training iteration, and the
// machine peaks. Does not train: the model is restored after each iteration. Writes no
// files.
//
// The measured iteration is the trainer's own, between two structural updates and with all SH bands
// active: project, refit, gather and blend with the depth bounds of the previous visit, loss,
// backward, chain rule and sparse Adam.
//
// Measurement header: an application that renders or trains does not need it. Threads: one call at
// a time in the whole process, because other calls would disturb the times.

#include "sparegs/gaussians.h"
#include "sparegs/ranks.h"
#include "sparegs/render.h"
#include "sparegs/runtime.h"
#include "sparegs/scene.h"
#include "sparegs/trainer.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { SGS_BENCH_VIEWS = 3 };

// A synthetic scene: surfaces covered with thin discs, a distant shell, floaters; sizes log-normal
// in pixels; half of the opacities below 0.1. Views on an arc, of 800x608 pixels or larger.
typedef struct sgs_bench_scene {
    const char *name; // constant string
    sgs_gaussians *model;
    size_t view_count;
    sgs_view views[SGS_BENCH_VIEWS]; // cameras and poses; no images
} sgs_bench_scene;

// Name of scene `index` ("sparse-32k", "dense-500k", ...); NULL beyond the last scene.
SGS_API const char *sgs_bench_scene_name(size_t index);
// Description of scene `index` in a sentence; NULL beyond the last scene.
SGS_API const char *sgs_bench_scene_text(size_t index);
// True if scene `index` takes minutes or gigabytes, so that a benchmark of all scenes omits it.
SGS_API bool sgs_bench_scene_by_name_only(size_t index);

// Creates the scene of that name, the same on all machines and for any number of threads. Fails
// with INVALID_ARGUMENT for an unknown name, or with OUT_OF_MEMORY; *scene is then NULL.
SGS_API sgs_status sgs_bench_scene_create(const char *name, uint64_t seed, sgs_bench_scene **scene);
SGS_API void sgs_bench_scene_destroy(sgs_bench_scene *scene); // accepts NULL

// ---- Timing of a model ----

// Means over the views of one repetition, in wall-clock seconds.
typedef struct sgs_bench_sample {
    double build;      // BVH build
    double rank_build; // build of the BVH of a rank, of lower quality; 0 = not measured
    double refit;      // BVH refit to the bounds of another view
    double gather;     // traversal, tests against the tiles, sorting of candidates
    double forward;    // project, order, blend; without gather
    double backward;   // gradients per primitive, reduced; without the chain rule
    double loss;       // loss and its gradient
    double optimizer;  // chain rule, statistics, Adam
    double iteration;  // all but `build`
    double project;    // part of forward: parameters to projected records and bounds
    double reduce;     // part of backward: sums of the tiles to sums of the primitives
    double serial;     // part of iteration: outside of parallel loops
    // Part of iteration: wait for the last thread of each loop, mean over the threads.
    double waiting;
} sgs_bench_sample;

// Means over the views of the last repetition.
typedef struct sgs_bench_counts {
    double primitives, pixels, tiles;
    double hits;     // counted hits of all rays, that is before early termination
    double gathered; // candidates of the macrotiles: reported by the BVH, may hit one of the tiles
    double candidates;       // candidates of the tiles
    double evaluations;      // (4x4 block, primitive) pairs evaluated in the forward pass
    double block_hits;       // those of them with a hit that counts or ends a ray
    double fallback_gathers; // macrotiles gathered again because a depth bound was too near
    sgs_train_bytes bytes;   // bytes moved, by phase
    // Floating-point operations of the formulas over all 16 lanes of the pairs above: responses,
    // blending and gradients, without sorting and bookkeeping.
    double forward_flops, backward_flops;
    // Bytes that these pairs read and write of the tile's copies of projected records and sums,
    // which exceed a typical L1 cache and fit in L2.
    double forward_l2_bytes, backward_l2_bytes;
    double build_bytes; // boxes read, tree written
} sgs_bench_counts;

typedef struct sgs_bench sgs_bench;

// Copies the model and the cameras and poses of the views (1 to 16). Images are not required: the
// photos are renders with noise. Renders and trains every view once to warm up. Fails with
// INVALID_ARGUMENT (number of views, empty model), or as sgs_renderer_render, sgs_trainer_create
// and sgs_trainer_step do; *bench is then NULL.
SGS_API sgs_status sgs_bench_create(const sgs_gaussians *model, const sgs_view *views,
                                    size_t view_count, sgs_bench **bench);
// The same for a model that is rendered with the filter, near_distance and compact_box of `options`
// (NULL = the defaults). Other members have no effect; filter_3d must be NULL. Also fails with
// INVALID_ARGUMENT (options) or UNSUPPORTED (filter_3d).
SGS_API sgs_status sgs_bench_create_with(const sgs_gaussians *model, const sgs_view *views,
                                         size_t view_count, const sgs_render_options *options,
                                         sgs_bench **bench);
SGS_API void sgs_bench_destroy(sgs_bench *bench); // accepts NULL

// One repetition with the current settings (sgs_threads_set, sgs_isa_set): a build, then an
// iteration per view. *sample is overwritten. Fails as sgs_trainer_step.
SGS_API sgs_status sgs_bench_run(sgs_bench *bench, sgs_bench_sample *sample);
// Counts of the last repetition. Cannot fail.
SGS_API sgs_bench_counts sgs_bench_counts_get(const sgs_bench *bench);

// The steps of a repetition, for measurements in between. _build builds the BVH and sets
// sample->build. _step runs an iteration of the next view and adds its times to *sample; as many
// steps as views visit each view once. Both fail as sgs_trainer_step. _restore restores the model,
// so that the next step does the same work; it cannot fail. _rank_build sets sample->rank_build: it
// builds a BVH over all primitives as a rank does, which builds one per view instead of refitting
// it. Call it after _run or _step. Fails as sgs_trainer_step.
SGS_API sgs_status sgs_bench_build(sgs_bench *bench, sgs_bench_sample *sample);
SGS_API sgs_status sgs_bench_rank_build(sgs_bench *bench, sgs_bench_sample *sample);
SGS_API sgs_status sgs_bench_step(sgs_bench *bench, sgs_bench_sample *sample);
SGS_API void sgs_bench_restore(sgs_bench *bench);

// ---- Scaling ----

typedef struct sgs_scaling {
    // Wall clock of some iterations: total, outside of parallel loops, waiting inside of them.
    double seconds, serial, waiting;
    double bytes; // bytes moved in these iterations
    int threads;  // threads used
    int cores;    // cores available to them; 0 = one each
    // Part of `seconds` with macrotiles as work items (gather, order and blend), and the number of
    // macrotiles of a view, which limits the number of busy cores. macrotiles 0 = arbitrarily
    // divisible.
    double macrotile_seconds, macrotiles;
} sgs_scaling;

// Predicted speed-up of `cores` over one core, with a total bandwidth of `memory_gbs` (10^9 bytes
// per second). The work, (seconds - serial - waiting) * threads (or the cores they had, if fewer),
// is divided evenly, that of macrotiles in whole macrotiles, but takes at least the time to move
// the bytes. The serial part remains (Amdahl's law). Omitted are the waits at the ends of other
// loops, of which the backward pass has two per 2^14 slots of each thread, one slot per (tile,
// primitive): its tiles and buckets of primitives are the work items. 1 if the times are not
// positive.
SGS_API double sgs_scaling_predict(const sgs_scaling *scaling, int cores, double memory_gbs);

// ---- Several machines ----

// Collective calls of one purpose in an iteration on several ranks: totals over the ranks, and the
// largest values of a single rank. Means over the views.
typedef struct sgs_rank_call {
    double calls, messages, bytes; // sent by all ranks; calls: of each rank
    double max_messages;           // sent by one rank
    double max_bytes;              // sent or received by one rank, whichever is more
} sgs_rank_call;

typedef struct sgs_rank_prediction {
    int ranks;
    sgs_rank_call calls[SGS_RANKS_PURPOSE_COUNT];
    double balance;    // mean work of a rank divided by the largest, from 1 / ranks to 1
    double primitives; // largest number of projected records on one rank
    double traced;     // primitives in view, whose records are sent
    double hit;        // primitives with a hit that counts or ends a ray, whose gradients are sent
} sgs_rank_prediction;

// Predicts the messages of ranks[i] ranks (2 to 1024) into predictions[count], from the lists of an
// iteration per view: bytes and messages are those that these ranks would count
// (sgs_ranks_traffic_get) with images divided by the costs of the previous visit. Call after
// sgs_bench_run. Fails with INVALID_ARGUMENT or OUT_OF_MEMORY.
SGS_API sgs_status sgs_bench_ranks(sgs_bench *bench, const int *ranks, size_t count,
                                   sgs_rank_prediction *predictions);

// Seconds of communication per iteration without overlap: for each call the messages of the rank
// with the most times `latency` (seconds), plus its bytes divided by `bandwidth` (bytes per second,
// in each direction). Headers, which are gathered, take log2(ranks) rounds (Thakur, Rabenseifner
// and Gropp 2005, section 4.1).
SGS_API double sgs_rank_seconds(const sgs_rank_prediction *prediction, double latency,
                                double bandwidth);

// ---- Machine peaks ----

typedef struct sgs_machine_limits {
    double tsc_ghz;    // time-stamp counter; 0 if unavailable
    double fma_gflops; // per core: fused multiply-adds in registers, two operations each
    double l2_gbs;     // per core: loads from a buffer of half the L2 size, 10^9 bytes per second
    // All threads: the larger of memory_read_gbs and memory_update_gbs (update in place, read +
    // written bytes).
    double memory_gbs;
    double memory_read_gbs, memory_update_gbs;
    size_t l2_bytes;
} sgs_machine_limits;

// Measures with the current instruction set and number of threads. Takes about a second and 64 MB
// per thread (at least 256 MB). Fails with OUT_OF_MEMORY.
SGS_API sgs_status sgs_machine_limits_measure(sgs_machine_limits *limits);

#ifdef __cplusplus
}
#endif
