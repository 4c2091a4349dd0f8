// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// End of training: the last iteration of the schedule, or an equilibrium of loss and count
// (SPARE-GS, Eq. 26).

#include <stdio.h>

#include "train/trainer_state.h"

static void describe_equilibrium(sgs_trainer *trainer)
{
    const spare_equilibrium *e = &trainer->progress.equilibrium;
    snprintf(
        trainer->stop_text, sizeof trainer->stop_text,
        "stopped at %d of %d: loss fell by %.2f +- %.2f %%, count changed by %.2f %% in the last "
        "of %d checks",
        trainer->progress.iteration, trainer->options.iterations, 100.0 * e->last_loss_change,
        100.0 * e->last_loss_error, 100.0 * e->last_count_change, trainer->options.spare_patience);
}

// Checks begin after densification. An update that is due at this iteration is applied before the
// next one, so the run does not end before it.
static bool is_at_equilibrium(sgs_trainer *trainer, size_t view, double loss)
{
    sgsi_train_progress *progress = &trainer->progress;
    const sgs_train_options *o = &trainer->options;
    const sgsi_schedule *schedule = &trainer->schedule;
    const int iteration = progress->iteration, interval = schedule->check_interval;
    const size_t views = trainer->views.count, count = sgsi_trainer_trained(trainer);
    if (iteration <= schedule->densify_until || sgsi_schedule_is_annealing(schedule, iteration)) {
        if (iteration % interval == 0)
            progress->equilibrium.previous_count = count;
        return false;
    }
    if (progress->disturbed)
        spare_equilibrium_disturb(&progress->equilibrium, trainer->view_fits, views);
    progress->disturbed = 0;
    spare_equilibrium_observe(&progress->equilibrium, trainer->view_fits, view, iteration, loss);
    const spare_tolerance tolerance = {o->spare_eps_loss, o->spare_eps_count, o->spare_patience};
    return iteration % interval == 0 &&
           spare_equilibrium_check(&progress->equilibrium, trainer->view_fits, views, interval,
                                   count, &tolerance) &&
           !sgsi_schedule_is_update(schedule, iteration);
}

sgs_stop_reason sgsi_trainer_decide_stop(sgs_trainer *trainer, size_t view, double loss)
{
    const sgs_train_options *o = &trainer->options;
    const int iteration = trainer->progress.iteration;
    if (o->spare & SGS_SPARE_EDT && iteration < o->iterations &&
        is_at_equilibrium(trainer, view, loss)) {
        describe_equilibrium(trainer);
        return SGS_STOP_EQUILIBRIUM;
    }
    if (iteration < o->iterations)
        return SGS_STOP_NONE;
    snprintf(trainer->stop_text, sizeof trainer->stop_text, "schedule completed");
    return SGS_STOP_SCHEDULE;
}
