// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The Fisher matrices of PUP against finite differences of the reference renderer in double
// precision, for each pixel filter and three backgrounds; the same bits with any number of threads
// and instruction set; the log determinant against matrices with known eigenvalues.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/core.h"
#include "base/threads.h"
#include "prune/fisher.h"
#include "sparegs/prune.h"
#include "sparegs/runtime.h"
#include "support/prune_support.h"

enum { COUNT = 52, WIDTH = 41, HEIGHT = 35 };

static int one_thread(void **state)
{
    (void)state;
    sgsi_threads_set(1);
    return 0;
}

typedef double matrix6[SGSI_FISHER_ENTRIES];

static const float black[3];

static const int entry_parameters[6] = {SGS_PARAM_MEAN,  SGS_PARAM_MEAN + 1,  SGS_PARAM_MEAN + 2,
                                        SGS_PARAM_SCALE, SGS_PARAM_SCALE + 1, SGS_PARAM_SCALE + 2};

static void render(const oracle_scene *model, const sgs_camera *camera, const sgs_pose *pose,
                   const sgs_render_options *options, sgs_reference_frame *frame)
{
    if (sgs_reference_render(model->params, model->count, camera, pose, options, frame))
        fail_msg("%s", sgs_last_error());
}

// Central differences of the image of one view by the six parameters of primitive i: adds their
// outer products. Returns the number of pixels where a hit appeared or vanished.
static size_t add_differences(const oracle_scene *model, size_t i, const sgs_camera *camera,
                              const sgs_pose *pose, const sgs_render_options *options,
                              const float background[3], matrix6 fisher)
{
    static const double step = 2e-6;
    sgs_reference_frame frames[6][2];
    const size_t pixels = (size_t)camera->width * (size_t)camera->height;
    size_t jumps = 0;
    for (int k = 0; k < 6; ++k) {
        double *value = oracle_primitive(model, i) + entry_parameters[k];
        const double kept = *value;
        for (int side = 0; side < 2; ++side) {
            *value = kept + (side ? step : -step);
            assert_int_equal(
                sgs_reference_frame_create(camera->width, camera->height, &frames[k][side]), 0);
            render(model, camera, pose, options, &frames[k][side]);
        }
        *value = kept;
        for (size_t p = 0; p < pixels; ++p)
            jumps += frames[k][0].hits[p] != frames[k][1].hits[p];
    }
    for (size_t p = 0; p < pixels; ++p)
        for (int c = 0; c < 3; ++c) {
            double g[6];
            for (int k = 0; k < 6; ++k)
                g[k] = (frames[k][1].color[c][p] - frames[k][0].color[c][p] +
                        (double)background[c] *
                            (frames[k][1].transmittance[p] - frames[k][0].transmittance[p])) /
                       (2 * step);
            for (int a = 0, at = 0; a < 6; ++a)
                for (int b = a; b < 6; ++b, ++at)
                    fisher[at] += g[a] * g[b];
        }
    for (int k = 0; k < 6; ++k)
        for (int side = 0; side < 2; ++side)
            sgs_reference_frame_free(&frames[k][side]);
    return jumps;
}

static double diagonal(const matrix6 fisher, int k)
{
    static const int at[6] = {0, 6, 11, 15, 18, 20};
    return fisher[at[k]];
}

// The largest difference relative to the diagonals; NaN is kept.
static double worst_error(const matrix6 actual, const matrix6 expected)
{
    double worst = 0;
    for (int a = 0, at = 0; a < 6; ++a)
        for (int b = a; b < 6; ++b, ++at) {
            const double norm = sqrt(diagonal(expected, a) * diagonal(expected, b));
            const double error = fabs(actual[at] - expected[at]) / norm;
            worst = isnan(worst) || error <= worst ? worst : error;
        }
    return worst;
}

// Compares every `stride`-th primitive; with an odd stride these are in all lanes.
static void matrices_equal_finite_differences(sgs_filter filter, uint64_t seed,
                                              const float background[3], size_t stride)
{
    const oracle_range range = {0.8, 0.06, 0.3, 0.1, 0.9, 0.15};
    oracle_scene model = oracle_random_model(seed, COUNT, &range);
    sgs_scene *scene = prune_scene(WIDTH, HEIGHT);
    sgs_view_pass_options options = sgs_view_pass_options_default();
    const sgs_render_options render = oracle_render_options(filter, 3, model.filter_3d);
    options.render = &render;
    matrix6 *actual = oracle_memory(COUNT, sizeof *actual);
    assert_int_equal(sgsi_fisher_sums(model.model, scene, &options, background, actual), 0);
    size_t compared = 0, differentiated = 0;
    for (size_t i = 0; i < COUNT; i += stride) {
        matrix6 expected = {0};
        size_t jumps = 0;
        ++differentiated;
        for (size_t v = 0; v < scene->view_count; ++v)
            if (scene->views[v].split == SGS_SPLIT_TRAIN)
                jumps += add_differences(&model, i, &scene->views[v].camera, &scene->views[v].pose,
                                         &render, background, expected);
        if (jumps) // not differentiable there
            continue;
        const double error = worst_error(actual[i], expected);
        if (!(error <= 1e-6))
            fail_msg("primitive %zu: relative error %g", i, error);
        ++compared;
    }
    assert_true(compared + (stride > 1 ? 1 : 2) >= differentiated);
    free(actual);
    sgs_scene_destroy(scene);
    oracle_scene_free(&model);
}

// Q diag(values) Q^T for a rotation Q of all axes: the eigenvalues are known.
static void rotated(const double values[6], matrix6 fisher)
{
    double q[6][6] = {{0}};
    for (int k = 0; k < 6; ++k)
        q[k][k] = 1;
    for (int a = 0; a < 6; ++a)
        for (int b = a + 1; b < 6; ++b) {
            const double angle = 0.3 + a + 2 * b, c = cos(angle), s = sin(angle);
            for (int row = 0; row < 6; ++row) {
                const double x = q[row][a], y = q[row][b];
                q[row][a] = c * x - s * y;
                q[row][b] = s * x + c * y;
            }
        }
    for (int a = 0, at = 0; a < 6; ++a)
        for (int b = a; b < 6; ++b, ++at) {
            fisher[at] = 0;
            for (int k = 0; k < 6; ++k)
                fisher[at] += q[a][k] * values[k] * q[b][k];
        }
}

static void planted_errors_are_found(void **state)
{
    (void)state;
    matrix6 right, wrong;
    const double values[6] = {1e3, 7, 0.02, 5e4, 3e-3, 12};
    rotated(values, right);
    for (int k = 0; k < SGSI_FISHER_ENTRIES; ++k) {
        memcpy(wrong, right, sizeof wrong);
        wrong[k] *= -1;
        assert_true(worst_error(wrong, right) > 1e-6);
        wrong[k] = NAN;
        assert_false(worst_error(wrong, right) <= 1e-6);
    }
    assert_true(worst_error(right, right) == 0);
}

static void matrices_equal_finite_differences_3dgs(void **state)
{
    (void)state;
    matrices_equal_finite_differences(SGS_FILTER_3DGS, 31, black, 1);
}

static void matrices_equal_finite_differences_none(void **state)
{
    (void)state;
    matrices_equal_finite_differences(SGS_FILTER_NONE, 32, black, 3);
}

static void matrices_equal_finite_differences_mip(void **state)
{
    (void)state;
    matrices_equal_finite_differences(SGS_FILTER_MIP, 33, black, 3);
}

static void matrices_equal_finite_differences_white(void **state)
{
    (void)state;
    const float white[3] = {1, 1, 1};
    matrices_equal_finite_differences(SGS_FILTER_3DGS, 34, white, 3);
}

static void matrices_equal_finite_differences_blue(void **state)
{
    (void)state;
    const float blue[3] = {0.2f, 0.4f, 0.9f};
    matrices_equal_finite_differences(SGS_FILTER_MIP, 33, blue, 3);
}

static void the_bits_depend_on_neither_threads_nor_instructions(void **state)
{
    (void)state;
    oracle_scene model = oracle_random_model(4, 400, NULL);
    sgs_scene *scene = prune_scene(83, 61);
    matrix6 *first = oracle_memory(400, sizeof *first), *other = oracle_memory(400, sizeof *other);
    const sgs_view_pass_options options = sgs_view_pass_options_default();
    assert_int_equal(sgsi_fisher_sums(model.model, scene, &options, black, first), 0);
    for (int threads = 2; threads <= 5; threads += 3) {
        sgsi_threads_set(threads);
        assert_int_equal(sgsi_fisher_sums(model.model, scene, &options, black, other), 0);
        assert_memory_equal(first, other, 400 * sizeof *first);
    }
    sgsi_threads_set(1);
    const sgs_isa best = sgs_isa_get();
    if (best > SGS_ISA_AVX2) {
        assert_int_equal(sgs_isa_set(SGS_ISA_AVX2), 0);
        assert_int_equal(sgsi_fisher_sums(model.model, scene, &options, black, other), 0);
        assert_memory_equal(first, other, 400 * sizeof *first);
        assert_int_equal(sgs_isa_set(best), 0);
    }
    free(first);
    free(other);
    sgs_scene_destroy(scene);
    oracle_scene_free(&model);
}

static void the_log_determinant_is_the_sum_over_the_eigenvalues(void **state)
{
    (void)state;
    const double values[6] = {1e3, 7, 0.02, 5e4, 3e-3, 12};
    matrix6 fisher;
    double expected = 0;
    rotated(values, fisher);
    for (int k = 0; k < 6; ++k)
        expected += log(values[k]);
    assert_true(fabs(sgsi_fisher_log_det(fisher) - expected) < 1e-8);
    // Singular matrices have a finite score below that of regular ones; an unseen one is lowest.
    const double singular[6] = {1e3, 7, 0.02, 5e4, 0, 0};
    const matrix6 unseen = {0};
    matrix6 flat;
    rotated(singular, flat);
    assert_true(isfinite(sgsi_fisher_log_det(flat)) && isfinite(sgsi_fisher_log_det(unseen)));
    assert_true(sgsi_fisher_log_det(flat) < expected - 30);
    assert_true(sgsi_fisher_log_det(unseen) < sgsi_fisher_log_det(flat) - 1000);
}

static void scores_use_the_reduced_size_and_the_background(void **state)
{
    (void)state;
    oracle_scene model = oracle_random_model(4, COUNT, NULL);
    sgs_scene *scene = prune_scene(WIDTH, HEIGHT);
    sgs_prune_options options = sgs_prune_options_default();
    options.method = SGS_PRUNE_PUP;
    options.scene = scene;
    options.fisher_downscale = 2;
    options.background[1] = 0.7f;
    double scores[COUNT];
    matrix6 *sums = oracle_memory(COUNT, sizeof *sums);
    assert_int_equal(sgs_prune_scores(model.model, &options, scores), 0);
    sgs_view_pass_options views = sgs_view_pass_options_default();
    views.downscale = 2;
    assert_int_equal(sgsi_fisher_sums(model.model, scene, &views, options.background, sums), 0);
    for (size_t i = 0; i < COUNT; ++i)
        assert_true(scores[i] == sgsi_fisher_log_det(sums[i]));
    free(sums);
    sgs_scene_destroy(scene);
    oracle_scene_free(&model);
}

static void running_out_of_memory_is_an_error(void **state)
{
    (void)state;
    oracle_scene model = oracle_random_model(4, COUNT, NULL);
    sgs_scene *scene = prune_scene(WIDTH, HEIGHT);
    sgs_prune_options options = sgs_prune_options_default();
    options.method = SGS_PRUNE_PUP;
    options.scene = scene;
    double scores[COUNT];
    size_t n = 1;
    for (; n < 200; ++n) {
        sgsi_fail_allocation(n);
        const sgs_status status = sgs_prune_scores(model.model, &options, scores);
        sgsi_fail_allocation(0);
        if (!status)
            break;
        assert_int_equal(status, SGS_STATUS_OUT_OF_MEMORY);
    }
    assert_in_range(n, 10, 199);
    sgs_scene_destroy(scene);
    oracle_scene_free(&model);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(planted_errors_are_found),
        cmocka_unit_test(matrices_equal_finite_differences_3dgs),
        cmocka_unit_test(matrices_equal_finite_differences_none),
        cmocka_unit_test(matrices_equal_finite_differences_mip),
        cmocka_unit_test(matrices_equal_finite_differences_white),
        cmocka_unit_test(matrices_equal_finite_differences_blue),
        cmocka_unit_test(the_bits_depend_on_neither_threads_nor_instructions),
        cmocka_unit_test(the_log_determinant_is_the_sum_over_the_eigenvalues),
        cmocka_unit_test(scores_use_the_reduced_size_and_the_background),
        cmocka_unit_test(running_out_of_memory_is_an_error),
    };
    return cmocka_run_group_tests(tests, one_thread, NULL);
}
