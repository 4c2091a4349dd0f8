// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Milestones. The published schedule (30 000 iterations, specs of 3DGS, sections 5 and 9): densification from 500 to
// 15 000 every 100, opacity reset every 3000, one SH band per 1000, positions decay over the whole run.
//
// Scaled to N iterations, f = N / 30 000: densification until N/2, SH band every N/30, equilibrium checks every
// spare_interval * f, positions decay over N. What does not shrink with N:
// - the interval of structural updates stays at 100 iterations as long as N >= 7000 and shrinks to no less than 50 below,
//   because the statistics need their views and a new primitive its steps;
// - the start stays late enough for the first average, at least one interval;
// - opacity resets never come closer than 1000 iterations (an opacity needs a few hundred steps to come back from 0.01, and
//   the loss as many to settle) and never in the last third of the densification: a short run has none.

#include "schedule.h"

#include <math.h>

enum { PAPER_LENGTH = 30000, RESET_RECOVERY = 1000 };

static int rounded(double value, int least)
{
    const int whole = (int)lround(value);
    return whole < least ? least : whole;
}

sgsi_schedule sgsi_schedule_make(const sgs_train_options *options, size_t train_views)
{
    const bool scaled = options->schedule == SGS_SCHEDULE_SCALED;
    const double f = scaled ? (double)options->iterations / PAPER_LENGTH : 1.0;
    sgsi_schedule schedule = {.iterations = options->iterations,
                              .densify_from = 500,
                              .densify_until = 15000,
                              .densify_interval = 100,
                              .reset_interval = 3000,
                              .reset_until = 15000,
                              .sh_interval = rounded(1000 * f, 1),
                              .rate_span = PAPER_LENGTH * f,
                              .check_interval = rounded(options->spare_interval * f, 1)};
    const double memory = fmax(200 * f, (double)train_views);
    schedule.loss_decay = 1.0 - 1.0 / fmax(memory, 2.0);
    if (!scaled || options->iterations == PAPER_LENGTH)
        return schedule;
    schedule.densify_until = rounded(15000 * f, 1);
    if (f < 1.0) {
        schedule.densify_interval = rounded(100 * fmin(1.0, f * PAPER_LENGTH / 7000), 50);
        schedule.densify_from = rounded(500 * f, schedule.densify_interval - 1);
        schedule.reset_interval = rounded(3000 * f / schedule.densify_interval, 1) * schedule.densify_interval;
        const int recovery = (RESET_RECOVERY + schedule.densify_interval - 1) / schedule.densify_interval * schedule.densify_interval;
        if (schedule.reset_interval < recovery)
            schedule.reset_interval = recovery;
        schedule.reset_until = schedule.densify_until * 2 / 3;
    } else {
        schedule.reset_until = schedule.densify_until;
    }
    return schedule;
}

bool sgsi_schedule_is_structural(const sgsi_schedule *schedule, int iteration)
{
    return iteration > schedule->densify_from && iteration < schedule->densify_until && iteration % schedule->densify_interval == 0;
}

bool sgsi_schedule_is_reset(const sgsi_schedule *schedule, int iteration)
{
    return schedule->reset_interval && iteration < schedule->reset_until && iteration % schedule->reset_interval == 0;
}

double sgsi_schedule_rate(const sgsi_schedule *schedule, int iteration)
{
    const double u = fmin(fmax(iteration / schedule->rate_span, 0.0), 1.0);
    return exp(u * log(0.01));
}
