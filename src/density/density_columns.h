// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What a structural update gives a base pipeline and gets from it: options, columns of the old rows
// with the pipeline's decisions, and counts. Plain data; names SPARE-GS's options, not its header.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

struct sgs_region;
struct sgs_train_options;
struct spare_options;

// What a pipeline carries from update to update; saved with the run.
typedef struct sgsi_pipeline_state {
    int64_t initial_count; // primitives the run started from
    int64_t momentum;      // DashGaussian's budget above initial_count
} sgsi_pipeline_state;

// tau of a published run, which all five pipelines share.
#define SGSI_GRADIENT_THRESHOLD 2e-4

typedef struct sgsi_density_options {
    const struct sgs_train_options *train; // for the pipeline's own switches; may be NULL for 3dgs
    sgsi_pipeline_state *state;            // may be NULL for 3dgs
    double extent;
    int update, update_count; // this is the update-th (from 0) of so many
    int until, interval;      // of the schedule, iterations
    int resolution;           // down-scaling of the images in force, >= 1
    bool final_prune;         // after the densification: removes only
    const float *importance,
        *prune_score;          // [count] scores from views, for pipelines that ask for them
    double gradient_threshold; // tau: SGSI_GRADIENT_THRESHOLD times the schedule's factor
    double opacity_min;        // 0.005
    double size_split;         // scales above this are split, below cloned: 0.01 * extent
    double size_max;           // scales above this are pruned; INFINITY = no size pruning
    size_t max_count;          // hard cap, 0 = none
    // Whether the memory suffices for so many primitives; asked before anything is changed. NULL =
    // always.
    bool (*admits)(const void *context, size_t count);
    const void *admits_context;
    uint64_t seed; // of the split children, mixed with `iteration`
    long iteration;
    bool spare_densify, spare_prune;   // BMD, RAP
    const struct spare_options *spare; // for these two; NULL without them
} sgsi_density_options;

typedef struct sgsi_density_result {
    size_t cloned, split, pruned,
        spare_pruned; // primitives; spare_pruned: removed by RAP alone, part of pruned
    size_t regions;
    double over_budget_share, mean_weight;
    size_t bmd_suppressed, bmd_boosted;
    double spare_seconds;
    struct sgs_region *region_list; // [regions], for the caller to sgsi_free; NULL without SPARE-GS
    double region_low[3], region_cell[3];
    bool refused; // the memory does not suffice: nothing is changed
} sgsi_density_result;

typedef enum sgsi_action { SGSI_ACTION_KEEP, SGSI_ACTION_CLONE, SGSI_ACTION_SPLIT } sgsi_action;

// Columns of the old rows of one structural update, [count] each.
typedef struct sgsi_density_columns {
    size_t count;
    float *x, *y, *z, *opacity, *scale_max;
    float *score;        // a / d, 0 where unseen
    float *abs_grad;     // the same over absolute values, 0 where unseen or not collected
    float *weight;       // w of SPARE-GS, 1 without BMD
    uint8_t *redundant;  // RAP's mask, 0 without
    uint8_t *degenerate; // a parameter is not finite: the row is removed in any case; x, y, z are
                         // NaN, the columns behind them 0
    // decided by the pipeline; all 0 before
    uint8_t *action;         // sgsi_action
    uint8_t *removed;        // the native rule removes the row
    uint8_t *prune_children; // the native rule removes the row's clone or children at once
    float *priority;         // who may grow first when the cap leaves no room for all
    void *workspace;
} sgsi_density_columns;
