// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Images of the reference renderer: scenes with closed-form pixels, the rules of a ray (thresholds,
// order, termination) one by one, invariants, and difficult scenes. test_reference_gradient.c tests
// the gradients.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>

#include "support/oracle_support.h"
#include "reference/reference.h"
#include "base/threads.h"

// Closed forms agree up to the rounding of a few dozen operations on numbers near 1.
static const double exact = 1e-13;

static const sgs_pose identity = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}};

static sgs_render_options bare(void)
{
    return oracle_render_options(SGS_FILTER_NONE, 3, NULL);
}

// 5 x 5 pixels; (2, 2) looks along the axis; f in pixels.
static sgs_camera axis_camera(double f)
{
    return (sgs_camera){SGS_CAMERA_PINHOLE, 5, 5, {f, f, 2.5, 2.5}};
}

enum { CENTRE = 12 };

static bool near_to(double value, double expected)
{
    return oracle_error(value, expected, 1) <= exact;
}

static sgs_reference_frame render(const double *params, size_t count, const sgs_camera *camera,
                                  const sgs_pose *pose, const sgs_render_options *options)
{
    sgs_reference_frame frame;
    assert_int_equal(sgs_reference_frame_create(camera->width, camera->height, &frame),
                     SGS_STATUS_OK);
    assert_int_equal(sgs_reference_render(params, count, camera, pose, options, &frame),
                     SGS_STATUS_OK);
    return frame;
}

// Counted hits of the axis ray of axis_camera(100) without a pixel filter.
static size_t axis_hits(const double *params, size_t count, double near_distance, sgs_hit *hits,
                        size_t capacity)
{
    const sgs_camera camera = axis_camera(100);
    sgs_render_options options = bare();
    options.near_distance = near_distance;
    return oracle_hits(params, count, &camera, &identity, &options, 2, 2, hits, capacity);
}

// ---- Closed forms ----

static void one_ball_on_the_axis(void **state)
{
    (void)state;
    double ball[SGS_PARAM_COUNT];
    oracle_set_ball(ball, 0, 0, 3, 0.1, 0.7);
    const sgs_camera camera = axis_camera(100);
    const sgs_render_options options = bare();
    sgs_reference_frame frame = render(ball, 1, &camera, &identity, &options);
    assert_true(near_to(frame.color[0][CENTRE], 0.7 * 0.8));
    assert_true(near_to(frame.color[1][CENTRE], 0.7 * 0.5));
    assert_true(near_to(frame.color[2][CENTRE], 0.7 * 0.25));
    assert_true(near_to(frame.transmittance[CENTRE], 0.3));
    assert_true(near_to(frame.depth_mean[CENTRE], 3));
    assert_true(near_to(frame.depth_median[CENTRE], 3));
    assert_true(near_to(frame.depth_first[CENTRE], 3));
    assert_true(frame.hits[CENTRE] == 1);
    // One pixel to the right: the ray passes the mean at distance 3 sin(theta), closest at t = 3
    // cos(theta).
    const double cosine = 1 / sqrt(1 + 1e-4), sine = 0.01 * cosine;
    const double alpha = 0.7 * exp(-0.5 * 9 * sine * sine / 0.01);
    assert_true(near_to(1 - frame.transmittance[CENTRE + 1], alpha));
    assert_true(near_to(frame.depth_mean[CENTRE + 1], 3 * cosine));
    sgs_reference_frame_free(&frame);
}

// An ellipsoid with axes (0.1, 0.2, 0.4) turned 90 degrees about z: its marginal across the axis is
// diag(0.2^2, 0.1^2).
static void turned_ellipsoid(void **state)
{
    (void)state;
    double one[SGS_PARAM_COUNT];
    oracle_set_ball(one, 0, 0, 3, 0.1, 0.7);
    oracle_set_scales(one, 0.1, 0.2, 0.4);
    one[SGS_PARAM_ROTATION] = one[SGS_PARAM_ROTATION + 3] = 5; // any norm
    const sgs_camera camera = axis_camera(40);
    const sgs_render_options options = bare();
    sgs_reference_frame frame = render(one, 1, &camera, &identity, &options);
    for (int step = 1; step <= 2; ++step) {
        // In the plane of the ray and one lateral axis the Gaussian has the variances v (lateral)
        // and 0.16 (depth); the line x = k z meets it with rho^2 = (3 k)^2 / (v + 0.16 k^2).
        const double k = step / 40.0, x = 9 * k * k / (0.04 + 0.16 * k * k),
                     y = 9 * k * k / (0.01 + 0.16 * k * k);
        assert_true(near_to(1 - frame.transmittance[CENTRE + step], 0.7 * exp(-0.5 * x)));
        assert_true(near_to(1 - frame.transmittance[CENTRE + 5 * step], 0.7 * exp(-0.5 * y)));
    }
    sgs_reference_frame_free(&frame);
}

static void filters_widen_a_ball_as_their_papers_say(void **state)
{
    (void)state;
    double ball[SGS_PARAM_COUNT];
    const double s2 = 0.01 * 0.01, z = 3, f = 100;
    const float f3 = 0.02f;
    oracle_set_ball(ball, 0, 0, z, 0.01, 0.7);
    const sgs_camera camera = axis_camera(f);
    const double shift2 =
        z * z * 1e-4 / (1 + 1e-4); // squared distance of the neighbour's ray from the mean
    sgs_render_options options = oracle_render_options(SGS_FILTER_3DGS, 3, NULL);
    sgs_reference_frame frame = render(ball, 1, &camera, &identity, &options);
    assert_true(near_to(1 - frame.transmittance[CENTRE], 0.7));
    assert_true(near_to(1 - frame.transmittance[CENTRE + 1],
                        0.7 * exp(-0.5 * shift2 / (s2 + 0.3 * z * z / (f * f)))));
    sgs_reference_frame_free(&frame);

    // Mip-Splatting preserves the mass: s^3 / s'^3 in space, then s'^2 / s''^2 in the image.
    options = oracle_render_options(SGS_FILTER_MIP, 3, &f3);
    const double v1 = s2 + (double)f3 * f3, v2 = v1 + 0.1 * z * z / (f * f);
    const double opacity = 0.7 * pow(s2 / v1, 1.5) * v1 / v2;
    frame = render(ball, 1, &camera, &identity, &options);
    assert_true(near_to(1 - frame.transmittance[CENTRE], opacity));
    assert_true(near_to(1 - frame.transmittance[CENTRE + 1], opacity * exp(-0.5 * shift2 / v2)));
    sgs_reference_frame_free(&frame);

    options.filter_3d = NULL; // pixel filter only
    frame = render(ball, 1, &camera, &identity, &options);
    assert_true(near_to(1 - frame.transmittance[CENTRE], 0.7 * s2 / (s2 + 0.1 * z * z / (f * f))));
    sgs_reference_frame_free(&frame);
}

// Perspective lenses dilate by the depth along the axis, fisheyes by the distance.
static void depth_of_the_filter_depends_on_the_lens(void **state)
{
    (void)state;
    double ball[SGS_PARAM_COUNT];
    oracle_set_ball(ball, 2, 0, 2, 0.01, 0.7);
    const sgs_camera_model lenses[2] = {SGS_CAMERA_PINHOLE, SGS_CAMERA_OPENCV_FISHEYE};
    const double depths[2] = {2, sqrt(8)};
    for (int k = 0; k < 2; ++k) {
        const sgs_camera camera = {lenses[k], 5, 5, {90, 110, 2.5, 2.5}};
        const sgs_render_options options = oracle_render_options(SGS_FILTER_3DGS, 3, NULL);
        sgsi_reference_view view;
        assert_int_equal(sgsi_reference_view_create(ball, 1, &camera, &identity, &options, &view),
                         SGS_STATUS_OK);
        assert_true(near_to(view.primitives[0].depth, depths[k]));
        assert_true(
            oracle_error(view.primitives[0].variance_view[0],
                         view.primitives[0].variance[0] + 0.3 * depths[k] * depths[k] / (90 * 110),
                         0) <= exact);
        sgsi_reference_view_free(&view);
    }
}

static void two_balls_blend(void **state)
{
    (void)state;
    double balls[2 * SGS_PARAM_COUNT];
    double *far_ball = balls, *near_ball = balls + SGS_PARAM_COUNT;
    oracle_set_ball(far_ball, 0, 0, 5, 0.2, 0.5);
    oracle_set_ball(near_ball, 0, 0, 2, 0.1, 0.3);
    oracle_set_color(far_ball, 0.1, 0.2, 0.3);
    oracle_set_color(near_ball, 0.9, 0.8, 0.7);
    const sgs_camera camera = axis_camera(100);
    const sgs_render_options options = bare();
    sgs_reference_frame frame = render(balls, 2, &camera, &identity, &options);
    assert_true(near_to(frame.color[0][CENTRE], 0.3 * 0.9 + 0.7 * 0.5 * 0.1));
    assert_true(near_to(frame.color[1][CENTRE], 0.3 * 0.8 + 0.7 * 0.5 * 0.2));
    assert_true(near_to(frame.color[2][CENTRE], 0.3 * 0.7 + 0.7 * 0.5 * 0.3));
    assert_true(near_to(frame.transmittance[CENTRE], 0.35));
    assert_true(near_to(frame.depth_mean[CENTRE], (0.3 * 2 + 0.35 * 5) / 0.65));
    assert_true(near_to(frame.depth_median[CENTRE], 5));
    assert_true(near_to(frame.depth_first[CENTRE], 2));
    assert_true(frame.hits[CENTRE] == 2);
    sgs_reference_frame_free(&frame);

    oracle_set_opacity(near_ball, 0.999); // clamped
    frame = render(balls, 2, &camera, &identity, &options);
    assert_true(near_to(frame.color[0][CENTRE], 0.99 * 0.9 + 0.01 * 0.5 * 0.1));
    assert_true(near_to(frame.depth_median[CENTRE], 2));
    sgs_reference_frame_free(&frame);

    oracle_set_opacity(near_ball, 0.3);
    oracle_set_opacity(far_ball, 0.2); // T stays above 0.5
    frame = render(balls, 2, &camera, &identity, &options);
    assert_true(frame.depth_median[CENTRE] == 0);
    sgs_reference_frame_free(&frame);
}

// Every SH basis function, computed by hand for direction u = (2, 3, 6) / 7.
static void spherical_harmonics_have_the_signs_of_3dgs(void **state)
{
    (void)state;
    const double x = 2.0 / 7, y = 3.0 / 7, z = 6.0 / 7, pi = 3.14159265358979323846;
    // Textbook forms of the real harmonics, with the signs of 3DGS.
    const double expected[SGSI_SH_COUNT] = {
        0.5 * sqrt(1 / pi),
        -sqrt(3 / (4 * pi)) * y,
        sqrt(3 / (4 * pi)) * z,
        -sqrt(3 / (4 * pi)) * x,
        0.5 * sqrt(15 / pi) * x * y,
        -0.5 * sqrt(15 / pi) * y * z,
        0.25 * sqrt(5 / pi) * (3 * z * z - 1),
        -0.5 * sqrt(15 / pi) * x * z,
        0.25 * sqrt(15 / pi) * (x * x - y * y),
        -0.25 * sqrt(35 / (2 * pi)) * y * (3 * x * x - y * y),
        0.5 * sqrt(105 / pi) * x * y * z,
        -0.25 * sqrt(21 / (2 * pi)) * y * (5 * z * z - 1),
        0.25 * sqrt(7 / pi) * z * (5 * z * z - 3),
        -0.25 * sqrt(21 / (2 * pi)) * x * (5 * z * z - 1),
        0.25 * sqrt(105 / pi) * z * (x * x - y * y),
        -0.25 * sqrt(35 / (2 * pi)) * x * (x * x - 3 * y * y),
    };
    double ball[SGS_PARAM_COUNT];
    const sgs_camera camera = axis_camera(100);
    for (int degree = -1; degree <= 4; ++degree) {
        const sgs_render_options options = oracle_render_options(SGS_FILTER_NONE, degree, NULL);
        const int band = degree < 0 ? 0 : degree > 3 ? 3 : degree, used = (band + 1) * (band + 1);
        for (int k = 0; k < SGSI_SH_COUNT; ++k) {
            sgsi_reference_view view;
            oracle_set_ball(ball, 2, 3, 6, 0.1, 0.5);
            oracle_set_color(ball, 0.5, 0.5, 0.5);
            ball[SGS_PARAM_SH_DC + 3 * k + 1] = 0.4;
            assert_int_equal(
                sgsi_reference_view_create(ball, 1, &camera, &identity, &options, &view),
                SGS_STATUS_OK);
            assert_true(near_to(view.primitives[0].color[0], 0.5));
            assert_true(
                near_to(view.primitives[0].color[1], 0.5 + (k < used ? 0.4 * expected[k] : 0)));
            sgsi_reference_view_free(&view);
        }
    }
}

// ---- The rules of a ray ----

static void stack_stops_before_the_hit_below_1e_4(void **state)
{
    (void)state;
    // T = 1, 0.2, 0.04, 0.008, 0.0016, 0.00032; the sixth ball would make it 0.000064. A faint one
    // behind it would fit, but the ray has ended.
    enum { BALLS = 8 };
    double balls[BALLS * SGS_PARAM_COUNT];
    for (int i = 0; i < BALLS; ++i)
        oracle_set_ball(balls + i * SGS_PARAM_COUNT, 0, 0, 2 + i, 0.1, i == 6 ? 0.01 : 0.8);
    sgs_hit hits[BALLS];
    assert_int_equal(axis_hits(balls, BALLS, 0.2, hits, BALLS), 5);
    for (int i = 0; i < 5; ++i) {
        assert_int_equal(hits[i].primitive, i);
        assert_true(oracle_error(hits[i].transmittance, pow(0.2, i), 0) <= exact);
        assert_true(near_to(hits[i].alpha, 0.8));
        assert_true(near_to(hits[i].t, 2 + i));
    }
    const sgs_camera camera = axis_camera(100);
    const sgs_render_options options = bare();
    sgs_reference_frame frame = render(balls, BALLS, &camera, &identity, &options);
    assert_true(frame.hits[CENTRE] == 5);
    assert_true(oracle_error(frame.transmittance[CENTRE], pow(0.2, 5), 0) <= exact);
    sgs_reference_frame_free(&frame);
}

static void hits_below_1_of_255_do_not_exist(void **state)
{
    (void)state;
    double ball[SGS_PARAM_COUNT];
    sgs_hit hit;
    oracle_set_ball(ball, 0, 0, 3, 0.1, (1 - 1e-9) / 255);
    assert_int_equal(axis_hits(ball, 1, 0.2, &hit, 1), 0);
    oracle_set_ball(ball, 0, 0, 3, 0.1, (1 + 1e-9) / 255);
    assert_int_equal(axis_hits(ball, 1, 0.2, &hit, 1), 1);
}

static void near_distance_is_open_and_is_measured_at_the_hit(void **state)
{
    (void)state;
    double ball[SGS_PARAM_COUNT];
    sgs_hit hit;
    oracle_set_ball(ball, 0, 0, 0.25, 1, 0.5); // scale 1: t is exactly 0.25
    assert_int_equal(axis_hits(ball, 1, 0.25, &hit, 1), 0);
    assert_int_equal(axis_hits(ball, 1, nextafter(0.25, 0), &hit, 1), 1);
    assert_true(hit.t == 0.25);
    assert_int_equal(axis_hits(ball, 1, 0.3, &hit, 1), 0);
}

static void hits_behind_the_camera_do_not_count(void **state)
{
    (void)state;
    double balls[2 * SGS_PARAM_COUNT];
    sgs_hit hits[2];
    oracle_set_ball(balls, 0, 0, -1, 2, 0.9);                  // extends in front of the camera
    oracle_set_ball(balls + SGS_PARAM_COUNT, 0, 0, 1, 3, 0.5); // contains the camera
    assert_int_equal(axis_hits(balls, 2, 0.2, hits, 2), 1);
    assert_int_equal(hits[0].primitive, 1);
    assert_true(near_to(hits[0].alpha, 0.5) && near_to(hits[0].t, 1));
}

// Mean and camera coincide: there is no direction, so only band 0 contributes colour; t = 0 counts
// for a negative near distance only.
static void camera_at_a_mean(void **state)
{
    (void)state;
    double ball[SGS_PARAM_COUNT];
    oracle_set_ball(ball, 0, 0, 0, 0.5, 0.5);
    ball[SGS_PARAM_SH_REST] = 3;
    for (int filter = SGS_FILTER_3DGS; filter <= SGS_FILTER_MIP; ++filter) {
        const sgs_camera camera = axis_camera(100);
        sgs_render_options options = oracle_render_options((sgs_filter)filter, 3, NULL);
        sgs_reference_frame frame = render(ball, 1, &camera, &identity, &options);
        assert_true(frame.hits[CENTRE] == 0 && frame.transmittance[CENTRE] == 1);
        sgs_reference_frame_free(&frame);
        options.near_distance = -1;
        frame = render(ball, 1, &camera, &identity, &options);
        assert_true(near_to(frame.color[0][CENTRE], 0.5 * 0.8));
        sgs_reference_frame_free(&frame);
    }
}

static void equal_depths_are_ordered_by_id(void **state)
{
    (void)state;
    enum { BALLS = 9 };
    double balls[BALLS * SGS_PARAM_COUNT];
    for (int i = 0; i < BALLS; ++i) {
        oracle_set_ball(balls + i * SGS_PARAM_COUNT, 0, 0, i % 3 == 0 ? 2 : 3, 0.1, 0.2);
        oracle_set_color(balls + i * SGS_PARAM_COUNT, 0.1 * i, 0, 0);
    }
    const uint32_t expected[BALLS] = {0, 3, 6, 1, 2, 4, 5, 7, 8};
    sgs_hit hits[BALLS];
    double color = 0, transmittance = 1;
    assert_int_equal(axis_hits(balls, BALLS, 0.2, hits, BALLS), BALLS);
    for (int i = 0; i < BALLS; ++i) {
        assert_int_equal(hits[i].primitive, expected[i]);
        color += transmittance * 0.2 * 0.1 * expected[i];
        transmittance *= 0.8;
    }
    const sgs_camera camera = axis_camera(100);
    const sgs_render_options options = bare();
    sgs_reference_frame frame = render(balls, BALLS, &camera, &identity, &options);
    assert_true(near_to(frame.color[0][CENTRE], color));
    sgs_reference_frame_free(&frame);
}

static void pixels_without_a_ray_stay_empty(void **state)
{
    (void)state;
    // A fisheye image 1.5 times as wide as the circle at 180 degrees from the axis: its corners
    // have no rays.
    const sgs_camera camera = {SGS_CAMERA_OPENCV_FISHEYE, 40, 40, {4, 4, 20, 20}};
    double ball[SGS_PARAM_COUNT];
    oracle_set_ball(ball, 0, 0, 1, 100, 0.5);
    ball[SGS_PARAM_MEAN + 2] = 0.5;
    sgs_render_options options = bare();
    options.near_distance = -1e6;
    sgs_reference_frame frame = render(ball, 1, &camera, &identity, &options);
    size_t empty = 0;
    for (int y = 0; y < 40; ++y) {
        for (int x = 0; x < 40; ++x) {
            const double pixel[2] = {x + 0.5, y + 0.5};
            const size_t i = 40 * (size_t)y + (size_t)x;
            double direction[3];
            sgs_hit hit;
            const bool has_ray = sgs_camera_unproject(&camera, pixel, direction);
            assert_int_equal(oracle_hits(ball, 1, &camera, &identity, &options, x, y, &hit, 1),
                             has_ray);
            assert_true(frame.hits[i] == has_ray);
            if (has_ray)
                continue;
            ++empty;
            assert_true(frame.color[0][i] == 0 && frame.color[1][i] == 0 && frame.color[2][i] == 0);
            assert_true(frame.transmittance[i] == 1 && frame.depth_mean[i] == 0);
            assert_true(frame.depth_median[i] == 0 && frame.depth_first[i] == 0);
        }
    }
    assert_true(empty > 100 && empty < 1500);
    sgs_reference_frame_free(&frame);
}

// ---- Invariants ----

static const sgs_camera_model lenses[] = {SGS_CAMERA_PINHOLE, SGS_CAMERA_OPENCV,
                                          SGS_CAMERA_OPENCV_FISHEYE};
enum { LENS_COUNT = 3, WIDTH = 24, HEIGHT = 18, PIXELS = WIDTH * HEIGHT };

static size_t planes_of(const sgs_reference_frame *frame, const double *planes[8])
{
    const double *const all[8] = {frame->color[0],      frame->color[1],   frame->color[2],
                                  frame->transmittance, frame->depth_mean, frame->depth_median,
                                  frame->depth_first,   frame->hits};
    memcpy(planes, all, sizeof all);
    return 8;
}

static double worst_difference(const sgs_reference_frame *a, const sgs_reference_frame *b)
{
    const double *left[8], *right[8];
    double worst = 0;
    planes_of(b, right);
    for (size_t k = planes_of(a, left); k-- > 0;)
        worst = fmax(
            worst, oracle_worst_error(left[k], right[k], (size_t)a->width * (size_t)a->height, 1));
    return worst;
}

static void white_in_front_of_white_is_white(void **state)
{
    (void)state;
    const oracle_range range = {1, 0.05, 0.4, 0.05, 0.999, 0};
    oracle_scene scene = oracle_random_model(5, 60, &range);
    for (size_t i = 0; i < scene.count; ++i)
        oracle_set_color(oracle_primitive(&scene, i), 1, 1, 1);
    const sgs_pose pose = oracle_pose_look_at(1, -0.7, -2.5);
    for (int lens = 0; lens < LENS_COUNT; ++lens) {
        for (int filter = SGS_FILTER_3DGS; filter <= SGS_FILTER_MIP; ++filter) {
            const sgs_camera camera = oracle_camera(lenses[lens], WIDTH, HEIGHT);
            const sgs_render_options options =
                oracle_render_options((sgs_filter)filter, 3, scene.filter_3d);
            sgs_reference_frame frame = render(scene.params, scene.count, &camera, &pose, &options);
            for (int i = 0; i < PIXELS; ++i)
                for (int c = 0; c < 3; ++c)
                    assert_true(near_to(frame.color[c][i] + frame.transmittance[i], 1));
            sgs_reference_frame_free(&frame);
        }
    }
    oracle_scene_free(&scene);
}

// Ids only break ties, so without ties the image is identical bit by bit.
static void permuting_primitives_changes_nothing(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(6, 60, NULL), shuffled = oracle_scene_create(60);
    for (size_t i = 0; i < 60; ++i) {
        memcpy(oracle_primitive(&shuffled, 37 * i % 60), oracle_primitive(&scene, i),
               SGS_PARAM_COUNT * sizeof(double));
        shuffled.filter_3d[37 * i % 60] = scene.filter_3d[i];
    }
    const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, WIDTH, HEIGHT);
    const sgs_pose pose = oracle_pose_look_at(-1, 0.7, -2.5);
    for (int filter = SGS_FILTER_3DGS; filter <= SGS_FILTER_MIP; ++filter) {
        sgs_render_options options = oracle_render_options((sgs_filter)filter, 3, scene.filter_3d);
        sgs_reference_frame a = render(scene.params, 60, &camera, &pose, &options);
        options.filter_3d = shuffled.filter_3d;
        sgs_reference_frame b = render(shuffled.params, 60, &camera, &pose, &options);
        assert_true(worst_difference(&a, &b) == 0);
        sgs_reference_frame_free(&a);
        sgs_reference_frame_free(&b);
    }
    oracle_scene_free(&scene);
    oracle_scene_free(&shuffled);
}

// World point x becomes Q x + v: means and rotations move together with the camera.
static void moving_world_and_camera_changes_nothing(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(7, 60, NULL);
    const double u[4] = {0.5, -0.1, 0.7, 0.5}; // unit quaternion of Q
    const double Q[9] = {-0.48, -0.64, 0.6, 0.36, 0.48, 0.8, -0.8, 0.6, 0}, v[3] = {3, -2, 5};
    double *moved = oracle_memory(scene.count * SGS_PARAM_COUNT, sizeof *moved);
    memcpy(moved, scene.params, scene.count * SGS_PARAM_COUNT * sizeof *moved);
    for (size_t i = 0; i < scene.count; ++i) {
        const double *mean = oracle_primitive(&scene, i), *q = mean + SGS_PARAM_ROTATION;
        double *out = moved + i * SGS_PARAM_COUNT;
        for (int k = 0; k < 3; ++k)
            out[k] = Q[3 * k] * mean[0] + Q[3 * k + 1] * mean[1] + Q[3 * k + 2] * mean[2] + v[k];
        out[SGS_PARAM_ROTATION] = u[0] * q[0] - u[1] * q[1] - u[2] * q[2] - u[3] * q[3];
        out[SGS_PARAM_ROTATION + 1] = u[0] * q[1] + u[1] * q[0] + u[2] * q[3] - u[3] * q[2];
        out[SGS_PARAM_ROTATION + 2] = u[0] * q[2] - u[1] * q[3] + u[2] * q[0] + u[3] * q[1];
        out[SGS_PARAM_ROTATION + 3] = u[0] * q[3] + u[1] * q[2] - u[2] * q[1] + u[3] * q[0];
    }
    const sgs_pose pose = oracle_pose_look_at(1, 0.7, -2.5);
    sgs_pose moved_pose = pose;
    for (int row = 0; row < 3; ++row) {
        for (int k = 0; k < 3; ++k) { // P Q^T
            moved_pose.rotation[3 * row + k] = pose.rotation[3 * row] * Q[3 * k] +
                                               pose.rotation[3 * row + 1] * Q[3 * k + 1] +
                                               pose.rotation[3 * row + 2] * Q[3 * k + 2];
            moved_pose.translation[row] -= moved_pose.rotation[3 * row + k] * v[k];
        }
    }
    for (int lens = 0; lens < LENS_COUNT; ++lens) {
        for (int filter = SGS_FILTER_3DGS; filter <= SGS_FILTER_MIP; ++filter) {
            const sgs_camera camera = oracle_camera(lenses[lens], WIDTH, HEIGHT);
            const sgs_render_options options =
                oracle_render_options((sgs_filter)filter, 0, scene.filter_3d);
            sgs_reference_frame a = render(scene.params, scene.count, &camera, &pose, &options);
            sgs_reference_frame b = render(moved, scene.count, &camera, &moved_pose, &options);
            assert_true(worst_difference(&a, &b) <= 1e-10);
            sgs_reference_frame_free(&a);
            sgs_reference_frame_free(&b);
        }
    }
    free(moved);
    oracle_scene_free(&scene);
}

static void zero_quaternion_is_the_identity(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(8, 20, NULL);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, WIDTH, HEIGHT);
    const sgs_pose pose = oracle_pose_look_at(1, 0.7, -2.5);
    const sgs_render_options options = bare();
    sgs_reference_frame frames[2];
    for (int w = 0; w < 2; ++w) {
        for (size_t i = 0; i < scene.count; ++i)
            for (int k = 0; k < 4; ++k)
                oracle_primitive(&scene, i)[SGS_PARAM_ROTATION + k] = k == 0 ? w : 0;
        frames[w] = render(scene.params, scene.count, &camera, &pose, &options);
    }
    assert_true(worst_difference(&frames[0], &frames[1]) == 0);
    sgs_reference_frame_free(&frames[0]);
    sgs_reference_frame_free(&frames[1]);
    oracle_scene_free(&scene);
}

static void bits_do_not_depend_on_threads(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(9, 60, NULL);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV_FISHEYE, WIDTH, HEIGHT);
    const sgs_pose pose = oracle_pose_look_at(1, 0.7, -1.5);
    const sgs_render_options options = oracle_render_options(SGS_FILTER_MIP, 3, scene.filter_3d);
    const int threads = sgsi_threads();
    sgsi_threads_set(1);
    sgs_reference_frame first = render(scene.params, scene.count, &camera, &pose, &options);
    for (int count = 2; count <= 4; ++count) {
        sgsi_threads_set(count);
        sgs_reference_frame other = render(scene.params, scene.count, &camera, &pose, &options);
        assert_true(worst_difference(&first, &other) == 0);
        sgs_reference_frame_free(&other);
    }
    sgsi_threads_set(threads);
    sgs_reference_frame_free(&first);
    oracle_scene_free(&scene);
}

// ---- Difficult scenes and the guarantees of the calls ----

// Every ray of a frame: hits strictly ordered by (t, id) and within their limits, T the product
// over the preceding hits, and the frame agrees with the list.
static void check_rays(const oracle_scene *scene, const sgs_camera *camera, const sgs_pose *pose,
                       const sgs_render_options *options)
{
    sgs_reference_frame frame = render(scene->params, scene->count, camera, pose, options);
    sgs_hit *hits = oracle_memory(scene->count, sizeof *hits);
    double any = 0;
    for (int y = 0; y < camera->height; ++y) {
        for (int x = 0; x < camera->width; ++x) {
            const size_t i = (size_t)y * (size_t)camera->width + (size_t)x;
            const size_t count = oracle_hits(scene->params, scene->count, camera, pose, options, x,
                                             y, hits, scene->count);
            double transmittance = 1;
            for (size_t k = 0; k < count; ++k) {
                assert_true(
                    k == 0 || hits[k - 1].t < hits[k].t ||
                    (hits[k - 1].t == hits[k].t && hits[k - 1].primitive < hits[k].primitive));
                assert_true(hits[k].t > options->near_distance && isfinite(hits[k].t));
                assert_true(hits[k].alpha >= 1.0 / 255 && hits[k].alpha <= 0.99);
                assert_true(hits[k].transmittance == transmittance);
                transmittance *= 1 - hits[k].alpha;
            }
            assert_true(transmittance >= 1e-4 && frame.transmittance[i] == transmittance);
            assert_true(frame.hits[i] == (double)count &&
                        frame.depth_first[i] == (count ? hits[0].t : 0));
            any += frame.hits[i];
        }
    }
    // Without a filter the thinnest fall between the rays; with Mip-Splatting's factors they are
    // too faint.
    assert_true(any > 0 || options->filter != SGS_FILTER_3DGS);
    free(hits);
    sgs_reference_frame_free(&frame);
}

static void hard_scenes_keep_the_rules(void **state)
{
    (void)state;
    const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, 16, 12);
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    for (int kind = 0; kind < ORACLE_ADVERSARY_COUNT; ++kind) {
        oracle_scene scene = oracle_adversarial_model((oracle_adversary)kind, 30, 96);
        for (int filter = SGS_FILTER_3DGS; filter <= SGS_FILTER_MIP; ++filter) {
            const sgs_render_options options =
                oracle_render_options((sgs_filter)filter, 3, scene.filter_3d);
            check_rays(&scene, &camera, &pose, &options);
        }
        oracle_scene_free(&scene);
    }
}

static void duplicates_have_equal_depths(void **state)
{
    (void)state;
    oracle_scene scene = oracle_adversarial_model(ORACLE_DUPLICATES, 31, 40);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 8, 6);
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    const sgs_render_options options = oracle_render_options(SGS_FILTER_3DGS, 3, NULL);
    sgs_hit hits[40];
    const size_t count = oracle_hits(scene.params, 40, &camera, &pose, &options, 4, 3, hits, 40);
    size_t ties = 0;
    for (size_t k = 1; k < count && k < 40; ++k)
        ties += hits[k].t == hits[k - 1].t;
    assert_true(ties > 0);
    oracle_scene_free(&scene);
}

static void scenes_are_the_same_in_float_and_double(void **state)
{
    (void)state;
    for (int kind = 0; kind < ORACLE_ADVERSARY_COUNT; ++kind) {
        oracle_scene scene = oracle_adversarial_model((oracle_adversary)kind, 32, 21);
        assert_int_equal(scene.model->count, 21);
        for (size_t i = 0; i < scene.count; ++i)
            for (int k = 0; k < SGS_PARAM_COUNT; ++k)
                assert_true((double)*sgs_gaussians_at(scene.model, i, k) ==
                            oracle_primitive(&scene, i)[k]);
        oracle_scene_free(&scene);
    }
}

static void degenerate_primitives_are_never_hit(void **state)
{
    (void)state;
    const double values[] = {NAN, HUGE_VAL, -HUGE_VAL, 1e308, -1e308};
    const int places[] = {SGS_PARAM_MEAN, SGS_PARAM_MEAN + 2, SGS_PARAM_ROTATION + 1,
                          SGS_PARAM_SCALE + 1, SGS_PARAM_OPACITY};
    for (size_t v = 0; v < sizeof values / sizeof *values; ++v) {
        for (size_t k = 0; k < sizeof places / sizeof *places; ++k) {
            double ball[SGS_PARAM_COUNT];
            sgs_hit hit = {0};
            oracle_set_ball(ball, 0, 0, 3, 0.1, 0.5);
            ball[places[k]] = values[v];
            const size_t count = axis_hits(ball, 1, 0.2, &hit, 1);
            assert_true(count == 0 ||
                        (isfinite(hit.t) && hit.alpha >= 1.0 / 255 && hit.alpha <= 0.99));
            if (isnan(values[v]))
                assert_int_equal(count, 0);
        }
    }
}

static void hits_write_no_more_than_the_capacity(void **state)
{
    (void)state;
    double balls[3 * SGS_PARAM_COUNT];
    for (int i = 0; i < 3; ++i)
        oracle_set_ball(balls + i * SGS_PARAM_COUNT, 0, 0, 4 - i, 0.1, 0.2);
    sgs_hit hits[3] = {{9, 0, 0, 0}, {9, 0, 0, 0}, {9, 0, 0, 0}};
    assert_int_equal(axis_hits(balls, 3, 0.2, hits, 2), 3);
    assert_int_equal(hits[0].primitive, 2);
    assert_int_equal(hits[1].primitive, 1);
    assert_int_equal(hits[2].primitive, 9);
    assert_int_equal(axis_hits(balls, 3, 0.2, NULL, 0), 3);
    assert_int_equal(axis_hits(NULL, 0, 0.2, hits, 3), 0);
    const sgs_camera camera = axis_camera(100);
    const sgs_render_options options = bare();
    assert_int_equal(oracle_hits(balls, 3, &camera, &identity, &options, -1, 2, hits, 3), 0);
    assert_int_equal(oracle_hits(balls, 3, &camera, &identity, &options, 2, 5, hits, 3), 0);
}

static void planes_that_are_not_wanted_may_be_missing(void **state)
{
    (void)state;
    double ball[SGS_PARAM_COUNT], transmittance[25];
    oracle_set_ball(ball, 0, 0, 3, 0.1, 0.7);
    const sgs_camera camera = axis_camera(100);
    const sgs_render_options options = bare();
    sgs_reference_frame frame = {.width = 5, .height = 5, .transmittance = transmittance};
    assert_int_equal(sgs_reference_render(ball, 1, &camera, &identity, &options, &frame),
                     SGS_STATUS_OK);
    assert_true(near_to(transmittance[CENTRE], 0.3));
    assert_int_equal(sgs_reference_render(NULL, 0, &camera, &identity, &options, &frame),
                     SGS_STATUS_OK);
    assert_true(transmittance[CENTRE] == 1);
}

static void bad_arguments_are_refused(void **state)
{
    (void)state;
    double ball[SGS_PARAM_COUNT];
    oracle_set_ball(ball, 0, 0, 3, 0.1, 0.7);
    const sgs_camera camera = axis_camera(100),
                     small = {SGS_CAMERA_PINHOLE, 4, 5, {100, 100, 2, 2}};
    sgs_camera broken = camera;
    broken.params[0] = NAN;
    sgs_render_options options = bare();
    sgs_reference_frame frame;
    assert_int_equal(sgs_reference_frame_create(0, 5, &frame), SGS_STATUS_INVALID_ARGUMENT);
    assert_null(frame.color[0]);
    assert_int_equal(sgs_reference_frame_create(5, 5, NULL), SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_reference_frame_create(5, 5, &frame), SGS_STATUS_OK);
    assert_int_equal(sgs_reference_render(ball, 1, &small, &identity, &options, &frame),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_reference_render(NULL, 1, &camera, &identity, &options, &frame),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_reference_render(ball, 1, &camera, NULL, &options, &frame),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_reference_render(ball, 1, &camera, &identity, NULL, &frame),
                     SGS_STATUS_OK); // the default options
    assert_int_equal(sgs_reference_render(ball, 1, &camera, &identity, &options, NULL),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_int_not_equal(sgs_reference_render(ball, 1, &broken, &identity, &options, &frame),
                         SGS_STATUS_OK);
    options.filter = (sgs_filter)7;
    assert_int_equal(sgs_reference_render(ball, 1, &camera, &identity, &options, &frame),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_true(strlen(sgs_last_error()) > 0);
    sgs_reference_frame_free(&frame);
    sgs_reference_frame_free(&frame); // no effect
    sgs_reference_frame_free(NULL);
}

static void lack_of_memory_is_reported_at_every_allocation(void **state)
{
    (void)state;
    double ball[SGS_PARAM_COUNT];
    oracle_set_ball(ball, 0, 0, 3, 0.1, 0.7);
    const sgs_camera camera = axis_camera(100);
    const sgs_render_options options = bare();
    size_t n = 1;
    for (;; ++n) {
        sgs_reference_frame frame;
        sgsi_fail_allocation(n);
        sgs_status status = sgs_reference_frame_create(5, 5, &frame);
        if (status == SGS_STATUS_OK)
            status = sgs_reference_render(ball, 1, &camera, &identity, &options, &frame);
        sgsi_fail_allocation(0);
        sgs_reference_frame_free(&frame);
        if (status == SGS_STATUS_OK)
            break;
        assert_int_equal(status, SGS_STATUS_OUT_OF_MEMORY);
    }
    assert_true(n > 9);
    for (n = 1; n <= 2; ++n) {
        sgs_hit hit;
        size_t count = 7;
        sgsi_fail_allocation(n);
        assert_int_equal(
            sgs_reference_hits(ball, 1, &camera, &identity, &options, 2, 2, &hit, 1, &count),
            SGS_STATUS_OUT_OF_MEMORY);
        sgsi_fail_allocation(0);
        assert_int_equal(count, 0);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_ball_on_the_axis),
        cmocka_unit_test(turned_ellipsoid),
        cmocka_unit_test(filters_widen_a_ball_as_their_papers_say),
        cmocka_unit_test(depth_of_the_filter_depends_on_the_lens),
        cmocka_unit_test(two_balls_blend),
        cmocka_unit_test(spherical_harmonics_have_the_signs_of_3dgs),
        cmocka_unit_test(stack_stops_before_the_hit_below_1e_4),
        cmocka_unit_test(hits_below_1_of_255_do_not_exist),
        cmocka_unit_test(near_distance_is_open_and_is_measured_at_the_hit),
        cmocka_unit_test(hits_behind_the_camera_do_not_count),
        cmocka_unit_test(camera_at_a_mean),
        cmocka_unit_test(equal_depths_are_ordered_by_id),
        cmocka_unit_test(pixels_without_a_ray_stay_empty),
        cmocka_unit_test(white_in_front_of_white_is_white),
        cmocka_unit_test(permuting_primitives_changes_nothing),
        cmocka_unit_test(moving_world_and_camera_changes_nothing),
        cmocka_unit_test(zero_quaternion_is_the_identity),
        cmocka_unit_test(bits_do_not_depend_on_threads),
        cmocka_unit_test(hard_scenes_keep_the_rules),
        cmocka_unit_test(duplicates_have_equal_depths),
        cmocka_unit_test(scenes_are_the_same_in_float_and_double),
        cmocka_unit_test(degenerate_primitives_are_never_hit),
        cmocka_unit_test(hits_write_no_more_than_the_capacity),
        cmocka_unit_test(planes_that_are_not_wanted_may_be_missing),
        cmocka_unit_test(bad_arguments_are_refused),
        cmocka_unit_test(lack_of_memory_is_reported_at_every_allocation),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
