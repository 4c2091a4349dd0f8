// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The interface of a base pipeline's density control, and functions that pipelines share. A
// pipeline decides which rows to clone, split and remove from columns of the old rows, which
// include the weights and the redundancy mask of SPARE-GS. The trainer and density.c use pipelines
// through this table only.

#include "density/density_columns.h"
#include "model/score_slots.h"
#include "sparegs/trainer.h"

// A rendered view: the photo, and the mean over channels of |image - photo|.
typedef struct sgsi_scored_image {
    int width, height;
    size_t stride; // of error and weights
    const float *error;
    float error_min, error_max;
    const uint8_t *pixels; // planes of the photo over the background, [3][height][width]
} sgsi_scored_image;

// A rendered view with its sums per primitive.
typedef struct sgsi_scored_view {
    size_t count;
    double loss;            // photometric, of the whole view
    const float *sums;      // [count][16] by SGSI_SCORE_; valid where touched
    const uint8_t *touched; // [count / 16]
    const float *depth;     // [count] view depth of the mean; 0 where not in view
    const float *radius;    // [count] pixels; 0 where not in view
    const float *gradient;  // [count] a / d
    const float *opacity;   // [count]
    const float *volume;    // [count] product of the scales
} sgsi_scored_view;

// How opacities are treated after the last structural update.
typedef enum sgsi_late_opacity {
    SGSI_LATE_OPACITY_TRAINED,
    SGSI_LATE_OPACITY_FROZEN,
    SGSI_LATE_OPACITY_LINEAR // converted to linear ones, see sgs_gaussians, and trained
} sgsi_late_opacity;

// What a pipeline adds to the descent along the loss, and its first model.
typedef struct sgsi_sampling {
    double noise;                      // of the positions, times their learning rate; 0 = none
    double opacity_loss, scale_loss;   // weights of the mean opacity and the mean scale; 0 = none
    double start_opacity, start_scale; // scale: times the distance to the nearest points
} sgsi_sampling;

typedef struct sgsi_pipeline {
    const char *name;
    // Milestones of the 30 000-iteration schedule.
    int densify_until, densify_interval;
    int prune_interval; // final prunes after densify_until; 0 = none
    // Iterations over which gradients accumulate before a step (0, 1: every iteration): of SH bands
    // above 0 during densification, of all parameters in the sixth of the run after it, and of all
    // parameters in the rest.
    int batch_rest, batch_middle, batch_late;
    float lr_opacity, lr_rest;
    float opacity_ceiling; // after every structural update; 0 = none
    int small_images;      // the first images have about this many times fewer tiles; 0 = full size
    bool abs_grad;         // requires sums of absolute gradients
    bool fine_growth;      // scaled runs use schedule.c's settings for high-resolution images
    bool abs_grad_norm;    // the 2-norm of the sums of both axes instead of their sum
    bool prunes_large;     // the published schedule removes large primitives
    bool relocates;        // decide fills columns->moves; opacities are never reset
    sgs_status (*decide)(const sgsi_density_options *options, sgsi_density_columns *columns,
                         sgsi_density_result *result);
    // NULL = 3DGS's: no noise, no regularisers, opacity 0.1.
    sgsi_sampling (*sampling)(const sgs_train_options *train, double extent);
    // Largest number of primitives, given option max_gaussians; NULL = the option.
    size_t (*limit)(size_t max_count, size_t initial);
    sgsi_late_opacity (*late_opacity)(const sgs_train_options *train); // NULL = trained
    // Number of views that are rendered for scores before every update; 0 = none. pixel_weights
    // fills weights [height][stride]; score_view adds a view to the scores (initially 0);
    // finish_scores completes them after `views` views.
    int score_views;
    sgs_status (*pixel_weights)(const sgsi_scored_image *image, const sgs_train_options *train,
                                float *weights);
    void (*score_view)(const sgsi_scored_view *view, float *importance, float *prune_score);
    void (*finish_scores)(size_t count, int views, float *importance, float *prune_score);
} sgsi_pipeline;

// Never NULL for a pipeline of the enumeration.
const sgsi_pipeline *sgsi_pipeline_get(sgs_pipeline pipeline);

// The sampling of options->pipeline in a scene of this extent.
sgsi_sampling sgsi_pipeline_sampling(const sgs_train_options *train, double extent);

extern const sgsi_pipeline sgsi_pipeline_3dgs, sgsi_pipeline_mip, sgsi_pipeline_taming,
    sgsi_pipeline_dash, sgsi_pipeline_fastgs, sgsi_pipeline_mcmc;

// ---- Shared by pipelines ----

// Pruning rule of 3DGS: opacity below opacity_min, or scale above size_max (INFINITY = no size
// pruning).
static inline bool sgsi_density_should_prune(const sgsi_density_options *options, float opacity,
                                             float scale_max)
{
    return opacity < (float)options->opacity_min || scale_max > (float)options->size_max;
}

// The same for the result of row i's action: the children of a split are 1.6 times smaller.
static inline bool sgsi_density_should_prune_after(const sgsi_density_options *options,
                                                   const sgsi_density_columns *columns, size_t i)
{
    const bool split = columns->action[i] == SGSI_ACTION_SPLIT;
    return sgsi_density_should_prune(options, columns->opacity[i],
                                     split ? columns->scale_max[i] / 1.6f : columns->scale_max[i]);
}

// Removed by the pipeline or by SPARE-GS.
static inline bool sgsi_density_is_removed(const sgsi_density_columns *columns, size_t i)
{
    return columns->removed[i] || columns->redundant[i];
}

// Action of a row that grows: split if longer than `size`, else clone.
static inline sgsi_action sgsi_density_growth(bool grows, float scale_max, float size)
{
    return !grows ? SGSI_ACTION_KEEP : scale_max > size ? SGSI_ACTION_SPLIT : SGSI_ACTION_CLONE;
}

// Counts a decision that w reversed.
static inline void sgsi_density_count_reversal(bool native, bool weighted,
                                               sgsi_density_result *result)
{
    result->bmd_suppressed += native && !weighted;
    result->bmd_boosted += !native && weighted;
}

// Marks (1, else 0) the `wanted` rows of largest score among those with eligible[i] (NULL: all); of
// equal scores the lower row. Fails with OUT_OF_MEMORY.
sgs_status sgsi_select_best(const double *score, const uint8_t *eligible, size_t count,
                            size_t wanted, uint8_t *chosen);

// Draws `wanted` of the eligible rows without replacement, with probability proportional to weight
// (Efraimidis and Spirakis, 2006: the largest u^(1/w)). Rows of weight 0 are drawn last. Fails with
// OUT_OF_MEMORY.
sgs_status sgsi_select_weighted(const double *weight, const uint8_t *eligible, size_t count,
                                size_t wanted, uint64_t seed, uint8_t *chosen);

// Pruning of Taming 3DGS and FastGS. Draws old rows by `weight`, half as many as there are rows
// (new ones included) to which 3DGS's pruning rule applies; removes those drawn to which it
// applies. Reads action; writes removed. Fails with OUT_OF_MEMORY.
sgs_status sgsi_prune_stochastic(const sgsi_density_options *options, sgsi_density_columns *columns,
                                 const double *weight);

// Decides an update that only removes primitives: no row grows, the rule of 3DGS prunes. Writes
// action, removed and prune_children.
void sgsi_density_decide_thinning(const sgsi_density_options *options,
                                  sgsi_density_columns *columns);

// Decides every row on its own: row(decision, i, result) writes the decisions of row i and adds its
// counts to *result. Parallel.
typedef struct sgsi_density_decision {
    const sgsi_density_options *options;
    sgsi_density_columns *columns;
    float quantile; // of Mip-Splatting
    void (*row)(const struct sgsi_density_decision *decision, size_t i,
                sgsi_density_result *result);
} sgsi_density_decision;
void sgsi_density_decide_rows(const sgsi_density_decision *decision, sgsi_density_result *result);

// The value of rank k < count in ascending order; values that are not positive count as 0.
float sgsi_positive_rank(const float *values, size_t count, size_t k);

// Median of the positive values (the lower of two middle ones), 0 without any. Value i is values[i
// * stride]; it is used if present[i / 16] (NULL: always).
float sgsi_positive_median(const float *values, size_t stride, const uint8_t *present,
                           size_t count);
