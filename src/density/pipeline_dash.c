// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// DashGaussian (Chen et al. 2025, the primitive scheduler): the first images are small
// (resolution.c), and the number of primitives follows their resolution up to a budget, which is
// momentum-based or preset.
//
// Budget: N_max = N_0 + m, m = 5 N_0 at first; after every update m <- max(m, 0.98 m + min(1e6,
// n)), n the number of primitives whose mean gradient reaches tau. At scale r and iteration t, N
// may grow towards N_0 + (N_max - N_0) / r^(2 - t / T) by at most a fifth per 100 iterations of the
// published schedule (compounded where a scaled schedule updates less often). An update first
// removes opacities below 0.005 (no pruning by size), then clones and splits the primitives with
// the largest gradients.
//
// SPARE-GS: w multiplies the gradient for threshold and ranking, not for the momentum; redundant
// primitives are removed with the faint ones, before new rows are added. As in the released code,
// the number of rows to add is measured from the count before pruning: pruned rows are replaced if
// enough primitives qualify.

#include "density/pipeline.h"

#include <math.h>

#include "base/core.h"
#include "density/row_limits.h"

enum { PAPER_UPDATES = 265 };
static const double rate_max = 0.2, momentum_decay = 0.98, momentum_step = 1e6, momentum_start = 5;

static double budget(const sgsi_density_options *options, double initial)
{
    const size_t preset = options->train->pipeline_options.dash_count;
    if (!options->state->momentum)
        options->state->momentum = (int64_t)(momentum_start * initial);
    return preset ? (double)preset : initial + (double)options->state->momentum;
}

// Number of rows to add to those left after pruning.
static double room(const sgsi_density_options *options, size_t count, size_t left)
{
    const double initial = (double)options->state->initial_count, most = budget(options, initial),
                 now = (double)count;
    const double share = (double)options->iteration / options->until;
    const bool last = options->iteration + options->interval >= options->until;
    const double next =
        last ? most : initial + trunc((most - initial) / pow(options->resolution, 2.0 - share));
    const double steps =
        fmax((double)PAPER_UPDATES / (options->update_count > 0 ? options->update_count : 1), 1.0);
    const double rate = fmin(fmax((next - now) / now, 0.0), pow(1.0 + rate_max, steps) - 1.0);
    return fmin(fmax(trunc(now * (1.0 + rate) - (double)left), 0.0), (double)left);
}

static sgs_status decide(const sgsi_density_options *options, sgsi_density_columns *c,
                         sgsi_density_result *result)
{
    const float threshold = (float)options->gradient_threshold;
    double *score = sgsi_alloc(c->count ? c->count : 1, sizeof *score);
    uint8_t *left = sgsi_alloc(c->count ? c->count : 1, 1),
            *chosen = sgsi_alloc(c->count ? c->count : 1, 1);
    sgs_status status = score && left && chosen ? SGS_STATUS_OK : SGS_STATUS_OUT_OF_MEMORY;
    size_t survivors = 0, pulled = 0;
    for (size_t i = 0; i < c->count && !status; ++i)
        c->removed[i] = c->opacity[i] < (float)options->opacity_min;
    if (!status) // before the rows that replace the removed ones are counted
        status = sgsi_limit_removal(options, c);
    for (size_t i = 0; i < c->count && !status; ++i) {
        c->priority[i] = c->score[i] * c->weight[i];
        left[i] = !c->removed[i] && !c->redundant[i];
        score[i] = (double)c->priority[i];
        survivors += left[i];
        pulled += !c->removed[i] && c->score[i] >= threshold;
    }
    if (!status && c->count)
        status = sgsi_select_best(score, left, c->count, (size_t)room(options, c->count, survivors),
                                  chosen);
    for (size_t i = 0; i < c->count && !status; ++i) {
        const bool grows = chosen[i] && c->priority[i] >= threshold;
        sgsi_density_count_reversal(left[i] && c->score[i] >= threshold,
                                    left[i] && c->priority[i] >= threshold, result);
        c->action[i] = sgsi_density_growth(grows, c->scale_max[i], (float)options->size_split);
    }
    const double m = (double)options->state->momentum;
    options->state->momentum =
        (int64_t)fmax(m, trunc(momentum_decay * m + fmin(momentum_step, (double)pulled)));
    sgsi_free(score);
    sgsi_free(left);
    sgsi_free(chosen);
    return status == SGS_STATUS_OUT_OF_MEMORY
               ? sgsi_fail(status, "not enough memory to rank %zu primitives", c->count)
               : status;
}

const sgsi_pipeline sgsi_pipeline_dash = {.name = "dash",
                                          .densify_until = 27000,
                                          .densify_interval = 100,
                                          .lr_opacity = 0.025f,
                                          .lr_rest = 1.25e-4f,
                                          .small_images = 16,
                                          .decide = decide};
