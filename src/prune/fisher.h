// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Data shared by fisher.c and its kernel: the 6 x 6 Fisher matrices of PUP 3D-GS over position and
// log scale, and what is needed of a primitive in one view. All in double precision.

#include <stdint.h>

#include "sparegs/prune.h"

// Upper triangle of a symmetric 6 x 6 matrix by rows: (0,0), (0,1), ... (0,5), (1,1), ... (5,5).
enum { SGSI_FISHER_ENTRIES = 21 };

typedef struct sgsi_fisher_primitive {
    double matrix[9];        // M = S''^-1 R^T, row-major
    double offset[3];        // p = M (c - mean)
    double opacity;          // o''
    double color[3];         // SH colour, >= 0
    double d_color[3][3];    // [channel]: gradient with respect to the mean, through the direction
    double ratio[3];         // d log s'' / d log s = s^2 / s''^2
    double inv_variance[3];  // 1 / s''^2
    double depth[3];         // half the gradient of the filter's variance eps^2 by the mean
    double d_log_opacity[6]; // of ln o'' by mean and log scale; 0 without Mip-Splatting's factors
} sgsi_fisher_primitive;

// A block of 4 x 4 rays and the primitives that one of them hits.
typedef struct sgsi_fisher_block {
    _Alignas(64) double direction[3][16]; // unit, world; all 0 for lanes without a ray
    double near_distance;
    double background[3];
    uint32_t count;
    const uint32_t *entries;                 // [count]: indices into primitives, ids and sums
    const sgsi_fisher_primitive *primitives; // of the tile
    const uint32_t *ids;                     // of the tile: order hits of equal distance
    double (*sums)[SGSI_FISHER_ENTRIES];     // of the tile; added to
    // Scratch: [count][16] each, 64-byte aligned; v and m [count][3][16]; order [count].
    double *response, *t, *weight, *v, *m;
    uint32_t *order;
} sgsi_fisher_block;

typedef void (*sgsi_fisher_kernel)(sgsi_fisher_block *block);

void sgsi_fisher_block_baseline(sgsi_fisher_block *block);
#ifdef SGSI_AVX_KERNELS
void sgsi_fisher_block_avx2(sgsi_fisher_block *block);
void sgsi_fisher_block_avx512(sgsi_fisher_block *block);
#endif

// Sums over all training views, pixels and channels of g g^T, g the gradient of the channel, over
// the background, by mean and log scale of the primitive. sums: [model->count]; overwritten. Fails
// as sgs_contributions does.
sgs_status sgsi_fisher_sums(const sgs_gaussians *model, const sgs_scene *scene,
                            const sgs_view_pass_options *options, const float background[3],
                            double (*sums)[SGSI_FISHER_ENTRIES]);

// ln |det| of a matrix, the sum of the logarithms of its singular values. Finite: entries of the
// diagonal below 1e-300 and pivots below 1e-15 of it count as these.
double sgsi_fisher_log_det(const double sums[SGSI_FISHER_ENTRIES]);
