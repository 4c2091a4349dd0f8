// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Ray tables. Every direction comes from sgs_camera_unproject, so any central camera works. A
// macrotile stores directions on the tangent plane through its centre, where neighbouring pixels
// differ by small, precise numbers for any lens.

#include "rays/rays.h"

#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "sparegs/runtime.h"

// The caller's progress function, for the loops over a large image.
typedef struct watch {
    sgs_progress_fn progress; // or NULL
    void *user;
    size_t total;
    atomic_bool stopped;
} watch;

// True if the rest of a loop is to be skipped. The first thread of a loop, the caller's, asks.
static bool is_stopped(watch *w, int thread)
{
    if (!w->progress)
        return false;
    if (thread == 0 && !w->stopped && !w->progress(w->user, 0, w->total))
        w->stopped = true;
    return w->stopped;
}

typedef struct direction_map {
    const sgs_camera *camera;
    float (*directions)[3]; // [height * width]; NaN where the lens has no ray
    atomic_bool sideways;   // a ray has z <= 0
    watch *watch;
} direction_map;

static void unproject_row(void *context, size_t y, int thread)
{
    direction_map *map = context;
    bool sideways = false;
    if (is_stopped(map->watch, thread))
        return;
    for (int x = 0; x < map->camera->width; ++x) {
        float *out = map->directions[y * (size_t)map->camera->width + (size_t)x];
        double d[3];
        const bool valid =
            sgs_camera_unproject(map->camera, (double[2]){x + 0.5, (double)y + 0.5}, d);
        for (int k = 0; k < 3; ++k)
            out[k] = valid ? (float)d[k] : NAN;
        sideways = sideways || (valid && !(d[2] > 0.0));
    }
    if (sideways)
        atomic_store_explicit(&map->sideways, true, memory_order_relaxed);
}

static void normalize(float v[3])
{
    const float length = sqrtf(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int k = 0; k < 3; ++k)
        v[k] /= length;
}

static float dot(const float a[3], const float b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Sums the directions of a pixel rectangle (clipped to the image). Returns their number.
static int sum_directions(const direction_map *map, int x0, int y0, int size, float sum[3])
{
    int count = 0;
    sum[0] = sum[1] = sum[2] = 0.0f;
    for (int y = y0; y < y0 + size && y < map->camera->height; ++y) {
        for (int x = x0; x < x0 + size && x < map->camera->width; ++x) {
            const float *d = map->directions[(size_t)y * (size_t)map->camera->width + (size_t)x];
            if (isnan(d[0]))
                continue;
            for (int k = 0; k < 3; ++k)
                sum[k] += d[k];
            ++count;
        }
    }
    return count;
}

// 1 - cos of the widest angle between the axis and a pixel of the rectangle, computed from the
// chord: in single precision the cosine itself is too coarse for narrow cones.
static float widest_versine(const direction_map *map, int x0, int y0, int width, int height,
                            const float axis[3])
{
    float versine = 0.0f;
    for (int y = y0; y < y0 + height && y < map->camera->height; ++y) {
        for (int x = x0; x < x0 + width && x < map->camera->width; ++x) {
            const float *d = map->directions[(size_t)y * (size_t)map->camera->width + (size_t)x];
            const float chord[3] = {d[0] - axis[0], d[1] - axis[1], d[2] - axis[2]};
            const float v = 0.5f * dot(chord, chord);
            if (v > versine) // false for NaN
                versine = v;
        }
    }
    return versine;
}

// e1, e2 orthogonal to d0; e1 as close to the x axis of the camera as possible (to z for tiles that
// look sideways).
static void complete_frame(float frame[9])
{
    const float *d0 = frame;
    const float seed[3] = {fabsf(d0[0]) < 0.9f ? 1.0f : 0.0f, 0.0f,
                           fabsf(d0[0]) < 0.9f ? 0.0f : 1.0f};
    const float along = dot(seed, d0);
    for (int k = 0; k < 3; ++k)
        frame[3 + k] = seed[k] - along * d0[k];
    normalize(frame + 3);
    frame[6] = d0[1] * frame[5] - d0[2] * frame[4];
    frame[7] = d0[2] * frame[3] - d0[0] * frame[5];
    frame[8] = d0[0] * frame[4] - d0[1] * frame[3];
}

typedef struct plane_range {
    float low[2], high[2]; // of u and v
} plane_range;

static const plane_range empty_range = {{INFINITY, INFINITY}, {-INFINITY, -INFINITY}};

static void widen_range(plane_range *range, const float low[2], const float high[2])
{
    for (int k = 0; k < 2; ++k) {
        range->low[k] = fminf(range->low[k], low[k]);
        range->high[k] = fmaxf(range->high[k], high[k]);
    }
}

// Centre and half extent of a range; the half extent of an empty range is negative, so that every
// test rejects it.
static void center_range(const plane_range *range, int k, float *center, float *half)
{
    const bool any = range->low[k] <= range->high[k];
    *center = any ? 0.5f * (range->low[k] + range->high[k]) : 0.0f;
    *half = any ? 0.5f * (range->high[k] - range->low[k]) * 1.00001f : -INFINITY;
}

// False when the cosine between a ray and the axis of the frame is below `least`: too far out on
// the tangent plane.
static bool fill_block(const direction_map *map, sgsi_tile_rays *tile, int b, float least,
                       plane_range *tile_range)
{
    bool complete = true;
    plane_range range = empty_range;
    tile->valid[b] = 0;
    for (int i = 0; i < 16; ++i) {
        const int x = tile->x + 4 * (b % 4) + i % 4, y = tile->y + 4 * (b / 4) + i / 4;
        tile->u[b][i] = tile->v[b][i] = 0.0f;
        if (x >= map->camera->width || y >= map->camera->height)
            continue;
        const float *d = map->directions[(size_t)y * (size_t)map->camera->width + (size_t)x];
        const float along = dot(d, tile->frame);
        if (isnan(d[0]))
            continue;
        if (!(along > least)) {
            complete = false;
            continue;
        }
        const float uv[2] = {dot(d, tile->frame + 3) / along, dot(d, tile->frame + 6) / along};
        widen_range(&range, uv, uv);
        tile->min_length = fminf(tile->min_length, sqrtf(1.0f + uv[0] * uv[0] + uv[1] * uv[1]));
        tile->u[b][i] = uv[0];
        tile->v[b][i] = uv[1];
        tile->valid[b] |= (uint16_t)(1u << i);
    }
    center_range(&range, 0, &tile->block_u[b], &tile->block_half_u[b]);
    center_range(&range, 1, &tile->block_v[b], &tile->block_half_v[b]);
    tile->max_half_u = fmaxf(tile->max_half_u, tile->block_half_u[b]);
    tile->max_half_v = fmaxf(tile->max_half_v, tile->block_half_v[b]);
    widen_range(tile_range, range.low, range.high);
    return complete;
}

static bool fill_tile(const direction_map *map, sgsi_tile_rays *tile, float least)
{
    bool complete = true;
    plane_range range = empty_range;
    tile->max_half_u = tile->max_half_v = 0.0f;
    tile->min_length = INFINITY;
    for (int b = 0; b < SGSI_BLOCKS; ++b)
        complete = fill_block(map, tile, b, least, &range) && complete;
    center_range(&range, 0, &tile->center_u, &tile->half_u);
    center_range(&range, 1, &tile->center_v, &tile->half_v);
    return complete;
}

typedef struct tile_job {
    sgsi_rays *rays;
    const direction_map *map;
    int macrotile_side;
    atomic_bool incomplete;
} tile_job;

// Fills the tiles of a row of macrotiles.
static void fill_tile_rows(void *context, size_t row, int thread)
{
    tile_job *job = context;
    const int side = job->macrotile_side, first = (int)row * side;
    const float least = side > 1 ? 0.5f : 0.05f;
    const direction_map *map = job->map;
    sgsi_rays *rays = job->rays;
    if (is_stopped(map->watch, thread))
        return;
    for (int y = first; y < first + side && y < rays->tiles_y; ++y)
        for (int x = 0; x < rays->tiles_x; ++x) {
            sgsi_tile_rays *tile = &rays->tiles[y * rays->tiles_x + x];
            memset(tile, 0, sizeof *tile);
            tile->x = x * SGSI_TILE;
            tile->y = y * SGSI_TILE;
            const int corner_x = x % side, corner_y = y - first; // tile within its macrotile
            if (corner_x || corner_y) {
                const sgsi_tile_rays *corner = tile - corner_y * rays->tiles_x - corner_x;
                memcpy(tile->frame, corner->frame, sizeof tile->frame);
            } else {
                if (sum_directions(map, tile->x, tile->y, side * SGSI_TILE, tile->frame))
                    normalize(tile->frame);
                else
                    tile->frame[2] = 1.0f;
                complete_frame(tile->frame);
            }
            if (!fill_tile(map, tile, least)) {
                atomic_store_explicit(&job->incomplete, true, memory_order_relaxed);
                return;
            }
        }
}

// Fills the tiles of all macrotiles. False when a tile sees more than its tangent plane can
// represent, or a larger macrotile more than 60 degrees to a side, where rectangles of (u, v) bound
// poorly.
static bool fill_tiles(sgsi_rays *rays, const direction_map *map, int macrotile_side)
{
    tile_job job = {.rays = rays, .map = map, .macrotile_side = macrotile_side};
    const size_t rows = (size_t)((rays->tiles_y + macrotile_side - 1) / macrotile_side);
    sgsi_parallel_for(rows, 1, fill_tile_rows, &job);
    return !job.incomplete;
}

// The tangent is limited to 20 (87 degrees): boxes dilated by 20 times their farthest distance
// contain the origin.
static float cone_tangent(float versine)
{
    const float widened = fminf(versine * 1.0001f + 1e-12f, 0.95f);
    return sqrtf(widened * (2.0f - widened)) / (1.0f - widened);
}

typedef struct macrotile_job {
    sgsi_rays *rays;
    const direction_map *map;
    float *tan_cone; // [macrotiles]
} macrotile_job;

static void fill_macrotile(void *context, size_t macrotile_index, int thread)
{
    const macrotile_job *job = context;
    const direction_map *map = job->map;
    sgsi_rays *rays = job->rays;
    if (is_stopped(map->watch, thread))
        return;
    const int macrotile = (int)macrotile_index;
    const int size = rays->macrotile_side * SGSI_TILE, step = size / 4;
    const int x0 = macrotile % rays->macrotiles_x * size,
              y0 = macrotile / rays->macrotiles_x * size;
    rays->macrotile_valid[macrotile] = 0;
    for (int i = 0; i < 16; ++i) {
        const int x = x0 + i % 4 * step, y = y0 + i / 4 * step;
        float direction[3];
        if (!sum_directions(map, x, y, step, direction)) {
            for (int k = 0; k < 3; ++k)
                rays->macrotile_directions[macrotile][k][i] = k == 2 ? 1.0f : 0.0f;
            continue;
        }
        if (!(dot(direction, direction) > 1e-6f)) // rays in all directions: any axis
            direction[2] = 1.0f;
        normalize(direction);
        rays->macrotile_valid[macrotile] |= 1u << i;
        for (int k = 0; k < 3; ++k)
            rays->macrotile_directions[macrotile][k][i] = direction[k];
        const float versine = widest_versine(map, x, y, step, step, direction);
        job->tan_cone[macrotile] = fmaxf(job->tan_cone[macrotile], cone_tangent(versine));
    }
}

// Directions and valid cones of all macrotiles. False if out of memory.
static bool fill_macrotiles(sgsi_rays *rays, const direction_map *map)
{
    const size_t count = (size_t)rays->macrotiles_x * (size_t)rays->macrotiles_y;
    rays->macrotile_directions = sgsi_calloc(count, sizeof *rays->macrotile_directions);
    rays->macrotile_valid = sgsi_calloc(count, sizeof *rays->macrotile_valid);
    macrotile_job job = {rays, map, sgsi_calloc(count, sizeof *job.tan_cone)};
    const bool complete = rays->macrotile_directions && rays->macrotile_valid && job.tan_cone;
    if (complete)
        sgsi_parallel_for(count, 8, fill_macrotile, &job);
    for (size_t i = 0; i < count && complete; ++i)
        rays->tan_cone = fmaxf(rays->tan_cone, job.tan_cone[i]);
    sgsi_free(job.tan_cone);
    return complete;
}

typedef struct row_job {
    const direction_map *map;
    const float *axis;
    float *versine; // [height]
} row_job;

static void widest_of_row(void *context, size_t y, int thread)
{
    const row_job *job = context;
    const int width = job->map->camera->width;
    job->versine[y] = 0;
    if (!is_stopped(job->map->watch, thread))
        job->versine[y] = widest_versine(job->map, 0, (int)y, width, 1, job->axis);
}

// False if out of memory.
static bool fill_image_cone(sgsi_rays *rays, const direction_map *map)
{
    const size_t height = (size_t)map->camera->height;
    float axis[3] = {0.0f, 0.0f, 0.0f};
    for (int macrotile = 0; macrotile < rays->macrotiles_x * rays->macrotiles_y; ++macrotile)
        for (int i = 0; i < 16; ++i)
            for (int k = 0; k < 3; ++k)
                if (rays->macrotile_valid[macrotile] >> i & 1)
                    axis[k] += rays->macrotile_directions[macrotile][k][i];
    if (!(dot(axis, axis) > 1e-6f))
        axis[2] = 1.0f;
    normalize(axis);
    const row_job job = {map, axis, sgsi_alloc(height, sizeof *job.versine)};
    if (!job.versine)
        return false;
    sgsi_parallel_for(height, 8, widest_of_row, (void *)&job);
    float versine = 0.0f;
    for (size_t y = 0; y < height; ++y)
        versine = fmaxf(versine, job.versine[y]);
    sgsi_free(job.versine);
    const float cosine = 1.0f - versine - 1e-4f;
    memcpy(rays->axis, axis, sizeof axis);
    rays->cone_cos = fmaxf(cosine, -1.0f);
    rays->cone_sin = sqrtf(fmaxf(0.0f, 1.0f - rays->cone_cos * rays->cone_cos));
    return true;
}

// An empty table for the camera; NULL if out of memory.
static sgsi_rays *allocate(const sgs_camera *camera)
{
    sgsi_rays *made = sgsi_calloc(1, sizeof *made);
    if (!made)
        return NULL;
    made->camera = *camera;
    made->tiles_x = (camera->width + SGSI_TILE - 1) / SGSI_TILE;
    made->tiles_y = (camera->height + SGSI_TILE - 1) / SGSI_TILE;
    made->fisheye = sgs_camera_is_fisheye(camera->model);
    double fx, fy, cx, cy;
    sgs_camera_intrinsics(camera, &fx, &fy, &cx, &cy);
    made->fx = (float)fx, made->fy = (float)fy, made->cx = (float)cx, made->cy = (float)cy;
    made->focal = (float)sqrt(fx * fy);
    // Each is zeroed when it is filled: for a large frame, that alone takes seconds.
    made->tiles = sgsi_alloc((size_t)made->tiles_x * (size_t)made->tiles_y, sizeof *made->tiles);
    if (made->tiles && sgsi_cells_set(&made->cells, camera->width, camera->height))
        return made;
    sgsi_rays_destroy(made);
    return NULL;
}

static sgs_status no_memory(const sgs_camera *camera)
{
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the rays of a %dx%d camera",
                     camera->width, camera->height);
}

// Allocations beyond the memory would succeed, and the system would end the process.
static sgs_status check_memory(const sgs_camera *camera)
{
    const double bytes = sgsi_ray_peak_bytes(camera->width, camera->height);
    // The limit is read from files, which takes longer than the rays of a small image.
    const double machine = bytes < 0x1p28 ? 0x1p28 : (double)sgs_machine_memory();
    return bytes > machine
               ? sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                           "the rays of a %dx%d camera require %.1f GiB, but the machine has %.1f "
                           "GiB; use a smaller size",
                           camera->width, camera->height, bytes / 0x1p30, machine / 0x1p30)
               : SGS_STATUS_OK;
}

static sgs_status fill(sgsi_rays *rays, direction_map *map, int macrotile_side)
{
    const sgs_camera *camera = map->camera;
    sgsi_parallel_for((size_t)camera->height, 8, unproject_row, map);
    rays->forward = !map->sideways;
    macrotile_side = macrotile_side < SGSI_MACROTILE_SIDE ? macrotile_side : SGSI_MACROTILE_SIDE;
    while (macrotile_side && !fill_tiles(rays, map, macrotile_side))
        macrotile_side /= 2;
    if (!macrotile_side)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "a tile of %d x %d pixels covers more than 174 degrees of this lens; "
                         "render a larger image",
                         SGSI_TILE, SGSI_TILE);
    const int macrotile = macrotile_side * SGSI_TILE;
    rays->macrotile_side = macrotile_side;
    rays->macrotiles_x = (camera->width + macrotile - 1) / macrotile;
    rays->macrotiles_y = (camera->height + macrotile - 1) / macrotile;
    return fill_macrotiles(rays, map) && fill_image_cone(rays, map) ? SGS_STATUS_OK
                                                                    : no_memory(camera);
}

sgs_status sgsi_rays_create_watched(const sgs_camera *camera, int macrotile_side,
                                    sgs_progress_fn progress, void *user, sgsi_rays **rays)
{
    *rays = NULL;
    sgs_status status = sgs_camera_validate(camera);
    if (!status)
        status = check_memory(camera);
    if (status)
        return status;
    const size_t pixels = (size_t)camera->width * (size_t)camera->height;
    sgsi_rays *made = allocate(camera);
    watch own = {.progress = pixels < SGSI_WATCHED_PIXELS ? NULL : progress,
                 .user = user,
                 .total = made ? (size_t)made->tiles_y : 0};
    direction_map map = {
        .camera = camera, .directions = sgsi_alloc(pixels, sizeof *map.directions), .watch = &own};
    status = made && map.directions ? fill(made, &map, macrotile_side) : no_memory(camera);
    sgsi_free(map.directions);
    if (own.stopped)
        status = sgsi_fail(SGS_STATUS_CANCELLED, "rendering was cancelled");
    if (status) {
        sgsi_rays_destroy(made);
        return status;
    }
    *rays = made;
    return SGS_STATUS_OK;
}

sgs_status sgsi_rays_create(const sgs_camera *camera, int macrotile_side, sgsi_rays **rays)
{
    return sgsi_rays_create_watched(camera, macrotile_side, NULL, NULL, rays);
}

void sgsi_rays_destroy(sgsi_rays *rays)
{
    if (!rays)
        return;
    sgsi_free(rays->tiles);
    sgsi_cells_free(&rays->cells);
    sgsi_free(rays->macrotile_directions);
    sgsi_free(rays->macrotile_valid);
    sgsi_free(rays);
}

// Direction of a corner of a tile's (u, v) range, unit.
static void tile_corner(const sgsi_tile_rays *tile, float side_u, float side_v, double out[3])
{
    const double u = (double)(tile->center_u + side_u * tile->half_u),
                 v = (double)(tile->center_v + side_v * tile->half_v);
    double length = 0.0;
    for (int k = 0; k < 3; ++k) {
        out[k] = (double)tile->frame[k] + u * (double)tile->frame[3 + k] +
                 v * (double)tile->frame[6 + k];
        length += out[k] * out[k];
    }
    for (int k = 0; k < 3; ++k)
        out[k] /= sqrt(length);
}

// A cone of less than 90 degrees that contains the corners of a tile contains the tile: on its
// tangent plane both are convex.
static sgsi_cone cell_cone(const sgsi_rays *rays, size_t cell)
{
    const sgsi_cells *cells = &rays->cells;
    const uint32_t *first = cells->tile_order + cells->tile_begin[cell],
                   *last = cells->tile_order + cells->tile_begin[cell + 1];
    double axis[3] = {0}, d[3], least = 1.0;
    sgsi_cone cone = {.cosine = -1.0};
    for (const uint32_t *tile = first; tile < last; ++tile) {
        if (!(rays->tiles[*tile].half_u >= 0.0f))
            continue;
        cone.any = true;
        tile_corner(&rays->tiles[*tile], 0.0f, 0.0f, d);
        for (int k = 0; k < 3; ++k)
            axis[k] += d[k];
    }
    const double length = sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    if (!cone.any || !(length > 1e-6))
        return cone;
    for (int k = 0; k < 3; ++k)
        cone.axis[k] = axis[k] / length;
    for (const uint32_t *tile = first; tile < last; ++tile)
        for (int corner = 0; corner < 4 && rays->tiles[*tile].half_u >= 0.0f; ++corner) {
            tile_corner(&rays->tiles[*tile], corner & 1 ? 1.0f : -1.0f, corner & 2 ? 1.0f : -1.0f,
                        d);
            double along = 0.0;
            for (int k = 0; k < 3; ++k)
                along += cone.axis[k] * d[k];
            least = fmin(least, along);
        }
    cone.cosine = least > 0.0 ? least : -1.0;
    return cone;
}

void sgsi_rays_cell_cones(const sgsi_rays *rays, sgsi_cone *cones)
{
    for (size_t i = 0; i < rays->cells.count; ++i)
        cones[i] = cell_cone(rays, i);
}

// Images with fewer macrotiles than this are gathered tile by tile; otherwise threads would wait
// for the last macrotile. Depends on the image size only, so that results do not depend on the
// number of threads.
enum { MACROTILE_SIDE = 2, FEW_MACROTILES = 16 };

int sgsi_macrotile_side(const sgs_camera *camera)
{
    const int macrotile = MACROTILE_SIDE * SGSI_TILE;
    const long long macrotiles = (long long)((camera->width + macrotile - 1) / macrotile) *
                                 ((camera->height + macrotile - 1) / macrotile);
    return macrotiles < FEW_MACROTILES ? 1 : MACROTILE_SIDE;
}

double sgsi_ray_peak_bytes(int width, int height)
{
    const double tiles = ceil((double)width / SGSI_TILE) * ceil((double)height / SGSI_TILE);
    return tiles * sizeof(sgsi_tile_rays) + (double)width * height * 3 * sizeof(float);
}

size_t sgsi_ray_table_bytes(int width, int height)
{
    return sgsi_tile_count(width, height) * sizeof(sgsi_tile_rays);
}

typedef struct cache_slot {
    sgsi_rays *rays;
    uint64_t key; // of the camera: the scan for it then stays in this array
    size_t bytes;
    uint64_t used;
} cache_slot;

struct sgsi_ray_cache {
    size_t byte_limit, bytes, period;
    uint64_t clock; // lookups
    cache_slot *slots;
    size_t count, capacity;
};

sgs_status sgsi_ray_cache_create(size_t byte_limit, size_t period, sgsi_ray_cache **cache)
{
    *cache = sgsi_calloc(1, sizeof **cache);
    if (!*cache)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the ray cache");
    (*cache)->byte_limit = byte_limit;
    (*cache)->period = period;
    return SGS_STATUS_OK;
}

void sgsi_ray_cache_destroy(sgsi_ray_cache *cache)
{
    if (!cache)
        return;
    for (size_t i = 0; i < cache->count; ++i)
        sgsi_rays_destroy(cache->slots[i].rays);
    sgsi_free(cache->slots);
    sgsi_free(cache);
}

void sgsi_ray_cache_limit_set(sgsi_ray_cache *cache, size_t byte_limit)
{
    cache->byte_limit = byte_limit;
}

size_t sgsi_ray_cache_limit(const sgsi_ray_cache *cache)
{
    return cache->byte_limit;
}

size_t sgsi_ray_cache_bytes(const sgsi_ray_cache *cache)
{
    return cache->bytes;
}

// Equal for equal cameras.
static uint64_t camera_key(const sgs_camera *camera)
{
    uint64_t key = sgsi_random_bits((uint64_t)camera->model,
                                    (uint64_t)camera->width << 32 | (uint64_t)camera->height);
    for (size_t i = 0; i < sizeof camera->params / sizeof *camera->params; ++i) {
        uint64_t bits;
        memcpy(&bits, &camera->params[i], sizeof bits);
        key = sgsi_random_bits(key, bits);
    }
    return key;
}

// Which of two tables is evicted first.
static bool goes_before(const sgsi_ray_cache *cache, const cache_slot *a, const cache_slot *b)
{
    const uint64_t oldest = a->used < b->used ? a->used : b->used;
    const bool stale = cache->clock - oldest > cache->period;
    return stale ? a->used < b->used : a->used > b->used;
}

static void evict(sgsi_ray_cache *cache)
{
    cache_slot *evicted = cache->slots;
    for (cache_slot *slot = evicted + 1; slot < cache->slots + cache->count; ++slot)
        if (goes_before(cache, slot, evicted))
            evicted = slot;
    cache->bytes -= evicted->bytes;
    sgsi_rays_destroy(evicted->rays);
    *evicted = cache->slots[--cache->count];
}

static sgs_status reserve_slot(sgsi_ray_cache *cache)
{
    if (cache->count < cache->capacity)
        return SGS_STATUS_OK;
    const size_t capacity = 2 * cache->capacity + 16;
    if (!sgsi_grow((void **)&cache->slots, cache->count, capacity, sizeof *cache->slots))
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the ray cache");
    cache->capacity = capacity;
    return SGS_STATUS_OK;
}

sgs_status sgsi_ray_cache_get(sgsi_ray_cache *cache, const sgs_camera *camera,
                              const sgsi_rays **rays)
{
    return sgsi_ray_cache_get_watched(cache, camera, NULL, NULL, rays);
}

sgs_status sgsi_ray_cache_get_watched(sgsi_ray_cache *cache, const sgs_camera *camera,
                                      sgs_progress_fn progress, void *user, const sgsi_rays **rays)
{
    *rays = NULL;
    ++cache->clock;
    while (cache->count > 1 && cache->bytes > cache->byte_limit) // the limit was lowered
        evict(cache);
    const uint64_t key = camera_key(camera);
    for (size_t i = 0; i < cache->count; ++i) {
        cache_slot *slot = &cache->slots[i];
        if (slot->key == key && sgs_camera_equal(&slot->rays->camera, camera)) {
            slot->used = cache->clock;
            *rays = slot->rays;
            return SGS_STATUS_OK;
        }
    }
    const size_t bytes = sgsi_ray_table_bytes(camera->width, camera->height);
    while (cache->count && cache->bytes + bytes > cache->byte_limit)
        evict(cache);
    sgs_status status = reserve_slot(cache);
    cache_slot made = {.key = key, .bytes = bytes, .used = cache->clock};
    if (!status)
        status = sgsi_rays_create_watched(camera, sgsi_macrotile_side(camera), progress, user,
                                          &made.rays);
    if (status)
        return status;
    cache->slots[cache->count++] = made;
    cache->bytes += bytes;
    *rays = made.rays;
    return SGS_STATUS_OK;
}
