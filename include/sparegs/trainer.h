// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Training a model on a scene: the 3DGS loop on the ray tracer, with SPARE-GS regulating its
// structure. A trainer owns the model, the optimiser state and the BVH. Writes files only when
// asked.
//
// Threads: a trainer takes one call at a time; what it returns by pointer is valid until the next
// step. Different trainers may run at the same time on different threads (for a common scene see
// scene.h). Results depend neither on that nor on the number of threads.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/gaussians.h"
#include "sparegs/render.h"
#include "sparegs/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum sgs_schedule { SGS_SCHEDULE_SCALED = 0, SGS_SCHEDULE_PAPER = 1 } sgs_schedule;
typedef enum sgs_optimizer { SGS_OPTIMIZER_SPARSE = 0, SGS_OPTIMIZER_DENSE = 1 } sgs_optimizer;
// Base pipelines: 3DGS (Kerbl et al., 2023), Mip-Splatting (Yu et al., 2024), Taming 3DGS (Mallick
// et al., 2024), DashGaussian (Chen et al., 2025), FastGS (Ren et al., 2025).
typedef enum sgs_pipeline {
    SGS_PIPELINE_3DGS = 0,
    SGS_PIPELINE_MIP = 1,
    SGS_PIPELINE_TAMING = 2,
    SGS_PIPELINE_DASH = 3,
    SGS_PIPELINE_FASTGS = 4,
    SGS_PIPELINE_COUNT
} sgs_pipeline;
enum { SGS_SPARE_BMD = 1, SGS_SPARE_RAP = 2, SGS_SPARE_EDT = 4, SGS_SPARE_ALL = 7 };
enum { SGS_DEMAND_H = 1, SGS_DEMAND_V = 2, SGS_DEMAND_C = 4, SGS_DEMAND_ALL = 7 };
typedef enum sgs_stop_reason {
    SGS_STOP_NONE = 0,
    SGS_STOP_SCHEDULE,
    SGS_STOP_EQUILIBRIUM,
    SGS_STOP_SIGNAL,
    SGS_STOP_TIME_LIMIT,
    SGS_STOP_MEMORY_LIMIT
} sgs_stop_reason; // from SIGNAL on: the caller's

// The bounded sigmoid of SPARE-GS, which the paper leaves open: see spare/spare.c. Coupled to the
// demand, constant range, product of slack and demand, slack alone.
typedef enum sgs_phi {
    SGS_PHI_COUPLED = 0,
    SGS_PHI_CONSTANT,
    SGS_PHI_PRODUCT,
    SGS_PHI_PLAIN
} sgs_phi;
// Which score SPARE-GS's weight multiplies, where a pipeline has two: gradients, the importance
// from views, both; default is both for Taming 3DGS, gradients for FastGS.
typedef enum sgs_spare_target {
    SGS_TARGET_DEFAULT = 0,
    SGS_TARGET_GRADIENT,
    SGS_TARGET_IMPORTANCE,
    SGS_TARGET_BOTH
} sgs_spare_target;

// What becomes of Taming 3DGS's opacities when densification is over: they go on as before; stay as
// they are; become parameters themselves, |x| instead of a logistic function, and may exceed 1.
typedef enum sgs_taming_opacity {
    SGS_TAMING_TRAINED = 0,
    SGS_TAMING_FROZEN = 1, // default, as in the released code
    SGS_TAMING_LINEAR = 2
} sgs_taming_opacity;

// What only one of the pipelines looks at.
typedef struct sgs_pipeline_options {
    double taming_multiplier;          // final count as a multiple of the initial one; 20
    size_t taming_count;               // final count; 0 = by the multiplier
    sgs_taming_opacity taming_opacity; // frozen, as in the released code
    size_t dash_count;                 // final count; 0 = by momentum
    double fastgs_loss;     // share of the range of a view's error above which a pixel counts; 0.1
    double fastgs_gradient; // threshold of the absolute gradient that splits, at full length: the
                            // schedule scales it as it scales 2e-4; 0.0012
    double fastgs_dense;    // scales above this share of the extent are split, below cloned; 0.001
} sgs_pipeline_options;

typedef struct sgs_train_options {
    size_t struct_size;      // set by sgs_train_options_default()
    int iterations;          // >= 1; 30000
    sgs_schedule schedule;   // scaled
    sgs_pipeline pipeline;   // 3dgs
    sgs_filter filter;       // 3dgs
    double compact_box;      // as in sgs_render_options; 1
    sgs_optimizer optimizer; // sparse
    int sh_degree;           // 0..3; 3
    float background[3];     // black
    bool background_random;  // a new colour per iteration instead
    size_t max_gaussians;    // hard cap; 0 = none
    uint64_t seed;           // 0
    unsigned spare;          // SGS_SPARE_ bits; all
    int spare_grid;          // voxels per axis, 2..256; 32
    double spare_tau_alpha;  // 0.05
    double spare_eps_loss;   // 0.008
    double spare_eps_count;  // 0.01
    int spare_patience;      // 2
    int spare_interval;      // iterations of the 30 000-iteration schedule between two equilibrium
                             // checks; 1000
    unsigned spare_demand;   // SGS_DEMAND_ bits; all
    sgs_phi spare_phi;       // coupled
    double spare_budget;     // kappa: budget of primitives as a share of their number; 1
    sgs_spare_target spare_target; // default
    sgs_pipeline_options pipeline_options;
    const sgs_gaussians *init; // start from this model (copied) instead of the point cloud; NULL
    double alpha_loss; // weight of the loss that draws opacity towards an alpha channel; 0 = none
    bool exposure;     // learn an affine map of colours per training image (3DGS's exposure
                       // compensation)
    size_t random_points; // size of the random cloud when the scene has no points; 100000
} sgs_train_options;

SGS_API sgs_train_options sgs_train_options_default(void);

// The first learning rate of the means, in extents of the scene.
#define SGS_TRAIN_LR_MEAN 1.6e-4

// Seconds of wall clock by phase, since the start of the training.
typedef struct sgs_train_seconds {
    double gather, forward, loss, backward, optimizer, bvh_refit, bvh_build, density, spare,
        image_io, total;
    double serial;  // part of total: outside parallel loops (the BVH's builds and refits are such)
    double waiting; // part of total: in parallel loops, mean over the threads of the wait for the
                    // last one
} sgs_train_seconds;

// Bytes moved by phase, since the start of this process's part of the training: what streams
// through arrays as large as the model, the image or the lists of the tiles, each access once. An
// estimate of the traffic to memory from above.
typedef struct sgs_train_bytes {
    double project, bvh, gather, forward, loss, backward, optimizer, total;
    double reduce;     // part of backward
    double iterations; // that were counted
    double macrotiles; // pieces that their forward passes were cut into, all together
} sgs_train_bytes;

// What one call of sgs_trainer_step did.
typedef struct sgs_step_info {
    int iteration;       // 1-based, the iteration just done
    size_t view;         // index into scene->views
    double loss;         // 0.8 L1 + 0.2 (1 - SSIM) of this view
    double loss_average; // EMA, bias-corrected
    double psnr_average; // EMA of the training views' PSNR (float image against the photo), dB
    size_t gaussians;    // after the step
    // Primitives with a gradient in this step: some ray counts a hit of them. 0 in a skipped step.
    size_t visible;
    bool structural; // a structural update came before this iteration: the next fields are valid
    int structure_iteration; // the iteration that it belongs to, the one before
    size_t densified, pruned,
        spare_pruned; // rows added (clones + split children - split parents), removed, removed by
                      // RAP alone
    size_t regions;   // non-empty voxels (0 when SPARE-GS is off)
    double over_budget_share; // share of primitives in voxels over their quota
    double mean_weight;       // mean w over primitives
    size_t bmd_suppressed,
        bmd_boosted;      // primitives whose densification decision w reversed (off, on)
    double spare_seconds; // of this update
    sgs_stop_reason stop; // other than NONE: training is over
} sgs_step_info;

// What SPARE-GS held of one region (voxel with primitives) at a structural update, and what became
// of its primitives.
typedef struct sgs_region {
    uint32_t voxel;     // (z * grid + y) * grid + x
    uint32_t count;     // n, before the update
    float gradient;     // H: mean of the mean gradients
    float visibility;   // V: mean number of views
    float demand;       // D in (0, 2]
    float capacity;     // C
    float quota;        // primitives
    float slack;        // (quota - n) / (quota + 1)
    float weight;       // w, 1 without BMD
    uint32_t densified; // primitives cloned or split
    uint32_t removed;   // by the pipeline's own rule
    uint32_t redundant; // by RAP alone
} sgs_region;

// All regions of the last structural update with SPARE-GS.
typedef struct sgs_regions {
    int iteration, grid;    // iteration 0: there was none yet
    double low[3], cell[3]; // corner of the grid and size of a voxel, world units
    size_t count;
    const sgs_region
        *regions; // [count] ascending voxel; owned by the trainer, valid until the next step
} sgs_regions;

typedef struct sgs_trainer sgs_trainer;

// About how many bytes a training of this scene takes at `gaussians` primitives, photographs and
// the program itself included: a rule of thumb, not a bound. The scene's images need not be loaded.
// Cannot fail. image_cache as in sgs_scene_options, 0 = none.
SGS_API size_t sgs_train_memory(const sgs_scene *scene, const sgs_train_options *options,
                                size_t image_cache, size_t gaussians);

// The scene (with loaded images) must outlive the trainer. Options are copied. On failure *trainer
// is NULL. Fails with INVALID_ARGUMENT (names the option) when an option is out of range.
SGS_API sgs_status sgs_trainer_create(const sgs_scene *scene, const sgs_train_options *options,
                                      sgs_trainer **trainer);
SGS_API void sgs_trainer_destroy(sgs_trainer *trainer); // accepts NULL

// Keeps the process below `bytes`, 0 = no limit: a step whose structural update may need more fails
// with OUT_OF_MEMORY before it changes anything, and the trainer stays whole. image_cache as in
// sgs_train_memory. Cannot fail.
SGS_API void sgs_trainer_memory_limit_set(sgs_trainer *trainer, size_t bytes, size_t image_cache);

// One iteration. After the last one info->stop is set; further calls fail with LIMIT. What the base
// pipeline does to the structure after an iteration (updates, opacity resets, another resolution)
// waits for the next call: between calls the model is the one the iteration left, as the published
// trainers save it. Where a photograph cannot be read any more the trainer stays whole, and the
// step may be tried again (the update may have been made: info->structural tells); after another
// failure further calls fail with INVALID_ARGUMENT unless sgs_trainer_is_consistent.
SGS_API sgs_status sgs_trainer_step(sgs_trainer *trainer, sgs_step_info *info);
// False when the last step failed half-way: there is no state to save or to go on from.
SGS_API bool sgs_trainer_is_consistent(const sgs_trainer *trainer);
// The last iteration whose structural update, if it has one, is made: the last one or the one
// before.
SGS_API int sgs_trainer_structure_iteration(const sgs_trainer *trainer);

// The model as it stands; owned by the trainer, invalidated by the next step. Row order changes at
// structural updates.
SGS_API const sgs_gaussians *sgs_trainer_model(const sgs_trainer *trainer);
// Mip-Splatting's 3D filter of that model, [count], world units; NULL with another pixel filter.
// Owned by the trainer.
SGS_API const float *sgs_trainer_filter_3d(const sgs_trainer *trainer);
SGS_API sgs_regions sgs_trainer_regions(const sgs_trainer *trainer);
SGS_API int sgs_trainer_iteration(const sgs_trainer *trainer);
// The colour map of a training view, row-major 3 x 4 (mapped = A image + b), owned by the trainer;
// NULL when none is learned.
SGS_API const double *sgs_trainer_exposure(const sgs_trainer *trainer, size_t view);
SGS_API sgs_train_seconds sgs_trainer_seconds(const sgs_trainer *trainer);
SGS_API sgs_train_bytes sgs_trainer_bytes(const sgs_trainer *trainer);

// What was left out because it was not finite, since the start of the training; the parameters
// stayed as they were.
typedef struct sgs_train_skipped {
    uint64_t steps;     // whole optimiser steps: the loss was NaN or infinite
    uint64_t gradients; // single primitives within a step
} sgs_train_skipped;
SGS_API sgs_train_skipped sgs_trainer_skipped(const sgs_trainer *trainer);
// In words, why training ended ("loss changed 0.5 %, count 0.2 % in two checks"); "" before that.
// Owned by the trainer.
SGS_API const char *sgs_trainer_stop_text(const sgs_trainer *trainer);

// Number of primitives the trainer started from, and a copy of the initial cloud for input.ply
// (points [n][3], colours [n][3]), owned by the trainer.
SGS_API size_t sgs_trainer_initial_cloud(const sgs_trainer *trainer, const float **points,
                                         const unsigned char **colors);

// The whole state (parameters, moments, statistics, schedule, counters, options) to one file,
// atomically, and back: training goes on with the same bits as if it had never stopped. Save fails
// with IO or OUT_OF_MEMORY; an earlier file at `path` stays. Load replaces the trainer's state, or
// fails and leaves it as it was: with IO or FORMAT when the file is damaged, UNSUPPORTED when
// another version wrote it, INVALID_ARGUMENT when options or training views differ; the error names
// what differs. Options may differ as their resume rule allows (option_descriptors.h), with a
// warning. A state that ended in equilibrium is over until one of the spare fields differs, one
// that ended with its schedule until `iterations` is larger.
SGS_API sgs_status sgs_trainer_save_checkpoint(const sgs_trainer *trainer, const char *path);
SGS_API sgs_status sgs_trainer_load_checkpoint(sgs_trainer *trainer, const char *path);
// Size of the file that sgs_trainer_save_checkpoint would write now. Cannot fail.
SGS_API size_t sgs_trainer_checkpoint_bytes(const sgs_trainer *trainer);
// Number of primitives in a checkpoint, without a trainer. Reads and proves the whole file; fails
// as load does when it is damaged or of another version, and *gaussians is 0.
SGS_API sgs_status sgs_checkpoint_gaussians(const char *path, size_t *gaussians);

#ifdef __cplusplus
}
#endif
