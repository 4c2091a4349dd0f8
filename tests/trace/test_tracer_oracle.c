// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The tracer against the oracle in double precision: colours, transmittance, distances, number of
// hits, and the ordered list of hits of each pixel.
//
// Fragile pixels (see fragile_support.h) may differ by as much as one decision allows. On all
// others the ordered lists must be identical.
//
// Tolerances. Float rays are accurate to 1e-7 rad, so a Gaussian of scale s at distance D sees rho
// with an error of about 2e-7 D / s, and alpha with rho alpha times that: 1e-5 for D = 6, s = 0.05
// (the smallest of the random scenes). Distances: a dozen roundings, 1e-6, times the slant (the
// change of t per rho, in units of s / D: up to a few).

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>

#include "support/fragile_support.h"
#include "support/tracer_support.h"

// The tracer's ordered hits of a pixel, in double, from its block list and the projected records.
// Returns the number of counted hits.
static size_t traced_hits(const traced_view *traced, const traced_lists *lists, int x, int y,
                          const double direction[3], sgs_hit *hits)
{
    const float *projected = sgsi_tracer_projected(traced->tracer);
    const size_t tile = (size_t)(y / 16) * (size_t)traced->rays->tiles_x + (size_t)(x / 16);
    const size_t block = tile * SGSI_BLOCKS + (size_t)(y % 16 / 4 * 4 + x % 16 / 4);
    size_t found = 0;
    for (size_t i = lists->begin[block]; i < lists->begin[block + 1]; ++i) {
        const float *r = projected + (size_t)lists->ids[i] * SGSI_PROJECTED_FLOATS;
        double abc[3];
        for (int k = 0; k < 3; ++k)
            abc[k] =
                r[3 * k] * direction[0] + r[3 * k + 1] * direction[1] + r[3 * k + 2] * direction[2];
        const double n2 = abc[0] * abc[0] + abc[1] * abc[1];
        const double g = r[SGSI_PROJECTED_INV_KAPPA] * n2 + abc[2] * abc[2];
        const double alpha = exp2(r[SGSI_PROJECTED_LOG_OPACITY] - n2 / g),
                     t = r[SGSI_PROJECTED_DISTANCE] * abc[2] / g;
        if (alpha >= 1.0 / 255 && t > traced->options.near_distance)
            hits[found++] = (sgs_hit){lists->ids[i], t, fmin(alpha, 0.99), 0};
    }
    qsort(hits, found, sizeof *hits, fragile_by_distance);
    double transmittance = 1;
    for (size_t k = 0; k < found; ++k) {
        transmittance *= 1 - hits[k].alpha;
        if (transmittance < 1e-4)
            return k;
    }
    return found;
}

// ---- An image against the oracle. strict: also compare hits and distances ----

typedef struct comparison {
    size_t pixels, fragile, compared; // compared: pixels whose ordered lists were compared
    double color, distance; // largest errors on other than fragile pixels (distance: relative)
    double fragile_color;
} comparison;

static void compare_lists(const traced_view *traced, const traced_lists *lists, int x, int y,
                          const double camera_direction[3], const sgs_hit *truth, size_t count,
                          sgs_hit *hits)
{
    const size_t found = traced_hits(traced, lists, x, y, camera_direction, hits);
    if (found != count)
        fail_msg("pixel (%d, %d): %zu hits, the oracle has %zu", x, y, found, count);
    for (size_t k = 0; k < count; ++k)
        if (hits[k].primitive != truth[k].primitive)
            fail_msg("pixel (%d, %d): hit %zu is primitive %u, the oracle has %u", x, y, k,
                     hits[k].primitive, truth[k].primitive);
}

static comparison compare_with_oracle(const traced_view *traced, const oracle_scene *scene,
                                      bool strict, double distance_scale)
{
    comparison result = {0};
    sgs_reference_frame frame;
    sgsi_reference_view view;
    const sgs_camera *camera = &traced->camera;
    assert_int_equal(sgs_reference_frame_create(camera->width, camera->height, &frame),
                     SGS_STATUS_OK);
    assert_int_equal(sgs_reference_render(scene->params, scene->count, camera, &traced->pose,
                                          &traced->options, &frame),
                     SGS_STATUS_OK);
    assert_int_equal(sgsi_reference_view_create(scene->params, scene->count, camera, &traced->pose,
                                                &traced->options, &view),
                     SGS_STATUS_OK);
    sgs_hit *truth = oracle_memory(scene->count, sizeof *truth),
            *hits = oracle_memory(scene->count, sizeof *hits);
    traced_lists lists = traced_lists_of(traced->tracer, traced->rays);
    const double *const planes[TRACED_PLANES] = {
        frame.color[0],   frame.color[1],     frame.color[2],    frame.transmittance,
        frame.depth_mean, frame.depth_median, frame.depth_first, frame.hits};
    for (int y = 0; y < camera->height; ++y) {
        for (int x = 0; x < camera->width; ++x) {
            double direction[3], in_camera[3];
            const size_t from = (size_t)y * traced->planes.stride + (size_t)x,
                         at = (size_t)y * (size_t)camera->width + (size_t)x;
            pixel_truth pixel = {0};
            if (sgsi_reference_ray(&view, x, y, direction)) {
                sgs_camera_unproject(camera, (double[2]){x + 0.5, y + 0.5}, in_camera);
                pixel = judge(&view, direction, truth);
            }
            ++result.pixels;
            double color = 0;
            for (int k = 0; k < 4; ++k)
                color = traced_worse(color,
                                     fabs(traced_plane(&traced->planes, k)[from] - planes[k][at]));
            if (pixel.fragile) {
                ++result.fragile;
                result.fragile_color = traced_worse(result.fragile_color, color);
                continue;
            }
            result.color = traced_worse(result.color, color);
            if (!strict)
                continue;
            for (int k = 4; k < 7; ++k)
                if (k != 5 || !pixel.median_fragile)
                    result.distance = traced_worse(
                        result.distance, oracle_error(traced_plane(&traced->planes, k)[from],
                                                      planes[k][at], distance_scale));
            assert_true(traced->planes.hits[from] == (float)pixel.count);
            if (pixel.count) {
                compare_lists(traced, &lists, x, y, in_camera, truth, pixel.count, hits);
                ++result.compared;
            }
        }
    }
    free(truth);
    free(hits);
    traced_lists_free(&lists);
    sgsi_reference_view_free(&view);
    sgs_reference_frame_free(&frame);
    return result;
}

static void random_scenes_equal_the_oracle_on_every_isa_and_lens(void **state)
{
    (void)state;
    const sgs_pose pose = oracle_pose_look_at(2.1, -1.3, -3.2);
    oracle_scene scene = oracle_random_model(31, 300, NULL);
    for (int isa = 0; isa < SGS_ISA_COUNT; ++isa) {
        if (!sgs_isa_supported((sgs_isa)isa))
            continue;
        sgs_isa_set((sgs_isa)isa);
        comparison sum = {0};
        for (int lens = 0; lens < TRACED_LENS_COUNT; ++lens) {
            for (int filter = SGS_FILTER_3DGS; filter <= SGS_FILTER_MIP; ++filter) {
                const sgs_camera camera = oracle_camera(traced_lenses[lens], 63, 47);
                traced_view traced = traced_create(scene.model, &camera, &pose, (sgs_filter)filter,
                                                   2, SGSI_BVH_REFIT);
                const comparison one = compare_with_oracle(&traced, &scene, true, 0);
                traced_destroy(&traced);
                sum.pixels += one.pixels, sum.fragile += one.fragile, sum.compared += one.compared;
                sum.color = traced_worse(sum.color, one.color),
                sum.distance = traced_worse(sum.distance, one.distance);
                sum.fragile_color = traced_worse(sum.fragile_color, one.fragile_color);
            }
        }
        print_message("%s: colour %.2g, distance %.2g, fragile %.1f %% (colour %.2g)\n",
                      sgs_isa_name((sgs_isa)isa), sum.color, sum.distance,
                      100.0 * (double)sum.fragile / (double)sum.pixels, sum.fragile_color);
        assert_true(sum.color <= 1e-5 && sum.distance <= 3e-5);
        assert_true(sum.fragile * 25 < sum.pixels && sum.compared * 3 > sum.pixels);
        assert_true(sum.fragile_color <= 0.05);
    }
    oracle_scene_free(&scene);
}

// Tolerances per scene. Unfiltered discs 1e-6 thick are thinner than the spacing of float rays (D /
// s = 4e6): hits are uncertain, so only the image is compared. Needles: D / s = 4e4; an error of
// one thickness (1e-4) along the line of sight is an error of one length (10). Large primitives are
// centred 1e4 away and hit near the camera: the absolute error of t is that of 1e4.
static const struct {
    double color[2], distance, distance_scale; // color: filter 3dgs, filter none
} limits[TRACED_SCENE_COUNT] = {
    {{1e-5, 1e-5}, 1e-5, 0},   // random
    {{1e-5, 1e-5}, 1e-5, 0},   // crowd
    {{1e-5, 1e-5}, 1e-5, 0},   // coplanar
    {{1e-5, 1e-5}, 1e-5, 0},   // nested
    {{3e-5, 0.2}, 3e-5, 0},    // thin
    {{1e-5, 1e-5}, 1e-5, 1e4}, // large
    {{1e-5, 1e-5}, 1e-5, 0},   // inside
    {{1e-5, 1e-5}, 1e-5, 0},   // duplicates
    {{3e-5, 5e-3}, 5e-3, 0},   // needles
};

static void adversarial_scenes_equal_the_oracle(void **state)
{
    (void)state;
    const sgs_pose poses[2] = {oracle_pose_look_at(0, 0, -4), oracle_pose_look_at(0.4, 0.3, -4)};
    for (int number = 0; number < TRACED_SCENE_COUNT; ++number) {
        oracle_scene scene = traced_scene(number);
        size_t compared = 0;
        for (int run = 0; run < 2 * TRACED_LENS_COUNT; ++run) {
            const int filter = run % 2;
            const sgs_camera camera = oracle_camera(traced_lenses[run / 2], 63, 47);
            const bool strict = limits[number].color[filter] < 0.1;
            traced_view traced = traced_create(scene.model, &camera, &poses[run % 2],
                                               (sgs_filter)filter, 4, SGSI_BVH_REFIT);
            const comparison one =
                compare_with_oracle(&traced, &scene, strict, limits[number].distance_scale);
            traced_destroy(&traced);
            print_message(
                "%s, filter %d: colour %.2g, distance %.2g, fragile %.1f %% (colour %.2g)\n",
                traced_scene_name(number), filter, one.color, one.distance,
                100.0 * (double)one.fragile / (double)one.pixels, one.fragile_color);
            assert_true(one.color <= limits[number].color[filter] &&
                        one.distance <= limits[number].distance);
            assert_true(one.fragile_color <= 0.6);
            assert_true(number >= TRACED_RANDOM_SCENES || one.fragile * 5 < one.pixels);
            compared += one.compared;
        }
        assert_true(compared > 100);
        oracle_scene_free(&scene);
    }
}

static void odd_sizes_equal_the_oracle(void **state)
{
    (void)state;
    static const int sizes[][2] = {{1, 1},   {1, 9},   {3, 2},   {17, 5},
                                   {16, 16}, {33, 31}, {63, 47}, {65, 4}};
    const sgs_pose pose = oracle_pose_look_at(-1, 0.5, -3.5);
    oracle_scene scene = oracle_random_model(77, 150, NULL);
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; ++i) {
        for (int lens = 0; lens < TRACED_LENS_COUNT; ++lens) {
            const sgs_camera camera = oracle_camera(traced_lenses[lens], sizes[i][0], sizes[i][1]);
            traced_view traced = traced_create(scene.model, &camera, &pose, SGS_FILTER_3DGS,
                                               1 << i % 3, SGSI_BVH_REFIT);
            const comparison one = compare_with_oracle(&traced, &scene, true, 0);
            assert_true(one.color <= 1e-5 && one.distance <= 1e-5 && one.fragile_color <= 0.05);
            traced_destroy(&traced);
        }
    }
    oracle_scene_free(&scene);
}

// Discs that single precision cannot distinguish from flat ones, as parameters may describe without
// a pixel filter.
static void flat_discs_equal_the_oracle(void **state)
{
    (void)state;
    for (int run = 0; run < 6; ++run) {
        const double size = run % 2 ? 100 : 1; // scale of the whole scene
        const int thinness = 10 + run / 2 * 15;
        const sgs_pose pose = oracle_pose_look_at(-size, 0.5 * size, -3.5 * size);
        oracle_scene scene = oracle_random_model(61, 150, NULL);
        for (size_t i = 0; i < scene.count; ++i) {
            double *p = oracle_primitive(&scene, i);
            for (size_t k = 0; k < 3; ++k) {
                p[SGS_PARAM_MEAN + k] *= size;
                p[SGS_PARAM_SCALE + k] =
                    k == i % 3 ? -thinness : p[SGS_PARAM_SCALE + k] + log(size);
            }
        }
        oracle_scene_round(&scene);
        for (int macrotile = 1; macrotile <= SGSI_MACROTILE_SIDE; macrotile *= 2) {
            const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, 83, 61);
            traced_view traced = traced_create(scene.model, &camera, &pose, SGS_FILTER_NONE,
                                               macrotile, SGSI_BVH_REFIT);
            const comparison one = compare_with_oracle(&traced, &scene, true, 0);
            print_message("size %g, log scale -%d, macrotiles of %d: colour %.2g, distance %.2g\n",
                          size, thinness, macrotile, one.color, one.distance);
            assert_true(one.color <= 1e-5 && one.distance <= 1e-5 && one.compared * 2 > one.pixels);
            traced_destroy(&traced);
        }
        oracle_scene_free(&scene);
    }
}

// Shifted lenses see a corner of the field of view. A 220 degree fisheye sees primitives behind the
// image plane, and pixels outside its circle have no ray.
static void shifted_and_very_wide_lenses_equal_the_oracle(void **state)
{
    (void)state;
    const sgs_camera cameras[] = {
        {SGS_CAMERA_PINHOLE, 48, 40, {60, 60, -40, 90}},
        {SGS_CAMERA_PINHOLE, 40, 48, {25, 25, 20, 24}},
        {SGS_CAMERA_OPENCV_FISHEYE, 96, 96, {25, 25, 48, 48}},
        {SGS_CAMERA_OPENCV_FISHEYE, 128, 64, {20.5, 20.5, 64, 32}},
        {SGS_CAMERA_THIN_PRISM_FISHEYE,
         64,
         64,
         {40, 41, 10, 60, 0.01, -0.002, 0.001, -0.001, 0, 0, 0.001, 0.002}},
        sgs_camera_equirectangular(160, 80),
    };
    // Around the camera, which is at the origin.
    const oracle_range range = {3, 0.05, 1, 0.05, 0.95, 0.15};
    oracle_scene scene = oracle_random_model(91, 250, &range);
    for (size_t i = 0; i < sizeof cameras / sizeof *cameras; ++i) {
        for (int filter = SGS_FILTER_3DGS; filter <= SGS_FILTER_MIP; ++filter) {
            const sgs_pose pose = oracle_pose_look_at(0.1, -0.2, 0.3 - 0.2 * (double)i);
            traced_view traced = traced_create(scene.model, &cameras[i], &pose, (sgs_filter)filter,
                                               1 << i % 3, SGSI_BVH_REFIT);
            const comparison one = compare_with_oracle(&traced, &scene, true, 0);
            print_message("camera %zu: colour %.2g, distance %.2g, fragile %.1f %%\n", i, one.color,
                          one.distance, 100.0 * (double)one.fragile / (double)one.pixels);
            assert_true(one.color <= 1e-5 && one.distance <= 3e-5 && one.fragile * 10 < one.pixels);
            assert_true(one.compared * 2 > one.pixels);
            traced_destroy(&traced);
        }
    }
    oracle_scene_free(&scene);
}

// Each COLMAP model with all coefficients nonzero. The last two fold inside the image: pixels
// beyond have no ray.
static void every_lens_equals_the_oracle(void **state)
{
    (void)state;
    const sgs_camera cameras[] = {
        {SGS_CAMERA_SIMPLE_PINHOLE, 50, 40, {44, 25, 20}},
        {SGS_CAMERA_PINHOLE, 50, 40, {44, 47, 26, 18}},
        {SGS_CAMERA_SIMPLE_RADIAL, 50, 40, {44, 25, 20, -0.14}},
        {SGS_CAMERA_RADIAL, 50, 40, {44, 25, 20, -0.31, 0.12}},
        {SGS_CAMERA_OPENCV, 50, 40, {44, 43, 25, 20, -0.1, 0.05, 0.02, -0.03}},
        {SGS_CAMERA_OPENCV_FISHEYE, 50, 40, {22, 22, 25, 20, 0.02, -0.004, 0.001, -0.0002}},
        {SGS_CAMERA_FULL_OPENCV,
         50,
         40,
         {44, 44, 25, 20, -0.1, 0.01, 1e-3, 2e-3, 0.001, 0.02, 0.01, 0.002}},
        {SGS_CAMERA_FOV, 50, 40, {30, 30, 25, 20, 0.92}},
        {SGS_CAMERA_SIMPLE_RADIAL_FISHEYE, 50, 40, {22, 25, 20, -0.01}},
        {SGS_CAMERA_RADIAL_FISHEYE, 50, 40, {22, 26, 19, -0.05, 0.01}},
        {SGS_CAMERA_THIN_PRISM_FISHEYE,
         50,
         40,
         {30, 31, 25, 20, .03, -.02, 2e-3, -1e-3, .01, -.001, 3e-3, -2e-3}},
        {SGS_CAMERA_SIMPLE_RADIAL, 50, 40, {30, 25, 20, -0.3}},
        {SGS_CAMERA_OPENCV_FISHEYE, 50, 40, {20, 20, 25, 20, -0.3, 0.1, 0, 0}},
    };
    const sgs_pose pose = oracle_pose_look_at(0.7, -0.9, -2.4);
    oracle_scene scene = oracle_random_model(53, 250, NULL);
    for (size_t i = 0; i < sizeof cameras / sizeof *cameras; ++i) {
        traced_view traced =
            traced_create(scene.model, &cameras[i], &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
        const comparison one = compare_with_oracle(&traced, &scene, true, 0);
        print_message("%s: colour %.2g, distance %.2g, %zu of %zu pixels compared\n",
                      sgs_camera_model_name(cameras[i].model), one.color, one.distance,
                      one.compared, one.pixels);
        assert_true(one.color <= 1e-5 && one.distance <= 3e-5 && one.fragile_color <= 0.05);
        assert_true(one.compared * 4 > one.pixels);
        traced_destroy(&traced);
    }
    oracle_scene_free(&scene);
}

// The centre of a camera is more precise than the floats of the means.
static void scenes_far_from_the_origin_equal_the_oracle(void **state)
{
    (void)state;
    const sgs_pose pose = oracle_pose_move(oracle_pose_look_at(2.1, -1.3, -3.2), oracle_far_away);
    oracle_scene scene = oracle_random_model(31, 300, NULL);
    oracle_scene_move(&scene, oracle_far_away);
    for (int isa = 0; isa < SGS_ISA_COUNT; ++isa) {
        if (!sgs_isa_supported((sgs_isa)isa))
            continue;
        sgs_isa_set((sgs_isa)isa);
        for (int run = 0; run < 3 * TRACED_LENS_COUNT; ++run) {
            const sgs_camera camera = oracle_camera(traced_lenses[run / 3], 63, 47);
            traced_view traced = traced_create(scene.model, &camera, &pose, (sgs_filter)(run % 3),
                                               2, SGSI_BVH_REFIT);
            const comparison one = compare_with_oracle(&traced, &scene, true, 0);
            traced_destroy(&traced);
            print_message("%s, run %d: colour %.2g, distance %.2g\n", sgs_isa_name((sgs_isa)isa),
                          run, one.color, one.distance);
            assert_true(one.color <= 1e-5 && one.distance <= 3e-5 && one.fragile_color <= 0.05);
            assert_true(one.fragile * 25 < one.pixels && one.compared * 10 > one.pixels);
        }
    }
    oracle_scene_free(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(random_scenes_equal_the_oracle_on_every_isa_and_lens,
                                  traced_restore),
        cmocka_unit_test(adversarial_scenes_equal_the_oracle),
        cmocka_unit_test(odd_sizes_equal_the_oracle),
        cmocka_unit_test(flat_discs_equal_the_oracle),
        cmocka_unit_test(every_lens_equals_the_oracle),
        cmocka_unit_test(shifted_and_very_wide_lenses_equal_the_oracle),
        cmocka_unit_test_teardown(scenes_far_from_the_origin_equal_the_oracle, traced_restore),
    };
    return cmocka_run_group_tests(tests, traced_prepare, NULL);
}
