// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Affine transforms of Gaussians: covariance and volume, also of flat ones. Their SH and other
// parameters are checked through the readers, in test_usd.c.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "model/affine.h"
#include "support/model_support.h"

static const double matrices[][3][3] = {{{1, 0, 0}, {0, 2, 0}, {0, 0, 3}},
                                        {{1, 0.5, 0}, {0, 1, 0}, {0, 0, 1}},
                                        {{0.3, -2, 1}, {1, 0.1, -0.4}, {0.2, 5, 3}},
                                        {{0, -1e5, 0}, {1e-5, 0, 0}, {0, 0, -1}}};
enum { MATRICES = sizeof matrices / sizeof *matrices };

static double determinant(const double a[3][3])
{
    double volume = 0;
    for (int k = 0; k < 3; ++k)
        volume += a[0][k] *
                  (a[1][(k + 1) % 3] * a[2][(k + 2) % 3] - a[1][(k + 2) % 3] * a[2][(k + 1) % 3]);
    return volume;
}

// Scales of 1, 2 and 0.5, the last one times `flat`.
static void make_row(float params[SGS_PARAM_COUNT], double flat)
{
    static const float rotation[4] = {0.5f, 0.1f, 0.7f, -0.3f};
    memset(params, 0, SGS_PARAM_COUNT * sizeof *params);
    memcpy(params + SGS_PARAM_ROTATION, rotation, sizeof rotation);
    params[SGS_PARAM_MEAN] = 1;
    params[SGS_PARAM_MEAN + 2] = -2;
    params[SGS_PARAM_SCALE + 1] = (float)log(2);
    params[SGS_PARAM_SCALE + 2] = (float)log(0.5 * flat);
}

static void get_shape(const float params[SGS_PARAM_COUNT], double q[4], double scales[3])
{
    for (int k = 0; k < 4; ++k)
        q[k] = (double)params[SGS_PARAM_ROTATION + k];
    for (int k = 0; k < 3; ++k)
        scales[k] = exp((double)params[SGS_PARAM_SCALE + k]);
}

static void the_covariance_is_transformed(void **state)
{
    (void)state;
    static const double moved[3] = {10, 20, 30};
    for (int n = 0; n < MATRICES; ++n) {
        float params[SGS_PARAM_COUNT];
        double q[4], scales[3], before[3][3], after[3][3];
        const double(*const a)[3] = matrices[n];
        sgsi_affine affine;
        make_row(params, 1);
        get_shape(params, q, scales);
        model_covariance(q, scales, before);
        assert_true(sgsi_affine_make(a, moved, &affine));
        sgsi_affine_apply(&affine, params);
        get_shape(params, q, scales);
        model_covariance(q, scales, after);
        for (int i = 0; i < 3; ++i) {
            const double mean = a[i][0] - 2 * a[i][2] + moved[i];
            assert_true(fabs((double)params[i] - mean) <= 1e-6 * fabs(mean));
            for (int j = 0; j < 3; ++j) {
                double sum = 0, size = 0;
                for (int k = 0; k < 9; ++k) {
                    const double term = a[i][k / 3] * before[k / 3][k % 3] * a[j][k % 3];
                    sum += term;
                    size += fabs(term);
                }
                // The rounded quaternion of the last one moves its shortest axis by more.
                if (n < 3 && !(fabs(sum - after[i][j]) <= 1e-5 * size))
                    fail_msg("matrix %d: %d, %d: %g, not %g", n, i, j, after[i][j], sum);
            }
        }
    }
}

// The product of the scales is multiplied by |det A|, however flat the Gaussian is: exp(-30) is the
// smallest scale that readers produce.
static void flat_gaussians_keep_their_least_scale(void **state)
{
    (void)state;
    static const double moved[3] = {0, 0, 0};
    for (int n = 0; n < MATRICES; ++n)
        for (double flat = 1; flat > 1e-13; flat /= 10) {
            float params[SGS_PARAM_COUNT];
            double sum = 0;
            sgsi_affine affine;
            assert_true(sgsi_affine_make(matrices[n], moved, &affine));
            make_row(params, flat);
            sgsi_affine_apply(&affine, params);
            for (int k = 0; k < 3; ++k)
                sum += (double)params[SGS_PARAM_SCALE + k];
            const double expected = log(flat) + log(fabs(determinant(matrices[n])));
            if (!(fabs(sum - expected) <= 1e-5 * (1 + fabs(expected))))
                fail_msg("matrix %d, flat %g: %g, not %g", n, flat, sum, expected);
        }
}

// What readers drop as invalid stays invalid; a scale of 0 is valid.
static void invalid_scales_stay_invalid(void **state)
{
    (void)state;
    static const double moved[3] = {0, 0, 0};
    static const float invalid[] = {NAN, INFINITY};
    for (int n = 0; n < MATRICES; ++n)
        for (int k = 0; k < 9; ++k) {
            float params[SGS_PARAM_COUNT];
            bool finite = true;
            sgsi_affine affine;
            assert_true(sgsi_affine_make(matrices[n], moved, &affine));
            make_row(params, 1);
            params[SGS_PARAM_SCALE + k % 3] = k < 6 ? invalid[k / 3] : -INFINITY;
            sgsi_affine_apply(&affine, params);
            for (int j = 0; j < 3; ++j)
                finite = finite && isfinite(params[SGS_PARAM_SCALE + j]);
            assert_true(finite == (k >= 6));
        }
}

// The scales 1, 2 and 0.5 of rotation 0 0 0 0 fit the identity that may replace it.
static void zero_quaternions_stay_zero(void **state)
{
    (void)state;
    static const double moved[3] = {10, 20, 30};
    static const struct {
        double matrix[3][3], scales[3];
    } cases[] = {{{{1, 0, 0}, {0, 2, 0}, {0, 0, 3}}, {1, 4, 1.5}},
                 {{{1, 0, 0}, {0, -2, 0}, {0, 0, 3}}, {1, 4, 1.5}},
                 {{{3, 0, 0}, {0, 3, 0}, {0, 0, 3}}, {3, 6, 1.5}},
                 {{{1, 0, 0}, {0, 0, 1}, {0, -1, 0}}, {1, 0.5, 2}}, // z up
                 {{{0, -2, 0}, {3, 0, 0}, {0, 0, 1}}, {4, 3, 0.5}},
                 {{{0.6, -0.8, 0}, {0.8, 0.6, 0}, {0, 0, 1}},
                  {1.7088007490635062, 1.4422205101855958, 0.5}}};
    for (size_t n = 0; n < sizeof cases / sizeof *cases; ++n) {
        float params[SGS_PARAM_COUNT];
        sgsi_affine affine;
        assert_true(sgsi_affine_make(cases[n].matrix, moved, &affine));
        make_row(params, 1);
        for (int k = 0; k < 4; ++k)
            params[SGS_PARAM_ROTATION + k] = 0;
        sgsi_affine_apply(&affine, params);
        for (int k = 0; k < 4; ++k)
            assert_true(params[SGS_PARAM_ROTATION + k] == 0);
        for (int k = 0; k < 3; ++k) {
            const double scale = exp((double)params[SGS_PARAM_SCALE + k]);
            if (!(fabs(scale - cases[n].scales[k]) <= 1e-6 * scale))
                fail_msg("case %zu: scale %d is %g, not %g", n, k, scale, cases[n].scales[k]);
        }
    }
}

static void similarities_have_no_deformation(void **state)
{
    (void)state;
    static const double moved[3] = {1, 2, 3}, turn[3][3] = {{0, -2, 0}, {2, 0, 0}, {0, 0, 2}},
                        mirror[3][3] = {{3, 0, 0}, {0, -3, 0}, {0, 0, 3}},
                        flat[3][3] = {{1, 0, 0}, {0, 1, 0}, {1, 1, 0}},
                        infinite[3][3] = {{1, 0, 0}, {0, INFINITY, 0}, {0, 0, 1}};
    sgsi_affine affine;
    assert_true(sgsi_affine_make(turn, moved, &affine));
    assert_false(affine.deforms || affine.mirrored);
    assert_true(fabs(affine.similarity.scale - 2) <= 1e-12);
    assert_true(sgsi_affine_make(mirror, moved, &affine));
    assert_true(!affine.deforms && affine.mirrored);
    assert_false(sgsi_affine_make(flat, moved, &affine));
    assert_false(sgsi_affine_make(infinite, moved, &affine));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_covariance_is_transformed),
        cmocka_unit_test(flat_gaussians_keep_their_least_scale),
        cmocka_unit_test(invalid_scales_stay_invalid),
        cmocka_unit_test(zero_quaternions_stay_zero),
        cmocka_unit_test(similarities_have_no_deformation),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
