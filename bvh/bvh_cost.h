// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// How good a tree is, without asking it: its surface-area cost and the overlap of its boxes. Embree
// shows its own trees to nobody, so these figures are of the tree that its builder of the same
// quality makes through rtcBuildBVH (HIGH as MEDIUM: it splits no user geometry), with one
// primitive per leaf (REFIT: up to eight, as in its trees of two levels).

#include "bvh/bvh.h"

typedef struct sgsi_bvh_cost {
    // Expected boxes and primitives that a random ray through the root's box meets: sum over nodes
    // of area / area of the root, leaves times their primitives (Goldsmith and Salmon 1987;
    // MacDonald and Booth 1990).
    double cost;
    // Share of a node's surface that two of its children have in common, summed over pairs; mean
    // weighted by area.
    double overlap;
    size_t nodes, leaves;
} sgsi_bvh_cost;

// The tree is built over `built` and then, its topology kept, fitted to `bounds` [count], as refits
// do. Both may be the same array. Takes about 200 bytes per box. Fails with OUT_OF_MEMORY.
sgs_status sgsi_bvh_cost_measure(const sgsi_bounds *built, const sgsi_bounds *bounds, size_t count,
                                 sgsi_bvh_quality quality, sgsi_bvh_cost *cost);
