// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The rays of a camera, laid out for the kernels: tile by tile, block by block, and the cone
// packets that ask the BVH. Depends on the intrinsics only, so it is made once per camera and kept.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/camera.h"

enum {
    SGSI_TILE = 16,         // pixels
    SGSI_BLOCKS = 16,       // blocks of 4x4 pixels per tile
    SGSI_MACROTILE_SIDE = 4 // tiles, at most
};

// The rays of a 16x16-pixel tile, camera axes. Lane i of block b is pixel (4 (b % 4) + i % 4, 4 (b
// / 4) + i / 4).
typedef struct sgsi_tile_rays {
    _Alignas(64) float u[SGSI_BLOCKS][16], v[SGSI_BLOCKS][16];
    float block_u[16], block_v[16];           // centres of the blocks' ranges of (u, v)
    float block_half_u[16], block_half_v[16]; // half extents, over valid pixels
    float widest_u, widest_v;                 // largest of the half extents
    float center_u, center_v, half_u, half_v; // of the tile's range of (u, v); half is -INFINITY
                                              // for a tile without rays
    float least_length;                       // least |d| of the tile's rays
    float frame[9];              // d0, e1, e2: orthonormal, the same in a whole macrotile
    uint16_t valid[SGSI_BLOCKS]; // pixels inside the image with a ray
    int x, y;                    // upper left pixel
} sgsi_tile_rays;

// Everything that depends on the camera's intrinsics only.
typedef struct sgsi_rays {
    sgs_camera camera;
    int tiles_x, tiles_y;
    sgsi_tile_rays *tiles; // [tiles_y][tiles_x], 64-byte aligned
    int macrotile_side;    // tiles per macrotile side; a macrotile is gathered by one packet of 4x4
                           // cone rays
    int macrotiles_x, macrotiles_y;
    float (*macrotile_directions)[3][16]; // camera axes, unit
    uint32_t *macrotile_valid;
    float tan_cone;                    // tangent of the widest cone ray's half angle
    float axis[3], cone_cos, cone_sin; // circumscribed cone of the whole image
    float focal, fx, fy, cx, cy;
    bool fisheye;
} sgsi_rays;

// A view as the kernels see it.
typedef struct sgsi_view {
    const sgsi_rays *rays;
    float rotation[9]; // world to camera
    float center[3];   // world
    float near_distance;
    float dilation; // 0.3 / f^2 for the 3dgs filter, 0.1 / f^2 for mip, 0 for none
    bool mip; // Mip-Splatting's filters: they conserve what a primitive covers times its opacity
    const float
        *filter_3d; // [padded to 16] f3 of the primitives, world units, or NULL for 0; mip only
    int sh_degree;
    bool linear_opacity; // the model's; projection sets it by itself
    float compact_box;   // share of the support that brings a primitive into a tile; 1: all of it.
                         // Bounds hold the whole: the tile alone decides
} sgsi_view;

// macrotile_side: tiles per side of a gather macrotile (1, 2, 4; more count as 4). In an image with
// a macrotile that would see too much for one tangent plane all macrotiles have fewer. On failure
// *rays is NULL.
sgs_status sgsi_rays_create(const sgs_camera *camera, int macrotile_side, sgsi_rays **rays);
void sgsi_rays_destroy(sgsi_rays *rays); // accepts NULL

// The number in rays->tiles of tile k (< macrotile_side^2) of a macrotile; -1 where that lies
// beyond the image.
static inline int sgsi_macrotile_tile(const sgsi_rays *rays, int macrotile, int k)
{
    const int x = macrotile % rays->macrotiles_x * rays->macrotile_side + k % rays->macrotile_side;
    const int y = macrotile / rays->macrotiles_x * rays->macrotile_side + k / rays->macrotile_side;
    return x < rays->tiles_x && y < rays->tiles_y ? y * rays->tiles_x + x : -1;
}

// The macrotile_side that suit a camera's image, the same for any number of threads.
int sgsi_macrotile_side(const sgs_camera *camera);

// Ray tables by camera, least recently used first out. One user thread at a time.
typedef struct sgsi_ray_cache sgsi_ray_cache;
sgs_status sgsi_ray_cache_create(size_t byte_limit, sgsi_ray_cache **cache);
void sgsi_ray_cache_destroy(sgsi_ray_cache *cache);
// The table stays valid until the next call.
sgs_status sgsi_ray_cache_get(sgsi_ray_cache *cache, const sgs_camera *camera,
                              const sgsi_rays **rays);
