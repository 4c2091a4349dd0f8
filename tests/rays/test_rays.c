// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The ray tables against the camera in double precision: each ray is in the right lane and inside
// the rectangles of its block and tile, the cone of its macrotile and the cone of the image. These
// bounds guarantee that no primitive is missed. The test also checks that they are tight, because
// the cost of the gather depends on it.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "rays/rays.h"
#include "base/threads.h"

static const sgs_camera cameras[] = {
    {SGS_CAMERA_PINHOLE, 83, 61, {88, 91, 41, 30}},
    {SGS_CAMERA_PINHOLE, 1, 1, {1, 1, 0.5, 0.5}},
    {SGS_CAMERA_PINHOLE, 4, 4, {2800, 2800, 2, 2}}, // a single block
    {SGS_CAMERA_PINHOLE, 40, 40, {5000, 5000, 20, 20}},
    {SGS_CAMERA_PINHOLE, 64, 48, {1e5, 1e5, 32, 24}},    // a telescope
    {SGS_CAMERA_PINHOLE, 64, 48, {300, 300, -500, 900}}, // principal point outside the image
    {SGS_CAMERA_OPENCV, 100, 75, {106, 110, 50.3, 36.7, -0.12, 0.03, 0.0011, -0.0007}},
    {SGS_CAMERA_OPENCV_FISHEYE, 63, 47, {28, 28, 31, 23, 0.02, -0.004, 0.001, -0.0002}},
    {SGS_CAMERA_OPENCV_FISHEYE, 96, 96, {25, 25, 48, 48}}, // 220 degrees
    {SGS_CAMERA_FOV, 80, 60, {50, 50, 40, 30, 0.9}},
};
enum { CAMERA_COUNT = sizeof cameras / sizeof *cameras, WIDE = 8 };

static double dot(const double a[3], const float b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// Angle between a unit vector and a float vector, accurate for small angles.
static double angle(const double a[3], const float b[3])
{
    const double c[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                         a[0] * b[1] - a[1] * b[0]};
    return atan2(sqrt(c[0] * c[0] + c[1] * c[1] + c[2] * c[2]), dot(a, b));
}

static void check_tile(const sgsi_tile_rays *tile, int block, int lane, const double d[3])
{
    const double along = dot(d, tile->frame), u = dot(d, tile->frame + 3) / along,
                 v = dot(d, tile->frame + 6) / along;
    const double slack = 3e-7 * (1 + fabs(u) + fabs(v));
    assert_true(tile->valid[block] >> lane & 1);
    assert_true(fabs(tile->u[block][lane] - u) <= slack && fabs(tile->v[block][lane] - v) <= slack);
    assert_true(
        fabs((double)tile->u[block][lane] - tile->center_u) <= tile->half_u + 1e-7 * fabs(u) &&
        fabs((double)tile->v[block][lane] - tile->center_v) <= tile->half_v + 1e-7 * fabs(v));
    assert_true(tile->min_length <= sqrt(1 + u * u + v * v) * (1 + 1e-6));
    const double off_u = fabs((double)tile->u[block][lane] - tile->block_u[block]);
    const double off_v = fabs((double)tile->v[block][lane] - tile->block_v[block]);
    assert_true(off_u <= tile->block_half_u[block] + 1e-7 * fabs(u) &&
                off_v <= tile->block_half_v[block] + 1e-7 * fabs(v));
}

static void every_ray_lies_in_its_block_tile_macrotile_and_image_bounds(void **state)
{
    (void)state;
    sgsi_threads_set(1);
    for (int c = 0; c < CAMERA_COUNT; ++c) {
        for (int most = 1; most <= SGSI_MACROTILE_SIDE; most *= 2) {
            sgsi_rays *rays;
            assert_int_equal(sgsi_rays_create(&cameras[c], most, &rays), SGS_STATUS_OK);
            const int macrotile = rays->macrotile_side;
            assert_true(macrotile >= 1 && macrotile <= most);
            double widest = 0;
            for (int y = 0; y < cameras[c].height; ++y) {
                for (int x = 0; x < cameras[c].width; ++x) {
                    const sgsi_tile_rays *tile = &rays->tiles[y / 16 * rays->tiles_x + x / 16];
                    const int block = y % 16 / 4 * 4 + x % 16 / 4, lane = y % 4 * 4 + x % 4,
                              size = 16 * macrotile;
                    double d[3];
                    if (!sgs_camera_unproject(&cameras[c], (double[2]){x + 0.5, y + 0.5}, d)) {
                        assert_false(tile->valid[block] >> lane & 1);
                        continue;
                    }
                    check_tile(tile, block, lane, d);
                    const int b = y / size * rays->macrotiles_x + x / size,
                              ray = y % size / (size / 4) * 4 + x % size / (size / 4);
                    float axis[3];
                    for (int k = 0; k < 3; ++k)
                        axis[k] = rays->macrotile_directions[b][k][ray];
                    assert_true(rays->macrotile_valid[b] >> ray & 1);
                    const double theta = angle(d, axis);
                    widest = fmax(widest, theta);
                    // Bounds are padded by 4e-6 of the distance, ten times the rounding errors of
                    // directions.
                    assert_true(theta < 1.5 ? tan(theta) <= rays->tan_cone + 3e-7
                                            : rays->tan_cone > 15);
                    assert_true(angle(d, rays->axis) <= acos((double)rays->cone_cos) + 1e-6);
                }
            }
            assert_true(widest > 1.5 || rays->tan_cone <= 1.001 * tan(widest) + 2e-6);
            sgsi_rays_destroy(rays);
        }
    }
}

static void frames_are_orthonormal(void **state)
{
    (void)state;
    for (int c = 0; c < CAMERA_COUNT; ++c) {
        sgsi_rays *rays;
        assert_int_equal(sgsi_rays_create(&cameras[c], 2, &rays), SGS_STATUS_OK);
        for (int t = 0; t < rays->tiles_x * rays->tiles_y; ++t)
            for (int i = 0; i < 3; ++i)
                for (int j = 0; j < 3; ++j) {
                    const float *f = rays->tiles[t].frame;
                    const float product = f[3 * i] * f[3 * j] + f[3 * i + 1] * f[3 * j + 1] +
                                          f[3 * i + 2] * f[3 * j + 2];
                    assert_true(fabsf(product - (i == j)) <= 1e-6f);
                }
        sgsi_rays_destroy(rays);
    }
}

static void rays_90_degrees_from_the_axis_are_recorded(void **state)
{
    (void)state;
    for (int k = 0; k < CAMERA_COUNT; ++k) {
        sgsi_rays *rays;
        bool forward = true;
        assert_int_equal(sgsi_rays_create(&cameras[k], 2, &rays), SGS_STATUS_OK);
        for (int y = 0; y < cameras[k].height; ++y)
            for (int x = 0; x < cameras[k].width; ++x) {
                double d[3];
                if (sgs_camera_unproject(&cameras[k], (double[2]){x + 0.5, y + 0.5}, d))
                    forward = forward && d[2] > 0;
            }
        assert_int_equal(rays->forward, forward);
        assert_int_equal(rays->forward, k != WIDE);
        sgsi_rays_destroy(rays);
    }
}

// Rows of a panorama beyond the poles have no rays.
static void panoramas_have_no_rays_beyond_their_poles(void **state)
{
    (void)state;
    enum { WIDTH = 256, HEIGHT = 128, TALLER = 40 };
    for (int shift = -TALLER; shift <= TALLER; shift += 16) {
        sgs_camera camera = sgs_camera_equirectangular(WIDTH, HEIGHT);
        camera.height += TALLER;
        camera = sgs_camera_shifted(&camera, 0, shift);
        sgsi_rays *rays;
        assert_int_equal(sgsi_rays_create(&camera, 1, &rays), SGS_STATUS_OK);
        for (int y = 0; y < camera.height; ++y)
            for (int x = 0; x < WIDTH; ++x) {
                const sgsi_tile_rays *tile = &rays->tiles[y / 16 * rays->tiles_x + x / 16];
                const int block = y % 16 / 4 * 4 + x % 16 / 4, lane = y % 4 * 4 + x % 4;
                const bool valid = tile->valid[block] >> lane & 1;
                if (valid != (y >= shift && y < HEIGHT + shift))
                    fail_msg("shift %d, pixel %d, %d: valid %d", shift, x, y, valid);
            }
        sgsi_rays_destroy(rays);
    }
}

// Sixteen pixels that cover all directions have no tangent plane: an error, not missing pixels.
static void images_too_small_for_their_lens_are_rejected(void **state)
{
    (void)state;
    const sgs_camera camera = {SGS_CAMERA_OPENCV_FISHEYE, 40, 40, {4, 4, 20, 20}};
    sgsi_rays *rays = (sgsi_rays *)&camera;
    assert_int_equal(sgsi_rays_create(&camera, 2, &rays), SGS_STATUS_UNSUPPORTED);
    assert_null(rays);
    assert_non_null(strstr(sgs_last_error(),
                           "a tile of 16 x 16 pixels covers more than 174 degrees of this lens"));
}

static void every_failed_allocation_is_reported(void **state)
{
    (void)state;
    sgsi_rays *rays = NULL;
    size_t failures = 0;
    for (size_t n = 1; n < 20; ++n) {
        sgsi_fail_allocation(n);
        const sgs_status status = sgsi_rays_create(&cameras[0], 2, &rays);
        sgsi_fail_allocation(0);
        if (status == SGS_STATUS_OK)
            break;
        assert_int_equal(status, SGS_STATUS_OUT_OF_MEMORY);
        assert_null(rays);
        ++failures;
    }
    assert_true(failures >= 4 && rays);
    sgsi_rays_destroy(rays);
    sgsi_rays_destroy(NULL);
}

// Epochs over 8 cameras, each in another order, with memory for 4 tables: nearly half of the
// lookups find a table, which the least recently used ones would not. After the period, tables of
// cameras that are no longer used leave.
static void cache_keeps_tables_over_epochs(void **state)
{
    (void)state;
    enum { CAMERAS = 8, HELD = 4, EPOCHS = 40, PERIOD = 2 * CAMERAS };
    const size_t bytes = 6 * 4 * sizeof(sgsi_tile_rays);
    sgsi_ray_cache *cache;
    assert_int_equal(sgsi_ray_cache_create(HELD * bytes, PERIOD, &cache), SGS_STATUS_OK);
    uint64_t counter = 0;
    size_t found = 0;
    for (int epoch = 0; epoch < 2 * EPOCHS; ++epoch) {
        int order[CAMERAS];
        const int first = epoch < EPOCHS ? 0 : CAMERAS; // other cameras in the second half
        for (int i = 0; i < CAMERAS; ++i) {
            const int at = (int)(sgsi_random_uniform(7, counter++) * (i + 1));
            order[i] = order[at];
            order[at] = first + i;
        }
        for (int i = 0; i < CAMERAS; ++i) {
            sgs_camera camera = cameras[0];
            camera.params[2] = 41 + order[i];
            const sgsi_rays *rays;
            assert_int_equal(sgsi_ray_cache_get(cache, &camera, &rays), SGS_STATUS_OK);
            assert_true(rays->camera.params[2] == camera.params[2]);
            found += rays->focal < 0;
            ((sgsi_rays *)rays)->focal = -1; // marks a table that was found before
        }
    }
    print_message("%zu of %d lookups found a table\n", found, 2 * EPOCHS * CAMERAS);
    assert_true(found * 10 > 4 * 2 * EPOCHS * CAMERAS);
    sgsi_ray_cache_destroy(cache);
}

static void cache_returns_one_table_per_camera_within_its_limit(void **state)
{
    (void)state;
    sgsi_ray_cache *cache;
    const size_t tiles = 6 * 4, bytes = tiles * sizeof(sgsi_tile_rays);
    sgs_camera camera = cameras[0];
    const sgsi_rays *first, *again;
    assert_true(bytes >= 2 * sizeof(float) * (size_t)camera.width * (size_t)camera.height);
    assert_int_equal(sgsi_ray_cache_create(3 * bytes, 0, &cache), SGS_STATUS_OK);
    assert_int_equal(sgsi_ray_cache_get(cache, &camera, &first), SGS_STATUS_OK);
    assert_int_equal(sgsi_ray_cache_get(cache, &camera, &again), SGS_STATUS_OK);
    assert_ptr_equal(first, again);
    for (int i = 0; i < 400; ++i) { // more cameras than slots and than bytes
        camera.params[2] = 41 + i;
        assert_int_equal(sgsi_ray_cache_get(cache, &camera, &again), SGS_STATUS_OK);
        assert_true(again->camera.params[2] == 41 + i);
        assert_int_equal(sgsi_ray_cache_bytes(cache), (i < 2 ? i + 1 : 3) * bytes);
    }
    sgsi_ray_cache_limit_set(cache, 400 * bytes);
    for (int i = 0; i < 800; ++i) { // each is built once
        camera.params[2] = 41 + i % 400;
        assert_int_equal(sgsi_ray_cache_get(cache, &camera, &again), SGS_STATUS_OK);
        assert_true(again->camera.params[2] == camera.params[2]);
        assert_true((again->focal > 0) == (i < 400));
        ((sgsi_rays *)again)->focal = -1; // marks it
    }
    assert_int_equal(sgsi_ray_cache_bytes(cache), 400 * bytes);
    sgsi_ray_cache_limit_set(cache, bytes / 2); // less than one table
    for (int i = 0; i < 3; ++i) {
        camera.params[2] = 1041 + i;
        assert_int_equal(sgsi_ray_cache_get(cache, &camera, &again), SGS_STATUS_OK);
        assert_int_equal(sgsi_ray_cache_bytes(cache), bytes);
    }
    camera.params[0] = -1;
    assert_int_not_equal(sgsi_ray_cache_get(cache, &camera, &again), SGS_STATUS_OK);
    assert_null(again);
    camera = cameras[0];
    assert_int_equal(sgsi_ray_cache_get(cache, &camera, &again), SGS_STATUS_OK);
    sgsi_ray_cache_destroy(cache);
    sgsi_ray_cache_destroy(NULL);
}

typedef struct watcher {
    size_t calls, last_call; // last_call: returns false; 0: never
} watcher;

static bool watch_rays(void *user, size_t done, size_t total)
{
    watcher *w = user;
    assert_int_equal(done, 0);
    assert_int_equal(total, 63); // ceil(1000 / 16)
    return ++w->calls != w->last_call;
}

static void large_tables_can_be_stopped_at_any_call(void **state)
{
    (void)state;
    const sgs_camera camera = {SGS_CAMERA_OPENCV, 1100, 1000, {900, 910, 540, 510, -0.1, 0.02}};
    sgsi_rays *whole, *rays;
    watcher w = {0};
    assert_int_equal(sgsi_rays_create(&camera, 2, &whole), SGS_STATUS_OK);
    assert_int_equal(sgsi_rays_create_watched(&camera, 2, watch_rays, &w, &rays), SGS_STATUS_OK);
    const size_t tiles = (size_t)whole->tiles_x * (size_t)whole->tiles_y;
    assert_memory_equal(rays->tiles, whole->tiles, tiles * sizeof *whole->tiles);
    assert_true(rays->cone_cos == whole->cone_cos);
    sgsi_rays_destroy(rays);
    sgsi_rays_destroy(whole);
    sgsi_threads_set(1); // then every row is a call, in each of the three loops over rows
    w = (watcher){0};
    assert_int_equal(sgsi_rays_create_watched(&camera, 2, watch_rays, &w, &rays), SGS_STATUS_OK);
    sgsi_rays_destroy(rays);
    const size_t all = w.calls;
    assert_true(all >= 1000 + 32 + 1000);
    for (int threads = 1; threads <= 2; ++threads) {
        sgsi_threads_set(threads);
        for (size_t k = 1; k <= all; k += k < 3 ? 1 : all / 9) {
            w = (watcher){.last_call = k};
            const sgs_status status = sgsi_rays_create_watched(&camera, 2, watch_rays, &w, &rays);
            if (threads == 2 && w.calls < k) { // the second thread took the rows
                sgsi_rays_destroy(rays);
                continue;
            }
            assert_int_equal(status, SGS_STATUS_CANCELLED);
            assert_null(rays);
            assert_int_equal(w.calls, k); // none afterwards
        }
    }
    sgsi_threads_set(0);
}

static void stopped_table_leaves_the_cache_usable(void **state)
{
    (void)state;
    const sgs_camera camera = {SGS_CAMERA_PINHOLE, 1100, 1000, {900, 910, 540, 510}};
    sgsi_ray_cache *cache;
    const sgsi_rays *rays;
    watcher w = {.last_call = 1};
    assert_int_equal(sgsi_ray_cache_create((size_t)1 << 30, 0, &cache), SGS_STATUS_OK);
    assert_int_equal(sgsi_ray_cache_get_watched(cache, &camera, watch_rays, &w, &rays),
                     SGS_STATUS_CANCELLED);
    assert_null(rays);
    assert_int_equal(sgsi_ray_cache_bytes(cache), 0);
    assert_int_equal(sgsi_ray_cache_get_watched(cache, &camera, watch_rays, &w, &rays),
                     SGS_STATUS_OK);
    const size_t calls = w.calls;
    assert_int_equal(sgsi_ray_cache_get_watched(cache, &camera, watch_rays, &w, &rays),
                     SGS_STATUS_OK); // found
    assert_int_equal(sgsi_ray_cache_get_watched(cache, &cameras[0], watch_rays, &w, &rays),
                     SGS_STATUS_OK); // small
    assert_int_equal(w.calls, calls);
    sgsi_ray_cache_destroy(cache);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_ray_lies_in_its_block_tile_macrotile_and_image_bounds),
        cmocka_unit_test(frames_are_orthonormal),
        cmocka_unit_test(rays_90_degrees_from_the_axis_are_recorded),
        cmocka_unit_test(panoramas_have_no_rays_beyond_their_poles),
        cmocka_unit_test(images_too_small_for_their_lens_are_rejected),
        cmocka_unit_test(every_failed_allocation_is_reported),
        cmocka_unit_test(cache_keeps_tables_over_epochs),
        cmocka_unit_test(cache_returns_one_table_per_camera_within_its_limit),
        cmocka_unit_test(large_tables_can_be_stopped_at_any_call),
        cmocka_unit_test(stopped_table_leaves_the_cache_usable),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
