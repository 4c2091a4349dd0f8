// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// SPARE-GS (arXiv 2607.16624) as pure functions on plain arrays: regional demand, capacity-aware
// quotas, budget-modulated densification (BMD), redundancy-aware pruning (RAP) and
// equilibrium-driven termination (EDT). No Embree, no files, no threads, no allocation: the caller
// provides the workspace and may provide a parallel loop.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// Forms of Phi in Eq. 22; s is the slack, l the normalised share. spare.c derives the first.
typedef enum spare_phi {
    SPARE_PHI_COUPLED,  // 1 + gamma(l, s) tanh(kappa_s s / 2)
    SPARE_PHI_CONSTANT, // 1 + gamma_0 tanh(kappa_s s / 2)
    SPARE_PHI_PRODUCT,  // 2 sigmoid(kappa_s s l)
    SPARE_PHI_PLAIN     // 1/2 + sigmoid(kappa_s s)
} spare_phi;

// Defaults in parentheses.
typedef struct spare_options {
    int grid; // voxels per axis, clamped to 1..256 (32)
    // Fraction of the centres outside the grid at each end of each axis, at most 0.25 (0: the
    // bounding box of the paper). Their primitives belong to the outermost voxels.
    double grid_quantile;
    double budget_scale;               // kappa: B = kappa N (1)
    double slack_gain;                 // kappa_s (2)
    double weight_range;               // gamma_0 (0.375)
    spare_phi phi;                     // SPARE_PHI_COUPLED
    double capacity_min, capacity_max; // clamp of C_r (0.25, 4)
    double tau_alpha;                  // opacity below which a primitive may be redundant (0.05)
    // tau_org, the densification threshold of the base pipeline (2e-4). RAP uses half of it.
    double tau_gradient;
    bool use_h, use_v, use_c; // demand by gradient, demand by visibility, capacity (all true)
    // RAP only for primitives that were visible since the last update (false, as in Eq. 24).
    bool rap_require_visible;
} spare_options;

// Cannot fail.
spare_options spare_options_default(void);

// One region (voxel) that holds at least one primitive.
typedef struct spare_region {
    uint32_t voxel;    // (z * grid + y) * grid + x
    uint32_t count;    // n_r
    double gradient;   // H_r
    double visibility; // V_r
    double area;       // A_r
    double demand;     // D_r in (0, 2]
    double capacity;   // C_r
    double score;      // Q_r
    double share;      // l_r
    double quota;      // n^_r = B l_r
    double slack;      // s_r
    double weight;     // w of its primitives
} spare_region;

// Runs body(context, slice) once for every slice in [0, count), in any order, also concurrently.
typedef void (*spare_slice_fn)(void *context, size_t slice);
typedef void (*spare_loop_fn)(size_t count, spare_slice_fn body, void *context);

// Columns of n primitives with the structural statistics since the last update.
typedef struct spare_input {
    size_t count;
    const float *x, *y, *z;        // means, world
    const float *opacity;          // alpha in (0, 1)
    const float *gradient_sum;     // a_i, accumulated norm of the view-space gradient
    const uint32_t *visible_count; // d_i, views
    const float *radius_max;       // rho_i, pixels
    // Of the passes over the primitives, or NULL; the result is the same.
    spare_loop_fn loop;
    int threads; // that the loop has
} spare_input;

// Bytes of workspace that spare_evaluate requires for this grid and count. Cannot fail.
size_t spare_workspace_size(const spare_options *options, size_t count);

// region_of a primitive with a non-finite centre.
#define SPARE_NO_REGION UINT32_MAX

typedef struct spare_result {
    size_t region_count;
    const spare_region *regions; // [region_count] by ascending voxel; in the workspace
    const uint32_t *region_of;   // [count] index into regions, or SPARE_NO_REGION; in the workspace
    double over_budget_share;    // share of primitives in regions with n_r > quota
    double mean_weight;          // over primitives
    size_t redundant_count;
    double low[3], voxel_size[3]; // lower corner and voxel size of the grid, world units
} spare_result;

// Computes regions, quotas, weights and the redundancy mask from the state before the densification
// of this update (Eqs. 15 to 22 and 24). Writes weights [count] and redundant [count] (0 or 1).
// `memory` is 64-byte aligned and has spare_workspace_size bytes. Cannot fail.
void spare_evaluate(const spare_options *options, const spare_input *input, void *memory,
                    float *weights, uint8_t *redundant, spare_result *result);

// True during the cooldown of redundancy-aware pruning after an opacity reset: 0 < iteration -
// reset <= interval (reset < 0: no reset yet).
bool spare_pruning_in_cooldown(long iteration, long last_opacity_reset, long interval);

// Equilibrium-driven termination, Eq. 26.
typedef struct spare_equilibrium {
    uint64_t observed[2];    // losses in this and in the previous interval between checks
    uint64_t previous_count; // primitives at the last check
    int32_t held;            // consecutive checks that passed
    // Of the last comparison: Delta L with its standard error, and Delta N.
    double last_loss_change, last_loss_error, last_count_change;
} spare_equilibrium;

// Sums over the losses of one view in one interval: t = iteration, y = ln loss.
typedef struct spare_view_fit {
    double count, t, y, tt, ty, yy;
} spare_view_fit;

typedef struct spare_tolerance {
    double loss, count; // eps_L, eps_N
    int patience;       // consecutive checks
} spare_tolerance;

// fits: the caller's array, [views][2], zeroed at the start.
void spare_equilibrium_begin(spare_equilibrium *state);
// Restarts the fit: losses before and after are not comparable.
void spare_equilibrium_disturb(spare_equilibrium *state, spare_view_fit *fits, size_t views);
// Adds the loss of an iteration. Ignores non-finite losses.
void spare_equilibrium_observe(spare_equilibrium *state, spare_view_fit *fits, size_t view,
                               long iteration, double loss);
// Evaluates Eq. 26 at a check and begins the next interval; `interval`: Delta t in iterations,
// `count`: primitives now, > 0. Has no effect if this interval has fewer losses than there are
// views. Compares nothing without a count of an earlier check (previous_count, which the caller may
// set while nothing is observed). Returns true when training may stop.
bool spare_equilibrium_check(spare_equilibrium *state, spare_view_fit *fits, size_t views,
                             long interval, size_t count, const spare_tolerance *tolerance);
