// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Milestones of a training run: those of the published 30 000 iterations, or scaled to another
// length. Pure functions.

#include <stdbool.h>
#include <stddef.h>

#include "sparegs/trainer.h"

typedef struct sgsi_schedule {
    int iterations;
    bool dense; // Adam over all primitives
    int densify_from, densify_until, densify_interval;
    int reset_interval, reset_until; // opacity resets; 0 = none
    int first_reset;                 // additional reset for a white background; 0 = none
    bool prunes_large;               // by size, after the first reset
    double growth;                   // MCMC: rows that an update adds, as a fraction
    int prune_interval;              // final prunes after densify_until; 0 = none
    int thin_until; // last update after densify_until that only removes primitives; 0 = none
    // See pipeline.h; 0 = every iteration steps.
    int batch_rest, batch_middle, batch_late, middle_until;
    int sh_interval;          // iterations per additional SH band; 0 = all bands at once
    double lr_begin, lr_span; // first and last iteration of the decay of the position rate
    int anneal_from;          // the other rates decay from this iteration to the end of the run,
    double lr_late;           // to this factor; 1 = constant
    double lr_shape;          // factor of the published rates of rotation and scale
    double lr_sh;             // on that of SH above degree 0: not 1 below 30 000 iterations
    // The image size may change after resolution_from, every resolution_interval iterations.
    int resolution_from, resolution_interval;
    int half_size_until;     // half-size images up to about here; 0 = none
    double lr_opacity;       // factor of the pipeline's rate of opacity
    double ssim_weight;      // of 1 - SSIM in the loss
    double ssim_sigma;       // of its window, pixels
    int check_interval;      // of SPARE-GS's equilibrium checks
    double threshold_factor; // on the pipeline's gradient threshold
    // Weight of absolute gradients in the score for growth; 0 = none, or the pipeline has its own
    // rule for them.
    double abs_share;
    // Gradients of primitives closer to the camera than this, in extents of the scene, count less
    // for growth; 0 = none.
    double near_depth;
    // Share of the primitives that an update in the second half of densification, or until
    // thin_until, removes at most, besides those replaced at the cap; 0 = no limit.
    double late_removal;
} sgsi_schedule;

typedef struct sgsi_schedule_input {
    size_t views;  // photos of training, >= 1
    double pixels; // their mean size, > 0
    bool random;   // the initial cloud is random
} sgsi_schedule_input;

sgsi_schedule sgsi_schedule_make(const sgs_train_options *options,
                                 const sgsi_schedule_input *input);

// True if a structural update follows this iteration (1-based).
bool sgsi_schedule_is_structural(const sgsi_schedule *schedule, int iteration);
// The first such iteration, 0 if there is none.
int sgsi_schedule_first_update(const sgsi_schedule *schedule);
// True if an opacity reset follows it.
bool sgsi_schedule_is_reset(const sgsi_schedule *schedule, int iteration);
// True if the update after this iteration also prunes by size: a structural one of the published
// schedule, after the first regular opacity reset. The additional reset for a white background does
// not count. last_reset: iteration of the last reset, -1 = none.
bool sgsi_schedule_prunes_large(const sgsi_schedule *schedule, int iteration, int last_reset);
// True if an update after densification, which only removes primitives, follows this iteration:
// a final prune of the pipeline, or thinning.
bool sgsi_schedule_is_final_prune(const sgsi_schedule *schedule, int iteration);
// True if such an update is one of thinning: SPARE-GS and the pipeline's ordinary pruning rule.
bool sgsi_schedule_is_thinning(const sgsi_schedule *schedule, int iteration);
// True if any update follows this iteration, structural or only removing.
bool sgsi_schedule_is_update(const sgsi_schedule *schedule, int iteration);
// True if the statistics of this iteration count for a later update.
bool sgsi_schedule_needs_statistics(const sgsi_schedule *schedule, int iteration);
// Share of the primitives that the update after this iteration removes at most; 0 = no limit.
double sgsi_schedule_removal_max(const sgsi_schedule *schedule, int iteration);
// True if the size of the images may change after this iteration.
bool sgsi_schedule_may_resize(const sgsi_schedule *schedule, int iteration);
// Number of intervals between structural updates in the whole run, >= 1: 145 for 3DGS as published.
int sgsi_schedule_updates(const sgsi_schedule *schedule);
// True if the optimiser steps in this iteration: SH bands above 0 (rest), other parameters (main).
bool sgsi_schedule_steps_rest(const sgsi_schedule *schedule, int iteration);
bool sgsi_schedule_steps_main(const sgsi_schedule *schedule, int iteration);
// Factor on the initial learning rate of the positions: 1 at the start, 0.01 at the end,
// log-linear.
double sgsi_schedule_lr(const sgsi_schedule *schedule, int iteration);
// True if the other rates decay in this iteration. The loss then follows the rates, so that it
// cannot show an equilibrium.
bool sgsi_schedule_is_annealing(const sgsi_schedule *schedule, int iteration);
// Factor on the other rates: 1 until anneal_from, then log-linear to lr_late.
double sgsi_schedule_lr_other(const sgsi_schedule *schedule, int iteration);
