// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// SPARE-GS: equilibrium-driven termination, Eq. 26 of the paper.
//
//   Delta L = 1 - L(t) / L(t - Delta t),   Delta N = N(t) / N(t - Delta t) - 1
//   stop when 0 <= Delta L < eps_L and |Delta N| < eps_N at `patience` checks in a row
//
// OPEN-4: the paper specifies neither Delta t nor how L is averaged. Late in training the loss
// falls by 0.7 to 1 % per 1000 iterations of a 30 000-iteration run, so eps_L = 0.008 fits checks
// that are 1000 f iterations apart, f = iterations / 30 000 (1 under the paper schedule).
//
// Views differ from each other far more than one view changes between two checks: on banana
// (375x250, iterations 1700 to 3000) the logarithm of the loss has a standard deviation of 0.20
// between views and of 0.014 around each view's own trend. A moving average over all views would
// therefore measure which views came last. Each view is compared with itself instead: the model is
//   ln L_v(t) = c_v - lambda t
// with one constant per view and one common slope, fitted by least squares to the last two
// intervals between checks (to one, if it has two losses per view and follows a disturbance),
//   lambda = - sum_v S_ty / sum_v S_tt,   Delta L = 1 - exp(-lambda Delta t),
// where S_ty and S_tt are sums of products of deviations from the means of the view. The residuals
// give the standard error of Delta L. Its upper confidence bound has to stay below eps_L:
//   0 <= Delta L   and   Delta L + 2 error < eps_L.
//
// An interval ends at a check, but not before it holds as many iterations as there are views. The
// fit restarts after a structural update, an opacity reset or a change of the image size. N is
// compared with the check before, also across such a disturbance.

#include <math.h>
#include <string.h>

#include "spare/spare.h"

#define CONFIDENCE 2.0 // standard errors
#define ROUNDING 1e-9  // a constant loss may appear to grow by this much

void spare_equilibrium_begin(spare_equilibrium *state)
{
    *state = (spare_equilibrium){0};
}

void spare_equilibrium_disturb(spare_equilibrium *state, spare_view_fit *fits, size_t views)
{
    memset(fits, 0, 2 * views * sizeof *fits);
    state->observed[0] = state->observed[1] = 0;
    state->held = 0;
}

void spare_equilibrium_observe(spare_equilibrium *state, spare_view_fit *fits, size_t view,
                               long iteration, double loss)
{
    if (!isfinite(loss))
        return;
    spare_view_fit *fit = &fits[2 * view];
    const double t = (double)iteration, y = log(fmax(loss, 1e-12));
    fit->count += 1.0;
    fit->t += t;
    fit->y += y;
    fit->tt += t * t;
    fit->ty += t * y;
    fit->yy += y * y;
    ++state->observed[0];
}

// Sums of products of deviations from the means of each view, over both intervals.
typedef struct deviations {
    double tt, ty, yy, freedom;
} deviations;

static deviations sum_deviations(const spare_view_fit *fits, size_t views)
{
    deviations sum = {.freedom = -1.0}; // of the slope
    for (size_t v = 0; v < views; ++v) {
        const spare_view_fit *a = &fits[2 * v], *b = a + 1;
        const double n = a->count + b->count, t = a->t + b->t, y = a->y + b->y;
        if (n < 2.0)
            continue;
        sum.tt += a->tt + b->tt - t * t / n;
        sum.ty += a->ty + b->ty - t * y / n;
        sum.yy += a->yy + b->yy - y * y / n;
        sum.freedom += n - 1.0;
    }
    return sum;
}

// Sets last_loss_change and last_loss_error. False if the observations do not determine them.
static bool fit_loss(spare_equilibrium *state, const spare_view_fit *fits, size_t views,
                     double interval)
{
    const deviations sum = sum_deviations(fits, views);
    if (!(sum.tt > 0.0) || sum.freedom < 1.0)
        return false;
    const double slope = sum.ty / sum.tt;
    const double variance = fmax(sum.yy - slope * sum.ty, 0.0) / sum.freedom;
    state->last_loss_change = -expm1(slope * interval);
    state->last_loss_error = sqrt(variance / sum.tt) * interval;
    return true;
}

bool spare_equilibrium_check(spare_equilibrium *state, spare_view_fit *fits, size_t views,
                             long interval, size_t count, const spare_tolerance *tolerance)
{
    if (state->observed[0] < views || !views)
        return false;
    bool holds = false;
    const double before = (double)state->previous_count;
    const bool enough = state->observed[1] || state->observed[0] >= 2 * views;
    if (enough && before > 0.0 && fit_loss(state, fits, views, (double)interval)) {
        state->last_count_change =
            state->previous_count == count ? 0.0 : (double)count / before - 1;
        holds = state->last_loss_change >= -ROUNDING &&
                state->last_loss_change + CONFIDENCE * state->last_loss_error < tolerance->loss &&
                fabs(state->last_count_change) < tolerance->count;
    }
    state->held = holds ? state->held + 1 : 0;
    state->previous_count = count;
    for (size_t v = 0; v < views; ++v) {
        fits[2 * v + 1] = fits[2 * v];
        fits[2 * v] = (spare_view_fit){0};
    }
    state->observed[1] = state->observed[0];
    state->observed[0] = 0;
    return holds && state->held >= tolerance->patience;
}
