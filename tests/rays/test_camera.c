// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Cameras: each COLMAP model against an independent implementation of its formulas, the inversion
// over whole images, the limit of the domain where distortion folds, resizing, and poses.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include <math.h>

#include "support/bad_input.h"
#include "base/core.h"
#include "sparegs/camera.h"

#define PI 3.14159265358979323846

// Real lenses and some extreme ones; every pixel of their images has a ray.
static const sgs_camera lenses[] = {
    {SGS_CAMERA_SIMPLE_PINHOLE, 640, 480, {500, 320, 240}},
    {SGS_CAMERA_PINHOLE, 640, 480, {500, 510, 300, 250}},
    {SGS_CAMERA_SIMPLE_RADIAL, 3008, 2000, {2600, 1504, 1000, 0.0101}},
    {SGS_CAMERA_SIMPLE_RADIAL, 640, 480, {400, 320, 240, -0.14}},
    {SGS_CAMERA_SIMPLE_RADIAL, 640, 480, {400, 320, 240, 0.9}},
    {SGS_CAMERA_RADIAL, 640, 480, {400, 330, 235, -0.31, 0.12}},
    {SGS_CAMERA_OPENCV,
     1920,
     1080,
     {903.3, 904.1, 959.6, 544.1, -6.95e-4, -2.2e-3, -1.8e-4, -1.6e-4}},
    {SGS_CAMERA_OPENCV,
     640,
     480,
     {458.654, 457.296, 367.215, 248.375, -0.28340811, 0.07395907, 1.9359e-4, 1.76e-5}},
    {SGS_CAMERA_OPENCV, 640, 480, {500, 500, 320, 240, -0.1, 0.05, 0.02, -0.03}},
    {SGS_CAMERA_OPENCV_FISHEYE, 800, 450, {545, 546.09, 398.3, 227.3, -0.02, 0.01, -0.003, 0.0004}},
    {SGS_CAMERA_OPENCV_FISHEYE, 1024, 1024, {300, 300, 512, 512, 0.02, -0.004, 0.001, 0}},
    {SGS_CAMERA_FULL_OPENCV,
     1280,
     720,
     {610, 610, 640, 360, 0.6, -2.5, 8e-4, -4e-4, 1.4, 0.5, -2.3, 1.35}},
    {SGS_CAMERA_FULL_OPENCV,
     640,
     480,
     {500, 500, 320, 240, -0.1, 0.01, 1e-3, 2e-3, 0.001, 0.02, 0.01, 0.002}},
    {SGS_CAMERA_FOV, 752, 480, {350, 352, 370, 245, 0.92}},
    {SGS_CAMERA_FOV, 752, 480, {350, 352, 370, 245, 1e-3}},
    {SGS_CAMERA_FOV, 752, 480, {350, 352, 370, 245, 0}},
    {SGS_CAMERA_SIMPLE_RADIAL_FISHEYE, 1000, 1000, {260, 500, 500, -0.01}},
    {SGS_CAMERA_RADIAL_FISHEYE, 1000, 800, {400, 510, 390, -0.05, 0.01}},
    {SGS_CAMERA_THIN_PRISM_FISHEYE,
     1000,
     700,
     {450, 452, 500, 350, 0.03, -0.02, 2e-3, -1e-3, 0.01, -0.001, 3e-3, -2e-3}},
};
enum { LENSES = sizeof lenses / sizeof *lenses };

static double radial(double r2, const double *k, int count)
{
    double sum = 1, power = 1;
    for (int i = 0; i < count; ++i)
        sum += k[i] * (power *= r2);
    return sum;
}

// The formulas of the COLMAP documentation, model by model, for points in front of the camera.
static void expected_projection(const sgs_camera *camera, const double p[3], double pixel[2])
{
    const double *q = camera->params;
    const double u = p[0] / p[2], v = p[1] / p[2], r2 = u * u + v * v, r = sqrt(r2),
                 theta = atan(r);
    const double bend = r > 0 ? theta / r : 1, t2 = theta * theta, a = u * bend, b = v * bend,
                 s = a * a + b * b;
    double f = 1, x = u, y = v;
    int two = 1;
    switch (camera->model) {
    case SGS_CAMERA_SIMPLE_PINHOLE:
        two = 0;
        break;
    case SGS_CAMERA_SIMPLE_RADIAL:
        two = 0;
        f = 1 + q[3] * r2;
        break;
    case SGS_CAMERA_RADIAL:
        two = 0;
        f = radial(r2, q + 3, 2);
        break;
    case SGS_CAMERA_OPENCV:
        f = radial(r2, q + 4, 2);
        break;
    case SGS_CAMERA_FULL_OPENCV:
        f = (1 + q[4] * r2 + q[5] * r2 * r2 + q[8] * pow(r2, 3)) / radial(r2, q + 9, 3);
        break;
    case SGS_CAMERA_OPENCV_FISHEYE:
        f = bend * radial(t2, q + 4, 4);
        break;
    case SGS_CAMERA_SIMPLE_RADIAL_FISHEYE:
        two = 0;
        f = bend * radial(t2, q + 3, 1);
        break;
    case SGS_CAMERA_RADIAL_FISHEYE:
        two = 0;
        f = bend * radial(t2, q + 3, 2);
        break;
    case SGS_CAMERA_FOV:
        f = q[4] != 0 && r > 0 ? atan(r * 2 * tan(q[4] / 2)) / (r * q[4]) : 1;
        break;
    default:
        break;
    }
    x *= f;
    y *= f;
    if (camera->model == SGS_CAMERA_OPENCV || camera->model == SGS_CAMERA_FULL_OPENCV) {
        x += 2 * q[6] * u * v + q[7] * (r2 + 2 * u * u);
        y += 2 * q[7] * u * v + q[6] * (r2 + 2 * v * v);
    } else if (camera->model == SGS_CAMERA_THIN_PRISM_FISHEYE) {
        const double k[4] = {q[4], q[5], q[8], q[9]};
        x = a * radial(s, k, 4) + 2 * q[6] * a * b + q[7] * (s + 2 * a * a) + q[10] * s;
        y = b * radial(s, k, 4) + 2 * q[7] * a * b + q[6] * (s + 2 * b * b) + q[11] * s;
    }
    pixel[0] = q[0] * x + q[1 + two];
    pixel[1] = q[two] * y + q[2 + two];
}

static void projection_equals_colmaps_formulas(void **state)
{
    (void)state;
    for (size_t i = 0; i < LENSES; ++i) {
        size_t projected = 0;
        for (uint64_t k = 0; k < 500; ++k) {
            const double depth = 0.1 + 5 * sgsi_random_uniform(1, 3 * k);
            const double point[3] = {depth * (1.2 * sgsi_random_uniform(1, 3 * k + 1) - 0.6),
                                     depth * (1.2 * sgsi_random_uniform(1, 3 * k + 2) - 0.6),
                                     depth};
            double pixel[2], expected[2];
            if (!sgs_camera_project(&lenses[i], point, pixel))
                continue;
            ++projected;
            expected_projection(&lenses[i], point, expected);
            if (!(hypot(pixel[0] - expected[0], pixel[1] - expected[1]) <= 1e-9))
                fail_msg("lens %zu (%s): (%.12g, %.12g) instead of (%.12g, %.12g)", i,
                         sgs_camera_model_name(lenses[i].model), pixel[0], pixel[1], expected[0],
                         expected[1]);
        }
        assert_true(projected >= 490);
    }
}

static void axis_projects_to_the_principal_point(void **state)
{
    (void)state;
    for (size_t i = 0; i < LENSES; ++i) {
        const double point[3] = {0, 0, 3};
        double pixel[2], direction[3], fx, fy, cx, cy;
        sgs_camera_intrinsics(&lenses[i], &fx, &fy, &cx, &cy);
        assert_true(sgs_camera_project(&lenses[i], point, pixel));
        assert_true(pixel[0] == cx && pixel[1] == cy);
        assert_true(sgs_camera_unproject(&lenses[i], pixel, direction));
        assert_true(direction[0] == 0 && direction[1] == 0 && direction[2] == 1);
    }
}

static void every_pixel_round_trips(void **state)
{
    (void)state;
    double worst = 0;
    for (size_t i = 0; i < LENSES; ++i) {
        for (int y = 0; y <= 60; ++y) {
            for (int x = 0; x <= 80; ++x) {
                const double pixel[2] = {lenses[i].width * x / 80.0, lenses[i].height * y / 60.0};
                double direction[3], back[2];
                if (!sgs_camera_unproject(&lenses[i], pixel, direction))
                    fail_msg("lens %zu: pixel (%g, %g) has no ray", i, pixel[0], pixel[1]);
                assert_true(fabs(sqrt(direction[0] * direction[0] + direction[1] * direction[1] +
                                      direction[2] * direction[2]) -
                                 1) < 1e-15 * 4);
                assert_true(sgs_camera_project(&lenses[i], direction, back));
                const double error = hypot(back[0] - pixel[0], back[1] - pixel[1]);
                if (!(error <= 1e-8))
                    fail_msg("lens %zu: pixel (%g, %g) comes back %g px away", i, pixel[0],
                             pixel[1], error);
                worst = fmax(worst, error);
            }
        }
    }
    print_message("worst round trip: %.3g px\n", worst);
}

// Injectivity: every point that projects unprojects to the same direction.
static void every_projected_direction_round_trips(void **state)
{
    (void)state;
    sgs_camera worse[] = {
        {SGS_CAMERA_SIMPLE_RADIAL, 640, 480, {400, 320, 240, -0.4}},
        {SGS_CAMERA_RADIAL, 640, 480, {400, 320, 240, -0.9, 0.25}}, // folds twice
        {SGS_CAMERA_OPENCV, 640, 480, {400, 400, 320, 240, -0.5, 0.1, 0.05, -0.08}},
        {SGS_CAMERA_OPENCV, 640, 480, {400, 400, 320, 240, 0, 0, 0.2, 0.1}},
        {SGS_CAMERA_FULL_OPENCV,
         640,
         480,
         {400, 400, 320, 240, 0.1, 0, 0.01, 0.01, 0, -0.3, 0, 0}}, // a pole
        {SGS_CAMERA_OPENCV_FISHEYE, 640, 480, {200, 200, 320, 240, -0.3, 0.2, -0.1, 0.02}},
        {SGS_CAMERA_THIN_PRISM_FISHEYE,
         640,
         480,
         {200, 200, 320, 240, -0.2, 0.02, 0.02, 0.01, 0, 0, 0.04, -0.03}},
    };
    for (size_t i = 0; i < sizeof worse / sizeof *worse; ++i) {
        size_t projected = 0;
        for (uint64_t k = 0; k < 20000; ++k) {
            const double z = 2 * sgsi_random_uniform(2, 2 * k) - 1,
                         angle = 2 * PI * sgsi_random_uniform(2, 2 * k + 1);
            const double d[3] = {sqrt(1 - z * z) * cos(angle), sqrt(1 - z * z) * sin(angle), z};
            double pixel[2], back[3];
            if (!sgs_camera_project(&worse[i], d, pixel))
                continue;
            ++projected;
            if (!sgs_camera_unproject(&worse[i], pixel, back))
                fail_msg("lens %zu: direction (%g, %g, %g) has a pixel without a ray", i, d[0],
                         d[1], d[2]);
            const double error = hypot(hypot(back[0] - d[0], back[1] - d[1]), back[2] - d[2]);
            // Near the fold, the inverse has infinite slope, like a square root at 0.
            if (!(error <= 1e-5))
                fail_msg("lens %zu: direction (%g, %g, %g) comes back %g away", i, d[0], d[1], d[2],
                         error);
        }
        assert_true(projected > 300);
    }
}

// Newton's method jumps between two points near this radius of a lens.
static void inversion_ends_where_newton_steps_do_not(void **state)
{
    (void)state;
    const sgs_camera camera = {
        SGS_CAMERA_RADIAL, 640, 480, {277.6, 320, 240, 0.67572117187811886, -0.35977268606937929}};
    for (int i = 0; i < 3000; ++i) {
        const double r = 0.909653 + 1e-9 * i, point[3] = {r, 0, 1};
        double pixel[2], direction[3];
        assert_true(sgs_camera_project(&camera, point, pixel));
        assert_true(sgs_camera_unproject(&camera, pixel, direction));
        if (!(fabs(direction[0] / direction[2] - r) < 1e-9))
            fail_msg("radius %.17g comes back as %.17g", r, direction[0] / direction[2]);
    }
}

static void barrel_distortion_is_rejected_beyond_its_fold(void **state)
{
    (void)state;
    const sgs_camera camera = {SGS_CAMERA_SIMPLE_RADIAL, 640, 480, {400, 320, 240, -0.3}};
    const double fold = sqrt(1 / 0.9), reach = 400 * fold * 2 / 3; // r (1 - 0.3 r^2) at its maximum
    double pixel[2], direction[3];
    for (double r = 0.05; r < 40; r *= 1.03) {
        const double point[3] = {r * 0.6, -r * 0.8, 1};
        assert_int_equal(sgs_camera_project(&camera, point, pixel), r < fold);
    }
    const double inside[2] = {320 + 0.9999 * reach, 240}, outside[2] = {320, 240 - 1.0001 * reach};
    assert_true(sgs_camera_unproject(&camera, inside, direction));
    assert_true(direction[0] / direction[2] < fold);
    assert_false(sgs_camera_unproject(&camera, outside, direction));
}

static void second_monotonic_branch_of_a_polynomial_is_rejected(void **state)
{
    (void)state;
    // 1 - 2.7 s + 1.25 s^2 has roots s = 0.475 and 1.685: beyond the second one the radius grows
    // again.
    const sgs_camera camera = {SGS_CAMERA_RADIAL, 640, 480, {400, 320, 240, -0.9, 0.25}};
    const double before[3] = {0.68, 0, 1}, between[3] = {1, 0, 1}, beyond[3] = {0, 2, 1};
    double pixel[2];
    assert_true(sgs_camera_project(&camera, before, pixel));
    assert_false(sgs_camera_project(&camera, between, pixel));
    assert_false(sgs_camera_project(&camera, beyond, pixel));
}

static void pole_of_the_rational_model_is_rejected(void **state)
{
    (void)state;
    const sgs_camera camera = {
        SGS_CAMERA_FULL_OPENCV, 640, 480, {400, 400, 320, 240, 0, 0, 0, 0, 0, -0.25, 0, 0}};
    const double before[3] = {1.9, 0, 1}, beyond[3] = {2.1, 0, 1};
    double pixel[2];
    assert_true(sgs_camera_project(&camera, before, pixel));
    assert_false(sgs_camera_project(&camera, beyond, pixel));
}

static void perspective_cameras_see_nothing_behind_them(void **state)
{
    (void)state;
    for (size_t i = 0; i < LENSES; ++i) {
        const double behind[3] = {0.1, 0.2, -1}, beside[3] = {1, 0, 0}, origin[3] = {0, 0, 0};
        double pixel[2];
        if (!sgs_camera_is_fisheye(lenses[i].model)) {
            assert_false(sgs_camera_project(&lenses[i], behind, pixel));
            assert_false(sgs_camera_project(&lenses[i], beside, pixel));
        }
        assert_false(sgs_camera_project(&lenses[i], origin, pixel));
    }
}

static void fisheye_cameras_see_beyond_ninety_degrees(void **state)
{
    (void)state;
    const sgs_camera camera = {
        SGS_CAMERA_OPENCV_FISHEYE, 2000, 2000, {300, 300, 1000, 1000, 0, 0, 0, 0}};
    for (int degrees = 1; degrees < 180; ++degrees) {
        const double theta = degrees * PI / 180;
        const double d[3] = {0.6 * sin(theta), 0.8 * sin(theta), cos(theta)};
        double pixel[2], back[3];
        assert_true(sgs_camera_project(&camera, d, pixel));
        assert_true(fabs(hypot(pixel[0] - 1000, pixel[1] - 1000) - 300 * theta) < 1e-9);
        assert_true(sgs_camera_unproject(&camera, pixel, back));
        assert_true(hypot(hypot(back[0] - d[0], back[1] - d[1]), back[2] - d[2]) < 1e-12);
    }
    const double straight_back[3] = {0, 0, -1}, too_far[2] = {1000, 1000 + 300 * 3.1416};
    double pixel[2], direction[3];
    assert_false(sgs_camera_project(&camera, straight_back, pixel));
    assert_false(sgs_camera_unproject(&camera, too_far, direction));
}

static void fov_model_ends_where_its_arc_tangent_does(void **state)
{
    (void)state;
    const sgs_camera camera = {SGS_CAMERA_FOV, 640, 480, {100, 100, 320, 240, 1.0}};
    const double inside[2] = {320 + 100 * 1.5707, 240}, outside[2] = {320 + 100 * 1.5708, 240};
    double direction[3];
    assert_true(sgs_camera_unproject(&camera, inside, direction));
    assert_false(sgs_camera_unproject(&camera, outside, direction));
}

static void fov_model_tends_to_the_pinhole(void **state)
{
    (void)state;
    const double point[3] = {0.5, 0.3, 1}, r2 = 0.34;
    for (double omega = 1e-2; omega > 1e-12; omega *= 0.1) {
        const sgs_camera camera = {SGS_CAMERA_FOV, 640, 480, {400, 400, 320, 240, omega}};
        const double factor = 1 + omega * omega * (1.0 / 12 - r2 / 3); // of the expansion in omega
        double pixel[2];
        assert_true(sgs_camera_project(&camera, point, pixel));
        assert_true(fabs(pixel[0] - (320 + 400 * 0.5 * factor)) < 1e-12 + 200 * pow(omega, 4));
    }
}

static void nonfinite_points_and_pixels_are_rejected(void **state)
{
    (void)state;
    const double bad[] = {NAN, INFINITY, -INFINITY};
    for (size_t i = 0; i < LENSES; ++i) {
        for (int k = 0; k < 3; ++k) {
            const double point[3] = {bad[k], 0.1, 1}, deep[3] = {0.1, 0.1, bad[k]},
                         where[2] = {10, bad[k]};
            double pixel[2], direction[3];
            assert_false(sgs_camera_project(&lenses[i], point, pixel));
            assert_false(sgs_camera_project(&lenses[i], deep, pixel));
            assert_false(sgs_camera_unproject(&lenses[i], where, direction));
        }
    }
    const sgs_camera panorama = sgs_camera_equirectangular(64, 32);
    for (int k = 0; k < 3; ++k)
        for (int axis = 0; axis < 3; ++axis) {
            double point[3] = {0, 0, 1}, where[2] = {10, 10}, pixel[2], direction[3];
            point[axis] = bad[k];
            assert_false(sgs_camera_project(&panorama, point, pixel));
            where[axis % 2] = bad[k];
            assert_false(sgs_camera_unproject(&panorama, where, direction));
        }
}

static void panoramas_end_at_their_poles(void **state)
{
    (void)state;
    sgs_camera camera = sgs_camera_equirectangular(4000, 2000);
    double direction[3];
    const double edges[2][2] = {{7.5, 0}, {3999, 2000}};
    for (int k = 0; k < 2; ++k) {
        assert_true(sgs_camera_unproject(&camera, edges[k], direction));
        assert_true(fabs(direction[1] - (k ? 1 : -1)) < 1e-12);
    }
    const double above[2] = {7.5, -0.001}, below[2] = {7.5, 2000.001}, far_below[2] = {7.5, 1e9};
    assert_false(sgs_camera_unproject(&camera, above, direction));
    assert_false(sgs_camera_unproject(&camera, below, direction));
    assert_false(sgs_camera_unproject(&camera, far_below, direction));
    camera = sgs_camera_shifted(&camera, 0, 300); // the sphere is in rows 300 to 2300
    const double out[2] = {7.5, 299.9}, in[2] = {7.5, 300.1};
    assert_false(sgs_camera_unproject(&camera, out, direction));
    assert_true(sgs_camera_unproject(&camera, in, direction));
}

static void extreme_coefficients_neither_hang_nor_crash(void **state)
{
    (void)state;
    const double values[] = {1e300, -1e300, 1e30, -1e30, 1e-300, 0, 5, -5};
    for (uint64_t trial = 0; trial < 3000; ++trial) {
        sgs_camera camera = {
            .model = (sgs_camera_model)(trial % SGS_CAMERA_MODEL_COUNT), .width = 64, .height = 48};
        for (int k = 0; k < sgs_camera_param_count(camera.model); ++k)
            camera.params[k] = values[sgsi_random_bits(trial, (uint64_t)k) % 8];
        camera.params[0] = camera.params[1] = 50;
        const double pixel[2] = {60, 3}, point[3] = {0.5, -0.4, 1};
        double direction[3], at[2];
        if (sgs_camera_unproject(&camera, pixel, direction))
            assert_true(isfinite(direction[0]) && isfinite(direction[1]) && isfinite(direction[2]));
        if (sgs_camera_project(&camera, point, at))
            assert_true(isfinite(at[0]) && isfinite(at[1]));
    }
}

static void alternating_cameras_are_independent(void **state)
{
    (void)state;
    double first[LENSES][2], again[2];
    const double point[3] = {0.3, -0.2, 1.5};
    for (size_t i = 0; i < LENSES; ++i)
        assert_true(sgs_camera_project(&lenses[i], point, first[i]));
    for (size_t i = LENSES; i-- > 0;) {
        assert_true(sgs_camera_project(&lenses[i], point, again));
        assert_memory_equal(first[i], again, sizeof again);
    }
}

static void resized_cameras_scale_their_pixels(void **state)
{
    (void)state;
    static const int sizes[][2] = {{2, 2}, {1, 2}, {3, 1}};
    for (size_t i = 0; i < LENSES; ++i) {
        for (size_t k = 0; k < 3; ++k) {
            const int width = lenses[i].width * sizes[k][0] / 2,
                      height = lenses[i].height * sizes[k][1] / 2;
            const sgs_camera camera = sgs_camera_resized(&lenses[i], width, height);
            const double point[3] = {0.31, -0.22, 1.1};
            double before[2], after[2];
            assert_int_equal(sgs_camera_validate(&camera), SGS_STATUS_OK);
            assert_true(camera.width == width && camera.height == height);
            assert_true(sgs_camera_project(&lenses[i], point, before));
            assert_true(sgs_camera_project(&camera, point, after));
            assert_true(fabs(after[0] - before[0] * sizes[k][0] / 2) < 1e-9);
            assert_true(fabs(after[1] - before[1] * sizes[k][1] / 2) < 1e-9);
        }
    }
}

static void shifted_cameras_move_their_image(void **state)
{
    (void)state;
    for (size_t i = 0; i < LENSES; ++i) {
        const sgs_camera camera = sgs_camera_shifted(&lenses[i], 3.25, -7.5);
        const double point[3] = {0.31, -0.22, 1.1};
        double before[2], after[2];
        assert_true(camera.width == lenses[i].width && camera.height == lenses[i].height);
        assert_true(sgs_camera_project(&lenses[i], point, before));
        assert_true(sgs_camera_project(&camera, point, after));
        assert_true(fabs(after[0] - before[0] - 3.25) < 1e-9);
        assert_true(fabs(after[1] - before[1] + 7.5) < 1e-9);
        const sgs_camera undone = sgs_camera_shifted(&camera, -3.25, 7.5);
        assert_true(sgs_camera_equal(&undone, &lenses[i]) && !sgs_camera_equal(&camera, &undone));
    }
}

static void resizing_keeps_one_focal_models_only_under_equal_scales(void **state)
{
    (void)state;
    const sgs_camera camera = {SGS_CAMERA_RADIAL, 640, 480, {400, 320, 240, -0.1, 0.02}};
    assert_int_equal(sgs_camera_resized(&camera, 320, 240).model, SGS_CAMERA_RADIAL);
    const sgs_camera other = sgs_camera_resized(&camera, 320, 480);
    assert_int_equal(other.model, SGS_CAMERA_OPENCV);
    const double expected[12] = {200, 400, 160, 240, -0.1, 0.02};
    assert_memory_equal(other.params, expected, sizeof expected);
}

static void invalid_cameras_are_rejected_with_the_reason(void **state)
{
    (void)state;
    static const struct {
        sgs_camera camera;
        const char *message;
    } cases[] = {
        {{(sgs_camera_model)11, 64, 48, {1, 1, 1}}, "unknown camera model 11"},
        {{(sgs_camera_model)-1, 64, 48, {1, 1, 1}}, "unknown camera model -1"},
        {{SGS_CAMERA_PINHOLE, 0, 48, {1, 1, 1, 1}}, "camera size 0 x 48"},
        {{SGS_CAMERA_PINHOLE, 64, -1, {1, 1, 1, 1}}, "camera size 64 x -1"},
        {{SGS_CAMERA_PINHOLE, 65537, 1, {1, 1, 1, 1}}, "camera size 65537 x 1"},
        {{SGS_CAMERA_PINHOLE, 64, 48, {1, 0, 1, 1}}, "focal length 0 of the PINHOLE"},
        {{SGS_CAMERA_SIMPLE_RADIAL, 64, 48, {-3, 0, 1, 1}}, "focal length -3 of the SIMPLE_RADIAL"},
        {{SGS_CAMERA_OPENCV, 64, 48, {1, 1, 1, 1, 0, NAN}},
         "parameter 6 of the OPENCV camera is not finite"},
        {{SGS_CAMERA_SIMPLE_PINHOLE, 64, 48, {INFINITY, 1, 1}},
         "parameter 1 of the SIMPLE_PINHOLE"},
        {{SGS_CAMERA_FOV, 64, 48, {1, 1, 1, 1, 3.2}}, "field-of-view parameter 3.2"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        assert_int_equal(sgs_camera_validate(&cases[i].camera), SGS_STATUS_INVALID_ARGUMENT);
        if (!strstr(sgs_last_error(), cases[i].message))
            fail_msg("'%s' does not contain '%s'", sgs_last_error(), cases[i].message);
        bad_input();
    }
    for (size_t i = 0; i < LENSES; ++i)
        assert_int_equal(sgs_camera_validate(&lenses[i]), SGS_STATUS_OK);
}

static void model_names_and_ids_match_colmaps(void **state)
{
    (void)state;
    static const struct {
        const char *name;
        int params, fisheye;
    } models[] = {{"SIMPLE_PINHOLE", 3, 0},
                  {"PINHOLE", 4, 0},
                  {"SIMPLE_RADIAL", 4, 0},
                  {"RADIAL", 5, 0},
                  {"OPENCV", 8, 0},
                  {"OPENCV_FISHEYE", 8, 1},
                  {"FULL_OPENCV", 12, 0},
                  {"FOV", 5, 0},
                  {"SIMPLE_RADIAL_FISHEYE", 4, 1},
                  {"RADIAL_FISHEYE", 5, 1},
                  {"THIN_PRISM_FISHEYE", 12, 1}};
    sgs_camera_model model;
    for (int i = 0; i < SGS_CAMERA_MODEL_COUNT; ++i) {
        assert_string_equal(sgs_camera_model_name((sgs_camera_model)i), models[i].name);
        assert_int_equal(sgs_camera_param_count((sgs_camera_model)i), models[i].params);
        assert_int_equal(sgs_camera_is_fisheye((sgs_camera_model)i), models[i].fisheye);
        assert_true(sgs_camera_model_from_name(models[i].name, &model));
        assert_int_equal(model, i);
    }
    assert_false(sgs_camera_model_from_name("opencv", &model));
    assert_null(sgs_camera_model_name((sgs_camera_model)11));
    assert_int_equal(sgs_camera_param_count((sgs_camera_model)-1), 0);
}

static void quaternions_of_any_norm_round_trip(void **state)
{
    (void)state;
    static const double norms[] = {1, 1e-200, 1e200, 3, -1};
    const double t[3] = {1, 2, 3};
    for (uint64_t k = 0; k < 1000; ++k) {
        double q[4], scaled[4], back[4], norm = 0;
        sgs_pose pose;
        for (uint64_t i = 0; i < 4; ++i) {
            q[i] = k < 4 ? k == i : sgsi_random_normal(3, 4 * k + i);
            norm += q[i] * q[i];
        }
        const double sign = q[0] < 0 ? -1 : 1;
        for (int i = 0; i < 4; ++i)
            scaled[i] = q[i] / sqrt(norm) * norms[k % 5];
        assert_int_equal(sgs_pose_from_quaternion(scaled, t, &pose), SGS_STATUS_OK);
        sgs_pose_quaternion(&pose, back);
        for (int i = 0; i < 4; ++i)
            assert_true(fabs(back[i] - sign * q[i] / sqrt(norm)) < 1e-14);
        assert_true(back[0] >= 0);
    }
}

static void quaternion_convention_is_colmaps(void **state)
{
    (void)state;
    const double h = sqrt(0.5), q[4] = {h, 0, 0, h}, t[3] = {10, 20, 30}; // 90 degrees about z
    const double expected[9] = {0, -1, 0, 1, 0, 0, 0, 0, 1};
    sgs_pose pose;
    double center[3];
    assert_int_equal(sgs_pose_from_quaternion(q, t, &pose), SGS_STATUS_OK);
    for (int i = 0; i < 9; ++i)
        assert_true(fabs(pose.rotation[i] - expected[i]) < 1e-15);
    sgs_pose_center(&pose, center);
    assert_true(fabs(center[0] + 20) < 1e-13 && fabs(center[1] - 10) < 1e-13 &&
                fabs(center[2] + 30) < 1e-13);
}

static void invalid_poses_are_rejected(void **state)
{
    (void)state;
    const double fine[4] = {1, 0, 0, 0}, zero[4] = {0, 0, 0, 0}, nan_q[4] = {1, NAN, 0, 0},
                 inf_q[4] = {INFINITY, 0, 0, 0};
    const double t[3] = {0, 0, 0}, nan_t[3] = {0, NAN, 0}, inf_t[3] = {0, 0, -INFINITY};
    sgs_pose pose;
    assert_int_equal(sgs_pose_from_quaternion(zero, t, &pose), SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "norm 0"));
    assert_int_equal(sgs_pose_from_quaternion(nan_q, t, &pose), SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "quaternion is not finite"));
    assert_int_equal(sgs_pose_from_quaternion(inf_q, t, &pose), SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_pose_from_quaternion(fine, nan_t, &pose), SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "translation is not finite"));
    assert_int_equal(sgs_pose_from_quaternion(fine, inf_t, &pose), SGS_STATUS_INVALID_ARGUMENT);
}

static void poses_must_be_rotations_within_range(void **state)
{
    (void)state;
    const sgs_pose fine = {{0, -1, 0, 1, 0, 0, 0, 0, 1}, {10, 20, 30}};
    static const struct {
        int entry; // of the rotation, or 9 + that of the translation
        double value;
        const char *message;
    } cases[] = {
        {8, 2, "not orthonormal"},
        {8, 0, "not orthonormal"},
        {2, NAN, "not orthonormal"},
        {0, 2e-3, "not orthonormal"},
        {8, -1, "mirrored"},
        {10, NAN, "translation is not finite"},
        {11, INFINITY, "translation is not"},
        {9, 1e15, "position is out of range"},
    };
    assert_int_equal(sgs_pose_validate(&fine), SGS_STATUS_OK);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        sgs_pose pose = fine;
        *(cases[i].entry < 9 ? &pose.rotation[cases[i].entry]
                             : &pose.translation[cases[i].entry - 9]) = cases[i].value;
        assert_int_equal(sgs_pose_validate(&pose), SGS_STATUS_INVALID_ARGUMENT);
        if (!strstr(sgs_last_error(), cases[i].message))
            fail_msg("'%s' does not contain '%s'", sgs_last_error(), cases[i].message);
    }
    sgs_pose rounded = fine;
    rounded.rotation[0] = 4e-4; // of a file with few digits
    assert_int_equal(sgs_pose_validate(&rounded), SGS_STATUS_OK);
    bad_input();
}

// A rotation with few digits: the nearest one is R times a symmetric matrix, the camera stays, and
// an exact rotation keeps its bits.
static void rotations_with_few_digits_become_exact(void **state)
{
    (void)state;
    for (uint64_t i = 0; i < 200; ++i) {
        double q[4];
        const double zero[3] = {0};
        for (uint64_t k = 0; k < 4; ++k)
            q[k] = sgsi_random_normal(i, k);
        sgs_pose exact, pose;
        assert_int_equal(sgs_pose_from_quaternion(q, zero, &exact), SGS_STATUS_OK);
        pose = exact;
        sgs_pose_orthonormalize(&pose);
        assert_memory_equal(&pose, &exact, sizeof pose);
        const double digits = i % 2 ? 1e3 : 1e6,
                     center[3] = {5e6 * sgsi_random_normal(i, 5), -12.5, 4e5};
        double *r = pose.rotation;
        for (int k = 0; k < 9; ++k)
            r[k] = round(r[k] * digits) / digits;
        const sgs_pose given = pose;
        for (int k = 0; k < 3; ++k)
            pose.translation[k] =
                -(r[3 * k] * center[0] + r[3 * k + 1] * center[1] + r[3 * k + 2] * center[2]);
        sgs_pose_orthonormalize(&pose);
        double found[3];
        sgs_pose_center(&pose, found);
        for (int k = 0; k < 3; ++k)
            assert_true(fabs(found[k] - center[k]) <= 1e-7);
        for (int a = 0; a < 3; ++a)
            for (int b = 0; b < 3; ++b) {
                double unit = 0, product = 0, transposed = 0;
                for (int k = 0; k < 3; ++k) {
                    unit += r[3 * a + k] * r[3 * b + k];
                    product += r[3 * k + a] * given.rotation[3 * k + b];
                    transposed += r[3 * k + b] * given.rotation[3 * k + a];
                }
                assert_true(fabs(unit - (a == b)) <= 1e-14);
                assert_true(fabs(product - transposed) <= 1e-14);
                assert_true(fabs(r[3 * a + b] - exact.rotation[3 * a + b]) <= 1 / digits);
            }
    }
}

// The image of a direction is scaled equally on both axes; the central column stays central.
static void reframing_keeps_the_pixel_aspect(void **state)
{
    (void)state;
    for (size_t model = 0; model < LENSES; ++model) {
        const sgs_camera camera = lenses[model];
        const int width = camera.width / 3, height = 2 * camera.height;
        const sgs_camera other = sgs_camera_reframed(&camera, width, height);
        assert_true(other.model == camera.model && other.width == width && other.height == height);
        const double points[][3] = {{0.05, 0.1, 1}, {-0.08, 0.02, 1}, {0, 0, 1}};
        for (size_t k = 0; k < sizeof points / sizeof *points; ++k) {
            double a[2], b[2];
            assert_true(sgs_camera_project(&camera, points[k], a));
            assert_true(sgs_camera_project(&other, points[k], b));
            assert_true(fabs(b[0] - 0.5 * width - 2 * (a[0] - 0.5 * camera.width)) < 1e-9);
            assert_true(fabs(b[1] - 2 * a[1]) < 1e-9);
        }
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(projection_equals_colmaps_formulas),
        cmocka_unit_test(axis_projects_to_the_principal_point),
        cmocka_unit_test(every_pixel_round_trips),
        cmocka_unit_test(rotations_with_few_digits_become_exact),
        cmocka_unit_test(reframing_keeps_the_pixel_aspect),
        cmocka_unit_test(every_projected_direction_round_trips),
        cmocka_unit_test(inversion_ends_where_newton_steps_do_not),
        cmocka_unit_test(barrel_distortion_is_rejected_beyond_its_fold),
        cmocka_unit_test(second_monotonic_branch_of_a_polynomial_is_rejected),
        cmocka_unit_test(pole_of_the_rational_model_is_rejected),
        cmocka_unit_test(perspective_cameras_see_nothing_behind_them),
        cmocka_unit_test(fisheye_cameras_see_beyond_ninety_degrees),
        cmocka_unit_test(fov_model_ends_where_its_arc_tangent_does),
        cmocka_unit_test(fov_model_tends_to_the_pinhole),
        cmocka_unit_test(nonfinite_points_and_pixels_are_rejected),
        cmocka_unit_test(panoramas_end_at_their_poles),
        cmocka_unit_test(extreme_coefficients_neither_hang_nor_crash),
        cmocka_unit_test(alternating_cameras_are_independent),
        cmocka_unit_test(resized_cameras_scale_their_pixels),
        cmocka_unit_test(shifted_cameras_move_their_image),
        cmocka_unit_test(resizing_keeps_one_focal_models_only_under_equal_scales),
        cmocka_unit_test(invalid_cameras_are_rejected_with_the_reason),
        cmocka_unit_test(model_names_and_ids_match_colmaps),
        cmocka_unit_test(quaternions_of_any_norm_round_trip),
        cmocka_unit_test(quaternion_convention_is_colmaps),
        cmocka_unit_test(invalid_poses_are_rejected),
        cmocka_unit_test(poses_must_be_rotations_within_range),
    };
    return cmocka_run_group_tests_name("camera", tests, NULL, NULL);
}
