// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Data shared by the tracer and its kernels: the projected record of a primitive in one view, the
// gradient sums of the backward pass, and the hit lists of a tile.
//
// Geometry. The camera is at the origin of camera axes; delta = R_wc (mean - c). In the primitive's
// own metric M = S'^-1 R^T R_wc^T the mean is at M delta, at distance P = |M delta|. Rotate that
// space so that M delta lies on the third axis and divide by P / |delta|. A ray d then has
// coordinates (gx, gy, gz), with gx = gy = 0 and gz = 1 towards the mean, and
//     rho^2 = P^2 (gx^2 + gy^2) / |g|^2,    t = |delta| gz / |g|^2   (in units of |d|).
// With kappa = P^2 log2(e) / 2, A = sqrt(kappa) gx, B = sqrt(kappa) gy and C = gz:
//     G = (A^2 + B^2) / kappa + C^2,   E = (A^2 + B^2) / G,
//     alpha = 2^(log2 o - E),          t = |delta| C / G.
// A, B and C are linear in d. A macrotile writes its rays as d = d0 + u e1 + v e2, which works for
// any central camera because rho is homogeneous in d. A, B and C are then affine in (u, v), and no
// term cancels at the footprint.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "bvh/bvh.h"
#include "rays/rays.h"
#include "sparegs/render.h"

enum { SGSI_PROJECTED_FLOATS = 16 }; // floats per projected record

// Projected record of a primitive in one view. 64 bytes: one cache line.
enum {
    SGSI_PROJECTED_A = 0, // 3: row of A in camera axes
    SGSI_PROJECTED_B = 3,
    SGSI_PROJECTED_C = 6,
    // log2 of the opacity, or SGSI_UNTRACED if the view cannot see the primitive.
    SGSI_PROJECTED_LOG_OPACITY = 9,
    SGSI_PROJECTED_INV_KAPPA = 10,
    SGSI_PROJECTED_DISTANCE = 11, // |delta|
    SGSI_PROJECTED_COLOR = 12,    // 3: clamped to >= 0
    SGSI_PROJECTED_RADIUS = 15,   // of a sphere around the support, world units
    // In tile records instead: q, the bound on sqrt(A^2 + B^2) / C inside the support.
    SGSI_PROJECTED_REACH = 15
};
#define SGSI_UNTRACED (-1e30f)
#define SGSI_LOG2_255 7.9943534368588578f
#define SGSI_HALF_LOG2E 0.72134752044448170f

// Gradient sums per primitive over counted hits, with v = alpha dL/dalpha, a = A C / G, b = B C /
// G.
enum {
    SGSI_GRAD_SUM_COLOR = 0, // 3: dL/dcolour = sum of w dL/dC
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
    SGSI_GRAD_SUM_WEIGHT = 13, // sum of w: > 0 if any ray counts a hit
    // 2, only if absolute gradients are collected: sums of |v (a A + b B - E C)|, x and y in camera
    // axes.
    SGSI_GRAD_SUM_ABS = 14
};

// Block hits of a tile, kept by the forward pass for the backward pass. A block hit is a (4x4
// block, primitive) pair with a hit that counts or ends a ray; with depths or AOVs, with any hit.
typedef struct sgsi_tile_list {
    uint32_t *ids;        // [count] primitives, near to far by |delta|
    uint32_t *block_hits; // per block, in block order: indices into ids
    uint32_t block_begin[SGSI_BLOCKS + 1];
    uint32_t count;
} sgsi_tile_list;
