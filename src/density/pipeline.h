// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The interface of a base pipeline's density control, and what pipelines share: which rows to
// clone, split and remove is decided from columns of the old rows; weights and the redundancy mask
// of SPARE-GS are among the columns. The trainer, spare/ and the machinery of density.c know
// pipelines through this table only.

#include "density/density_columns.h"
#include "model/score_slots.h"
#include "sparegs/trainer.h"

// A drawn view before its sums: the photograph, and the mean over channels of |image - photograph|.
typedef struct sgsi_scored_image {
    int width, height;
    size_t stride; // of error and weights
    const float *error;
    float error_min, error_max;
    const uint8_t *pixels; // planes of the photograph, [channels][height][width]
} sgsi_scored_image;

// A drawn view with its sums.
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

typedef struct sgsi_pipeline {
    const char *name;
    // Milestones of the 30 000-iteration schedule.
    int densify_until, densify_interval;
    int prune_interval; // final prunes after densify_until; 0 = none
    // Gradients of primitives add up over so many iterations before a step (0, 1: every iteration):
    // SH bands above 0 while primitives are added, everything in the sixth of the run after that,
    // everything in the rest.
    int batch_rest, batch_middle, batch_late;
    float lr_opacity, lr_rest;
    float opacity_ceiling; // after every structural update; 0 = none
    int small_images;      // the first images have about this many times fewer tiles; 0 = full size
    bool abs_grad;         // wants sums of absolute gradients
    bool abs_grad_norm;    // the 2-norm of the sums of both axes instead of their sum
    sgs_status (*decide)(const sgsi_density_options *options, sgsi_density_columns *columns,
                         sgsi_density_result *result);
    sgsi_late_opacity (*late_opacity)(const sgs_train_options *train); // NULL = trained
    // Scores from views: drawn before every update, 0 = none. pixel_weights fills [height][stride]
    // weights; score_view adds a view to the scores (all 0 before the first one); finish_scores
    // ends them after `views` views.
    int score_views;
    sgs_status (*pixel_weights)(const sgsi_scored_image *image, const sgs_train_options *train,
                                float *weights);
    void (*score_view)(const sgsi_scored_view *view, float *importance, float *prune_score);
    void (*finish_scores)(size_t count, int views, float *importance, float *prune_score);
} sgsi_pipeline;

// Never NULL for a pipeline of the enumeration.
const sgsi_pipeline *sgsi_pipeline_get(sgs_pipeline pipeline);

extern const sgsi_pipeline sgsi_pipeline_3dgs, sgsi_pipeline_mip, sgsi_pipeline_taming,
    sgsi_pipeline_dash, sgsi_pipeline_fastgs;

// ---- What pipelines share ----

// 3DGS's rule on one row: fainter than opacity_min or, where size pruning is on, longer than
// size_max.
static inline bool sgsi_density_should_prune(const sgsi_density_options *options, float opacity,
                                             float scale_max)
{
    return opacity < (float)options->opacity_min || scale_max > (float)options->size_max;
}

// The same on what row i's action, decided already, leaves of it: the children of a split are 1.6
// times shorter.
static inline bool sgsi_density_should_prune_after(const sgsi_density_options *options,
                                                   const sgsi_density_columns *columns, size_t i)
{
    const bool split = columns->action[i] == SGSI_ACTION_SPLIT;
    return sgsi_density_should_prune(options, columns->opacity[i],
                                     split ? columns->scale_max[i] / 1.6f : columns->scale_max[i]);
}

// How a row grows: longer than `size` it splits, else it is cloned.
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

// Draws `wanted` of the eligible rows without replacement, each next one with probability
// proportional to its weight (Efraimidis and Spirakis, 2006: the largest u^(1/w)). Rows of weight 0
// come last. `seed` names the draw.
sgs_status sgsi_select_weighted(const double *weight, const uint8_t *eligible, size_t count,
                                size_t wanted, uint64_t seed, uint8_t *chosen);

// Taming's and FastGS's pruning: of the rows (new ones included) that outlived 3DGS's rule half are
// meant to go. As many old rows are drawn by `weight`, and those that were drawn and outlived the
// rule are removed. Reads action; writes removed.
sgs_status sgsi_prune_stochastic(const sgsi_density_options *options, sgsi_density_columns *columns,
                                 const double *weight);

// Median of the values > 0 (the lower of two middle ones), 0 when there are none. Value i is
// values[i * stride], and counts only where present[i / 16] (NULL: everywhere).
float sgsi_positive_median(const float *values, size_t stride, const uint8_t *present,
                           size_t count);
