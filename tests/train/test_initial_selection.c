// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Which points and primitives stay when the initial cloud or model exceeds the cap.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include "base/core.h"
#include "train/initial_selection.h"

enum { DENSE = 900, SPARSE = 100, ALL = DENSE + SPARSE };

static size_t count_of(const uint8_t *chosen, size_t begin, size_t end)
{
    size_t count = 0;
    for (size_t i = begin; i < end; ++i)
        count += chosen[i];
    return count;
}

static double nearest_kept(const float *points, const uint8_t *chosen, size_t i)
{
    double best = INFINITY;
    for (size_t j = 0; j < ALL; ++j) {
        double sum = 0;
        for (size_t k = 0; k < 3; ++k)
            sum += pow((double)points[3 * i + k] - (double)points[3 * j + k], 2);
        best = chosen[j] ? fmin(best, sqrt(sum)) : best;
    }
    return best;
}

// A ball of 900 points with radius 0.1 among 100 points of a cube with side 10.
static void thinning_keeps_the_sparse_parts(void **state)
{
    (void)state;
    static float points[3 * ALL];
    static uint8_t chosen[ALL];
    for (size_t i = 0; i < (size_t)3 * ALL; ++i) {
        const double u = sgsi_random_uniform(5, i) - 0.5;
        points[i] = (float)(i < (size_t)3 * DENSE ? 0.2 * u : 10 * u);
    }
    const size_t wanted[] = {999, 900, 500, 200};
    for (size_t k = 0; k < sizeof wanted / sizeof *wanted; ++k) {
        assert_int_equal(sgsi_thin_points(points, ALL, wanted[k], chosen), SGS_STATUS_OK);
        assert_int_equal(count_of(chosen, 0, ALL), wanted[k]);
        assert_true(count_of(chosen, DENSE, ALL) >= SPARSE * 97 / 100); // at random: 20 of 100
        for (size_t i = 0; i < ALL; ++i)
            assert_true(nearest_kept(points, chosen, i) < (i < DENSE ? 0.1 : 3.0));
    }
}

// An outdoor scene: 6000 points of a ball of radius 1, 2500 of a ground of radius 10, 1500 far away
// at 10 to 200. Distances alone would leave the ball 3.5 % of 1000.
static void thinning_keeps_half_the_share_of_dense_parts(void **state)
{
    (void)state;
    enum { BALL = 6000, GROUND = 2500, COUNT = 10000 };
    static float points[3 * COUNT];
    static uint8_t chosen[COUNT];
    for (size_t i = 0; i < COUNT; ++i) {
        const double a = 2 * M_PI * sgsi_random_uniform(7, 3 * i),
                     z = 2 * sgsi_random_uniform(7, 3 * i + 1) - 1,
                     u = sgsi_random_uniform(7, 3 * i + 2);
        const double r = i < BALL ? cbrt(u) : i < BALL + GROUND ? 10 * sqrt(u) : 10 * pow(20, u);
        const double h = i >= BALL && i < BALL + GROUND ? -1.0 / r : z, s = sqrt(1 - z * z);
        const bool flat = i >= BALL && i < BALL + GROUND;
        points[3 * i] = (float)(r * cos(a) * (flat ? 1 : s));
        points[3 * i + 1] = (float)(r * sin(a) * (flat ? 1 : s));
        points[3 * i + 2] = (float)(r * h);
    }
    const size_t wanted[] = {9000, 5000, 2500, 1000, 100};
    for (size_t k = 0; k < sizeof wanted / sizeof *wanted; ++k) {
        assert_int_equal(sgsi_thin_points(points, COUNT, wanted[k], chosen), SGS_STATUS_OK);
        assert_int_equal(count_of(chosen, 0, COUNT), wanted[k]);
        const double share = (double)count_of(chosen, 0, BALL) / (double)wanted[k];
        assert_true(share >= 0.26 && share < 0.6);
    }
}

static void coincident_points_can_be_thinned_to_one(void **state)
{
    (void)state;
    static const float points[3 * 7] = {0};
    uint8_t chosen[7];
    for (size_t wanted = 1; wanted < 7; ++wanted) {
        assert_int_equal(sgsi_thin_points(points, 7, wanted, chosen), SGS_STATUS_OK);
        assert_int_equal(count_of(chosen, 0, 7), wanted);
    }
}

static void opaque_and_wide_primitives_stay(void **state)
{
    (void)state;
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(4, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, 4), SGS_STATUS_OK);
    // opacity and scales; opacity times the two largest: 0.02, 0.45, 0.0045, 0.5
    const float rows[4][4] = {{0.5f, 2, 0.02f, 0.01f},
                              {0.9f, 0.5f, 1, 0.1f},
                              {0.9f, 0.05f, 0.05f, 0.1f},
                              {0.005f, 10, 10, 10}};
    for (size_t i = 0; i < 4; ++i) {
        float p[SGS_PARAM_COUNT] = {0};
        p[SGS_PARAM_ROTATION] = 1;
        p[SGS_PARAM_OPACITY] = logf(rows[i][0] / (1 - rows[i][0]));
        for (int k = 0; k < 3; ++k)
            p[SGS_PARAM_SCALE + k] = logf(rows[i][k + 1]);
        sgs_gaussians_set(model, i, p);
    }
    uint8_t chosen[4];
    const uint8_t expected[3][4] = {{0, 0, 0, 1}, {0, 1, 0, 1}, {1, 1, 0, 1}};
    for (size_t wanted = 1; wanted <= 3; ++wanted) {
        assert_int_equal(sgsi_select_largest(model, NULL, wanted, chosen), SGS_STATUS_OK);
        assert_memory_equal(chosen, expected[wanted - 1], 4);
    }
    sgs_gaussians_destroy(model);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(thinning_keeps_the_sparse_parts),
        cmocka_unit_test(thinning_keeps_half_the_share_of_dense_parts),
        cmocka_unit_test(coincident_points_can_be_thinned_to_one),
        cmocka_unit_test(opaque_and_wide_primitives_stay),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
