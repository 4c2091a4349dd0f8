// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The base pipelines other than 3DGS: sums over views against the oracle, the shared selections
// against sorting and expected frequencies, and the rules of each pipeline on models small enough
// to predict each row.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "base/compare.h"
#include "density/density.h"
#include "density/pipeline.h"
#include "density/plane_range.h"
#include "spare/spare.h"
#include "reference/reference.h"
#include "support/density_support.h"
#include "support/tracer_support.h"

// ---- Sums over views ----

static void score_sums_match_the_oracle(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(3, 120, NULL);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 37, 29);
    const sgs_pose pose = oracle_pose_look_at(1, -0.5, -4);
    traced_view traced =
        traced_create(scene.model, &camera, &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_LOW);
    const size_t stride = traced.planes.stride;
    float *weight = sgsi_calloc(stride, (size_t)camera.height * sizeof *weight),
          *centers = sgsi_calloc(scene.count, 2 * sizeof *centers);
    double *expected = oracle_memory(scene.count * SGSI_SCORE_COUNT, sizeof *expected);
    sgs_hit *hits = oracle_memory(scene.count, sizeof *hits);
    for (size_t i = 0; i < 2 * scene.count; ++i)
        centers[i] = (float)(40 * sgsi_random_uniform(2, i) - 2);
    for (int y = 0; y < camera.height; ++y)
        for (int x = 0; x < camera.width; ++x) {
            weight[(size_t)y * stride + (size_t)x] =
                (float)sgsi_random_uniform(5, 64 * (uint64_t)y + (uint64_t)x);
            const size_t count = oracle_hits(scene.params, scene.count, &camera, &pose,
                                             &traced.options, x, y, hits, scene.count);
            for (size_t k = 0; k < count; ++k) {
                double *sum = expected + SGSI_SCORE_COUNT * (size_t)hits[k].primitive;
                sum[SGSI_SCORE_WEIGHT] += (double)weight[(size_t)y * stride + (size_t)x];
                sum[SGSI_SCORE_HITS] += 1;
                sum[SGSI_SCORE_BLEND] += hits[k].transmittance * hits[k].alpha;
                sum[SGSI_SCORE_FRONT] += hits[k].transmittance;
                sum[SGSI_SCORE_DISTANCE] +=
                    hypot(x + 0.5 - (double)centers[2 * hits[k].primitive],
                          y + 0.5 - (double)centers[2 * hits[k].primitive + 1]);
            }
        }
    const sgsi_score_planes planes = {.weight = weight, .centers = centers};
    assert_int_equal(sgsi_tracer_score(traced.tracer, &traced.view, &traced.planes, &planes),
                     SGS_STATUS_OK);
    size_t seen = 0;
    for (size_t i = 0; i < scene.count; ++i) {
        const float *sum = sgsi_tracer_grad_sums(traced.tracer) + 16 * i;
        const bool touched = sgsi_tracer_touched(traced.tracer)[i / 16];
        seen += expected[SGSI_SCORE_COUNT * i + SGSI_SCORE_HITS] > 0;
        for (int k = 0; k < SGSI_SCORE_COUNT; ++k) {
            const double actual = touched ? (double)sum[k] : 0;
            const double wanted = expected[SGSI_SCORE_COUNT * i + (size_t)k];
            if (!(fabs(actual - wanted) <= 1e-4 * (1 + wanted)))
                fail_msg("primitive %zu, sum %d: %g, not %g", i, k, actual, wanted);
        }
    }
    assert_true(seen > 50);
    free(expected);
    free(hits);
    sgsi_free(weight);
    sgsi_free(centers);
    traced_destroy(&traced);
    oracle_scene_free(&scene);
}

// A view whose backward passes also sum absolute gradients.
static traced_view trace_with_abs_grad(const oracle_scene *scene, const sgs_camera *camera,
                                       const sgs_pose *pose)
{
    traced_view traced =
        traced_create(scene->model, camera, pose, SGS_FILTER_3DGS, 2, SGSI_BVH_LOW);
    sgsi_tracer_collect_abs_grad(traced.tracer, true);
    return traced;
}

// Fills the sums of `settings` from the last backward pass, without a step.
static void collect(const traced_view *traced, const oracle_scene *scene, sgsi_optimize settings)
{
    settings.params = scene->model->data;
    settings.count = scene->count;
    settings.view = traced->view;
    settings.sums = sgsi_tracer_grad_sums(traced->tracer);
    settings.touched = sgsi_tracer_touched(traced->tracer);
    settings.tan_half_x = 0.7f;
    settings.tan_half_y = 0.4f;
    sgsi_optimize_blocks(&settings, 0, (scene->count + 15) / 16);
}

static void absolute_gradients_match_the_oracle_pixel_by_pixel(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(4, 24, NULL);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 24, 20);
    const sgs_pose pose = oracle_pose_look_at(0.5, 0.3, -4);
    traced_view traced = trace_with_abs_grad(&scene, &camera, &pose);
    const size_t pixels = (size_t)camera.width * (size_t)camera.height;
    double *d[3], *params = oracle_memory(scene.count * SGS_PARAM_COUNT, sizeof *params),
                  *mean = oracle_memory(scene.count * 3, sizeof *mean);
    double *expected = oracle_memory(2 * scene.count, sizeof *expected);
    sgsi_planes single = traced_planes_create(camera.width, camera.height);
    for (int c = 0; c < 3; ++c)
        d[c] = oracle_memory(pixels, sizeof *d[c]);
    for (int y = 0; y < camera.height; ++y)
        for (int x = 0; x < camera.width; ++x) {
            const size_t at = (size_t)y * (size_t)camera.width + (size_t)x,
                         to = (size_t)y * single.stride + (size_t)x;
            for (int c = 0; c < 3; ++c)
                d[c][at] = (double)(single.color[c][to] =
                                        (float)(sgsi_random_uniform(8, 3 * at + (size_t)c) - 0.5));
            single.transmittance[to] = 0;
            assert_int_equal(sgs_reference_backward(
                                 scene.params, scene.count, &camera, &pose, &traced.options,
                                 (const double *const[3]){d[0], d[1], d[2]}, NULL, params, mean),
                             SGS_STATUS_OK);
            for (size_t i = 0; i < scene.count; ++i)
                for (int axis = 0; axis < 2; ++axis) { // rows of the rotation: camera x, camera y
                    double g = 0;
                    for (int k = 0; k < 3; ++k)
                        g += pose.rotation[3 * axis + k] * mean[3 * i + (size_t)k];
                    expected[2 * i + (size_t)axis] += fabs(g);
                }
            for (int c = 0; c < 3; ++c)
                d[c][at] = 0;
        }
    assert_int_equal(sgsi_tracer_backward(traced.tracer, &traced.view, &traced.planes, single.color,
                                          single.transmittance),
                     SGS_STATUS_OK);
    float *sums[2] = {sgsi_calloc(scene.model->capacity, sizeof(float)),
                      sgsi_calloc(scene.model->capacity, sizeof(float))};
    for (int norm = 0; norm < 2; ++norm) {
        collect(&traced, &scene,
                (sgsi_optimize){.abs_grad_sum = sums[norm], .abs_grad_norm = norm});
    }
    size_t seen = 0;
    for (size_t i = 0; i < scene.count; ++i) {
        const double *m = scene.params + i * SGS_PARAM_COUNT;
        double z = pose.translation[2];
        for (int k = 0; k < 3; ++k)
            z += pose.rotation[6 + k] * m[k];
        const double x = 0.7 * z * expected[2 * i], y = 0.4 * z * expected[2 * i + 1];
        seen += x > 0;
        assert_true(fabs((double)sums[0][i] - (x + y)) <= 2e-4 * (x + y + 1e-3));
        assert_true(fabs((double)sums[1][i] - hypot(x, y)) <= 2e-4 * (x + y + 1e-3));
    }
    assert_true(seen > 10);
    for (int c = 0; c < 3; ++c)
        free(d[c]);
    free(params);
    free(mean);
    free(expected);
    sgsi_free(sums[0]);
    sgsi_free(sums[1]);
    traced_planes_free(&single);
    traced_destroy(&traced);
    oracle_scene_free(&scene);
}

// Pixel-GS: min(1, (depth / near_depth)^2), for signed and absolute sums.
static void gradients_close_to_the_camera_count_less(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(4, 24, NULL);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 24, 20);
    const sgs_pose pose = oracle_pose_look_at(0.5, 0.3, -4);
    traced_view traced = trace_with_abs_grad(&scene, &camera, &pose);
    sgsi_planes d = traced_planes_create(camera.width, camera.height);
    for (size_t i = 0; i < (size_t)camera.height * d.stride; ++i) {
        for (int c = 0; c < 3; ++c)
            d.color[c][i] = (float)(sgsi_random_uniform(8, 3 * i + (size_t)c) - 0.5);
        d.transmittance[i] = 0;
    }
    assert_int_equal(
        sgsi_tracer_backward(traced.tracer, &traced.view, &traced.planes, d.color, d.transmittance),
        SGS_STATUS_OK);
    float *sums[2][2];
    for (int k = 0; k < 2; ++k) {
        for (int s = 0; s < 2; ++s)
            sums[k][s] = sgsi_calloc(scene.model->capacity, sizeof(float));
        collect(&traced, &scene,
                (sgsi_optimize){.gradient_sum = sums[k][0],
                                .abs_grad_sum = sums[k][1],
                                .near_depth = k ? 4.0f : 0.0f});
    }
    size_t near = 0, far = 0;
    for (size_t i = 0; i < scene.count; ++i) {
        double z = pose.translation[2];
        for (int k = 0; k < 3; ++k)
            z += pose.rotation[6 + k] * scene.params[i * SGS_PARAM_COUNT + (size_t)k];
        near += z < 4 && sums[0][0][i] > 0;
        far += z >= 4 && sums[0][0][i] > 0;
        for (int s = 0; s < 2; ++s) {
            const double wanted = fmin(1, z * z / 16) * (double)sums[0][s][i];
            assert_true(fabs((double)sums[1][s][i] - wanted) <= 1e-5 * wanted);
        }
    }
    assert_true(near > 3 && far > 3);
    for (int k = 0; k < 4; ++k)
        sgsi_free(sums[k / 2][k % 2]);
    traced_planes_free(&d);
    traced_destroy(&traced);
    oracle_scene_free(&scene);
}

// ---- Selections ----

static void median_is_the_lower_middle_of_the_positive_values(void **state)
{
    (void)state;
    for (size_t n = 0; n < 60; ++n) {
        float values[64], positive[64];
        size_t count = 0;
        for (size_t i = 0; i < n; ++i) {
            values[i] = (float)ldexp(sgsi_random_uniform(n, i) - 0.3, (int)(i % 9) * 7 - 30);
            if (values[i] > 0)
                positive[count++] = values[i];
        }
        qsort(positive, count, sizeof *positive, sgsi_compare_floats);
        assert_true(sgsi_positive_median(values, 1, NULL, n) ==
                    (count ? positive[(count - 1) / 2] : 0.0f));
    }
}

static void range_counts_every_row_of_the_plane_and_no_padding(void **state)
{
    (void)state;
    enum { WIDTH = 5, STRIDE = 8, ROWS = 1025 };
    static const int heights[] = {1, 8, 255, 256, 257, 1024, ROWS};
    static float plane[ROWS * STRIDE];
    for (size_t h = 0; h < sizeof heights / sizeof *heights; ++h) {
        const size_t rows = (size_t)heights[h];
        for (size_t at = 0; at < rows * STRIDE; ++at)
            plane[at] = at % STRIDE < WIDTH ? (float)sgsi_random_uniform(h, at) : 9.0f;
        for (size_t k = 0; k < 7; ++k) {
            const size_t low = k * (rows - 1) / 6, high = rows - 1 - low;
            float *const least = &plane[low * STRIDE], *const most = &plane[high * STRIDE + 4];
            const float before = *least, behind = *most;
            *least = -1.0f - (float)k;
            *most = 2.0f + (float)k;
            plane[1] = NAN;
            const sgsi_plane_range range = sgsi_plane_range_find(plane, WIDTH, heights[h], STRIDE);
            assert_true(range.least == -1.0f - (float)k && range.most == 2.0f + (float)k);
            *least = before;
            *most = behind;
        }
    }
}

static void best_rows_are_those_that_sorting_finds(void **state)
{
    (void)state;
    enum { N = 500 };
    double score[N];
    uint8_t eligible[N], chosen[N];
    for (size_t i = 0; i < N; ++i) {
        score[i] = floor(40 * sgsi_random_uniform(1, i)); // many ties
        eligible[i] = sgsi_random_uniform(2, i) < 0.7;
    }
    for (size_t wanted = 0; wanted <= N; wanted += 25) {
        assert_int_equal(sgsi_select_best(score, eligible, N, wanted, chosen), SGS_STATUS_OK);
        size_t total = 0, held = 0;
        for (size_t i = 0; i < N; ++i) {
            size_t before = 0; // eligible rows in front of row i
            for (size_t k = 0; k < N; ++k)
                before += eligible[k] && (score[k] > score[i] || (score[k] == score[i] && k < i));
            assert_int_equal(chosen[i], eligible[i] && before < wanted);
            total += eligible[i];
            held += chosen[i];
        }
        assert_int_equal(held, wanted < total ? wanted : total);
    }
}

static void weighted_draws_follow_their_weights(void **state)
{
    (void)state;
    const double weight[5] = {1, 2, 0, 7, 5};
    const uint8_t eligible[5] = {1, 1, 1, 1, 0};
    enum { DRAWS = 20000 };
    int first[5] = {0}, pair = 0;
    uint8_t chosen[5];
    for (uint64_t seed = 0; seed < DRAWS; ++seed) {
        assert_int_equal(sgsi_select_weighted(weight, eligible, 5, 1, seed, chosen), SGS_STATUS_OK);
        for (int i = 0; i < 5; ++i)
            first[i] += chosen[i];
        assert_int_equal(sgsi_select_weighted(weight, eligible, 5, 2, seed + DRAWS, chosen),
                         SGS_STATUS_OK);
        pair += chosen[0] && chosen[1];
    }
    assert_int_equal(first[2] + first[4], 0);
    for (int i = 0; i < 4; ++i) {
        const double p = weight[i] / 10;
        assert_true(fabs(first[i] - DRAWS * p) <= 4 * sqrt(DRAWS * p * (1 - p)));
    }
    const double p = 0.1 * 2 / 9 + 0.2 * 1 / 8; // rows 0 and 1, in either order
    assert_true(fabs(pair - DRAWS * p) <= 4 * sqrt(DRAWS * p * (1 - p)));
    assert_int_equal(sgsi_select_weighted(weight, eligible, 5, 4, 1, chosen), SGS_STATUS_OK);
    assert_true(chosen[2]); // weight 0 is drawn last
}

// ---- Rules ----

static void taming_grows_along_its_parabola(void **state)
{
    (void)state;
    for (int j = 0; j < 145; j += 12) {
        fixture *f = make(&sgsi_pipeline_taming, 3000, 1e-3f);
        f->options.update = j;
        f->state.initial_count = 1000; // smaller than the model
        f->train.pipeline_options.taming_multiplier = 5;
        const double x = (j + 1) / 145.0, scheduled = floor(5000 - 4000 * (1 - x) * (1 - x) + 1e-9);
        const size_t expected =
            scheduled < 3000 ? 3000 : (size_t)scheduled; // at least the present number
        assert_true(fabs((double)update(f) - (double)expected) <= 1);
        drop(f);
    }
    fixture *f = make(&sgsi_pipeline_taming, 3000, 1e-3f);
    f->train.pipeline_options.taming_count = 3100;
    f->options.update = 144;
    assert_int_equal(update(f), 3100);
    drop(f);
}

static void taming_draws_by_importance_among_qualifiers(void **state)
{
    (void)state;
    fixture *f = make(&sgsi_pipeline_taming, 1000, 1e-3f);
    f->train.pipeline_options.taming_count = 1200;
    f->options.update = 144;
    for (size_t i = 0; i < 1000; ++i) {
        f->importance[i] = i < 500 ? 1e-6f : 1e3f;
        f->statistics.gradient_sum[i] = i % 2 ? 1e-3f : 1e-5f; // even rows do not qualify
    }
    assert_int_equal(update(f), 1200);
    for (int i = 0; i < 1000; ++i)
        assert_true(copies_of(f, (float)i) == 1 || (i >= 500 && i % 2));
    drop(f);
}

static void half_of_what_3dgs_would_prune_is_drawn(void **state)
{
    (void)state;
    const sgsi_pipeline *const pipelines[] = {&sgsi_pipeline_taming, &sgsi_pipeline_fastgs};
    for (int p = 0; p < 2; ++p) {
        fixture *f = make(pipelines[p], 400, 1e-6f);
        for (size_t i = 0; i < 200; ++i)
            set_faint(f, i);
        const size_t left = update(f), removed = 400 - left;
        assert_true(removed <= 100 &&
                    removed >= 25); // 100 of 400 equal rows are drawn: about 50 are faint
        for (int i = 200; i < 400; ++i)
            assert_int_equal(copies_of(f, (float)i), 1);
        drop(f);
    }
    fixture *f = make(&sgsi_pipeline_taming, 400, 1e-6f);
    for (size_t i = 0; i < 200; ++i)
        set_faint(f, i);
    f->options.update = 27;
    assert_int_equal(update(f), 400); // no native pruning after that
    drop(f);
}

static void fastgs_grows_only_if_views_agree(void **state)
{
    (void)state;
    fixture *f = make(&sgsi_pipeline_fastgs, 60, 1e-3f);
    for (size_t i = 0; i < 60; ++i) {
        if (i >= 20)
            *sgs_gaussians_at(f->model, i, SGS_PARAM_SCALE) =
                logf(0.02f); // above 0.001 of the extent
        if (i >= 40)
            f->statistics.abs_grad_sum[i] = 2 * 0.0013f;
        f->importance[i] = i % 2 ? 5.9f : 6.0f; // the floor must exceed 5
    }
    assert_int_equal(update(f), 60 + 10 + 10);
    for (int i = 0; i < 60; ++i)
        assert_int_equal(copies_of(f, (float)i), i % 2 || (i >= 20 && i < 40) ? 1 : 2);
    assert_int_equal(f->result.cloned, 10);
    assert_int_equal(f->result.split, 10);
    drop(f);
}

// A shorter run has larger thresholds for both gradients.
static void fastgs_scales_both_thresholds(void **state)
{
    (void)state;
    fixture *f = make(&sgsi_pipeline_fastgs, 80, 2e-4f * 1.65f);
    f->options.gradient_threshold = 1.7 * SGSI_GRADIENT_THRESHOLD;
    for (size_t i = 0; i < 80; ++i) {
        if (i < 40)
            *sgs_gaussians_at(f->model, i, SGS_PARAM_SCALE) = logf(0.02f);
        f->statistics.abs_grad_sum[i] = 2 * 0.0012f * (i % 2 ? 1.75f : 1.65f);
        if (i >= 40 && i % 2)
            f->statistics.gradient_sum[i] = 2 * 2e-4f * 1.75f;
    }
    update(f);
    assert_int_equal(f->result.split, 20);
    assert_int_equal(f->result.cloned, 20);
    drop(f);
}

static void fastgs_votes_are_native_without_weights(void **state)
{
    (void)state;
    size_t counts[4];
    for (int target = SGS_TARGET_DEFAULT; target <= SGS_TARGET_BOTH; ++target) {
        fixture *f = make(&sgsi_pipeline_fastgs, 100, 1e-3f);
        f->train.spare_target = (sgs_spare_target)target;
        for (size_t i = 0; i < 100; ++i)
            f->importance[i] = 4 + 0.04f * (float)i; // 4 to 7.96: half of them reach 6
        counts[target] = update(f);
        assert_int_equal(f->result.bmd_boosted + f->result.bmd_suppressed, 0);
        drop(f);
    }
    for (int target = SGS_TARGET_DEFAULT; target <= SGS_TARGET_BOTH; ++target)
        assert_int_equal(counts[target], 150);
}

static void fastgs_final_prune_removes_faint_rows_and_high_scores(void **state)
{
    (void)state;
    fixture *f = make(&sgsi_pipeline_fastgs, 50, 1e-3f);
    f->options.final_prune = true;
    *sgs_gaussians_at(f->model, 3, SGS_PARAM_OPACITY) = logf(0.09f / 0.91f);
    f->prune_score[4] = 0.95f;
    f->prune_score[5] = 0.85f;
    assert_int_equal(update(f), 48);
    assert_int_equal(copies_of(f, 3) + copies_of(f, 4), 0);
    assert_int_equal(copies_of(f, 5), 1);
    drop(f);
}

static void fastgs_scores_average_votes_and_scale_pruning(void **state)
{
    (void)state;
    float sums[16 * 16] = {0}, importance[3] = {0}, prune_score[3] = {0};
    uint8_t touched[1] = {1};
    for (int view = 0; view < 4; ++view) {
        for (int i = 0; i < 3; ++i)
            sums[16 * i + SGSI_SCORE_WEIGHT] = (float)(i * (view + 1));
        const sgsi_scored_view scored = {
            .count = 3, .loss = 0.1 * (view + 1), .sums = sums, .touched = touched};
        sgsi_pipeline_fastgs.score_view(&scored, importance, prune_score);
    }
    sgsi_pipeline_fastgs.finish_scores(3, 4, importance, prune_score);
    assert_true(importance[0] == 0 && importance[1] == 2.5f && importance[2] == 5);
    assert_true(prune_score[0] == 0 && fabsf(prune_score[1] - 0.5f) < 1e-6f && prune_score[2] == 1);
}

// Pillow 9.4: convert("L") and filter(ImageFilter.FIND_EDGES) of an image of 7 x 6 pixels. Border
// pixels are the grey itself.
static void taming_edges_are_those_of_pillow(void **state)
{
    (void)state;
    enum { WIDTH = 7, HEIGHT = 6, STRIDE = 16, PIXELS = WIDTH * HEIGHT };
    static const uint8_t pixels[3 * PIXELS] = {
        128, 110, 129, 105, 130, 116, 129, 125, 129, 120, 111, 119, 131, 123, 117, 116, 121, 109,
        131, 102, 128, 129, 108, 128, 102, 131, 113, 113, 109, 106, 128, 118, 112, 110, 122, 111,
        104, 121, 119, 110, 108, 127, 104, 131, 126, 112, 131, 125, 116, 115, 104, 129, 106, 126,
        131, 108, 114, 111, 121, 109, 106, 114, 125, 111, 110, 104, 130, 119, 112, 101, 115, 107,
        104, 122, 100, 120, 106, 119, 102, 113, 123, 110, 126, 120, 105, 113, 126, 127, 119, 112,
        131, 100, 112, 102, 124, 118, 114, 125, 125, 108, 112, 117, 122, 131, 121, 120, 109, 119,
        122, 110, 120, 114, 100, 112, 107, 129, 109, 125, 100, 106, 118, 111, 121, 126, 114, 108};
    static const int edges[PIXELS] = {111, 123, 127, 112, 129, 121, 122, 116, 0,  58,  0,
                                      46,  71,  114, 116, 0,   50,  0,   0,   0,  125, 117,
                                      0,   0,   49,  60,  0,   106, 111, 0,   0,  54,  0,
                                      36,  110, 115, 104, 115, 122, 112, 119, 121}; // 0 to 129
    static const float error[STRIDE * HEIGHT];
    float weights[STRIDE * HEIGHT];
    const sgsi_scored_image image = {
        .width = WIDTH, .height = HEIGHT, .stride = STRIDE, .error = error, .pixels = pixels};
    assert_int_equal(sgsi_pipeline_taming.pixel_weights(&image, NULL, weights), 0);
    for (int i = 0; i < PIXELS; ++i) {
        const double weight = (double)weights[i / WIDTH * STRIDE + i % WIDTH];
        if (!(fabs(weight - 50 * edges[i] / 129.0) <= 1e-4))
            fail_msg("pixel %d: edge %g, expected %d", i, weight * 129 / 50, edges[i]);
    }
}

static void taming_importance_is_the_published_sum(void **state)
{
    (void)state;
    float sums[16 * 16] = {0}, importance[4] = {0};
    const uint8_t touched[1] = {1};
    const float gradient[4] = {1, 2, 4, 8}, opacity[4] = {0.1f, 0.2f, 0.5f, 0.9f},
                depth[4] = {3, 0, 5, 7}, radius[4] = {2, 0, 4, 9}, volume[4] = {1, 1, 3, 2};
    for (int i = 0; i < 4; ++i)
        for (int k = 0; k < 4; ++k)
            sums[16 * i + k] = (float)((i + 1) * (k + 2));
    const sgsi_scored_view view = {.count = 4,
                                   .loss = 0.25,
                                   .sums = sums,
                                   .touched = touched,
                                   .depth = depth,
                                   .radius = radius,
                                   .gradient = gradient,
                                   .opacity = opacity,
                                   .volume = volume};
    sgsi_pipeline_taming.score_view(&view, importance, NULL);
    assert_true(importance[1] == 0); // not in view
    // Medians, lower middle: gradient 2, opacity 0.2, depth 5, radius 4, volume 1; sums: those of
    // row 1.
    const double row3 = 25 * 8 / 2.0 + 100 * 0.9 / 0.2 + 5 * 7 / 5.0 + 10 * 9 / 4.0 + 25 * 2.0 +
                        (10 + 0.1 + 50 + 50) * 2.0;
    assert_true(fabs((double)importance[3] - 50 * 0.25 * row3) <= 1e-5 * 50 * 0.25 * row3);
}

static void dash_adds_no_more_than_its_budget(void **state)
{
    (void)state;
    fixture *f = make(&sgsi_pipeline_dash, 1000, 1e-3f);
    f->options.until = 27000;
    f->options.update_count = 265;
    for (size_t i = 0; i < 1000; ++i)
        f->statistics.gradient_sum[i] = 1e-3f + 1e-6f * (float)i;
    assert_int_equal(update(f), 1200); // a fifth at most
    for (int i = 0; i < 1000; ++i)
        assert_int_equal(copies_of(f, (float)i), i < 800 ? 1 : 2);
    assert_int_equal(f->state.momentum, 5900); // 0.98 * 5000 + 1000
    drop(f);

    f = make(&sgsi_pipeline_dash, 1000, 1e-3f);
    f->options.until = 27000;
    f->options.update_count = 265;
    f->options.resolution = 8;
    const double most = 1000 + 5000 / pow(8, 2 - 600.0 / 27000);
    assert_int_equal(update(f), (size_t)most);
    drop(f);

    f = make(&sgsi_pipeline_dash, 1000, 1e-3f);
    f->train.pipeline_options.dash_count = 1050;
    f->options.until = 27000;
    f->options.iteration = 26900;
    f->options.update_count = 265;
    assert_int_equal(update(f), 1050);
    drop(f);
}

// Pipelines that prune large primitives may decide twice at a cap. DashGaussian does not.
static void dash_has_the_same_momentum_with_a_cap(void **state)
{
    (void)state;
    fixture *f = make(&sgsi_pipeline_dash, 1000, 1e-3f);
    f->options.until = 27000;
    f->options.update_count = 265;
    f->options.size_max = 1e6;
    f->options.max_count = 5000;
    for (size_t i = 0; i < 1000; ++i)
        f->statistics.gradient_sum[i] = 1e-3f + 1e-6f * (float)i;
    assert_int_equal(update(f), 1200);
    assert_int_equal(f->state.momentum, 5900);
    drop(f);
}

static void dash_prunes_before_it_grows(void **state)
{
    (void)state;
    fixture *f = make(&sgsi_pipeline_dash, 100, 1e-3f);
    f->options.until = 27000;
    f->options.update_count = 265;
    for (size_t i = 0; i < 10; ++i)
        set_faint(f, i);
    assert_int_equal(update(f), 120); // 1.2 times the count before; pruned rows are replaced
    for (int i = 0; i < 10; ++i)
        assert_int_equal(copies_of(f, (float)i), 0);
    drop(f);
}

// Faint rows with small gradients in one crowded voxel are redundant in every pipeline and do not
// grow.
static void every_pipeline_prunes_redundant_rows(void **state)
{
    (void)state;
    for (int p = 0; p < SGS_PIPELINE_COUNT; ++p) {
        const sgsi_pipeline *pipeline = sgsi_pipeline_get((sgs_pipeline)p);
        if (!pipeline)
            continue;
        fixture *f = make(pipeline, 200, 1e-5f);
        f->options.spare_prune = true;
        // For mcmc, which limits the pruning of an update to its growth, and in long runs to half.
        f->train.iterations = 7000;
        f->options.growth = f->train.pipeline_options.mcmc_growth = 1;
        f->options.max_count = 200;
        f->options.until = 27000;
        for (size_t i = 0; i < 200; ++i) {
            *sgs_gaussians_at(f->model, i, SGS_PARAM_MEAN) =
                i < 150 ? 0.01f * (float)sgsi_random_uniform(3, i)
                        : 0.2f + 0.016f * (float)(i - 150);
            *sgs_gaussians_at(f->model, i, SGS_PARAM_MEAN + 1) =
                *sgs_gaussians_at(f->model, i, SGS_PARAM_MEAN + 2) = 0;
            *sgs_gaussians_at(f->model, i, SGS_PARAM_OPACITY) = i % 2 ? 0 : logf(0.03f / 0.97f);
            f->statistics.abs_grad_sum[i] =
                1e-9f * (float)i; // one row has the largest gradient, so only one grows
            f->statistics.radius_max[i] = 4;
        }
        update(f);
        assert_int_equal(f->result.spare_pruned, 75);
        assert_int_equal(copies_of(f, 0), 0);
        assert_int_equal(copies_of(f, 1), 1);
        assert_int_equal(copies_of(f, 160), 1);
        drop(f);
    }
}

// As if no view had seen a primitive. mcmc grows without gradients.
static void no_pipeline_grows_without_gradients(void **state)
{
    (void)state;
    for (int p = 0; p < SGS_PIPELINE_COUNT; ++p) {
        const sgsi_pipeline *pipeline = sgsi_pipeline_get((sgs_pipeline)p);
        if (!pipeline || pipeline->relocates)
            continue;
        fixture *f = make(pipeline, 200, 0.0f);
        f->options.until = 27000;
        assert_int_equal(update(f), 200);
        drop(f);
    }
}

// Rows that the limit keeps are not replaced.
static void dash_replaces_only_rows_that_are_removed(void **state)
{
    (void)state;
    for (int limited = 0; limited < 2; ++limited) {
        fixture *f = make(&sgsi_pipeline_dash, 100, 1e-3f);
        f->train.pipeline_options.dash_count = 100;
        f->options.until = 27000;
        f->options.update_count = 265;
        f->options.removal_max = limited ? 0.05 : 0.0;
        for (size_t i = 0; i < 12; ++i)
            set_faint(f, i);
        assert_int_equal(update(f), 100);
        assert_int_equal(f->result.pruned, limited ? 5 : 12);
        drop(f);
    }
}

// The weights of crowded voxels suppress growth.
static void weights_suppress_growth_in_every_pipeline(void **state)
{
    (void)state;
    for (int p = 0; p < SGS_PIPELINE_COUNT; ++p) {
        const sgsi_pipeline *pipeline = sgsi_pipeline_get((sgs_pipeline)p);
        if (!pipeline)
            continue;
        size_t counts[2];
        for (int spare = 0; spare < 2; ++spare) {
            fixture *f = make(pipeline, 200, 2.05e-4f);
            f->options.spare_densify = spare;
            f->options.growth = 1;
            f->train.pipeline_options.taming_count = 100000; // an unreached budget
            f->options.until = 27000;
            for (size_t i = 0; i < 200; ++i) {
                *sgs_gaussians_at(f->model, i, SGS_PARAM_MEAN) =
                    i < 150 ? 0.01f * (float)sgsi_random_uniform(3, i)
                            : 0.2f + 0.016f * (float)(i - 150);
                *sgs_gaussians_at(f->model, i, SGS_PARAM_MEAN + 1) =
                    *sgs_gaussians_at(f->model, i, SGS_PARAM_MEAN + 2) = 0;
                f->statistics.radius_max[i] = 4;
            }
            counts[spare] = update(f);
            assert_true(spare || (!f->result.bmd_suppressed && !f->result.bmd_boosted));
            drop(f);
        }
        if (!(counts[1] + 20 < counts[0]))
            fail_msg("%s: %zu rows with weights, %zu without", pipeline->name, counts[1],
                     counts[0]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(score_sums_match_the_oracle),
        cmocka_unit_test(absolute_gradients_match_the_oracle_pixel_by_pixel),
        cmocka_unit_test(gradients_close_to_the_camera_count_less),
        cmocka_unit_test(median_is_the_lower_middle_of_the_positive_values),
        cmocka_unit_test(range_counts_every_row_of_the_plane_and_no_padding),
        cmocka_unit_test(best_rows_are_those_that_sorting_finds),
        cmocka_unit_test(weighted_draws_follow_their_weights),
        cmocka_unit_test(taming_grows_along_its_parabola),
        cmocka_unit_test(taming_draws_by_importance_among_qualifiers),
        cmocka_unit_test(half_of_what_3dgs_would_prune_is_drawn),
        cmocka_unit_test(taming_edges_are_those_of_pillow),
        cmocka_unit_test(taming_importance_is_the_published_sum),
        cmocka_unit_test(fastgs_grows_only_if_views_agree),
        cmocka_unit_test(fastgs_scales_both_thresholds),
        cmocka_unit_test(fastgs_votes_are_native_without_weights),
        cmocka_unit_test(fastgs_final_prune_removes_faint_rows_and_high_scores),
        cmocka_unit_test(fastgs_scores_average_votes_and_scale_pruning),
        cmocka_unit_test(dash_adds_no_more_than_its_budget),
        cmocka_unit_test(dash_has_the_same_momentum_with_a_cap),
        cmocka_unit_test(dash_prunes_before_it_grows),
        cmocka_unit_test(no_pipeline_grows_without_gradients),
        cmocka_unit_test(dash_replaces_only_rows_that_are_removed),
        cmocka_unit_test(every_pipeline_prunes_redundant_rows),
        cmocka_unit_test(weights_suppress_growth_in_every_pipeline),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
