// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// When things happen in a training run: the milestones of the 30 000-iteration schedule, as
// published or scaled to another length. Pure numbers.

#include <stdbool.h>

#include "sparegs/trainer.h"

typedef struct sgsi_schedule {
    int iterations;
    int densify_from, densify_until, densify_interval;
    int reset_interval, reset_until; // opacity resets; 0 = none
    int first_reset;                 // one more on white backgrounds, where densification begins
    int prune_interval;              // final prunes after densify_until; 0 = none
    int batch_rest, batch_middle, batch_late,
        middle_until;         // see pipeline.h; 0 = every iteration steps
    int sh_interval;          // one more SH band every so many iterations
    double lr_begin, lr_span; // the position rate decays from one to the other, iterations
    int resolution_from,
        resolution_interval; // when the size of the images may change: after the first, every so
                             // often
    int check_interval;      // SPARE-GS's equilibrium checks
    double loss_decay;       // of the loss average behind those checks
    double threshold_factor; // on the pipeline's gradient threshold
} sgsi_schedule;

// train_views: number of training views (an average of the loss spans at least one epoch).
sgsi_schedule sgsi_schedule_make(const sgs_train_options *options, size_t train_views);

// A structural update happens at this iteration (1-based).
bool sgsi_schedule_is_structural(const sgsi_schedule *schedule, int iteration);
// An opacity reset follows it.
bool sgsi_schedule_is_reset(const sgsi_schedule *schedule, int iteration);
// Updates prune large primitives: after the first opacity reset, the early one of white backgrounds
// aside. last_reset is the iteration of the last one made, -1 = none.
bool sgsi_schedule_prunes_large(const sgsi_schedule *schedule, int last_reset);
// One of the final prunes, after densification.
bool sgsi_schedule_is_final_prune(const sgsi_schedule *schedule, int iteration);
// The size of the images may change after this iteration.
bool sgsi_schedule_may_resize(const sgsi_schedule *schedule, int iteration);
// Number of intervals between structural updates in the whole run: 145 for 3DGS as published. At
// least 1.
int sgsi_schedule_updates(const sgsi_schedule *schedule);
// The optimiser steps in this iteration: SH bands above 0, and the other parameters.
bool sgsi_schedule_steps_rest(const sgsi_schedule *schedule, int iteration);
bool sgsi_schedule_steps_main(const sgsi_schedule *schedule, int iteration);
// Factor between the first and the last position rate: 1 at 0, 0.01 at the end, log-linear.
double sgsi_schedule_lr(const sgsi_schedule *schedule, int iteration);
