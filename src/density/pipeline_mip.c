// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Mip-Splatting (Yu et al. 2024, section 5, and the authors' trainer): density control of 3DGS with
// two gradients. A primitive grows if its mean gradient reaches tau, or its mean absolute gradient
// (per pixel, without cancellation) reaches Q, the quantile that as many primitives exceed as
// exceed tau. Sizes and opacities are the stored ones, without the 3D filter. SPARE-GS: tau and Q
// are from the unweighted gradients; w multiplies both gradients before the comparison. Updates
// after the densification only remove primitives.

#include "density/pipeline.h"

#include <math.h>

// The (1 - share) quantile of `count` > 0 values with linear interpolation between neighbours.
static float upper_quantile(const float *values, size_t count, double share)
{
    const double at = (1.0 - share) * (double)(count - 1);
    const size_t below = (size_t)at, above = below + 1 < count ? below + 1 : below;
    const double low = (double)sgsi_positive_rank(values, count, below),
                 high = (double)sgsi_positive_rank(values, count, above);
    return (float)(low + (at - (double)below) * (high - low));
}

// Without any gradient the quantile is 0, which no primitive reaches.
static bool reaches(float gradient, float quantile)
{
    return quantile > 0.0f && gradient >= quantile;
}

static void decide_row(const sgsi_density_decision *decision, size_t i, sgsi_density_result *result)
{
    const sgsi_density_options *options = decision->options;
    sgsi_density_columns *c = decision->columns;
    const float threshold = (float)options->gradient_threshold, quantile = decision->quantile;
    const float w = c->weight[i], share = quantile > 0.0f ? threshold / quantile : 0.0f;
    const bool native = c->score[i] >= threshold || reaches(c->abs_grad[i], quantile);
    const bool grows = c->score[i] * w >= threshold || reaches(c->abs_grad[i] * w, quantile);
    c->priority[i] = fmaxf(c->score[i], c->abs_grad[i] * share) * w;
    c->action[i] = sgsi_density_growth(grows, c->scale_max[i], (float)options->size_split);
    c->removed[i] = sgsi_density_should_prune(options, c->opacity[i], c->scale_max[i]);
    c->prune_children[i] = sgsi_density_should_prune_after(options, c, i);
    sgsi_density_count_reversal(native, grows, result);
}

static sgs_status decide(const sgsi_density_options *options, sgsi_density_columns *c,
                         sgsi_density_result *result)
{
    if (options->final_prune) {
        sgsi_density_decide_thinning(options, c);
        return SGS_STATUS_OK;
    }
    const float threshold = (float)options->gradient_threshold;
    size_t pulled = 0;
    for (size_t i = 0; i < c->count; ++i)
        pulled += c->score[i] >= threshold;
    if (!c->count)
        return SGS_STATUS_OK;
    const float quantile = upper_quantile(c->abs_grad, c->count, (double)pulled / (double)c->count);
    sgsi_density_decide_rows(&(sgsi_density_decision){options, c, quantile, decide_row}, result);
    return SGS_STATUS_OK;
}

const sgsi_pipeline sgsi_pipeline_mip = {.name = "mip",
                                         .densify_until = 15000,
                                         .densify_interval = 100,
                                         .lr_opacity = 0.05f,
                                         .lr_rest = 1.25e-4f,
                                         .abs_grad = true,
                                         .prunes_large = true,
                                         .fine_growth = true,
                                         .decide = decide};
