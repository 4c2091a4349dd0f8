// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Transforms and selections of primitives. A transformed model has, at the transformed place and in
// the turned direction, the density and colour of the original.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "support/model_support.h"
#include "sparegs/model_edit.h"

enum { COUNT = 40 };

// ---- Transforms ----

static void rotate(const double q[4], const double v[3], double out[3])
{
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    out[0] =
        (1 - 2 * (y * y + z * z)) * v[0] + 2 * (x * y - w * z) * v[1] + 2 * (x * z + w * y) * v[2];
    out[1] =
        2 * (x * y + w * z) * v[0] + (1 - 2 * (x * x + z * z)) * v[1] + 2 * (y * z - w * x) * v[2];
    out[2] =
        2 * (x * z - w * y) * v[0] + 2 * (y * z + w * x) * v[1] + (1 - 2 * (x * x + y * y)) * v[2];
}

// Squared distance of a point in the metric of a primitive.
static double distance(const sgs_gaussians *model, size_t i, const double point[3])
{
    double q[4], offset[3], local[3], sum = 0, norm = 0;
    for (int k = 0; k < 4; ++k) {
        q[k] = (double)model_value(model, i, SGS_PARAM_ROTATION + k) * (k ? -1 : 1); // the inverse
        norm += q[k] * q[k];
    }
    for (int k = 0; k < 4; ++k)
        q[k] = norm > 0 ? q[k] / sqrt(norm) : !k; // 0: no rotation
    for (int k = 0; k < 3; ++k)
        offset[k] = point[k] - (double)model_value(model, i, SGS_PARAM_MEAN + k);
    rotate(q, offset, local);
    for (int k = 0; k < 3; ++k) {
        const double s = exp((double)model_value(model, i, SGS_PARAM_SCALE + k));
        sum += local[k] * local[k] / (s * s);
    }
    return sum;
}

static void transforms_move_density_and_colour(void **state)
{
    (void)state;
    static const sgs_similarity cases[] = {
        {1, {1, 0, 0, 0}, {1, -2, 3}},
        {2.5, {1, 0, 0, 0}, {0, 0, 0}},
        {1, {0.70710678118654757, 0, 0, 0.70710678118654757}, {0, 0, 0}},
        {0.3, {0.2, -0.7, 1.1, 0.4}, {-5, 0.5, 2}},
        {7, {0, 0, -3, 0}, {0, 1, 0}},
    };
    for (size_t c = 0; c < sizeof cases / sizeof *cases; ++c) {
        const sgs_similarity *s = &cases[c];
        sgs_gaussians *model = model_random(COUNT, 3), *moved = model_random(COUNT, 3);
        for (int k = 0; k < 4; ++k)
            *sgs_gaussians_at(model, 3, SGS_PARAM_ROTATION + k) =
                *sgs_gaussians_at(moved, 3, SGS_PARAM_ROTATION + k) = 0;
        assert_int_equal(sgs_gaussians_transform(moved, s), SGS_STATUS_OK);
        double q[4], norm = 0;
        for (int k = 0; k < 4; ++k)
            norm += s->rotation[k] * s->rotation[k];
        for (int k = 0; k < 4; ++k)
            q[k] = s->rotation[k] / sqrt(norm);
        for (size_t i = 0; i < COUNT; ++i) {
            double d[3], turned[3], point[3], length = 0, reach = 0;
            for (int k = 0; k < 3; ++k) {
                d[k] = sgsi_random_normal(i, 700 + (uint64_t)k);
                length += d[k] * d[k];
                reach = fmax(reach, exp((double)model_value(model, i, SGS_PARAM_SCALE + k)));
            }
            for (int k = 0; k < 3; ++k)
                d[k] /= sqrt(length);
            rotate(q, d, turned);
            for (int channel = 0; channel < 3; ++channel) {
                const double error = model_radiance(moved, i, turned, channel) -
                                     model_radiance(model, i, d, channel);
                if (!(fabs(error) <= 3e-6))
                    fail_msg("case %zu, primitive %zu: colour differs by %g", c, i, error);
            }
            // A point one standard deviation away, and its image.
            double image[3];
            for (int k = 0; k < 3; ++k)
                point[k] = (double)model_value(model, i, k) + reach * d[k];
            rotate(q, point, image);
            for (int k = 0; k < 3; ++k)
                image[k] = s->scale * image[k] + s->translation[k];
            const double before = distance(model, i, point), after = distance(moved, i, image);
            // Positions up to 100 have errors of 4e-6, relative to the smallest scale.
            double least = INFINITY;
            for (int k = 0; k < 3; ++k)
                least = fmin(least, exp((double)model_value(model, i, SGS_PARAM_SCALE + k)));
            assert_true(fabs(after - before) <= 1e-4 * before + before * 5e-5 / least);
            assert_float_equal(model_value(moved, i, SGS_PARAM_OPACITY),
                               model_value(model, i, SGS_PARAM_OPACITY), 0);
        }
        sgs_gaussians_destroy(model);
        sgs_gaussians_destroy(moved);
    }
}

// The norm of the quaternion does not matter, even where its squares leave the range of double.
static void quaternions_have_any_norm(void **state)
{
    (void)state;
    static const double scales[] = {1, 0x1p-300, 0x1p600, 0x1p-1000, 0x1p1022};
    char first[17], hash[17];
    for (size_t k = 0; k < sizeof scales / sizeof *scales; ++k) {
        sgs_similarity s = {1, {0.2, -0.7, 1.1, 0.4}, {0, 0, 0}};
        for (int c = 0; c < 4; ++c)
            s.rotation[c] *= scales[k];
        sgs_gaussians *model = model_random(COUNT, 3);
        if (sgs_gaussians_transform(model, &s))
            fail_msg("%g: %s", scales[k], sgs_last_error());
        sgs_gaussians_hash(model, k ? hash : first);
        assert_string_equal(k ? hash : first, first);
        sgs_gaussians_destroy(model);
    }
}

static void invalid_transforms_change_nothing(void **state)
{
    (void)state;
    static const sgs_similarity cases[] = {
        {0, {1, 0, 0, 0}, {0, 0, 0}},   {-1, {1, 0, 0, 0}, {0, 0, 0}},
        {NAN, {1, 0, 0, 0}, {0, 0, 0}}, {1, {0, 0, 0, 0}, {0, 0, 0}},
        {1, {NAN, 0, 0, 0}, {0, 0, 0}}, {1, {1, 0, 0, 0}, {0, INFINITY, 0}},
        {1, {1, 0, NAN, 0}, {0, 0, 0}}, {1, {1, 0, 0, -INFINITY}, {0, 0, 0}}};
    sgs_gaussians *model = model_random(COUNT, 3);
    char before[17], after[17];
    sgs_gaussians_hash(model, before);
    for (size_t c = 0; c < sizeof cases / sizeof *cases; ++c)
        assert_int_equal(sgs_gaussians_transform(model, &cases[c]), SGS_STATUS_INVALID_ARGUMENT);
    static const sgs_similarity far[] = {{1, {1, 0, 0, 0}, {0, 1e39, 0}},
                                         {1e38, {0, 1, 1, 0}, {0, 0, 0}},
                                         {1e30, {1, 0, 0, 0}, {0, 0, 0}}};
    for (size_t c = 0; c < sizeof far / sizeof *far; ++c)
        assert_int_equal(sgs_gaussians_transform(model, &far[c]), SGS_STATUS_LIMIT);
    sgs_gaussians_hash(model, after);
    assert_string_equal(before, after);
    sgs_gaussians_destroy(model);
}

static void limited_sh_keep_the_lower_degrees(void **state)
{
    (void)state;
    sgs_gaussians *model = model_random(COUNT, 3), *limited = model_random(COUNT, 3);
    for (int degree = 3; degree >= 0; --degree) {
        sgs_gaussians_limit_sh(limited, degree);
        assert_int_equal(limited->sh_degree, degree);
        const int used = SGS_PARAM_SH_DC + 3 * (degree + 1) * (degree + 1);
        for (size_t i = 0; i < COUNT; ++i)
            for (int k = 0; k < SGS_PARAM_COUNT; ++k)
                assert_true(model_value(limited, i, k) ==
                            (k < used ? model_value(model, i, k) : 0.0f));
    }
    sgs_gaussians_limit_sh(limited, 2);
    assert_int_equal(limited->sh_degree, 0);
    sgs_gaussians_destroy(model);
    sgs_gaussians_destroy(limited);
}

// ---- Selections ----

// A model of points; opacity logit 2.
static sgs_gaussians *points_model(const float *points, size_t count)
{
    sgs_gaussians *model = model_random(count, 1);
    for (size_t i = 0; i < count; ++i) {
        for (int k = 0; k < 3; ++k)
            *sgs_gaussians_at(model, i, k) = points[3 * i + (size_t)k];
        *sgs_gaussians_at(model, i, SGS_PARAM_OPACITY) = 2.0f;
    }
    return model;
}

static void boxes_and_spheres_include_their_border(void **state)
{
    (void)state;
    static const float points[] = {0, 0, 0, 1, 1, 1, 1.001f, 1, 1, -1, 0, 0, -1, -1, -1, 0, 0, 2};
    static const unsigned char in_box[] = {1, 1, 0, 1, 1, 0}, in_sphere[] = {1, 0, 0, 1, 0, 0},
                               in_both[] = {1, 0, 0, 1, 0, 0};
    sgs_gaussians *model = points_model(points, 6);
    unsigned char keep[6];
    memset(keep, 1, 6);
    sgs_select_box(model, (double[]){-1, -1, -1}, (double[]){1, 1, 1}, keep);
    assert_memory_equal(keep, in_box, 6);
    sgs_select_sphere(model, (double[]){0, 0, 0}, 1, keep); // clears flags only
    assert_memory_equal(keep, in_both, 6);
    memset(keep, 1, 6);
    sgs_select_sphere(model, (double[]){0, 0, 0}, 1, keep);
    assert_memory_equal(keep, in_sphere, 6);
    unsigned char none[6];
    memset(none, 1, 6);
    sgs_select_sphere(model, (double[]){0, 0, 0}, -10, none);
    assert_memory_equal(none, (const unsigned char[6]){0}, 6);
    sgs_selection_apply(model, keep);
    assert_int_equal(model->count, 2);
    assert_true(model_value(model, 1, 0) == -1.0f);
    sgs_gaussians_destroy(model);
}

static void values_are_compared_as_named(void **state)
{
    (void)state;
    sgs_gaussians *model = model_random(3, 1);
    for (size_t i = 0; i < 3; ++i) {
        *sgs_gaussians_at(model, i, 0) = (float)i;
        *sgs_gaussians_at(model, i, SGS_PARAM_OPACITY) = (float)i - 1.0f; // 0.27, 0.5, 0.73
        *sgs_gaussians_at(model, i, SGS_PARAM_SCALE + 1) = (float)i;      // 1, e, e^2
        *sgs_gaussians_at(model, i, SGS_PARAM_SH_DC + 2) = (float)i;      // 0.5, 0.78, 1.06
        *sgs_gaussians_at(model, i, SGS_PARAM_ROTATION + 3) = (float)i;
        // f_rest_4 is the second coefficient of green.
        *sgs_gaussians_at(model, i, SGS_PARAM_SH_REST + 3 * 1 + 1) = (float)i;
    }
    static const struct {
        const char *name;
        sgs_comparison comparison;
        double value;
        unsigned char kept[3];
    } cases[] = {
        {"x", SGS_LESS, 1, {1, 0, 0}},
        {"x", SGS_LESS_EQUAL, 1, {1, 1, 0}},
        {"x", SGS_GREATER, 1, {0, 0, 1}},
        {"x", SGS_GREATER_EQUAL, 1, {0, 1, 1}},
        {"x", SGS_EQUAL, 1, {0, 1, 0}},
        {"x", SGS_NOT_EQUAL, 1, {1, 0, 1}},
        {"opacity", SGS_GREATER, 0.6, {0, 0, 1}},
        {"opacity", SGS_EQUAL, 0.5, {0, 1, 0}},
        {"opacity_raw", SGS_GREATER, 0.6, {0, 0, 1}},
        {"opacity_raw", SGS_LESS, -0.5, {1, 0, 0}},
        {"scale_1", SGS_LESS, 2.8, {1, 1, 0}},
        {"scale_1_raw", SGS_LESS, 1.5, {1, 1, 0}},
        {"scale_1_raw", SGS_LESS, 0.5, {1, 0, 0}},
        {"f_dc_2", SGS_GREATER, 1, {0, 0, 1}},
        {"f_dc_2_raw", SGS_GREATER, 0.9, {0, 1, 1}},
        {"rot_3", SGS_GREATER, 0.9, {0, 1, 1}},
        {"f_rest_4", SGS_EQUAL, 2, {0, 0, 1}},
    };
    for (size_t c = 0; c < sizeof cases / sizeof *cases; ++c) {
        unsigned char keep[3] = {1, 1, 1};
        assert_int_equal(
            sgs_select_value(model, cases[c].name, cases[c].comparison, cases[c].value, keep),
            SGS_STATUS_OK);
        if (memcmp(keep, cases[c].kept, 3))
            fail_msg("%s, case %zu: %d %d %d", cases[c].name, c, keep[0], keep[1], keep[2]);
    }
    static const char *const unknown[] = {"",       "w",         "xx",        "scale_3",
                                          "scale_", "f_rest_9",  "f_rest_-1", "opacity_",
                                          "rot_4",  "f_dc_1raw", "scale_1_ra"};
    for (size_t k = 0; k < sizeof unknown / sizeof *unknown; ++k) {
        unsigned char keep[3] = {1, 1, 1};
        assert_int_equal(sgs_select_value(model, unknown[k], SGS_LESS, 0, keep),
                         SGS_STATUS_INVALID_ARGUMENT);
        assert_true(keep[0] && keep[1] && keep[2]);
    }
    static const int degrees[] = {-1, 4, 7};
    for (size_t k = 0; k < sizeof degrees / sizeof *degrees; ++k) {
        unsigned char keep[3] = {1, 1, 1};
        model->sh_degree = degrees[k];
        assert_int_equal(sgs_select_value(model, "f_rest_50", SGS_LESS, 0, keep),
                         SGS_STATUS_INVALID_ARGUMENT);
        assert_non_null(strstr(sgs_last_error(), "is not within 0 to 3"));
        assert_true(keep[0] && keep[1] && keep[2]);
    }
    sgs_gaussians_destroy(model);
}

// A grid of 8^3 points, a cluster of 20, and 5 single points, also at negative coordinates.
static void floaters_are_small_components(void **state)
{
    (void)state;
    enum { GRID = 512, CLUSTER = 20, SINGLES = 5, ALL = GRID + CLUSTER + SINGLES };
    float points[3 * ALL];
    for (int i = 0; i < GRID; ++i) {
        points[3 * i] = 0.1f * (float)(i % 8);
        points[3 * i + 1] = 0.1f * (float)(i / 8 % 8);
        points[3 * i + 2] = 0.1f * (float)(i / 64);
    }
    for (int i = 0; i < CLUSTER; ++i) {
        points[3 * (GRID + i)] = 10 + 0.01f * (float)i;
        points[3 * (GRID + i) + 1] = points[3 * (GRID + i) + 2] = -4;
    }
    for (int i = 0; i < SINGLES; ++i)
        for (int k = 0; k < 3; ++k)
            points[3 * (GRID + CLUSTER + i) + k] = -3.0f - 2.0f * (float)i;
    sgs_gaussians *model = points_model(points, ALL);
    static const struct {
        double voxel, share;
        size_t kept;
    } cases[] = {{0.1, 0.1, GRID}, {0.1, 0.01, GRID + CLUSTER}, {0.1, 0, ALL},
                 {0, 0.1, GRID},   {0, 0.01, GRID + CLUSTER},   {100, 0.5, ALL},
                 {0.02, 0.1, 0}};
    for (size_t c = 0; c < sizeof cases / sizeof *cases; ++c) {
        unsigned char keep[ALL];
        memset(keep, 1, sizeof keep);
        const sgs_floater_options options = {cases[c].voxel, 0.5, cases[c].share};
        assert_int_equal(sgs_select_connected(model, &options, keep), SGS_STATUS_OK);
        size_t kept = 0;
        for (size_t i = 0; i < ALL; ++i) {
            kept += keep[i];
            assert_true(cases[c].kept != GRID || keep[i] == (i < GRID));
        }
        assert_int_equal(kept, cases[c].kept);
    }
    // Faint primitives connect nothing, but are kept inside of an occupied voxel.
    for (size_t i = 0; i < GRID; ++i)
        if (points[3 * i] > 0.25f && points[3 * i] < 0.45f)
            *sgs_gaussians_at(model, i, SGS_PARAM_OPACITY) = -2.0f;
    unsigned char keep[ALL];
    memset(keep, 1, sizeof keep);
    const sgs_floater_options options = {0.1, 0.5, 0.4};
    assert_int_equal(sgs_select_connected(model, &options, keep), SGS_STATUS_OK);
    for (size_t i = 0; i < ALL; ++i) // 192 of 409 solid ones on each side
        assert_int_equal(keep[i], i < GRID && (points[3 * i] < 0.25f || points[3 * i] > 0.45f));
    sgs_gaussians_destroy(model);
}

// A far primitive on either side of any axis does not join the components of the rest.
static void floaters_are_found_beside_far_primitives(void **state)
{
    (void)state;
    enum { GRID = 512, FAR = GRID + 4, ALL };
    float points[3 * ALL] = {0};
    for (int i = 0; i < FAR; ++i) {
        points[3 * i] = 0.1f * (float)(i % 8);
        points[3 * i + 1] = 0.1f * (float)(i / 8 % 8);
        points[3 * i + 2] = 0.1f * (float)(i / 64);
    }
    for (int axis = 0; axis < 3; ++axis)
        for (int side = -1; side <= 1; side += 2) {
            for (int i = GRID; i < ALL; ++i)
                for (int k = 0; k < 3; ++k)
                    points[3 * i + k] = k == axis ? 5.0f : 0.1f;
            points[3 * FAR + axis] = 1e7f * (float)side;
            sgs_gaussians *model = points_model(points, ALL);
            for (int automatic = 0; automatic < 2; ++automatic) {
                unsigned char keep[ALL];
                memset(keep, 1, sizeof keep);
                const sgs_floater_options options = {automatic ? 0 : 0.2, 0.5, 0.1};
                assert_int_equal(sgs_select_connected(model, &options, keep), SGS_STATUS_OK);
                for (int i = 0; i < ALL; ++i)
                    assert_int_equal(keep[i], i < GRID);
            }
            sgs_gaussians_destroy(model);
        }
}

static void floater_options_have_defaults_and_limits(void **state)
{
    (void)state;
    float points[3 * 202];
    for (size_t i = 0; i < 202; ++i) {
        const float at[3] = {(float)(i % 10), (float)(i / 10), i < 200 ? 0.0f : 1000.0f};
        memcpy(points + 3 * i, at, sizeof at);
    }
    sgs_gaussians *model = points_model(points, 202);
    unsigned char expected[202], keep[202];
    memset(expected, 1, sizeof expected);
    memset(keep, 1, sizeof keep);
    const sgs_floater_options typical = {0, 0.1, 0.01};
    assert_int_equal(sgs_select_connected(model, &typical, expected), SGS_STATUS_OK);
    assert_int_equal(sgs_select_connected(model, NULL, keep), SGS_STATUS_OK);
    assert_memory_equal(keep, expected, sizeof keep);
    assert_true(keep[0] && !keep[200] && !keep[201]);
    for (int k = 0; k < 9; ++k) {
        const double wrong = k < 3 ? NAN : k < 6 ? INFINITY : -1;
        const sgs_floater_options options = {k % 3 == 0 ? wrong : 0, k % 3 == 1 ? wrong : 0.1,
                                             k % 3 == 2 ? wrong : 0.01};
        assert_int_equal(sgs_select_connected(model, &options, keep), SGS_STATUS_INVALID_ARGUMENT);
    }
    // The grid has 2^20 voxels per side; the points span 19 units, but for two outliers.
    const sgs_floater_options tiny = {1e-5, 0.1, 0.01}, small = {2e-5, 0.1, 0.01};
    assert_int_equal(sgs_select_connected(model, &tiny, keep), SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "at least 1.8e-05 is required"));
    assert_int_equal(sgs_select_connected(model, &small, keep), SGS_STATUS_OK);
    sgs_gaussians_destroy(model);
}

static void few_or_coincident_primitives_are_one_component(void **state)
{
    (void)state;
    for (size_t count = 1; count <= 6; ++count) {
        float points[18];
        for (size_t i = 0; i < 18; ++i)
            points[i] = 1.5f;
        sgs_gaussians *model = points_model(points, count);
        unsigned char keep[6] = {1, 1, 1, 1, 1, 1};
        const sgs_floater_options options = {0, 0.1, 0.5};
        assert_int_equal(sgs_select_connected(model, &options, keep), SGS_STATUS_OK);
        for (size_t i = 0; i < count; ++i)
            assert_int_equal(keep[i], 1);
        sgs_gaussians_destroy(model);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(transforms_move_density_and_colour),
        cmocka_unit_test(quaternions_have_any_norm),
        cmocka_unit_test(invalid_transforms_change_nothing),
        cmocka_unit_test(limited_sh_keep_the_lower_degrees),
        cmocka_unit_test(boxes_and_spheres_include_their_border),
        cmocka_unit_test(values_are_compared_as_named),
        cmocka_unit_test(floaters_are_small_components),
        cmocka_unit_test(floaters_are_found_beside_far_primitives),
        cmocka_unit_test(floater_options_have_defaults_and_limits),
        cmocka_unit_test(few_or_coincident_primitives_are_one_component),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
