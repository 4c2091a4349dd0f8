// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// "Which Gaussians can these rays meet?" One Embree user geometry over all primitives, answered for
// packets of sixteen cone rays: each ray stands for a block of pixels, and the caller has dilated
// the bounds by the block's footprint, so the answer is conservative. Knows boxes and ids, nothing
// of Gaussians.

#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

typedef struct sgsi_bvh sgsi_bvh;

// Same layout as Embree's RTCBounds: 32 bytes.
typedef struct sgsi_bounds {
    float lower[3], align0;
    float upper[3], align1;
} sgsi_bounds;

// LOW: Morton order, the fastest build. MEDIUM: macrotile_seconds SAH. HIGH: Embree's best (no
// spatial splits for user geometry). REFIT: macrotile_seconds SAH in a scene of two levels, the
// only one that refits.
typedef enum sgsi_bvh_quality {
    SGSI_BVH_LOW,
    SGSI_BVH_MEDIUM,
    SGSI_BVH_HIGH,
    SGSI_BVH_REFIT,
    SGSI_BVH_QUALITY_COUNT
} sgsi_bvh_quality;

// On failure *bvh is NULL.
sgs_status sgsi_bvh_create(sgsi_bvh **bvh);
void sgsi_bvh_destroy(sgsi_bvh *bvh); // accepts NULL

// Builds over `bounds`, which stay owned by the caller and must live until the next build or
// destroy.
sgs_status sgsi_bvh_build(sgsi_bvh *bvh, const sgsi_bounds *bounds, size_t count,
                          sgsi_bvh_quality quality);

// Follows changed bounds (same array, same count) without changing the tree's topology. Falls back
// to a rebuild for a tree that was not built with SGSI_BVH_REFIT.
sgs_status sgsi_bvh_refit(sgsi_bvh *bvh);

// Sixteen rays from one origin, world space; unit directions. Lanes whose bit in `valid` is 0 are
// ignored.
typedef struct sgsi_packet {
    float origin[3];
    uint32_t valid;
    float direction[3][16];
    float far[16];
} sgsi_packet;

// Where the ids go. Owned by the caller, one per thread; grows as needed (ids may be NULL at
// first).
typedef struct sgsi_gather_list {
    uint32_t *ids;
    size_t count, capacity;
    const void
        *rows; // NULL, or what the caller reads next of each primitive: row `id` is prefetched
    size_t row_bytes;
} sgsi_gather_list;

// Appends the id of every primitive whose bounds a ray of the packet may cross at a distance in [0,
// far], in no particular order and possibly more than once. Thread-safe for different lists. Fails
// with OUT_OF_MEMORY.
sgs_status sgsi_bvh_gather(const sgsi_bvh *bvh, const sgsi_packet *packet, sgsi_gather_list *list);

// Bytes that Embree holds for this tree, by its memory monitor.
size_t sgsi_bvh_bytes(const sgsi_bvh *bvh);

// "Embree 3.13.5": the library as loaded. Constant string.
const char *sgsi_bvh_version(void);
