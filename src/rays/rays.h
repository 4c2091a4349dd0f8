// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The rays of a camera in kernel layout, by tile and block, and the cone packets for BVH queries.
// They depend on the intrinsics only and are computed once per camera.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/image_cells.h"
#include "sparegs/camera.h"

enum {
    SGSI_TILE = 16,         // pixels
    SGSI_BLOCKS = 16,       // blocks of 4x4 pixels per tile
    SGSI_MACROTILE_SIDE = 4 // maximum, tiles
};

// Limit of the ray tables of a renderer, bytes; see sgs_renderer_ray_limit_set.
#define SGSI_RAY_CACHE_BYTES ((size_t)1 << 30)

// Tiles of an image.
static inline size_t sgsi_tile_count(int width, int height)
{
    return ((size_t)width + SGSI_TILE - 1) / SGSI_TILE *
           (((size_t)height + SGSI_TILE - 1) / SGSI_TILE);
}

// The rays d = d0 + u e1 + v e2 of a 16x16-pixel tile, camera axes. Lane i of block b is pixel (4
// (b % 4) + i % 4, 4 (b / 4) + i / 4).
typedef struct sgsi_tile_rays {
    _Alignas(64) float u[SGSI_BLOCKS][16], v[SGSI_BLOCKS][16];
    float block_u[16], block_v[16];           // centres of the (u, v) ranges of the blocks
    float block_half_u[16], block_half_v[16]; // half extents, over valid pixels
    float max_half_u, max_half_v;             // largest half extents
    // (u, v) range of the tile; half is -INFINITY for a tile without rays.
    float center_u, center_v, half_u, half_v;
    float min_length;            // smallest |d| of the rays
    float frame[9];              // d0, e1, e2: orthonormal, shared by all tiles of a macrotile
    uint16_t valid[SGSI_BLOCKS]; // pixels inside the image with a ray
    int x, y;                    // upper left pixel
} sgsi_tile_rays;

// Everything that depends on the camera's intrinsics only.
typedef struct sgsi_rays {
    sgs_camera camera;
    int tiles_x, tiles_y;
    sgsi_tile_rays *tiles; // [tiles_y][tiles_x], 64-byte aligned
    // Tiles per macrotile side. One packet of 4x4 cone rays gathers a macrotile.
    int macrotile_side;
    int macrotiles_x, macrotiles_y;
    sgsi_cells cells;                     // order of the sums over tiles
    float (*macrotile_directions)[3][16]; // camera axes, unit
    uint32_t *macrotile_valid;
    float tan_cone;                    // tangent of the widest cone ray's half angle
    float axis[3], cone_cos, cone_sin; // circumscribed cone of the whole image
    float focal, fx, fy, cx, cy;
    bool fisheye;
    bool forward; // all rays have z > 0: distances along the camera axis are defined
} sgsi_rays;

// A view, as used by the kernels.
typedef struct sgsi_view {
    const sgsi_rays *rays;
    float rotation[9]; // world to camera
    float center[3];   // world, rounded
    // What rounding removed from `center`. x - center is exact for x near the camera, so that (x -
    // center) - center_low is as precise far from the origin as it is near it.
    float center_low[3];
    float near_distance;
    float dilation; // 0.3 / f^2 for the 3dgs filter, 0.1 / f^2 for mip, 0 for none
    bool mip;       // Mip-Splatting's filters, which preserve area times opacity
    // f3 of the primitives, [padded to 16], world units, or NULL for 0; mip only.
    const float *filter_3d;
    int sh_degree;
    bool linear_opacity; // of the model; set by the projection
    // Share of the support within which a primitive enters a tile (1 = all). Applied per tile: the
    // bounds of the BVH contain the whole support.
    float compact_box;
} sgsi_view;

// macrotile_side: tiles per side of a macrotile (1, 2, 4; larger values count as 4). It is reduced
// for the whole image if a macrotile would cover too wide an angle for one tangent plane. Fails
// with INVALID_ARGUMENT (sgs_camera_validate), UNSUPPORTED (a tile too wide for one tangent plane)
// or OUT_OF_MEMORY; *rays is then NULL.
sgs_status sgsi_rays_create(const sgs_camera *camera, int macrotile_side, sgsi_rays **rays);
void sgsi_rays_destroy(sgsi_rays *rays); // accepts NULL

// The same for a caller who may stop it. For images of at least SGSI_WATCHED_PIXELS, `progress` is
// called every few rows, on the calling thread, with `done` 0 and the rows of tiles as `total`.
// Fails with CANCELLED after it returned false. NULL: not called.
enum { SGSI_WATCHED_PIXELS = 1 << 20 };
sgs_status sgsi_rays_create_watched(const sgs_camera *camera, int macrotile_side,
                                    sgs_progress_fn progress, void *user, sgsi_rays **rays);

// Index in rays->tiles of tile k (< macrotile_side^2) of a macrotile; -1 outside the image.
static inline int sgsi_macrotile_tile(const sgsi_rays *rays, int macrotile, int k)
{
    const int x = macrotile % rays->macrotiles_x * rays->macrotile_side + k % rays->macrotile_side;
    const int y = macrotile / rays->macrotiles_x * rays->macrotile_side + k / rays->macrotile_side;
    return x < rays->tiles_x && y < rays->tiles_y ? y * rays->tiles_x + x : -1;
}

// Cones of the cells of rays->cells along the curve, camera axes: [rays->cells.count]. Cannot fail.
void sgsi_rays_cell_cones(const sgsi_rays *rays, sgsi_cone *cones);

// The macrotile_side for a camera. Depends on its image size only, not on the number of threads.
int sgsi_macrotile_side(const sgs_camera *camera);

// Bytes of a camera's table in the cache.
size_t sgsi_ray_table_bytes(int width, int height);

// Bytes per camera while its table is created: the table and a direction per pixel.
double sgsi_ray_peak_bytes(int width, int height);

// Cache of ray tables by camera: cameras with equal values share a table. It holds one table even
// if that exceeds the limit.
// `period`: lookups within which every camera is expected again, such as twice the number of views
// for epochs in random order. A full cache evicts a table unused for longer, the least recently
// used one; otherwise the most recently used one, which is needed again last. 0: always the least
// recently used one. Not thread-safe. Fails with OUT_OF_MEMORY; *cache is then NULL.
typedef struct sgsi_ray_cache sgsi_ray_cache;
sgs_status sgsi_ray_cache_create(size_t byte_limit, size_t period, sgsi_ray_cache **cache);
void sgsi_ray_cache_destroy(sgsi_ray_cache *cache); // accepts NULL
// Applies from the next lookup; its table may exceed the limit.
void sgsi_ray_cache_limit_set(sgsi_ray_cache *cache, size_t byte_limit);
size_t sgsi_ray_cache_limit(const sgsi_ray_cache *cache);
// Bytes of the tables it holds.
size_t sgsi_ray_cache_bytes(const sgsi_ray_cache *cache);
// The table is valid until the next call. Fails as sgsi_rays_create; *rays is then NULL.
sgs_status sgsi_ray_cache_get(sgsi_ray_cache *cache, const sgs_camera *camera,
                              const sgsi_rays **rays);
// The same with the progress function of sgsi_rays_create_watched.
sgs_status sgsi_ray_cache_get_watched(sgsi_ray_cache *cache, const sgs_camera *camera,
                                      sgs_progress_fn progress, void *user, const sgsi_rays **rays);
