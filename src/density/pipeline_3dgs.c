// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Density control of 3D Gaussian Splatting (Kerbl et al. 2023, section 5.2 and appendix B):
// primitives with a large gradient of their projected centre are cloned if small and split if
// large; those that are faint or, after the first opacity reset, too large are removed, new rows
// included. In scaled runs on high-resolution images, absolute gradients count as well
// (schedule.c), after AbsGS (Ye et al. 2024), which uses them for splits only and in place of
// signed ones: signed ones cancel where a texture is finer than the primitive. Updates after the
// densification only remove primitives. SPARE-GS: w multiplies the mean gradient; redundant
// primitives are removed, too.

#include "density/pipeline.h"

#include <math.h>

static void decide_row(const sgsi_density_decision *decision, size_t i, sgsi_density_result *result)
{
    const sgsi_density_options *options = decision->options;
    sgsi_density_columns *c = decision->columns;
    const float threshold = (float)options->gradient_threshold,
                score = fmaxf(c->score[i], (float)options->abs_share * c->abs_grad[i]);
    c->priority[i] = score * c->weight[i];
    const bool grows = c->priority[i] >= threshold;
    c->action[i] = sgsi_density_growth(grows, c->scale_max[i], (float)options->size_split);
    c->removed[i] = sgsi_density_should_prune(options, c->opacity[i], c->scale_max[i]);
    c->prune_children[i] = sgsi_density_should_prune_after(options, c, i);
    sgsi_density_count_reversal(score >= threshold, grows, result);
}

static sgs_status decide(const sgsi_density_options *options, sgsi_density_columns *c,
                         sgsi_density_result *result)
{
    if (options->final_prune)
        sgsi_density_decide_thinning(options, c);
    else
        sgsi_density_decide_rows(&(sgsi_density_decision){options, c, 0.0f, decide_row}, result);
    return SGS_STATUS_OK;
}

const sgsi_pipeline sgsi_pipeline_3dgs = {.name = "3dgs",
                                          .densify_until = 15000,
                                          .densify_interval = 100,
                                          .lr_opacity = 0.025f,
                                          .lr_rest = 1.25e-4f,
                                          .prunes_large = true,
                                          .fine_growth = true,
                                          .abs_grad_norm = true,
                                          .decide = decide};
