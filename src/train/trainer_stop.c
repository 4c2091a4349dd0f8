// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// End of training: the last iteration of the schedule, or an equilibrium of loss and count
// (SPARE-GS, Eq. 26).

#include <stdio.h>

#include "train/trainer_state.h"

static void describe_equilibrium(sgs_trainer *trainer)
{
    const spare_equilibrium *e = &trainer->progress.equilibrium;
    snprintf(trainer->stop_text, sizeof trainer->stop_text,
             "stopped at %d of %d: loss changed %.2f %%, count %.2f %% in the last of %d checks",
             trainer->progress.iteration, trainer->options.iterations, 100.0 * e->last_loss_change,
             100.0 * e->last_count_change, trainer->options.spare_patience);
}

// True if an equilibrium may be detected: densification has ended, and each training view was used
// twice since the last structural update or opacity reset. Before that the average loss still
// recovers from them, and a short run would end too early.
static bool may_be_in_equilibrium(const sgs_trainer *trainer)
{
    const sgsi_schedule *schedule = &trainer->schedule;
    const int iteration = trainer->progress.iteration;
    const size_t epochs = 2 * trainer->views.count;
    if (iteration < schedule->densify_until || (size_t)iteration < epochs)
        return false;
    const int calm_since = iteration - (int)epochs;
    if (trainer->progress.last_reset > calm_since)
        return false;
    for (int i = iteration; i > calm_since; --i)
        if (sgsi_schedule_is_structural(schedule, i) || sgsi_schedule_is_final_prune(schedule, i))
            return false;
    return true;
}

sgs_stop_reason sgsi_trainer_decide_stop(sgs_trainer *trainer, double loss)
{
    sgsi_progress *progress = &trainer->progress;
    const sgs_train_options *o = &trainer->options;
    const int iteration = progress->iteration;
    if (o->spare & SGS_SPARE_EDT && iteration < o->iterations) {
        spare_equilibrium_observe(&progress->equilibrium, loss, trainer->schedule.loss_decay);
        if (iteration % trainer->schedule.check_interval == 0) {
            const bool still = spare_equilibrium_check(
                &progress->equilibrium, trainer->model->count, progress->reset_since_check,
                o->spare_eps_loss, o->spare_eps_count, o->spare_patience);
            progress->reset_since_check = 0;
            if (!may_be_in_equilibrium(trainer))
                progress->equilibrium.held = 0;
            else if (still) {
                describe_equilibrium(trainer);
                return SGS_STOP_EQUILIBRIUM;
            }
        }
    }
    if (iteration < o->iterations)
        return SGS_STOP_NONE;
    snprintf(trainer->stop_text, sizeof trainer->stop_text, "schedule completed");
    return SGS_STOP_SCHEDULE;
}
