// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// SPARE-GS, the part that says when to stop: Eq. (26) of the paper.
//
//   Delta L = 1 - L(t) / L(t - Delta t),   Delta N = N(t) / N(t - Delta t) - 1
//   stop when 0 <= Delta L < eps_L and |Delta N| < eps_N at `patience` checks in a row
//
// with L an exponential moving average of the photometric loss. A loss that grows (Delta L < 0)
// starts the count again.
//
// OPEN-4: the paper names neither Delta t nor the average. Late in training the loss falls by 0.7
// to 1 % per 1000 iterations, so eps_L = 0.008 is a sensible threshold for checks 1000 iterations
// apart and for no other interval: the trainer checks every 1000. The average has decay 0.995, a
// memory of about 200 iterations (one round through the views); the decay 0.6 of the usual log line
// remembers three views, and Delta L would be noise of +-20 %. The average is corrected for its
// start at 0 by dividing by the weight it has gathered.
//
// Two cases the paper does not mention: a window that holds an opacity reset says nothing about
// convergence, because the loss jumps there: its check only records where the next comparison
// starts from. A loss that is not finite is not observed.

#include <math.h>

#include "spare/spare.h"

void spare_equilibrium_begin(spare_equilibrium *state)
{
    *state = (spare_equilibrium){.previous_loss = -1.0};
}

void spare_equilibrium_observe(spare_equilibrium *state, double loss, double decay)
{
    if (!isfinite(loss))
        return;
    state->loss_average = decay * state->loss_average + (1.0 - decay) * loss;
    state->loss_weight = decay * state->loss_weight + (1.0 - decay);
}

// now / before - 1, with 0/0 no change.
static double relative_change(double now, double before)
{
    return now == before ? 0.0 : now / before - 1.0;
}

bool spare_equilibrium_check(spare_equilibrium *state, size_t count, bool disturbed,
                             double eps_loss, double eps_count, int patience)
{
    if (!(state->loss_weight > 0.0))
        return false;
    const double loss = state->loss_average / state->loss_weight;
    const bool comparable = !disturbed && state->previous_loss >= 0.0;
    if (comparable) {
        state->last_loss_change = -relative_change(loss, state->previous_loss);
        state->last_count_change = relative_change((double)count, (double)state->previous_count);
    }
    const bool holds = comparable && state->last_loss_change >= 0.0 &&
                       state->last_loss_change < eps_loss &&
                       fabs(state->last_count_change) < eps_count;
    state->held = holds ? state->held + 1 : 0;
    state->previous_loss = loss;
    state->previous_count = count;
    return holds && state->held >= patience;
}
