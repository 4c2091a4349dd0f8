// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Contributions against the hits of the reference renderer; LightGaussian's and REFINE's scores
// against the formulas written out; the selection rules; the random subset against Python's.

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
#include "prune/scores.h"
#include "sparegs/prune.h"
#include "support/prune_support.h"

enum { COUNT = 150, WIDTH = 45, HEIGHT = 37 };

static int one_thread(void **state)
{
    (void)state;
    sgsi_threads_set(1);
    return 0;
}

static bool is_near(double value, double wanted, double tolerance)
{
    return fabs(value - wanted) <= tolerance * (1 + fabs(wanted));
}

// The contributions by the reference renderer. In the model of this seed no two hits of a ray have
// distances that round to the same float, where the tracer may order them in another way.
static void expect_contributions(const oracle_scene *model, const sgs_scene *scene,
                                 const sgs_render_options *options, int downscale,
                                 sgs_contribution *expected)
{
    sgs_hit *hits = oracle_memory(model->count, sizeof *hits);
    for (size_t v = 0; v < scene->view_count; ++v) {
        const sgs_view *view = &scene->views[v];
        if (view->split != SGS_SPLIT_TRAIN)
            continue;
        const sgs_camera camera =
            sgs_camera_resized(&view->camera, (view->camera.width + downscale - 1) / downscale,
                               (view->camera.height + downscale - 1) / downscale);
        bool *seen = oracle_memory(model->count, sizeof *seen);
        for (int y = 0; y < camera.height; ++y)
            for (int x = 0; x < camera.width; ++x) {
                const size_t n = oracle_hits(model->params, model->count, &camera, &view->pose,
                                             options, x, y, hits, model->count);
                for (size_t k = 0; k < n; ++k) {
                    const size_t i = hits[k].primitive;
                    const double logit = model->params[i * SGS_PARAM_COUNT + SGS_PARAM_OPACITY];
                    expected[i].weight += hits[k].transmittance * hits[k].alpha;
                    expected[i].front += hits[k].transmittance / (1 + exp(-logit));
                    expected[i].hits += 1;
                    expected[i].views += !seen[i];
                    seen[i] = true;
                }
            }
        free(seen);
    }
    free(hits);
}

static void contributions_are_those_of_the_reference(void **state)
{
    (void)state;
    oracle_scene model = oracle_random_model(12, COUNT, NULL);
    sgs_scene *scene = prune_scene(WIDTH, HEIGHT);
    for (int downscale = 1; downscale <= 2; ++downscale) {
        sgs_view_pass_options options = sgs_view_pass_options_default();
        options.downscale = downscale;
        const sgs_render_options render = sgs_render_options_default();
        options.render = downscale == 1 ? NULL : &render;
        sgs_contribution *expected = oracle_memory(COUNT, sizeof *expected);
        sgs_contribution *actual = oracle_memory(COUNT, sizeof *actual);
        expect_contributions(&model, scene, &render, downscale, expected);
        assert_int_equal(sgs_contributions(model.model, scene, &options, actual), 0);
        size_t seen = 0;
        for (size_t i = 0; i < COUNT; ++i) {
            seen += expected[i].hits > 0;
            if (!is_near(actual[i].weight, expected[i].weight, 1e-4) ||
                !is_near(actual[i].front, expected[i].front, 1e-4) ||
                actual[i].hits != expected[i].hits || actual[i].views != expected[i].views)
                fail_msg("primitive %zu: %g %g %g %u, not %g %g %g %u", i, actual[i].weight,
                         actual[i].front, actual[i].hits, actual[i].views, expected[i].weight,
                         expected[i].front, expected[i].hits, expected[i].views);
        }
        assert_true(seen > COUNT / 2);
        free(expected);
        free(actual);
    }
    sgs_scene_destroy(scene);
    oracle_scene_free(&model);
}

// In a small scene, primitives closer than the default near distance of 0.2 count.
static void the_near_distance_is_that_of_the_scene(void **state)
{
    (void)state;
    oracle_scene model = oracle_random_model(12, 10, NULL);
    sgs_scene *scene = prune_scene(WIDTH, HEIGHT);
    double center[3];
    for (size_t k = 1; k < scene->view_count; ++k)
        scene->views[k].split = SGS_SPLIT_TEST;
    sgs_pose_center(&scene->views[0].pose, center);
    const double share =
        1 - 0.1 / sqrt(center[0] * center[0] + center[1] * center[1] + center[2] * center[2]);
    oracle_set_ball(oracle_primitive(&model, 3), share * center[0], share * center[1],
                    share * center[2], 0.01, 0.5); // 0.1 in front of the camera
    oracle_scene_round(&model);
    sgs_contribution sums[10];
    static const double extents[] = {0.05, 0.45, 0.55, 2}; // near distances 0.01, 0.09, 0.11, 0.2
    for (size_t k = 0; k < sizeof extents / sizeof *extents; ++k) {
        scene->extent = extents[k];
        assert_int_equal(sgs_contributions(model.model, scene, NULL, sums), 0);
        assert_true((sums[3].hits > 0) == (k < 2));
    }
    sgs_view_pass_options options = sgs_view_pass_options_default();
    const sgs_render_options render = sgs_render_options_default();
    options.render = &render; // the caller's near distance is kept
    scene->extent = 0.05;
    assert_int_equal(sgs_contributions(model.model, scene, &options, sums), 0);
    assert_true(sums[3].hits == 0);
    sgs_scene_destroy(scene);
    oracle_scene_free(&model);
}

static void lightgaussian_weighs_by_the_volume(void **state)
{
    (void)state;
    oracle_scene model = oracle_random_model(12, COUNT, NULL);
    sgs_scene *scene = prune_scene(WIDTH, HEIGHT);
    sgs_prune_options options = sgs_prune_options_default();
    options.scene = scene;
    sgs_contribution sums[COUNT];
    double scores[COUNT], volumes[COUNT];
    assert_int_equal(sgs_contributions(model.model, scene, NULL, sums), 0);
    assert_int_equal(sgs_prune_scores(model.model, &options, scores), 0);
    for (size_t i = 0; i < COUNT; ++i) {
        const double *s = model.params + i * SGS_PARAM_COUNT + SGS_PARAM_SCALE;
        volumes[i] = exp(s[0]) * exp(s[1]) * exp(s[2]);
    }
    for (size_t i = 0; i < COUNT; ++i) { // the volume with 135 of 150 larger ones
        size_t larger = 0;
        for (size_t k = 0; k < COUNT; ++k)
            larger += volumes[k] > volumes[i];
        if (larger != 135)
            continue;
        for (size_t k = 0; k < COUNT; ++k)
            assert_true(
                is_near(scores[k], sums[k].front * pow(volumes[k] / volumes[i], 0.1), 1e-9));
        sgs_scene_destroy(scene);
        oracle_scene_free(&model);
        return;
    }
    fail_msg("no volume has rank 135");
}

// The formulas of the paper for a model and cameras, without blocks, logarithms or threads.
static void refine_formula(const oracle_scene *model, const double (*cameras)[3], size_t count,
                           double *scores)
{
    const size_t n = model->count;
    double(*f)[5] = oracle_memory(n, sizeof *f); // Y, o, S_geo, S_color, S_opa
    double mean_y = 0, var_y = 0, mean_o = 0, mean_g = 0, mean_s[3] = {0};
    for (size_t i = 0; i < n; ++i) {
        const double *p = model->params + i * SGS_PARAM_COUNT;
        double rgb[3], s[3], h = 0;
        for (int k = 0; k < 3; ++k) {
            rgb[k] = fmin(fmax(0.28209479177387814 * p[SGS_PARAM_SH_DC + k] + 0.5, 0), 1);
            s[k] = exp(p[SGS_PARAM_SCALE + k]);
        }
        for (int pass = 0; pass < 2; ++pass) // descending
            for (int k = 0; k < 2; ++k)
                if (s[k] < s[k + 1]) {
                    const double kept = s[k];
                    s[k] = s[k + 1];
                    s[k + 1] = kept;
                }
        const double y = 0.299 * rgb[0] + 0.587 * rgb[1] + 0.114 * rgb[2];
        const double o = 1 / (1 + exp(-p[SGS_PARAM_OPACITY]));
        for (size_t c = 0; c < count; ++c) {
            double d2 = 0;
            for (int k = 0; k < 3; ++k)
                d2 += (p[k] - cameras[c][k]) * (p[k] - cameras[c][k]);
            h += o / (double)count / (fmax(d2, 1e-6) + 0.5);
        }
        mean_y += y / (double)n;
        mean_o += 4 * o * (1 - o) / (double)n;
        mean_g += s[0] / (s[2] + 1e-6) / (double)n;
        const double row[5] = {y, o, h * s[0] * s[1], h * y * y, h * o * o};
        memcpy(f[i], row, sizeof row);
        for (int k = 0; k < 3; ++k)
            mean_s[k] += row[2 + k] / (double)n;
    }
    for (size_t i = 0; i < n; ++i)
        var_y += (f[i][0] - mean_y) * (f[i][0] - mean_y) / (double)(n - 1);
    double w[3] = {log(mean_g + 1e-6) / 10.73, 100 * var_y / 56.06, 100 * mean_o / 100.67};
    const double norm = fabs(w[0]) + fabs(w[1]) + fabs(w[2]);
    for (size_t i = 0; i < n; ++i) {
        scores[i] = 0;
        for (int k = 0; k < 3; ++k)
            scores[i] += w[k] / norm * f[i][2 + k] / (mean_s[k] + 1e-8);
    }
    free(f);
}

static void refine_is_its_closed_form(void **state)
{
    (void)state;
    oracle_scene model = oracle_random_model(5, 5000, NULL); // more than one block
    double cameras[7][3], expected[5000], scores[5000], again[5000];
    for (int k = 0; k < 21; ++k)
        cameras[k / 3][k % 3] = 4 * sgsi_random_uniform(9, (uint64_t)k) - 2;
    sgs_prune_options options = sgs_prune_options_default();
    options.method = SGS_PRUNE_REFINE;
    options.cameras = (const double(*)[3])cameras;
    options.camera_count = 7;
    refine_formula(&model, options.cameras, 7, expected);
    assert_int_equal(sgs_prune_scores(model.model, &options, scores), 0);
    for (size_t i = 0; i < model.count; ++i)
        if (!(fabs(scores[i] - expected[i]) <= 2e-6 * expected[i])) // the opacity is a float
            fail_msg("primitive %zu: %g, not %g", i, scores[i], expected[i]);
    sgsi_threads_set(3);
    assert_int_equal(sgs_prune_scores(model.model, &options, again), 0);
    sgsi_threads_set(1);
    assert_memory_equal(scores, again, sizeof scores);
    oracle_scene_free(&model);
}

// random.Random(42).sample(range(n), 64): the first six, and the sum of (position + 1) * value.
static void the_subset_of_cameras_is_that_of_python(void **state)
{
    (void)state;
    static const struct {
        size_t count, first[6], sum;
    } cases[] = {{65, {14, 3, 47, 17, 15, 64}, 68287},
                 {100, {81, 14, 3, 94, 35, 31}, 99362},
                 {277, {57, 12, 140, 125, 114, 71}, 256797},
                 {278, {57, 12, 140, 125, 114, 71}, 277868},
                 {1000, {654, 114, 25, 759, 281, 250}, 1002136}};
    for (size_t c = 0; c < sizeof cases / sizeof *cases; ++c) {
        size_t chosen[64], sum = 0;
        assert_int_equal(sgsi_refine_sample(cases[c].count, 64, chosen), 0);
        for (size_t k = 0; k < 64; ++k)
            sum += (k + 1) * chosen[k];
        assert_memory_equal(chosen, cases[c].first, sizeof cases[c].first);
        assert_int_equal(sum, cases[c].sum);
    }
}

static void the_share_is_removed_by_the_rule_of_the_method(void **state)
{
    (void)state;
    const double scores[10] = {5, 0, 3, 0, 8, 0, 1, 9, 0, 7};
    bool keep[10];
    size_t kept;
    // Threshold: rank int(0.3 * 9) = 2 has score 0, and all four zeros fall.
    assert_int_equal(sgs_prune_select(SGS_PRUNE_LIGHTGAUSSIAN, scores, 10, 0.3, keep, &kept), 0);
    assert_int_equal(kept, 6);
    assert_true(keep[0] && !keep[1] && !keep[3] && !keep[5] && keep[6] && !keep[8]);
    // Number: three, the first rows of equal scores.
    assert_int_equal(sgs_prune_select(SGS_PRUNE_REFINE, scores, 10, 0.3, keep, &kept), 0);
    assert_int_equal(kept, 7);
    assert_true(!keep[1] && !keep[3] && !keep[5] && keep[8] && keep[6]);
    // REFINE rounds the number of removed primitives down, RAP that of kept ones.
    assert_int_equal(sgs_prune_select(SGS_PRUNE_REFINE, scores, 10, 0.55, keep, &kept), 0);
    assert_int_equal(kept, 5);
    assert_int_equal(sgs_prune_select(SGS_PRUNE_RAP, scores, 10, 0.55, keep, &kept), 0);
    assert_int_equal(kept, 4);
    assert_int_equal(sgs_prune_select(SGS_PRUNE_RAP, scores, 10, 0.9, keep, &kept), 0);
    assert_int_equal(kept, 1);
    assert_int_equal(sgs_prune_select(SGS_PRUNE_RAP, scores, 10, 0.3, keep, &kept), 0);
    assert_int_equal(kept, 7);
    assert_int_equal(sgs_prune_select(SGS_PRUNE_REFINE, scores, 10, 0, keep, &kept), 0);
    assert_int_equal(kept, 10);
    assert_int_equal(sgs_prune_select(SGS_PRUNE_LIGHTGAUSSIAN, scores, 10, 0, keep, &kept), 0);
    assert_int_equal(kept, 10);
    assert_int_equal(sgs_prune_select(SGS_PRUNE_REFINE, scores, 10, 1, keep, &kept), 0);
    assert_int_equal(kept, 0);
    assert_int_equal(sgs_prune_select(SGS_PRUNE_REFINE, scores, 0, 0.5, keep, &kept), 0);
    assert_int_equal(kept, 0);
    const double broken[2] = {1, NAN};
    assert_int_equal(sgs_prune_select(SGS_PRUNE_REFINE, broken, 2, 0.5, keep, &kept),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_prune_select(SGS_PRUNE_REFINE, scores, 10, 1.01, keep, &kept),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_prune_select(SGS_PRUNE_REFINE, scores, 10, NAN, keep, &kept),
                     SGS_STATUS_INVALID_ARGUMENT);
}

static void kept_rows_are_unchanged_and_in_order(void **state)
{
    (void)state;
    oracle_scene model = oracle_random_model(2, 40, NULL);
    bool keep[40];
    for (size_t i = 0; i < 40; ++i)
        keep[i] = i % 3 == 1;
    sgs_gaussians *pruned;
    assert_int_equal(sgs_gaussians_keep(model.model, keep, &pruned), 0);
    assert_int_equal(pruned->count, 13);
    for (size_t i = 0; i < 13; ++i) {
        float a[SGS_PARAM_COUNT], b[SGS_PARAM_COUNT];
        sgs_gaussians_get(pruned, i, a);
        sgs_gaussians_get(model.model, 3 * i + 1, b);
        assert_memory_equal(a, b, sizeof a);
    }
    sgs_gaussians_destroy(pruned);
    oracle_scene_free(&model);
}

static bool cancel(void *user, size_t done, size_t total)
{
    assert_int_equal(total, PRUNE_VIEWS);
    return done < *(size_t *)user;
}

static void missing_inputs_and_cancellation_are_reported(void **state)
{
    (void)state;
    oracle_scene model = oracle_random_model(2, 40, NULL);
    sgs_scene *scene = prune_scene(WIDTH, HEIGHT);
    double scores[40];
    sgs_prune_options options = sgs_prune_options_default();
    assert_int_equal(sgs_prune_scores(model.model, &options, scores), SGS_STATUS_INVALID_ARGUMENT);
    options.method = SGS_PRUNE_REFINE;
    assert_int_equal(sgs_prune_scores(model.model, &options, scores), SGS_STATUS_INVALID_ARGUMENT);
    options.method = (sgs_prune_method)77;
    assert_int_equal(sgs_prune_scores(model.model, &options, scores), SGS_STATUS_INVALID_ARGUMENT);
    options = sgs_prune_options_default();
    options.scene = scene;
    sgs_view_pass_options views = sgs_view_pass_options_default();
    options.views = &views;
    views.downscale = 0;
    assert_int_equal(sgs_prune_scores(model.model, &options, scores), SGS_STATUS_INVALID_ARGUMENT);
    views.downscale = 1;
    options.method = SGS_PRUNE_PUP;
    options.background[2] = NAN;
    assert_int_equal(sgs_prune_scores(model.model, &options, scores), SGS_STATUS_INVALID_ARGUMENT);
    assert_string_equal(sgs_last_error(), "background nan is not finite");
    options = sgs_prune_options_default();
    options.scene = scene;
    options.views = &views;
    size_t limit = 2;
    views.progress = cancel;
    views.progress_user = &limit;
    assert_int_equal(sgs_prune_scores(model.model, &options, scores), SGS_STATUS_CANCELLED);
    assert_string_equal(sgs_last_error(), "cancelled after 2 of 3 views");
    limit = 9;
    assert_int_equal(sgs_prune_scores(model.model, &options, scores), 0);
    for (size_t i = 0; i < scene->view_count; ++i)
        scene->views[i].split = SGS_SPLIT_TEST;
    assert_int_equal(sgs_prune_scores(model.model, &options, scores), SGS_STATUS_INVALID_ARGUMENT);
    sgs_scene_destroy(scene);
    oracle_scene_free(&model);
}

static void models_that_are_not_finite_are_refused(void **state)
{
    (void)state;
    oracle_scene model = oracle_random_model(2, 40, NULL);
    sgs_scene *scene = prune_scene(WIDTH, HEIGHT);
    const double cameras[1][3] = {{0, 0, -4}};
    double scores[40];
    sgs_prune_options options = sgs_prune_options_default();
    options.scene = scene;
    options.cameras = cameras;
    options.camera_count = 1;
    options.fisher_downscale = 1;
    static const sgs_prune_method methods[] = {SGS_PRUNE_LIGHTGAUSSIAN, SGS_PRUNE_REFINE,
                                               SGS_PRUNE_PUP};
    for (size_t m = 0; m < sizeof methods / sizeof *methods; ++m) {
        options.method = methods[m];
        *sgs_gaussians_at(model.model, 7, SGS_PARAM_OPACITY) = INFINITY; // opacity 1
        if (sgs_prune_scores(model.model, &options, scores))
            fail_msg("method %d: %s", (int)methods[m], sgs_last_error());
        for (size_t i = 0; i < 40; ++i)
            assert_true(isfinite(scores[i]));
        float *at = sgs_gaussians_at(model.model, 33, SGS_PARAM_MEAN + 2);
        const float kept = *at;
        *at = INFINITY;
        assert_int_equal(sgs_prune_scores(model.model, &options, scores),
                         SGS_STATUS_INVALID_ARGUMENT);
        assert_string_equal(sgs_last_error(),
                            "primitive 33 has a parameter that is not finite; remove it");
        *at = kept;
    }
    sgs_gaussians_linearize_opacity(model.model);
    *sgs_gaussians_at(model.model, 7, SGS_PARAM_OPACITY) = INFINITY; // no opacity
    assert_int_equal(sgs_prune_scores(model.model, &options, scores), SGS_STATUS_INVALID_ARGUMENT);
    sgs_scene_destroy(scene);
    oracle_scene_free(&model);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(contributions_are_those_of_the_reference),
        cmocka_unit_test(the_near_distance_is_that_of_the_scene),
        cmocka_unit_test(lightgaussian_weighs_by_the_volume),
        cmocka_unit_test(refine_is_its_closed_form),
        cmocka_unit_test(the_subset_of_cameras_is_that_of_python),
        cmocka_unit_test(the_share_is_removed_by_the_rule_of_the_method),
        cmocka_unit_test(kept_rows_are_unchanged_and_in_order),
        cmocka_unit_test(missing_inputs_and_cancellation_are_reported),
        cmocka_unit_test(models_that_are_not_finite_are_refused),
    };
    return cmocka_run_group_tests(tests, one_thread, NULL);
}
