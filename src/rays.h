// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The rays of a camera, laid out for the kernels: tile by tile, block by block, and the cone
// packets that ask the BVH. Depends on the intrinsics only, so it is made once per camera and kept.

#include "trace.h"

// bin_tiles: tiles per side of a gather bin (1, 2, 4; more count as 4). In an image with a bin that
// would see too much for one tangent plane all bins have fewer. On failure *rays is NULL.
sgs_status sgsi_rays_create(const sgs_camera *camera, int bin_tiles, sgsi_rays **rays);
void sgsi_rays_destroy(sgsi_rays *rays); // accepts NULL

// The number in rays->tiles of tile k (< bin_tiles^2) of a bin; -1 where that lies beyond the
// image.
static inline int sgsi_bin_tile(const sgsi_rays *rays, int bin, int k)
{
    const int x = bin % rays->bins_x * rays->bin_tiles + k % rays->bin_tiles;
    const int y = bin / rays->bins_x * rays->bin_tiles + k / rays->bin_tiles;
    return x < rays->tiles_x && y < rays->tiles_y ? y * rays->tiles_x + x : -1;
}

// The bin_tiles that suit a camera's image, the same for any number of threads.
int sgsi_bin_tiles(const sgs_camera *camera);

// Ray tables by camera, least recently used first out. One user thread at a time.
typedef struct sgsi_ray_cache sgsi_ray_cache;
sgs_status sgsi_ray_cache_create(size_t byte_limit, sgsi_ray_cache **cache);
void sgsi_ray_cache_destroy(sgsi_ray_cache *cache);
// The table stays valid until the next call.
sgs_status sgsi_ray_cache_get(sgsi_ray_cache *cache, const sgs_camera *camera,
                              const sgsi_rays **rays);
