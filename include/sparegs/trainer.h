// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Training a model on a scene: the optimisation of 3DGS (Kerbl et al. 2023) with a ray tracer as
// renderer, its density control regulated by SPARE-GS (arXiv 2607.16624). A trainer owns the model,
// the optimiser state and the BVH. The only file it writes is a checkpoint, on request.
//
// Threads: a trainer takes one call at a time; pointers that it returns are valid until the next
// step. Different trainers may run at the same time on different threads (for a scene that they
// share, see scene.h). Results depend neither on this nor on the number of threads.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/gaussians.h"
#include "sparegs/ranks.h"
#include "sparegs/region.h"
#include "sparegs/render.h"
#include "sparegs/scene.h"

#ifdef __cplusplus
extern "C" {
#endif

// Milestones (densification, opacity resets, SH degree, learning rates) of the published schedule
// of 30 000 iterations: scaled to the length of the run, or as published. Finetune, for a trained
// model in `init`: no densification, pruning or opacity resets; all SH bands and the final learning
// rate of the positions from the first iteration.
typedef enum sgs_schedule {
    SGS_SCHEDULE_SCALED = 0,
    SGS_SCHEDULE_PAPER = 1,
    SGS_SCHEDULE_FINETUNE = 2
} sgs_schedule;
// Adam over the primitives visible in the view, without bias correction, or over all. Auto: dense
// for MCMC from 2000 iterations on and with the published schedule, else sparse.
typedef enum sgs_optimizer {
    SGS_OPTIMIZER_SPARSE = 0,
    SGS_OPTIMIZER_DENSE = 1,
    SGS_OPTIMIZER_AUTO = 2
} sgs_optimizer;
// Base pipelines: 3DGS (Kerbl et al., 2023), Mip-Splatting (Yu et al., 2024), Taming 3DGS (Mallick
// et al., 2024), DashGaussian (Chen et al., 2025), FastGS (Ren et al., 2025), 3DGS as Markov chain
// Monte Carlo (Kheradmand et al., 2024; published with the dense optimiser).
typedef enum sgs_pipeline {
    SGS_PIPELINE_3DGS = 0,
    SGS_PIPELINE_MIP = 1,
    SGS_PIPELINE_TAMING = 2,
    SGS_PIPELINE_DASH = 3,
    SGS_PIPELINE_FASTGS = 4,
    SGS_PIPELINE_MCMC = 5,
    SGS_PIPELINE_COUNT
} sgs_pipeline;
// Parts of SPARE-GS: budget-modulated densification (Eq. 23), redundancy-aware pruning (Eq. 24),
// equilibrium-driven termination (Eq. 26).
enum { SGS_SPARE_BMD = 1, SGS_SPARE_RAP = 2, SGS_SPARE_EDT = 4, SGS_SPARE_ALL = 7 };
// Terms of the regional demand: gradient H, visibility V, capacity C.
enum { SGS_DEMAND_H = 1, SGS_DEMAND_V = 2, SGS_DEMAND_C = 4, SGS_DEMAND_ALL = 7 };
typedef enum sgs_stop_reason {
    SGS_STOP_NONE = 0,
    SGS_STOP_SCHEDULE,
    SGS_STOP_EQUILIBRIUM,
    // For the caller's records; a trainer never returns these.
    SGS_STOP_SIGNAL,
    SGS_STOP_TIME_LIMIT,
    SGS_STOP_MEMORY_LIMIT
} sgs_stop_reason;

// Form of Phi in Eq. 22 of SPARE-GS, which the paper leaves open (derivation: spare/spare.c): range
// coupled to the demand, constant range, product of slack and demand, slack only.
typedef enum sgs_phi {
    SGS_PHI_COUPLED = 0,
    SGS_PHI_CONSTANT,
    SGS_PHI_PRODUCT,
    SGS_PHI_PLAIN
} sgs_phi;
// Score that SPARE-GS's weight multiplies, in pipelines with two: gradients, importance from views,
// or both. Default: both for Taming 3DGS, gradients for FastGS.
typedef enum sgs_spare_target {
    SGS_TARGET_DEFAULT = 0,
    SGS_TARGET_GRADIENT,
    SGS_TARGET_IMPORTANCE,
    SGS_TARGET_BOTH
} sgs_spare_target;

// Opacities of Taming 3DGS after densification: trained as before; frozen, as in the released code;
// or linear, as in the paper: the parameter x itself, opacity |x|, which may exceed 1.
typedef enum sgs_taming_opacity {
    SGS_TAMING_TRAINED = 0,
    SGS_TAMING_FROZEN = 1, // default
    SGS_TAMING_LINEAR = 2
} sgs_taming_opacity;

// Units of the noise and the scale loss of MCMC, which depend on the unit of length of the scene:
// EXTENT multiplies them by (5 / extent)^2 and 5 / extent to remove the dependence; WORLD, as in
// the released code, does not. Default: EXTENT.
typedef enum sgs_mcmc_units { SGS_MCMC_UNITS_EXTENT = 0, SGS_MCMC_UNITS_WORLD } sgs_mcmc_units;

// What MCMC does with primitives that SPARE-GS finds redundant: it deletes them and lowers the
// maximum number by their count, or relocates them like dead ones. Default: DELETE.
typedef enum sgs_mcmc_redundant { SGS_MCMC_DELETE = 0, SGS_MCMC_RELOCATE } sgs_mcmc_redundant;

// Options that only one pipeline reads; the others ignore them. Ranges: option_descriptors.h.
typedef struct sgs_pipeline_options {
    // Taming 3DGS: final number of primitives as a multiple of the initial number; 20.
    double taming_multiplier;
    size_t taming_count; // Taming 3DGS: final number of primitives; 0 = from the multiplier
    sgs_taming_opacity taming_opacity;
    size_t dash_count; // DashGaussian: final number of primitives; 0 = momentum-based
    // FastGS: normalised per-view error, in [0, 1], above which a pixel counts as high-error; 0.1.
    double fastgs_loss;
    // FastGS: absolute-gradient threshold for splitting; 0.0012. Schedules scale it like the
    // gradient threshold of 3DGS, 2e-4.
    double fastgs_gradient;
    double fastgs_dense; // FastGS: size, in extents of the scene, above which to split; 0.001
    // MCMC: noise on the positions, as a multiple of their learning rate; -1 = 5e5, in scaled runs
    // below 30 000 iterations less and 0 up to 7000, where the copies of a duplicated primitive
    // are jittered by their covariance instead.
    double mcmc_noise;
    double mcmc_opacity_loss; // MCMC: weight of the mean opacity in the loss; 0.01
    double mcmc_scale_loss;   // MCMC: weight of the mean scale in the loss; 0.01
    // MCMC: fraction of the primitives added per 100 iterations of the 30 000-iteration schedule;
    // 0.05. Below 30 000 iterations at most; up to 7000 only as much as reaches max_gaussians after
    // a fifth of the updates.
    double mcmc_growth;
    double mcmc_start_opacity; // MCMC: of the initial primitives; 0.5
    // MCMC: scale of the initial primitives, as a multiple of the RMS distance to the three nearest
    // points, in a run of 30 000 iterations; a scaled run of N iterations raises it to the power N
    // / 30 000. 0.1.
    double mcmc_start_scale;
    sgs_mcmc_units mcmc_units;
    sgs_mcmc_redundant mcmc_redundant;
} sgs_pipeline_options;

// The number at the end of a comment is the default. Ranges, and the pipelines that read an option:
// option_descriptors.h.
typedef struct sgs_train_options {
    size_t struct_size; // set by sgs_train_options_default()
    int iterations;     // >= 1; 30000
    sgs_schedule schedule;
    // Views per optimiser step, 1..1024; 1. A step applies the mean of the views' gradients,
    // multiplies the learning rates by the square root of the number of views, and raises the decay
    // rates of the moments to that number (Grendel-GS, Zhao et al. 2024, arXiv 2406.18533). One
    // iteration is one view. A batch ends before a structural update and at an opacity reset.
    int batch;
    sgs_pipeline pipeline;
    sgs_filter filter;       // 3DGS
    double compact_box;      // as in sgs_render_options; 1
    sgs_optimizer optimizer; // auto
    int sh_degree;           // 0..3; 3
    float background[3];     // in the space of the photos; black
    bool background_random;  // a new colour per iteration instead; false
    // Maximum number of primitives, also of the initial model; 0 = none. MCMC: 0 = 10 times the
    // initial number, at most 1 000 000 and at least the initial number.
    size_t max_gaussians;
    uint64_t seed;          // 0
    unsigned spare;         // SGS_SPARE_ bits; all
    int spare_grid;         // voxels per axis, 2..256; 32
    double spare_tau_alpha; // opacity below which a primitive may be redundant (Eq. 24); 0.05
    double spare_eps_loss;  // equilibrium: relative change of the loss (Eq. 26); 0.008
    double spare_eps_count; // equilibrium: relative change of the number of primitives; 0.01
    int spare_patience;     // consecutive checks in equilibrium before training ends; 2
    int spare_interval;     // iterations between checks in the 30 000-iteration schedule; 1000
    unsigned spare_demand;  // SGS_DEMAND_ bits; all
    sgs_phi spare_phi;
    double spare_budget; // kappa: budget of primitives as a fraction of their number; 1
    double spare_range;  // gamma_0: largest deviation of the weight from 1; 0.375
    double spare_slope;  // kappa_s: slope of the weight over the slack; 2
    // Limits of the capacity C of a region (Eq. 18), relative to the median; 0.25 and 4. 0 and 1e9
    // leave it as in the paper.
    double spare_capacity_min, spare_capacity_max;
    bool spare_rap_visible; // prune only primitives seen since the last update; false
    sgs_spare_target spare_target;
    sgs_pipeline_options pipeline_options;
    // Copied; start from it instead of the point cloud; NULL. With SGS_FILTER_MIP it is a stored
    // model, which contains the 3D filter: sgs_trainer_model begins without it. Scales below that
    // of the filter have no exact inverse; such primitives grow and keep opacity times volume.
    const sgs_gaussians *init;
    // lambda of the loss (1 - lambda) L1 + lambda (1 - SSIM) (Kerbl et al. 2023, equation 7).
    // Below 0: 0.2 as published, and up to 0.4 in scaled runs of less than 30 000 iterations on
    // high-resolution images (mean of more than 130 000 pixels) with SGS_PIPELINE_3DGS,
    // SGS_PIPELINE_MIP or SGS_PIPELINE_FASTGS; -1.
    double ssim_weight;
    // Standard deviation of the Gaussian window of that SSIM, pixels, at most 3. 0: 1.5 as
    // published, and down to 1 in the runs above; 0.
    double ssim_sigma;
    // Weight of the loss |alpha - alpha of the photo|, mean over pixels; 0 = none.
    double alpha_loss;
    // Learn an affine colour map per training image (exposure compensation of 3DGS); false.
    bool exposure;
    size_t random_points; // size of the random cloud; 0 = sgs_train_random_points
    // The alpha loss treats photos without an alpha channel as opaque: the model covers every
    // pixel that is not masked. Requires alpha_loss > 0, and works best with background_random;
    // false.
    bool opaque;
    // Train only the primitives with centres in this box; infinite. The others are rendered, but
    // not optimised, cloned, split, moved, removed or reset. Limits and counts (max_gaussians,
    // targets of pipelines, quotas and checks of SPARE-GS) exclude them. A centre that would leave
    // the box is clamped to it. All SH bands are used from the first iteration on.
    //
    // Photos are replaced by a mixture with the rendering of init, so that adjoining regions
    // together correct each error once (src/train/region_targets.c). The mixtures are kept in
    // memory in addition to the photos. Requires init; with exposure the photos are used.
    sgs_box region;
    // Fraction of the primitives that lie outside the region grid of SPARE-GS at either end of each
    // axis, at most 0.25; they belong to the outermost voxels. 0: the grid covers all primitives,
    // as in the paper. Below 0: 0, or 0.01 in runs with the noise of SGS_PIPELINE_MCMC, which moves
    // primitives far away; -1.
    double spare_grid_quantile;
    // Called while sgs_trainer_create prepares the photos of the training views, for a region or
    // SGS_PIPELINE_DASH: after every view, or NULL. If it returns false, sgs_trainer_create fails
    // with SGS_STATUS_CANCELLED.
    sgs_progress_fn progress;
    void *progress_user;
} sgs_train_options;

// Writes the defaults to a struct of `size` bytes, see status.h. Cannot fail.
SGS_API void sgs_train_options_init(sgs_train_options *options, size_t size);
static inline sgs_train_options sgs_train_options_default(void)
{
    sgs_train_options options;
    sgs_train_options_init(&options, sizeof options);
    return options;
}
// Number of random points with which a run of the scene begins, before max_gaussians: random_points
// or, if that is 0, 100 000 with SGS_SCHEDULE_PAPER and in the cube of NeRF synthetic scenes, else
// 10 000. 0 if the scene has points, or with init. options NULL = the defaults; 0 for options of an
// unknown size.
SGS_API size_t sgs_train_random_points(const sgs_scene *scene, const sgs_train_options *options);

// Value of alpha_loss that the program uses with `opaque`.
#define SGS_TRAIN_OPAQUE_WEIGHT 0.1

// Initial learning rate of the means, in extents of the scene per step.
#define SGS_TRAIN_LR_MEAN 1.6e-4

// Wall-clock seconds by phase since the start of training, including the time before a resume.
typedef struct sgs_train_seconds {
    double gather, forward, loss, backward, optimizer, bvh_refit, bvh_build, density, spare,
        image_io, total;
    double serial;  // part of total: outside of parallel loops (BVH builds and refits are parallel)
    double waiting; // part of total: wait for the last thread of each loop, mean over the threads
    double project; // part of forward: projection of the model
} sgs_train_seconds;

// Bytes moved by phase since this trainer was created: accesses to arrays of the size of the model,
// the image or the tiles' lists, each counted once. An upper estimate of the memory traffic.
typedef struct sgs_train_bytes {
    double project, bvh, gather, forward, loss, backward, optimizer, total;
    double reduce;     // part of backward
    double iterations; // number of iterations counted
    double macrotiles; // sum of the macrotiles of their images
} sgs_train_bytes;

// Result of one call of sgs_trainer_step.
typedef struct sgs_step_info {
    int iteration;       // 1-based, the iteration just completed
    size_t view;         // index into scene->views
    double loss;         // of this view; lambda: sgs_train_milestones.ssim_weight
    double loss_average; // EMA, bias-corrected
    double psnr_average; // EMA over training views, dB; unquantised image against photo
    size_t gaussians;    // after the step
    size_t visible;      // primitives with a gradient, that is a counted hit; 0 in a skipped step
    // Of this process's part of the view: primitives reported by the BVH, pairs of tile and
    // candidate, and macrotiles that were gathered again because a depth bound was too near.
    uint64_t callbacks, candidates, fallback_gathers;
    // A structural update preceded this iteration; the fields below are valid.
    bool structural;
    int structure_iteration;  // the iteration that the update belongs to, the previous one
    size_t densified;         // rows added: clones + children of splits - split parents
    size_t pruned;            // rows removed
    size_t spare_pruned;      // part of `pruned`: removed by RAP only
    size_t relocated;         // MCMC: rows moved to another row
    size_t spare_deferred;    // MCMC: redundant rows kept because of the limit per update
    size_t regions;           // non-empty voxels; 0 without SPARE-GS
    double over_budget_share; // fraction of primitives in voxels above their quota
    double mean_weight;       // mean of w over primitives
    size_t bmd_suppressed, bmd_boosted; // densification decisions that w reversed: off, on
    double spare_seconds;               // wall clock of SPARE-GS in this update
    sgs_stop_reason stop;               // always valid; other than NONE: training has ended
} sgs_step_info;

// One region (voxel with primitives) at a structural update: SPARE-GS's quantities before the
// update (Eqs. 15 to 22), and what the update did to its primitives.
typedef struct sgs_region {
    uint32_t voxel;     // (z * grid + y) * grid + x
    uint32_t count;     // n, before the update
    float gradient;     // H: mean of the mean gradients
    float visibility;   // V: mean number of views
    float demand;       // D in (0, 2]
    float capacity;     // C
    float quota;        // primitives
    float slack;        // (quota - n) / (quota + 1)
    float weight;       // w; 1 without BMD
    uint32_t densified; // primitives cloned or split
    uint32_t removed;   // by the pipeline's own rule; MCMC: relocated from here
    uint32_t redundant; // removed by RAP only
} sgs_region;

// All regions of the last structural update; none, with iteration 0, if there was no update since
// the trainer was created or loaded a checkpoint, or the last one was without SPARE-GS.
typedef struct sgs_regions {
    int iteration, grid;
    double low[3], voxel_size[3]; // lower corner of the grid and size of a voxel, world units
    size_t count;
    // [count] by ascending voxel; owned by the trainer, valid until the next step.
    const sgs_region *regions;
} sgs_regions;

typedef struct sgs_trainer sgs_trainer;

// Estimate of the memory, in bytes, needed to train this scene with `gaussians` primitives; it
// includes photos and the program itself and is not a bound. The scene's images need not be
// loaded. image_cache as in sgs_scene_options, 0 = all photos in memory. options NULL = the
// defaults. Returns 0 for options of an unknown size; cannot fail otherwise.
SGS_API size_t sgs_train_memory(const sgs_scene *scene, const sgs_train_options *options,
                                size_t image_cache, size_t gaussians);
// The same for each of several ranks that share the primitives (sgs_trainer_ranks_set), including
// the evaluation of the whole model after training. ray_limit as in sgs_trainer_ray_limit_set.
SGS_API size_t sgs_train_memory_per_rank(const sgs_scene *scene, const sgs_train_options *options,
                                         size_t image_cache, size_t gaussians, int ranks,
                                         size_t ray_limit);
// Suitable limit of the ray tables of a process that may use `memory` bytes, 0 = that of the
// machine: 1/16, at least 1 GiB. Cannot fail.
SGS_API size_t sgs_train_ray_limit(uint64_t memory);

// Creates a trainer; release it with sgs_trainer_destroy. The scene, with loaded images, must
// outlive it. Options and options->init are copied; options NULL = the defaults. Fails with
// INVALID_ARGUMENT (the error names the field), OUT_OF_MEMORY, LIMIT, UNSUPPORTED or INTERNAL
// (Embree), CANCELLED by options->progress, or as sgs_scene_photo does; *trainer is then NULL.
SGS_API sgs_status sgs_trainer_create(const sgs_scene *scene, const sgs_train_options *options,
                                      sgs_trainer **trainer);
// The same with *init, which may be NULL, in place of options->init. The trainer takes ownership of
// it instead of copying it, so that the model is in memory once, unless max_gaussians omits rows;
// *init is NULL afterwards, also after a failure.
SGS_API sgs_status sgs_trainer_create_from(const sgs_scene *scene, const sgs_train_options *options,
                                           sgs_gaussians **init, sgs_trainer **trainer);
SGS_API void sgs_trainer_destroy(sgs_trainer *trainer); // accepts NULL

// Makes this trainer one of several with the same scene and options, one per rank, that train one
// model together; NULL = alone. Call it before the first step and before loading a checkpoint;
// `ranks` must outlive the trainer. sgs_trainer_step is then collective. Every rank keeps a part of
// the rows with their moments, and traces and differentiates its own part of every image. Fails
// with OUT_OF_MEMORY, or INVALID_ARGUMENT if a rank differs from rank 0 in version, options, views,
// photos or arithmetic; the trainer can then only be destroyed. Collective.
SGS_API sgs_status sgs_trainer_ranks_set(sgs_trainer *trainer, sgs_ranks *ranks);

// Limits the memory of the process to `bytes`; 0 = no limit. A step whose structural update would
// exceed it fails with OUT_OF_MEMORY and changes nothing. image_cache as in sgs_train_memory. With
// several ranks, the limits may differ; the step fails on all of them if one exceeds its limit.
// Also lowers the limit of the ray tables to sgs_train_ray_limit(bytes). Cannot fail.
SGS_API void sgs_trainer_memory_limit_set(sgs_trainer *trainer, size_t bytes, size_t image_cache);

// Memory that the process uses besides training, for example for a viewer: `bytes`, and
// `row_bytes` per primitive. It counts against the limit. 0 and 0 by default. Cannot fail.
SGS_API void sgs_trainer_memory_reserve_set(sgs_trainer *trainer, size_t bytes, size_t row_bytes);

// Limit of the memory for ray tables, bytes; initially sgs_train_ray_limit(0). A trainer keeps the
// table of each different camera, about 10 bytes per pixel; beyond the limit, an iteration builds
// the table of its view, which takes a noticeable fraction of its time. Applies from the next
// iteration. Does not affect results. Cannot fail.
SGS_API void sgs_trainer_ray_limit_set(sgs_trainer *trainer, size_t bytes);

// Runs one iteration. The last one sets info->stop; further calls fail with LIMIT. Structural
// updates, opacity resets and changes of the image size that belong to an iteration are made by the
// next call: between calls the model is the one that the iteration trained, as the published
// trainers save it.
//
// If a photo cannot be read, the step fails as sgs_scene_photo does and may be repeated (the
// structural update may have been made: see info->structural). After any other failure call
// sgs_trainer_is_consistent; if it is false, further calls fail with INVALID_ARGUMENT.
SGS_API sgs_status sgs_trainer_step(sgs_trainer *trainer, sgs_step_info *info);
// False if a step failed after it had changed the state. Such a trainer can only load a checkpoint
// or be destroyed.
SGS_API bool sgs_trainer_is_consistent(const sgs_trainer *trainer);
// True if the last step failed with OUT_OF_MEMORY because its structural update would exceed the
// memory limit of this process or of another rank; nothing has changed. The same on all ranks.
SGS_API bool sgs_trainer_update_refused(const sgs_trainer *trainer);
// Last iteration whose structural update, if any, has been made: the last one or the one before it.
SGS_API int sgs_trainer_structure_iteration(const sgs_trainer *trainer);

// Number of primitives, of all ranks.
SGS_API size_t sgs_trainer_count(const sgs_trainer *trainer);
// Of these, the number that training may change: all, or those with centres in options.region.
SGS_API size_t sgs_trainer_trained(const sgs_trainer *trainer);
// Hash of the model, as sgs_gaussians_hash: the same on all ranks. Fails with OUT_OF_MEMORY with
// several ranks only. Collective.
SGS_API sgs_status sgs_trainer_hash(sgs_trainer *trainer, char hex[17]);
// Writes the model as sgs_ply_write, in parts; a 3D filter is applied to it before, as by
// sgs_gaussians_fuse_filter_3d, and the file is marked as antialiased. Rank 0 writes the file, and
// alone fails if that is impossible; other ranks ignore `path`. Collective.
SGS_API sgs_status sgs_trainer_write_ply(sgs_trainer *trainer, const char *path);
// The same as sgs_ply_write_filter_3d. Fails with INVALID_ARGUMENT without a 3D filter.
SGS_API sgs_status sgs_trainer_write_ply_filter_3d(sgs_trainer *trainer, const char *path);
// Writes the centres of the model and its colours of degree 0, limited to [0, 1], as
// sgs_ply_write_points: the input.ply of a run that starts from options.init. Collective, as
// sgs_trainer_write_ply.
SGS_API sgs_status sgs_trainer_write_points(sgs_trainer *trainer, const char *path);
// With several ranks, makes the two functions below return the whole model on rank 0, until the
// next step, and the rows of the rank on others; without, it does nothing. Fails with
// OUT_OF_MEMORY. Collective.
SGS_API sgs_status sgs_trainer_collect(sgs_trainer *trainer);
// The current model; owned by the trainer, valid until the next step. Structural updates change the
// order of the rows. With several ranks: see sgs_trainer_collect.
SGS_API const sgs_gaussians *sgs_trainer_model(const sgs_trainer *trainer);
// Mip-Splatting's 3D filter (Yu et al. 2024, section 5.1) of that model: [count], world units; NULL
// with other pixel filters. Owned by the trainer, valid until the next step.
SGS_API const float *sgs_trainer_filter_3d(const sgs_trainer *trainer);
// The functions below cannot fail.

// Milestones and settings that follow from the options, the number of training views, and the size
// of their photos. Iterations count from 1.
typedef struct sgs_train_milestones {
    int densify_from, densify_until, densify_interval; // structural updates; all 0 = none
    int thin_until;          // last prune-only update after densify_until; 0 = none
    int reset_interval;      // iterations between opacity resets; 0 = none
    int half_size_until;     // half-size images up to about this iteration; 0 = none
    int sh_interval;         // iterations per additional SH band; 0 = all bands at once
    double gradient_factor;  // on the pipeline's gradient threshold
    double shape_factor;     // on the published learning rates of rotation and scale
    double sh_factor;        // on that of SH above degree 0
    double opacity_factor;   // on that of opacity
    double ssim_weight;      // of 1 - SSIM in the loss
    double ssim_sigma;       // of its window, pixels
    sgs_optimizer optimizer; // SPARSE or DENSE
    size_t max_gaussians;    // the option, or the pipeline's own limit; 0 = none
} sgs_train_milestones;
SGS_API sgs_train_milestones sgs_trainer_milestones(const sgs_trainer *trainer);
SGS_API sgs_regions sgs_trainer_regions(const sgs_trainer *trainer);
SGS_API int sgs_trainer_iteration(const sgs_trainer *trainer); // completed iterations
// Colour map of a view (index into scene->views): row-major 3 x 4, mapped = A image + b; NULL for
// held-out views or without option exposure. Owned by the trainer, valid until the next step.
SGS_API const double *sgs_trainer_exposure(const sgs_trainer *trainer, size_t view);
SGS_API sgs_train_seconds sgs_trainer_seconds(const sgs_trainer *trainer);
SGS_API sgs_train_bytes sgs_trainer_bytes(const sgs_trainer *trainer);

// Updates skipped since the start of training because of non-finite values. Skipped parameters keep
// their values.
typedef struct sgs_train_skipped {
    uint64_t steps;     // whole optimiser steps: the loss was NaN or infinite
    uint64_t gradients; // single primitives within a step
} sgs_train_skipped;
SGS_API sgs_train_skipped sgs_trainer_skipped(const sgs_trainer *trainer);
// Why training ended: "schedule completed", or for an equilibrium the last changes of loss and
// count. "" before that. Owned by the trainer.
SGS_API const char *sgs_trainer_stop_text(const sgs_trainer *trainer);

// Initial point cloud, as for input.ply: returns its size, 0 if the trainer started from
// options.init. *points: [n][3], world; *colors: [n][3], 8-bit in the scene's space. Owned by the
// trainer.
SGS_API size_t sgs_trainer_initial_cloud(const sgs_trainer *trainer, const float **points,
                                         const unsigned char **colors);

// Writes the complete state to one file, atomically: parameters, moments, statistics, schedule,
// counters, options. A trainer that loads it computes the same bits as one that was never
// interrupted. Fails with IO, OUT_OF_MEMORY, or INVALID_ARGUMENT if sgs_trainer_is_consistent is
// false; an existing file is then unchanged. Collective: rank 0 writes the file, and alone fails if
// that is impossible; other ranks ignore `path`.
SGS_API sgs_status sgs_trainer_save_checkpoint(const sgs_trainer *trainer, const char *path);
// Replaces the trainer's state by that of a checkpoint. Options may differ as their resume rule
// allows (option_descriptors.h), with a warning. A run that ended in equilibrium continues only if
// one of the spare options differs, a run that completed its schedule only if `iterations` is
// larger.
//
// Fails with IO or FORMAT (damaged file), UNSUPPORTED (written by another version),
// INVALID_ARGUMENT (options or training views differ; the error names the first); the trainer is
// then unchanged. After OUT_OF_MEMORY, or an unreadable photo, see sgs_trainer_is_consistent.
// Collective: rank 0 reads the file, other ranks ignore `path`; a failure is that of all ranks, and
// their next calls fail, too.
SGS_API sgs_status sgs_trainer_load_checkpoint(sgs_trainer *trainer, const char *path);
// Validates a checkpoint file without loading it: fails as sgs_trainer_load_checkpoint would for
// this file. Not collective.
SGS_API sgs_status sgs_trainer_check_checkpoint(sgs_trainer *trainer, const char *path);
// Size in bytes of the file that sgs_trainer_save_checkpoint would write now. Cannot fail.
SGS_API size_t sgs_trainer_checkpoint_bytes(const sgs_trainer *trainer);
// Number of primitives in a checkpoint. Reads and validates the whole file without a trainer. Fails
// with IO, FORMAT, UNSUPPORTED or OUT_OF_MEMORY as sgs_trainer_load_checkpoint; *gaussians is then
// 0.
SGS_API sgs_status sgs_checkpoint_gaussians(const char *path, size_t *gaussians);

// Fine-tuning of a stored model: optimises all parameters of its primitives, with
// SGS_SCHEDULE_FINETUNE and without SPARE-GS. Fields as in sgs_train_options; the number at the end
// of a comment is the default.
typedef struct sgs_finetune_options {
    size_t struct_size; // set by sgs_finetune_options_default()
    int iterations;     // >= 1; 5000
    sgs_filter filter;  // 3DGS
    double compact_box; // 1
    float background[3];
    uint64_t seed; // 0
    // Called after every iteration, or NULL. Returning false cancels.
    bool (*progress)(void *user, const sgs_step_info *info);
    void *progress_user;
} sgs_finetune_options;

// Writes the defaults to a struct of `size` bytes, see status.h. Cannot fail.
SGS_API void sgs_finetune_options_init(sgs_finetune_options *options, size_t size);
static inline sgs_finetune_options sgs_finetune_options_default(void)
{
    sgs_finetune_options options;
    sgs_finetune_options_init(&options, sizeof options);
    return options;
}

// Trains a copy of `model` on the training views of the scene, whose images are loaded. *tuned: as
// many primitives, perhaps in another order, owned by the caller; Mip-Splatting's 3D filter is
// removed from the copy, see options.init, and fused into *tuned, as by sgs_trainer_write_ply.
// Fails as sgs_trainer_create and sgs_trainer_step, or with CANCELLED; *tuned is then NULL.
SGS_API sgs_status sgs_finetune(const sgs_gaussians *model, const sgs_scene *scene,
                                const sgs_finetune_options *options, sgs_gaussians **tuned);

#ifdef __cplusplus
}
#endif
