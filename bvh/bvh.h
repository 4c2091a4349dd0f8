// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Finds the Gaussians that rays may hit. One Embree user geometry over all primitives, queried with
// packets of sixteen rays. Each ray represents a block of pixels. The caller dilates the bounds by
// the footprint of a block, so the result is conservative. Works on boxes and ids, independent of
// Gaussians.

#include <stddef.h>
#include <stdint.h>

#include "sparegs/status.h"

typedef struct sgsi_bvh sgsi_bvh;

// Same layout as Embree's RTCBounds: 32 bytes.
typedef struct sgsi_bounds {
    float lower[3], align0;
    float upper[3], align1;
} sgsi_bounds;

// LOW: Morton order, the fastest build. MEDIUM: binned SAH. HIGH: the best quality of Embree
// (without spatial splits, which user geometry does not support). REFIT: binned SAH in a two-level
// scene, the only kind that can be refitted.
typedef enum sgsi_bvh_quality {
    SGSI_BVH_LOW,
    SGSI_BVH_MEDIUM,
    SGSI_BVH_HIGH,
    SGSI_BVH_REFIT,
    SGSI_BVH_QUALITY_COUNT
} sgsi_bvh_quality;

// Fails with OUT_OF_MEMORY, UNSUPPORTED if Embree has no device for this processor, or INTERNAL
// (Embree); *bvh is then NULL.
sgs_status sgsi_bvh_create(sgsi_bvh **bvh);
void sgsi_bvh_destroy(sgsi_bvh *bvh); // accepts NULL

// Builds over `bounds` [count], world space. The caller owns the array and keeps it alive until the
// next build or destroy. Fails with LIMIT (count), OUT_OF_MEMORY, UNSUPPORTED or INTERNAL (Embree);
// only another build or destroy may follow.
sgs_status sgsi_bvh_build(sgsi_bvh *bvh, const sgsi_bounds *bounds, size_t count,
                          sgsi_bvh_quality quality);

// Adapts the tree to changed bounds (same array, same count) and keeps its topology. Rebuilds a
// tree that was not built with SGSI_BVH_REFIT. Fails as sgsi_bvh_build, except with LIMIT.
sgs_status sgsi_bvh_refit(sgsi_bvh *bvh);

// Sixteen rays from one origin, world space; unit directions. Lanes whose bit in `valid` is 0 are
// ignored.
typedef struct sgsi_packet {
    float origin[3];
    uint32_t valid;
    float direction[3][16];
    float far[16]; // world units; INFINITY = unlimited
} sgsi_packet;

// Result of a gather. Owned by the caller, one per thread; grows as needed (ids may be NULL at
// first). Release ids with sgsi_free.
typedef struct sgsi_gather_list {
    uint32_t *ids;
    size_t count, capacity;
    // NULL, or the array that the caller reads next: row `id` is prefetched.
    const void *rows;
    size_t row_bytes;
} sgsi_gather_list;

// Appends the id of every primitive whose bounds a ray of the packet may cross at a distance in [0,
// far]. The order is undefined and ids may repeat. Thread-safe for different lists. Fails with
// OUT_OF_MEMORY.
sgs_status sgsi_bvh_gather(const sgsi_bvh *bvh, const sgsi_packet *packet, sgsi_gather_list *list);

// Bytes that Embree has allocated for all trees of the process, as reported to its memory monitor.
size_t sgsi_bvh_bytes(void);

// "Embree 3.13.5": the library as loaded. Constant string.
const char *sgsi_bvh_version(void);
