// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// SPARE-GS: equilibrium-driven termination, Eq. 26 of the paper.
//
//   Delta L = 1 - L(t) / L(t - Delta t),   Delta N = N(t) / N(t - Delta t) - 1
//   stop when 0 <= Delta L < eps_L and |Delta N| < eps_N at `patience` checks in a row
//
// with L an exponential moving average of the photometric loss. A growing loss (Delta L < 0) resets
// the count.
//
// OPEN-4: the paper specifies neither Delta t nor the average. Late in training the loss falls by
// 0.7 to 1 % per 1000 iterations of a 30 000-iteration run, so eps_L = 0.008 fits checks that are
// 1000 f iterations apart, f = iterations / 30 000 (1 under the paper schedule). The average
// remembers max(200 f, number of training views) iterations, at least one pass over the views: its
// decay is 1 - 1 / that, 0.995 at full length with up to 200 views. The decay 0.6 of the usual log
// line would average about three views and make Delta L noise of +-20 %. The average is divided by
// its accumulated weight, which removes the bias of the start at 0.
//
// Two cases that the paper does not cover: an interval with an opacity reset gives no evidence of
// convergence, because the reset raises the loss; its check only sets the reference of the next
// comparison. A non-finite loss is ignored.

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

// now / before - 1; 0 / 0 counts as no change.
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
