// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Quality of a tree: its shape, surface-area cost, the overlap of its boxes, and the work of
// packets that traverse it. Embree does not expose the trees of its scenes, so these figures
// describe the tree that rtcBuildBVH builds with the settings of Embree's builders for user
// geometry: eight children (four without AVX), one primitive per leaf, up to seven with REFIT; HIGH
// as MEDIUM, because user geometry has no spatial splits.

#include "bvh/bvh.h"

enum { SGSI_BVH_LEAF_MAX = 7 };

typedef struct sgsi_bvh_cost {
    // Expected number of boxes and primitives that a random ray through the root box intersects:
    // the sum over nodes of their area, for leaves times their number of primitives, divided by the
    // area of the root (Goldsmith and Salmon 1987; MacDonald and Booth 1990).
    double cost;
    double primitives; // the primitives alone: those that Embree reports for such a ray
    // Surface area of the intersection of two children of a node, relative to that of the node,
    // summed over pairs; area-weighted mean.
    double overlap;
    size_t nodes, leaves;                     // nodes: with the leaves
    size_t leaf_sizes[SGSI_BVH_LEAF_MAX + 1]; // number of leaves with 0, 1, ... primitives
    int depth;                                // nodes on the longest path from the root to a leaf
} sgsi_bvh_cost;

// Work of all packets: a packet visits the root and every node whose box one of its valid rays
// crosses at a distance in [0, far]. Embree may split a packet whose rays diverge and then visits
// nodes more than once.
typedef struct sgsi_bvh_visits {
    const sgsi_packet *packets; // [count]
    size_t count;
    // Results, summed over the packets:
    uint64_t nodes;      // visited
    uint64_t boxes;      // of children tested
    uint64_t primitives; // in visited leaves: those that Embree reports
} sgsi_bvh_visits;

// Builds the tree over `built` [count] and refits it to `bounds` [count]. Both may be the same
// array. visits: NULL, or packets that traverse it, in parallel. Allocates about 250 bytes per box
// and 24 per packet. Fails with OUT_OF_MEMORY, or UNSUPPORTED or INTERNAL if
// Embree has no device; *cost is then zeroed.
sgs_status sgsi_bvh_cost_measure(const sgsi_bounds *built, const sgsi_bounds *bounds, size_t count,
                                 sgsi_bvh_quality quality, sgsi_bvh_visits *visits,
                                 sgsi_bvh_cost *cost);
