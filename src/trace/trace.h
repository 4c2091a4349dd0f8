// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The data that the tracer and its kernels share: what is known of a primitive for one view, of a
// tile's rays for one camera, and the sums that the backward pass leaves per primitive.
//
// Geometry. The camera sits at the origin of camera axes; delta = R_wc (mean - c). In the
// primitive's own metric M = S'^-1 R^T R_wc^T the mean is at M delta, distance P = |M delta|.
// Rotate that space so that M delta lies on the third axis and divide by P / |delta|: a ray d then
// has coordinates (gx, gy, gz) with gx = gy = 0, gz = 1 towards the mean, and
//     rho^2 = P^2 (gx^2 + gy^2) / |g|^2,    t = |delta| gz / |g|^2   (in units of |d|).
// With kappa = P^2 log2(e) / 2 folded into A = sqrt(kappa) gx, B = sqrt(kappa) gy, C = gz:
//     G = (A^2 + B^2) / kappa + C^2,   E = (A^2 + B^2) / G,   alpha = 2^(log2 o - E),   t = |delta|
//         C / G.
// A, B, C are linear in d. A macrotile of tiles writes its rays as d = d0 + u e1 + v e2 (any
// central camera, no unit length needed: rho is homogeneous), so they become affine in (u, v), with
// nothing that cancels at the footprint.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "bvh/bvh.h"
#include "rays/rays.h"
#include "sparegs/render.h"

enum { SGSI_PROJECTED_FLOATS = 16 }; // floats per record

// What a view knows of a primitive: one cache line.
enum {
    SGSI_PROJECTED_A = 0, // 3: row of A in camera axes
    SGSI_PROJECTED_B = 3,
    SGSI_PROJECTED_C = 6,
    SGSI_PROJECTED_LOG_OPACITY =
        9, // log2 of the opacity; SGSI_UNTRACED when the view cannot see it
    SGSI_PROJECTED_INV_KAPPA = 10,
    SGSI_PROJECTED_DISTANCE = 11, // |delta|
    SGSI_PROJECTED_COLOR = 12,    // 3: clamped at 0
    SGSI_PROJECTED_REACH = 15     // in tiles: q, bound on sqrt(A^2 + B^2) / C inside the support
};
#define SGSI_UNTRACED (-1e30f)
#define SGSI_LOG2_255 7.9943534368588578f
#define SGSI_HALF_LOG2E 0.72134752044448170f

// What the backward pass sums per primitive, over counted hits: v = alpha dL/dalpha, a = A C / G, b
// = B C / G, E.
enum {
    SGSI_GRAD_SUM_COLOR = 0, // 3: dL/dcolour = sum w dL/dC
    SGSI_GRAD_SUM_V = 3,
    SGSI_GRAD_SUM_VA = 4,
    SGSI_GRAD_SUM_VB = 5,
    SGSI_GRAD_SUM_VE = 6,
    SGSI_GRAD_SUM_VAA = 7,
    SGSI_GRAD_SUM_VAB = 8,
    SGSI_GRAD_SUM_VBB = 9,
    SGSI_GRAD_SUM_VAE = 10,
    SGSI_GRAD_SUM_VBE = 11,
    SGSI_GRAD_SUM_VEE = 12,
    SGSI_GRAD_SUM_WEIGHT = 13, // sum w: above 0 where any ray counts a hit
    SGSI_GRAD_SUM_ABS =
        14 // 2, on demand: sums of |v (a A + b B - E C)| over x and y of the camera axes
};

// Bits of a tile's candidates for the backward pass.
typedef struct sgsi_tile_list {
    uint32_t *ids;        // [count] primitives, near to far by |delta|
    uint32_t *block_hits; // per block: indices into ids, in the block's order
    uint32_t block_begin[SGSI_BLOCKS + 1];
    uint32_t count;
} sgsi_tile_list;
