// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Storage, inert rows, 3DGS initialisation, and the hash of a model.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <math.h>

#include "base/core.h"
#include "sparegs/gaussians.h"
#include "sparegs/runtime.h"

static void fill_row(float params[SGS_PARAM_COUNT], size_t i)
{
    for (int k = 0; k < SGS_PARAM_COUNT; ++k)
        params[k] = (float)sgsi_random_normal(i, (uint64_t)k);
}

static sgs_gaussians *random_model(size_t count, size_t capacity)
{
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(capacity, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, count), SGS_STATUS_OK);
    for (size_t i = 0; i < count; ++i) {
        float params[SGS_PARAM_COUNT];
        fill_row(params, i);
        sgs_gaussians_set(model, i, params);
    }
    return model;
}

static void assert_inert(const sgs_gaussians *model, size_t begin)
{
    for (size_t i = begin; i < model->capacity; ++i) {
        float params[SGS_PARAM_COUNT];
        sgs_gaussians_get(model, i, params);
        for (int k = 0; k < SGS_PARAM_COUNT; ++k) {
            const float expected = k == SGS_PARAM_ROTATION                           ? 1.0f
                                   : k >= SGS_PARAM_SCALE && k < SGS_PARAM_SCALE + 3 ? -20.0f
                                   : k == SGS_PARAM_OPACITY                          ? -30.0f
                                                                                     : 0.0f;
            assert_true(params[k] == expected);
        }
    }
}

static void gaussians_start_empty_aligned_and_inert(void **state)
{
    (void)state;
    static const size_t capacities[] = {0, 1, 15, 16, 17, 1000};
    for (size_t c = 0; c < sizeof capacities / sizeof *capacities; ++c) {
        sgs_gaussians *model;
        assert_int_equal(sgs_gaussians_create(capacities[c], &model), SGS_STATUS_OK);
        assert_int_equal(model->count, 0);
        assert_int_equal(model->sh_degree, 3);
        assert_true(model->capacity >= capacities[c] && model->capacity % SGS_LANES == 0);
        assert_int_equal((uintptr_t)model->data % 64, 0);
        assert_inert(model, 0);
        sgs_gaussians_destroy(model);
    }
    sgs_gaussians_destroy(NULL);
}

static void gaussians_layout_is_blocks_of_sixteen(void **state)
{
    (void)state;
    sgs_gaussians *model = random_model(50, 0);
    for (size_t i = 0; i < 50; ++i) {
        float expected[SGS_PARAM_COUNT], got[SGS_PARAM_COUNT];
        fill_row(expected, i);
        sgs_gaussians_get(model, i, got);
        assert_memory_equal(got, expected, sizeof expected);
        for (int k = 0; k < SGS_PARAM_COUNT; ++k)
            assert_true(model->data[((i / 16) * SGS_PARAM_COUNT + (size_t)k) * 16 + i % 16] ==
                        expected[k]);
    }
    sgs_gaussians_destroy(model);
}

static void gaussians_keep_rows_and_inert_tail_through_resizes(void **state)
{
    (void)state;
    sgs_gaussians *model = random_model(100, 0);
    assert_int_equal(sgs_gaussians_reserve(model, 1000), SGS_STATUS_OK);
    assert_int_equal(model->count, 100);
    const size_t capacity = model->capacity;
    assert_int_equal(sgs_gaussians_reserve(model, 3), SGS_STATUS_OK);
    assert_int_equal(model->capacity, capacity);
    assert_int_equal(sgs_gaussians_resize(model, 37), SGS_STATUS_OK);
    assert_inert(model, 37);
    assert_int_equal(sgs_gaussians_resize(model, 2000), SGS_STATUS_OK);
    assert_inert(model, 37);
    for (size_t i = 0; i < 37; ++i) {
        float expected[SGS_PARAM_COUNT], got[SGS_PARAM_COUNT];
        fill_row(expected, i);
        sgs_gaussians_get(model, i, got);
        assert_memory_equal(got, expected, sizeof expected);
    }
    assert_int_equal(sgs_gaussians_resize(model, 0), SGS_STATUS_OK);
    assert_inert(model, 0);
    sgs_gaussians_destroy(model);
}

static void gaussians_survive_lack_of_memory(void **state)
{
    (void)state;
    for (size_t n = 1; n <= 2; ++n) {
        sgs_gaussians *model = (sgs_gaussians *)state;
        sgsi_fail_allocation(n);
        assert_int_equal(sgs_gaussians_create(100, &model), SGS_STATUS_OUT_OF_MEMORY);
        assert_null(model);
    }
    sgsi_fail_allocation(0);
    sgs_gaussians *model = random_model(20, 0);
    char before[17], after[17];
    sgs_gaussians_hash(model, before);
    sgsi_fail_allocation(1);
    assert_int_equal(sgs_gaussians_resize(model, 500), SGS_STATUS_OUT_OF_MEMORY);
    sgsi_fail_allocation(0);
    assert_int_equal(model->count, 20);
    assert_int_equal(sgs_gaussians_reserve(model, SIZE_MAX - 3), SGS_STATUS_LIMIT);
    assert_int_equal(sgs_gaussians_reserve(model, (size_t)1 << 31), SGS_STATUS_LIMIT);
    sgs_gaussians_hash(model, after);
    assert_string_equal(before, after);
    sgs_gaussians_destroy(model);

    const float points[] = {0, 0, 0, 1, 0, 0};
    const unsigned char colors[6] = {0};
    for (size_t n = 1; n <= 5; ++n) {
        sgsi_fail_allocation(n);
        assert_int_equal(sgs_gaussians_init_points(points, colors, 2, 1.0, &model),
                         SGS_STATUS_OUT_OF_MEMORY);
        assert_null(model);
    }
    sgsi_fail_allocation(0);
}

static void init_follows_3dgs(void **state)
{
    (void)state;
    // A corner and its three neighbours at 1, 2, 3: mean squared distance 14/3 for the corner.
    const float points[] = {0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 3};
    const unsigned char colors[] = {0, 255, 128, 1, 2, 3, 4, 5, 6, 7, 8, 9};
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_init_points(points, colors, 4, 0.0, &model), SGS_STATUS_OK);
    assert_int_equal(model->count, 4);
    assert_int_equal(model->sh_degree, 3);
    float row[SGS_PARAM_COUNT];
    sgs_gaussians_get(model, 0, row);
    for (int k = 0; k < 3; ++k) {
        assert_true(row[SGS_PARAM_MEAN + k] == 0.0f);
        assert_true(fabs(row[SGS_PARAM_SCALE + k] - log(sqrt(14.0 / 3.0))) <= 1e-7);
        assert_true(fabs(row[SGS_PARAM_SH_DC + k] -
                         (colors[k] / 255.0 - 0.5) / 0.28209479177387814) <= 1e-6);
        assert_true(row[SGS_PARAM_ROTATION + 1 + k] == 0.0f);
    }
    assert_true(row[SGS_PARAM_ROTATION] == 1.0f);
    assert_true(fabs(row[SGS_PARAM_OPACITY] + 2.1972246) <= 1e-6);
    for (int k = SGS_PARAM_SH_REST; k < SGS_PARAM_COUNT; ++k)
        assert_true(row[k] == 0.0f);
    sgs_gaussians_get(model, 2, row); // (0,2,0): 4, 1 + 4, 4 + 9
    assert_true(fabs(row[SGS_PARAM_SCALE] - log(sqrt(22.0 / 3.0))) <= 1e-7);
    assert_true(row[SGS_PARAM_MEAN + 1] == 2.0f);
    assert_inert(model, 4);
    sgs_gaussians_destroy(model);
}

static void init_without_colours_is_grey(void **state)
{
    (void)state;
    const float points[] = {0, 0, 0, 1, 0, 0};
    unsigned char grey[6];
    memset(grey, 128, sizeof grey);
    sgs_gaussians *model, *expected;
    assert_int_equal(sgs_gaussians_init_points(points, NULL, 2, 0.0, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_init_points(points, grey, 2, 0.0, &expected), SGS_STATUS_OK);
    char hex[2][17];
    sgs_gaussians_hash(model, hex[0]);
    sgs_gaussians_hash(expected, hex[1]);
    assert_string_equal(hex[0], hex[1]);
    sgs_gaussians_destroy(model);
    sgs_gaussians_destroy(expected);
}

static void init_leaves_missing_neighbours_out(void **state)
{
    (void)state;
    const float points[] = {0, 0, 0, 3, 0, 0, 0, 4, 0};
    const unsigned char colors[9] = {0};
    const double expected[] = {0.25, 9.0, (9.0 + 16.0) / 2}; // first point, for n = 1, 2, 3
    for (size_t n = 1; n <= 3; ++n) {
        sgs_gaussians *model;
        assert_int_equal(sgs_gaussians_init_points(points, colors, n, 0.5, &model), SGS_STATUS_OK);
        assert_true(fabs(*sgs_gaussians_at(model, 0, SGS_PARAM_SCALE) -
                         log(sqrt(expected[n - 1]))) <= 1e-6);
        sgs_gaussians_destroy(model);
    }
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_init_points(points, colors, 0, 0.5, &model), SGS_STATUS_OK);
    assert_int_equal(model->count, 0);
    sgs_gaussians_destroy(model);
}

static void init_clamps_duplicates(void **state)
{
    (void)state;
    const float points[15] = {0};
    const unsigned char colors[15] = {0};
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_init_points(points, colors, 5, 1.0, &model), SGS_STATUS_OK);
    for (size_t i = 0; i < 5; ++i)
        assert_true(fabs(*sgs_gaussians_at(model, i, SGS_PARAM_SCALE + 1) - log(sqrt(1e-7))) <=
                    1e-6);
    sgs_gaussians_destroy(model);
}

static void init_refuses_what_is_not_finite(void **state)
{
    (void)state;
    const float points[] = {0, 0, 0, 1, NAN, 0};
    const unsigned char colors[6] = {0};
    sgs_gaussians *model = (sgs_gaussians *)state;
    assert_int_equal(sgs_gaussians_init_points(points, colors, 2, 1.0, &model),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_null(model);
    assert_string_equal(sgs_last_error(), "point 1 of the initial cloud is not finite; remove it");
    assert_int_equal(sgs_gaussians_init_points(points, colors, 1, 0.0, &model),
                     SGS_STATUS_INVALID_ARGUMENT);
    static const double scales[] = {NAN, -1, INFINITY, 1e300, 1.1e18};
    for (size_t k = 0; k < sizeof scales / sizeof *scales; ++k)
        assert_int_equal(sgs_gaussians_init_points(points, colors, 1, scales[k], &model),
                         SGS_STATUS_INVALID_ARGUMENT);
}

// Scales are finite for any scale of the scene, also of equal points.
static void init_scales_are_finite(void **state)
{
    (void)state;
    const float points[6] = {0};
    static const double scales[] = {1e-320, 1e-300, 1e-30, 1e18};
    for (size_t k = 0; k < sizeof scales / sizeof *scales; ++k)
        for (size_t n = 1; n <= 2; ++n) {
            sgs_gaussians *model;
            assert_int_equal(sgs_gaussians_init_points(points, NULL, n, scales[k], &model),
                             SGS_STATUS_OK);
            for (int c = 0; c < 3; ++c) {
                const float scale = *sgs_gaussians_at(model, n - 1, SGS_PARAM_SCALE + c);
                assert_true(scale >= -42 && scale <= 42);
            }
            sgs_gaussians_destroy(model);
        }
}

static void init_is_the_same_for_every_thread_count(void **state)
{
    (void)state;
    enum { COUNT = 30000 };
    static float points[3 * COUNT];
    static unsigned char colors[3 * COUNT];
    for (size_t i = 0; i < 3 * COUNT; ++i) {
        points[i] = (float)sgsi_random_normal(9, i);
        colors[i] = (unsigned char)sgsi_random_bits(10, i);
    }
    const int before = sgs_threads_get();
    char expected[17] = "", got[17];
    for (int threads = 1; threads <= 4; ++threads) {
        sgs_gaussians *model;
        sgs_threads_set(threads);
        assert_int_equal(sgs_gaussians_init_points(points, colors, COUNT, 1.0, &model),
                         SGS_STATUS_OK);
        sgs_gaussians_hash(model, threads == 1 ? expected : got);
        if (threads > 1)
            assert_string_equal(got, expected);
        sgs_gaussians_destroy(model);
    }
    sgs_threads_set(before);
}

static void hash_sees_every_bit_and_only_the_rows(void **state)
{
    (void)state;
    sgs_gaussians *model = random_model(33, 0), *wide = random_model(33, 5000);
    char base[17], other[17];
    sgs_gaussians_hash(model, base);
    assert_int_equal(strlen(base), 16);
    assert_int_equal(strspn(base, "0123456789abcdef"), 16);
    sgs_gaussians_hash(wide, other);
    assert_string_equal(base, other); // independent of capacity
    for (size_t i = 0; i < 33; ++i) {
        for (int k = 0; k < SGS_PARAM_COUNT; ++k) {
            uint32_t bits;
            float *at = sgs_gaussians_at(wide, i, k);
            memcpy(&bits, at, sizeof bits);
            bits ^= 1;
            memcpy(at, &bits, sizeof bits);
            sgs_gaussians_hash(wide, other);
            assert_string_not_equal(base, other);
            bits ^= 1;
            memcpy(at, &bits, sizeof bits);
        }
    }
    wide->sh_degree = 2;
    sgs_gaussians_hash(wide, other);
    assert_string_not_equal(base, other);
    wide->sh_degree = 3;
    assert_int_equal(sgs_gaussians_resize(wide, 34), SGS_STATUS_OK);
    sgs_gaussians_hash(wide, other);
    assert_string_not_equal(base, other);
    *sgs_gaussians_at(model, 32, 0) = 0.0f;
    sgs_gaussians_hash(model, base);
    *sgs_gaussians_at(model, 32, 0) = -0.0f;
    sgs_gaussians_hash(model, other);
    assert_string_not_equal(base, other); // bits, not values
    sgs_gaussians_destroy(model);
    sgs_gaussians_destroy(wide);
}

static void strided_copies_read_and_write_one_parameter(void **state)
{
    (void)state;
    enum { COUNT = 37, FIRST = 5, TAKEN = 23, ROW = SGS_PARAM_COUNT };
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(COUNT, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, COUNT), SGS_STATUS_OK);
    for (size_t i = 0; i < COUNT; ++i)
        for (int k = 0; k < ROW; ++k)
            *sgs_gaussians_at(model, i, k) = (float)(1000 * i) + (float)k;
    float rows[TAKEN][ROW], packed[TAKEN];
    for (int k = 0; k < ROW; ++k)
        assert_int_equal(sgs_gaussians_read(model, k, FIRST, TAKEN, &rows[0][k], sizeof rows[0]),
                         SGS_STATUS_OK);
    for (size_t i = 0; i < TAKEN; ++i)
        for (int k = 0; k < ROW; ++k)
            assert_true(rows[i][k] == (float)(1000 * (FIRST + i)) + (float)k);
    assert_int_equal(sgs_gaussians_read(model, SGS_PARAM_OPACITY, FIRST, TAKEN, packed, 0),
                     SGS_STATUS_OK);
    assert_true(packed[3] == rows[3][SGS_PARAM_OPACITY]);
    for (size_t i = 0; i < TAKEN; ++i)
        packed[i] = -(float)i - 1;
    assert_int_equal(sgs_gaussians_write(model, SGS_PARAM_SCALE, FIRST, TAKEN, packed, 0),
                     SGS_STATUS_OK);
    for (size_t i = 0; i < COUNT; ++i)
        for (int k = 0; k < ROW; ++k) {
            const bool written = k == SGS_PARAM_SCALE && i >= FIRST && i < FIRST + TAKEN;
            assert_true(*sgs_gaussians_at(model, i, k) ==
                        (written ? -(float)(i - FIRST) - 1 : (float)(1000 * i) + (float)k));
        }
    assert_int_equal(sgs_gaussians_read(model, ROW, 0, 1, packed, 0), SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_gaussians_read(model, -1, 0, 1, packed, 0), SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_gaussians_read(model, 0, COUNT, 0, packed, 0), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_read(model, 0, COUNT, 1, packed, 0),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_gaussians_write(model, 0, 1, SIZE_MAX, packed, 0),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_gaussians_read(model, 0, 0, 2, packed, 3), SGS_STATUS_INVALID_ARGUMENT);
    sgs_gaussians_destroy(model);
}

static void a_copy_is_equal_whatever_was_there(void **state)
{
    (void)state;
    sgs_gaussians *from = random_model(37, 40);
    from->sh_degree = 1;
    static const size_t counts[] = {0, 5, 37, 300};
    for (size_t c = 0; c < sizeof counts / sizeof *counts; ++c) {
        sgs_gaussians *to = random_model(counts[c], counts[c]);
        assert_int_equal(sgs_gaussians_copy(to, from), SGS_STATUS_OK);
        char expected[17], actual[17];
        sgs_gaussians_hash(from, expected);
        sgs_gaussians_hash(to, actual);
        assert_string_equal(actual, expected);
        assert_int_equal(to->count, 37);
        assert_int_equal(to->sh_degree, 1);
        assert_inert(to, 37);
        sgs_gaussians_destroy(to);
    }
    sgs_gaussians_destroy(from);
}

static void opacities_are_stored_as_logits(void **state)
{
    (void)state;
    static const float logits[] = {-30, -4.5f, 0, 1.25f, 7};
    static const double linear[] = {0.25, 0.5, 0.75, 1, 1.5};
    static const double expected[] = {-1.0986122886681098, 0, 1.0986122886681098,
                                      13.815509557963774, 13.815509557963774}; // of 1 - 1e-6
    sgs_gaussians *model = random_model(5, 16);
    for (size_t i = 0; i < 5; ++i) {
        *sgs_gaussians_at(model, i, SGS_PARAM_OPACITY) = logits[i];
        assert_true(sgs_gaussians_opacity_logit(model, i) == logits[i]);
    }
    sgs_gaussians_linearize_opacity(model);
    assert_true(model->linear_opacity);
    for (size_t i = 1; i < 5; ++i) {
        const double opacity = 1 / (1 + exp(-(double)logits[i]));
        assert_true(fabs((double)*sgs_gaussians_at(model, i, SGS_PARAM_OPACITY) - opacity) < 1e-7);
        assert_true(fabs((double)(sgs_gaussians_opacity_logit(model, i) - logits[i])) < 1e-3);
    }
    for (size_t i = 0; i < 5; ++i) {
        *sgs_gaussians_at(model, i, SGS_PARAM_OPACITY) = (float)linear[i];
        assert_true(fabs((double)sgs_gaussians_opacity_logit(model, i) - expected[i]) < 1e-6);
    }
    sgs_gaussians_destroy(model);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(gaussians_start_empty_aligned_and_inert),
        cmocka_unit_test(gaussians_layout_is_blocks_of_sixteen),
        cmocka_unit_test(gaussians_keep_rows_and_inert_tail_through_resizes),
        cmocka_unit_test(gaussians_survive_lack_of_memory),
        cmocka_unit_test(init_follows_3dgs),
        cmocka_unit_test(init_without_colours_is_grey),
        cmocka_unit_test(init_leaves_missing_neighbours_out),
        cmocka_unit_test(init_clamps_duplicates),
        cmocka_unit_test(init_refuses_what_is_not_finite),
        cmocka_unit_test(init_scales_are_finite),
        cmocka_unit_test(init_is_the_same_for_every_thread_count),
        cmocka_unit_test(hash_sees_every_bit_and_only_the_rows),
        cmocka_unit_test(strided_copies_read_and_write_one_parameter),
        cmocka_unit_test(a_copy_is_equal_whatever_was_there),
        cmocka_unit_test(opacities_are_stored_as_logits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
