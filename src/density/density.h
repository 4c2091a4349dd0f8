// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Structural updates: where primitives are cloned, split and removed (by the rules of a base
// pipeline), weighted and pruned by SPARE-GS. Works on the model, its moments and its statistics;
// knows no images and no BVH.

#include <stdbool.h>

#include "spare/spare.h"
#include "sparegs/gaussians.h"

// Per primitive, since the last structural update (Kerbl et al. 2023, section 5.2; a_i, d_i and
// rho_i of the SPARE-GS paper, equations 16 to 18). 64-byte aligned columns, `capacity` long.
typedef struct sgsi_statistics {
    float *gradient_sum;     // a_i
    float *abs_grad_sum;     // the same over absolute values of the pixels' gradients; 0 where the
                             // pipeline wants none
    uint32_t *visible_count; // d_i
    float *radius_max;       // rho_i, pixels
    size_t capacity;
} sgsi_statistics;

sgs_status sgsi_statistics_reserve(sgsi_statistics *statistics,
                                   size_t capacity); // zeroes everything when it grows
void sgsi_statistics_clear(sgsi_statistics *statistics, size_t count);
void sgsi_statistics_free(sgsi_statistics *statistics);

// What a pipeline carries from update to update; saved with the run.
typedef struct sgsi_pipeline_state {
    int64_t initial_count; // primitives the run started from
    int64_t momentum;      // DashGaussian's budget above initial_count
} sgsi_pipeline_state;

typedef struct sgsi_density_options {
    const struct sgsi_pipeline *pipeline;
    const struct sgs_train_options *train; // for the pipeline's own switches; may be NULL for 3dgs
    sgsi_pipeline_state *state;            // may be NULL for 3dgs
    double extent;
    int update, update_count; // this is the update-th (from 0) of so many
    int until, interval;      // of the schedule, iterations
    int resolution;           // down-scaling of the images in force, >= 1
    bool final_prune;         // after the densification: removes only
    const float *importance,
        *prune_score;          // [count] scores from views, for pipelines that ask for them
    double gradient_threshold; // tau, 2e-4
    double opacity_min;        // 0.005
    double size_split;         // scales above this are split, below cloned: 0.01 * extent
    double size_max;           // scales above this are pruned; INFINITY = no size pruning
    size_t max_count;          // hard cap, 0 = none
    uint64_t seed;             // of the split children, mixed with `iteration`
    long iteration;
    bool spare_densify, spare_prune; // BMD, RAP
    spare_options spare;
} sgsi_density_options;

struct sgs_region;

typedef struct sgsi_density_result {
    size_t cloned, split, pruned,
        spare_pruned; // primitives; spare_pruned: removed by RAP alone, part of pruned
    size_t regions;
    double over_budget_share, mean_weight;
    size_t bmd_suppressed, bmd_boosted;
    double spare_seconds;
    struct sgs_region *region_list; // [regions], for the caller to sgsi_free; NULL without SPARE-GS
    double region_low[3], region_cell[3];
} sgsi_density_result;

// One structural update. m and v are moments in the model's layout and capacity; they are gathered
// along (new rows: 0) and may be reallocated. Rows come out in Morton order of their means.
// Statistics are cleared. On failure (OUT_OF_MEMORY) the model must not be used further.
sgs_status sgsi_density_update(sgs_gaussians *model, float **m, float **v,
                               sgsi_statistics *statistics, const sgsi_density_options *options,
                               sgsi_density_result *result);

// Opacity reset: logit <- logit(min(o, ceiling)), its moments <- 0. filter_3d [count] or NULL: what
// is held under the ceiling is the opacity that Mip-Splatting's filter leaves.
void sgsi_density_reset_opacity(sgs_gaussians *model, float *m, float *v, double ceiling,
                                const float *filter_3d);

// Puts the rows of a fresh model (no moments yet) into Morton order.
sgs_status sgsi_density_sort(sgs_gaussians *model);
