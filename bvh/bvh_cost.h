// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Quality of a tree: its surface-area cost and the overlap of its boxes. Embree does not expose the
// trees of its scenes, so these figures describe the tree that rtcBuildBVH builds with the settings
// of Embree's builders for user geometry: eight children (four without AVX), one primitive per
// leaf, up to seven with REFIT; HIGH as MEDIUM, because user geometry has no spatial splits.

#include "bvh/bvh.h"

typedef struct sgsi_bvh_cost {
    // Expected number of boxes and primitives that a random ray through the root box intersects:
    // the sum over nodes of their area, for leaves times their number of primitives, divided by the
    // area of the root (Goldsmith and Salmon 1987; MacDonald and Booth 1990).
    double cost;
    double primitives; // the primitives alone: those that Embree reports for such a ray
    // Surface area of the intersection of two children of a node, relative to that of the node,
    // summed over pairs; area-weighted mean.
    double overlap;
    size_t nodes, leaves;
} sgsi_bvh_cost;

// Builds the tree over `built` [count] and refits it to `bounds` [count]. Both may be the same
// array. Allocates about 200 bytes per box. Fails with OUT_OF_MEMORY, or UNSUPPORTED or INTERNAL if
// Embree has no device; *cost is then zeroed.
sgs_status sgsi_bvh_cost_measure(const sgsi_bounds *built, const sgsi_bounds *bounds, size_t count,
                                 sgsi_bvh_quality quality, sgsi_bvh_cost *cost);
