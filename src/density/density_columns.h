// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Data exchanged between a structural update and a base pipeline: options, columns of the old rows
// with the pipeline's decisions, and counts. Does not include the header of SPARE-GS.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

struct sgs_region;
struct sgs_train_options;
struct spare_options;

// State of a pipeline between updates; part of checkpoints.
typedef struct sgsi_pipeline_state {
    int64_t initial_count; // primitives of the initial model
    int64_t momentum;      // DashGaussian's budget above initial_count
    int64_t deleted;       // primitives that SPARE-GS took away from MCMC's limit
} sgsi_pipeline_state;

// tau of the published schedule, the same in all pipelines.
#define SGSI_GRADIENT_THRESHOLD 2e-4

typedef struct sgsi_density_options {
    const struct sgs_train_options *train; // for the pipeline's own options; may be NULL for 3dgs
    sgsi_pipeline_state *state;            // may be NULL for 3dgs
    double extent;
    int update, update_count; // index of this update, number of updates
    int until, interval;      // of the schedule, iterations
    int resolution;           // current down-scaling of the images, >= 1
    bool final_prune;         // after densification: only remove
    // [count] scores from views, for pipelines with score_views.
    const float *importance, *prune_score;
    double gradient_threshold; // tau: SGSI_GRADIENT_THRESHOLD times the schedule's factor
    double abs_share;          // weight of absolute gradients in the score for growth; 3dgs
    double opacity_min;        // 0.005
    double size_split;         // scales above this are split, below cloned: 0.01 * extent
    double size_max;           // scales above this are pruned; INFINITY = no size pruning
    double growth;             // MCMC: share of the rows that an update adds
    double removal_max; // share of the rows removed at most, besides those replaced at the cap
    size_t max_count;   // hard cap, 0 = none
    // True if the memory suffices for this many primitives; called before any change. NULL =
    // always.
    bool (*admits)(const void *context, size_t count);
    // With several processes: fails if their plans differ; called before any change.
    sgs_status (*compare)(const void *context, uint64_t digest);
    const void *context; // of both
    uint64_t seed;       // of the split children, mixed with `iteration`
    long iteration;
    bool spare_densify, spare_prune;   // BMD, RAP
    bool opacity_is_reset;             // in the update before this one: no replacement at the cap
    const struct spare_options *spare; // for these two; NULL without them
} sgsi_density_options;

typedef struct sgsi_density_result {
    size_t cloned, split, pruned; // primitives
    size_t spare_pruned;          // part of pruned: removed by RAP only
    size_t regions;
    double over_budget_share, mean_weight;
    size_t bmd_suppressed, bmd_boosted;
    size_t relocated, spare_deferred; // see sgs_step_info
    double spare_seconds;
    struct sgs_region *region_list; // [regions], the caller frees it; NULL without SPARE-GS
    double region_low[3], region_voxel_size[3];
    bool unchanged; // the update failed before it changed model, moments or statistics
    bool refused;   // so it failed, because options.admits refused
} sgsi_density_result;

typedef enum sgsi_action { SGSI_ACTION_KEEP, SGSI_ACTION_CLONE, SGSI_ACTION_SPLIT } sgsi_action;

// What becomes of each row, [count] each, for pipelines that move rows. NULL for others.
typedef struct sgsi_row_moves {
    uint32_t *root;   // old row whose mean, rotation and colour row i takes; i where it stays
    uint32_t *copies; // rows to add that are equal to row i
    float *opacity;   // of row i and its copies; 0: as it was
    float *log_scale; // added to the log-scales of the root
    uint8_t *forget;  // the moments of row i become 0
    // Rows with a new opacity move by R S xi times this, xi ~ N(0, I)^3, with their new scales.
    double jitter;
} sgsi_row_moves;

// Columns of the old rows of one structural update, [count] each.
typedef struct sgsi_density_columns {
    size_t count;
    float *x, *y, *z, *opacity, *scale_max;
    float *score;       // a / d, 0 where unseen
    float *abs_grad;    // the same over absolute values, 0 where unseen or not collected
    float *weight;      // w of SPARE-GS, 1 without BMD
    uint8_t *redundant; // RAP's mask, 0 without
    // A parameter is not finite: the row is always removed. Its x, y, z are NaN, its opacity, scale
    // and scores 0.
    uint8_t *degenerate;
    // Set by the pipeline, initially 0.
    uint8_t *action;         // sgsi_action
    uint8_t *removed;        // the pipeline removes the row
    uint8_t *prune_children; // the pipeline removes the row's clone or children in this update
    float *priority;         // order of densification under a cap, largest first
    sgsi_row_moves moves;
    void *workspace;
} sgsi_density_columns;
