// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The scores of the single methods. Arguments are checked by sgs_prune_scores; errors are its.

#include "sparegs/prune.h"

// At most this many cameras enter REFINE's visibility.
enum { SGSI_REFINE_CAMERAS = 64 };

// Multiplies the scores [model->count] by (V / V_90)^power, V the product of the scales and V_90
// the element of rank 0.9 count of the volumes in descending order. Fails with OUT_OF_MEMORY.
sgs_status sgsi_weigh_by_volume(const sgs_gaussians *model, double power, double *scores);

sgs_status sgsi_lightgaussian_scores(const sgs_gaussians *model, const sgs_prune_options *options,
                                     double *scores);
sgs_status sgsi_refine_scores(const sgs_gaussians *model, const sgs_prune_options *options,
                              double *scores);
sgs_status sgsi_pup_scores(const sgs_gaussians *model, const sgs_prune_options *options,
                           double *scores);
sgs_status sgsi_rap_scores(const sgs_gaussians *model, const sgs_prune_options *options,
                           double *scores);

// The cameras that REFINE's released code draws from `count` > `wanted`: Python's
// random.Random(42).sample(range(count), wanted). chosen: [wanted]. Fails with OUT_OF_MEMORY.
sgs_status sgsi_refine_sample(size_t count, size_t wanted, size_t *chosen);

// 1 - share as a decimal fraction: in doubles, 1 - 0.8 is below 0.2 and 1 - 0.9 below 0.1.
double sgsi_other_share(double share);
