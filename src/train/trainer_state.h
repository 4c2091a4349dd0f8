// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The state of a trainer, and the functions on it. Calls go one way: trainer.c runs the iterations
// and calls all others; checkpoint.c, trainer_structure.c and trainer_optimize.c call
// trainer_model.c.

#include "density/density.h"
#include "density/pipeline.h"
#include "density/resolution.h"
#include "density/schedule.h"
#include "optimize/numerics.h"
#include "spare/spare.h"
#include "sparegs/trainer.h"
#include "train/train_view.h"
#include "train/view_scores.h"

// What the first model was made from.
typedef enum sgsi_train_start {
    SGSI_START_UNKNOWN, // in old checkpoints
    SGSI_START_GIVEN,   // options.init or the points of the scene
    SGSI_START_RANDOM,  // a random cloud
} sgsi_train_start;

// State of a run besides its arrays; part of checkpoints.
typedef struct sgsi_train_progress {
    int32_t iteration;  // completed
    int32_t adam_step;  // optimiser steps made (bias correction of dense Adam)
    int32_t last_reset; // iteration of the last opacity reset, -1 = none
    int32_t disturbed;  // losses are not comparable with those before: update, reset, image size
    uint32_t order_position, order_epoch; // of the view permutation
    int32_t stop;                         // sgs_stop_reason
    int32_t updates;                      // structural updates made
    int32_t rest_step;           // as adam_step, for SH bands above 0 if they step separately
    int32_t resolution;          // current down-scaling of the images; 0 = it never changes
    int32_t batch_views;         // views whose gradients wait for the step of their batch
    int32_t structure_iteration; // last iteration whose update, reset and resolution are applied
    int32_t start;               // sgsi_train_start; the schedule depends on it
    sgsi_pipeline_state pipeline;
    double loss_average, loss_weight; // for the progress line
    double psnr_average, psnr_weight;
    double near_limit; // of sgsi_trainer_near_depth, by the points (near_depth.h); 0 = none
    spare_equilibrium equilibrium;
    sgsi_skipped skipped;
    sgs_train_seconds seconds;
} sgsi_train_progress;

struct sgs_trainer {
    const sgs_scene *scene;
    sgs_train_options options;
    const sgsi_pipeline *pipeline;
    sgsi_sampling sampling;
    sgsi_schedule schedule;
    sgs_gaussians *model; // with several ranks, and all arrays of its length: the own rows
    size_t count;         // rows of all ranks
    size_t fixed;         // of these the last ones, outside of options.region: drawn, never changed
    float *m, *v;         // Adam's moments, model layout
    float *accumulated_grad; // before a step, model layout; NULL if every iteration steps
    uint16_t *accumulated_rows;
    float *filter_3d; // of Mip-Splatting, [capacity], padding 0; NULL with other pixel filters
    sgsi_statistics statistics;
    sgsi_train_views views;
    sgsi_view_scores scores;
    sgsi_resolution resolution;
    sgs_regions regions;       // of the last update; the list is owned
    spare_view_fit *view_fits; // [training views][2], of the equilibrium
    uint32_t *order;           // permutation of the training views of this epoch
    uint32_t *next_order;      // that of epoch next_epoch; NULL if no views are prefetched
    uint64_t next_epoch;
    bool seen;                        // a primitive was hit in some view
    bool inconsistent;                // the last step failed after it had changed the state
    bool update_refused;              // the last structural update would have exceeded memory_limit
    bool has_init;                    // it began from options.init
    size_t memory_limit, image_cache; // bytes; 0 = none
    size_t reserved_bytes, reserved_row_bytes; // see sgs_trainer_memory_reserve_set
    sgsi_train_progress progress;
    sgs_train_bytes bytes; // of this process, not of the checkpoint
    float *cloud_points;   // initial cloud
    unsigned char *cloud_colors;
    size_t cloud_count;
    // Of sgs_trainer_collect, on rank 0, until the next step.
    sgs_gaussians *collected;
    float *collected_filter;
    float *held_params; // see sgsi_trainer_hold
    int held_iteration;
    char stop_text[160];
};

// True if growth needs sums of absolute gradients of this iteration.
static inline bool sgsi_trainer_uses_abs_grad(const sgs_trainer *trainer, int iteration)
{
    return iteration < trainer->schedule.densify_until &&
           (trainer->pipeline->abs_grad || trainer->schedule.abs_share > 0.0);
}

// The schedule's near_depth, limited by the points of the scene; in extents.
static inline double sgsi_trainer_near_depth(const sgs_trainer *trainer)
{
    const double limit = trainer->progress.near_limit, depth = trainer->schedule.near_depth;
    return limit > 0.0 && limit < depth ? limit : depth;
}

// True if several ranks share the rows (base/row_groups.h).
static inline bool sgsi_trainer_is_shared(const sgs_trainer *trainer)
{
    return trainer->views.view_ranks != NULL;
}

static inline int sgsi_trainer_rank(const sgs_trainer *trainer)
{
    return sgsi_trainer_is_shared(trainer) ? sgs_ranks_rank(trainer->views.ranks) : 0;
}

static inline int sgsi_trainer_ranks(const sgs_trainer *trainer)
{
    return sgsi_trainer_is_shared(trainer) ? sgs_ranks_count(trainer->views.ranks) : 1;
}

// Number of rows that training may change: the first ones. _own: those of this rank.
static inline size_t sgsi_trainer_trained(const sgs_trainer *trainer)
{
    return trainer->count - trainer->fixed;
}

static inline size_t sgsi_trainer_own(const sgs_trainer *trainer)
{
    return sgsi_shard_count(sgsi_trainer_trained(trainer), sgsi_trainer_rank(trainer),
                            sgsi_trainer_ranks(trainer));
}

// ---- trainer_model.c: the model and the arrays of its length ----

// The initial model (options.init, the scene's cloud or a random one).
sgs_status sgsi_trainer_create_model(sgs_trainer *trainer);
// Moments, statistics and accumulated gradients of a new model. Nothing uses them before the first
// step, when ranks have divided the model.
sgs_status sgsi_trainer_reserve_state(sgs_trainer *trainer);
// Moves centres that left options.region back to it.
void sgsi_trainer_clamp_to_region(sgs_trainer *trainer);
// Allocates and computes the 3D filter of the current model, if the pixel filter uses it. The
// second is collective.
sgs_status sgsi_trainer_reserve_filter_3d(sgs_trainer *trainer);
sgs_status sgsi_trainer_update_filter_3d(sgs_trainer *trainer);
// True if steps have several views, whose gradients are accumulated.
bool sgsi_trainer_accumulates(const sgs_trainer *trainer);
// Allocates zeroed accumulated gradients for the current model, if steps have several views. An
// open batch is dropped.
sgs_status sgsi_trainer_reserve_accumulated_grad(sgs_trainer *trainer);
// True if opacities are linear after the last iteration. The second function converts them then.
bool sgsi_trainer_opacity_is_linear(const sgs_trainer *trainer);
void sgsi_trainer_convert_opacity(sgs_trainer *trainer);
float sgsi_trainer_lr_opacity(const sgs_trainer *trainer, int iteration);

// ---- trainer_optimize.c ----

// What the ranks send each other after a step.
typedef struct sgsi_step_counts {
    uint64_t seen;
    sgsi_rejected rejected; // `first` is a row of the whole model
} sgsi_step_counts;

// True if the gradient of this iteration is used for a step: not before a structural update, and
// not in the last one.
bool sgsi_trainer_makes_step(const sgs_trainer *trainer, int iteration);
// True if a batch of views ends with this iteration, which has a gradient.
bool sgsi_trainer_ends_batch(const sgs_trainer *trainer, int iteration);
// Chain rule, statistics and Adam for the gradient sums of a view. *visible: the number of
// primitives with a gradient. Collective.
sgs_status sgsi_trainer_optimize(sgs_trainer *trainer, const sgsi_train_view *view,
                                 size_t *visible);
// After the step of a batch of `views`, or, with 1, after the structural update of an iteration
// that has one: the noise of a pipeline that samples. 0: none.
void sgsi_trainer_add_noise(sgs_trainer *trainer, int iteration, int views);

// ---- trainer_shards.c: rows that ranks share. Collective ----

// Keeps the rows of this rank of the model that all ranks have created.
sgs_status sgsi_trainer_share(sgs_trainer *trainer);
// How a structural update reaches the rows of other ranks.
sgsi_row_peers sgsi_trainer_peers(sgs_trainer *trainer);
// Forgets the copy of sgs_trainer_collect.
void sgsi_trainer_release(sgs_trainer *trainer);

// ---- trainer_structure.c ----

// Density control after the optimiser step of `iteration`; scores: NULL for pipelines without
// score_views. Fills the structural fields of *info.
sgs_status sgsi_trainer_update_structure(sgs_trainer *trainer, int iteration,
                                         const sgsi_view_scores *scores, sgs_step_info *info);
void sgsi_trainer_reset_opacity(sgs_trainer *trainer, int iteration);

// ---- trainer_stop.c ----

// After progress.iteration, which trained on the training view `view`: updates SPARE-GS's
// termination test once densification has ended; returns why training ends, or NONE.
sgs_stop_reason sgsi_trainer_decide_stop(sgs_trainer *trainer, size_t view, double loss);

// ---- trainer.c ----

// For measurements: copies the parameters and sets the trainer to the state after `iteration`,
// without its structural update. sgsi_trainer_restore returns to this state after a step. Moments
// and statistics are not restored.
sgs_status sgsi_trainer_hold(sgs_trainer *trainer, int iteration);
void sgsi_trainer_restore(sgs_trainer *trainer);
