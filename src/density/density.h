// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Structural updates: where primitives are cloned, split and removed (by the rules of a base
// pipeline), weighted and pruned by SPARE-GS. Works on the model, its moments and its statistics;
// knows no images and no BVH.

#include "density/density_columns.h"
#include "sparegs/gaussians.h"

struct sgsi_pipeline;

// Per primitive, since the last structural update (Kerbl et al. 2023, section 5.2; a_i, d_i and
// rho_i of the SPARE-GS paper, equations 16 to 18). 64-byte aligned columns, `capacity` long.
typedef struct sgsi_statistics {
    float *gradient_sum;     // a_i
    float *abs_grad_sum;     // the same over absolute values of the pixels' gradients; 0 where the
                             // pipeline wants none
    uint32_t *visible_count; // d_i
    float *radius_max;       // rho_i, pixels
    size_t capacity;
} sgsi_statistics;

sgs_status sgsi_statistics_reserve(sgsi_statistics *statistics,
                                   size_t capacity); // zeroes everything when it grows
void sgsi_statistics_clear(sgsi_statistics *statistics, size_t count);
// After a change of the image size by `factor`: radii are pixels. Gradients are per half image, so
// they and the counts stay.
void sgsi_statistics_resize_images(sgsi_statistics *statistics, size_t count, float factor);
void sgsi_statistics_free(sgsi_statistics *statistics);

// What an update changes. m and v are moments in the model's layout and capacity; both may be
// reallocated.
typedef struct sgsi_density_rows {
    sgs_gaussians *model;
    float **m, **v;
    sgsi_statistics *statistics;
} sgsi_density_rows;

// One structural update by the rules of a pipeline. Moments are gathered along (new rows: 0). Rows
// come out in Morton order of their means. Statistics are cleared. On failure (OUT_OF_MEMORY) the
// model must not be used further.
sgs_status sgsi_density_update(const sgsi_density_rows *rows, const struct sgsi_pipeline *pipeline,
                               const sgsi_density_options *options, sgsi_density_result *result);

// Opacity reset: logit <- logit(min(o, ceiling)), its moments <- 0. filter_3d [count] or NULL: what
// is held under the ceiling is the opacity that Mip-Splatting's filter leaves.
void sgsi_density_reset_opacity(sgs_gaussians *model, float *m, float *v, double ceiling,
                                const float *filter_3d);

// Puts the rows of a fresh model (no moments yet) into Morton order.
sgs_status sgsi_density_sort(sgs_gaussians *model);
