// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Mip-Splatting: the 3D filter against its definition, models with the filter applied against
// models with a separate filter (rendered by the oracle), both files, the quantile, and the opacity
// reset through the filter. test_tracer_oracle.c and test_tracer_gradient.c compare the image and
// its gradients with the oracle.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <cmocka.h>

#include "base/compare.h"
#include "base/threads.h"
#include "model/filter_3d.h"
#include "density/density.h"
#include "density/pipeline.h"
#include "reference/reference.h"
#include "support/tracer_support.h"

// With the near distance of the paper, and with one that hides some primitives.
static void check_sampling(double nearest_depth)
{
    oracle_scene scene = oracle_random_model(6, 200, NULL);
    for (size_t i = 0; i < 200; i += 10) // some are in no view
        *sgs_gaussians_at(scene.model, i, SGS_PARAM_MEAN) = 500;
    sgs_view views[4] = {0};
    const size_t used[3] = {3, 0, 2};
    for (int v = 0; v < 4; ++v) {
        views[v].camera = oracle_camera(SGS_CAMERA_PINHOLE, 60 + 10 * v, 50);
        views[v].camera.params[0] = views[v].camera.params[1] = 45 + 9 * v;
        views[v].pose = oracle_pose_look_at(1.0 + v, -1.0 + 0.7 * v, -4.0 + 0.5 * v);
    }
    const sgs_scene set = {.view_count = 4, .views = views};
    float filter[200];
    float largest;
    assert_int_equal(
        sgsi_filter_3d_sample(scene.model, &set, used, 3, nearest_depth, filter, &largest),
        SGS_STATUS_OK);
    sgsi_filter_3d_scale(&set, used, 3, largest, filter, 200);
    double nearest[200], farthest = 0;
    size_t unseen = 0;
    for (size_t i = 0; i < 200; ++i) {
        nearest[i] = 1e5;
        for (int k = 0; k < 3; ++k) {
            const sgs_view *view = &views[used[k]];
            double p[3];
            for (int row = 0; row < 3; ++row) {
                p[row] = view->pose.translation[row];
                for (int c = 0; c < 3; ++c)
                    p[row] += view->pose.rotation[3 * row + c] *
                              (double)*sgs_gaussians_at(scene.model, i, SGS_PARAM_MEAN + c);
            }
            const double *f = view->camera.params, w = view->camera.width, h = view->camera.height;
            const double x = f[0] * p[0] / p[2] + f[2], y = f[1] * p[1] / p[2] + f[3];
            if (p[2] > nearest_depth && x >= -0.15 * w && x <= 1.15 * w && y >= -0.15 * h &&
                y <= 1.15 * h)
                nearest[i] = fmin(nearest[i], p[2]);
        }
        unseen += nearest[i] == 1e5;
        farthest = nearest[i] < 1e5 ? fmax(farthest, nearest[i]) : farthest;
    }
    assert_true(unseen >= 20 && unseen < 150);
    for (size_t i = 0; i < 200; ++i) {
        const double expected =
            (nearest[i] == 1e5 ? farthest : nearest[i]) / (45 + 9 * 3) * sqrt(0.2);
        assert_true(fabs((double)filter[i] - expected) <= 1e-5 * expected);
    }
    oracle_scene_free(&scene);
}

static void filter_is_the_finest_sampling_of_all_views(void **state)
{
    (void)state;
    check_sampling(0.2);
    check_sampling(3.5);
}

enum { MANY_VIEWS = 600, MANY_ROWS = 900 };

// The nearest depth at which a view samples a mean: one loop over all views.
static double nearest_of_all(const sgs_view *views, const double mean[3], double limit)
{
    double nearest = INFINITY;
    for (size_t v = 0; v < MANY_VIEWS; ++v) {
        const sgs_camera *camera = &views[v].camera;
        const double *f = camera->params, w = camera->width, h = camera->height;
        double p[3], pixel[2];
        for (int row = 0; row < 3; ++row)
            p[row] = views[v].pose.rotation[3 * row] * mean[0] +
                     views[v].pose.rotation[3 * row + 1] * mean[1] +
                     views[v].pose.rotation[3 * row + 2] * mean[2] + views[v].pose.translation[row];
        const bool fisheye = camera->model == SGS_CAMERA_OPENCV_FISHEYE;
        const double depth = fisheye ? sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]) : p[2];
        pixel[0] = f[0] * p[0] / p[2] + f[2];
        pixel[1] = f[1] * p[1] / p[2] + f[3];
        if (!(depth > limit) || (fisheye && !sgs_camera_project(camera, p, pixel)))
            continue;
        if (pixel[0] >= -0.15 * w && pixel[0] <= 1.15 * w && pixel[1] >= -0.15 * h &&
            pixel[1] <= 1.15 * h)
            nearest = fmin(nearest, depth);
    }
    return nearest;
}

// Rows in Morton order, as in training, and in random order; some are far away or not finite. Views
// on a sphere, some of them between the rows, every third with a fisheye lens. `narrow`: images of
// a few rows only, so that most blocks are at a side of the pyramid.
static void check_nearest(bool sorted, double narrow)
{
    sgs_gaussians *model;
    static sgs_view views[MANY_VIEWS];
    static float filter[MANY_ROWS + 16], expected[MANY_ROWS];
    float expected_farthest = 0;
    size_t used[MANY_VIEWS], sampled = 0;
    assert_int_equal(sgs_gaussians_create(MANY_ROWS, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, MANY_ROWS), SGS_STATUS_OK);
    for (size_t i = 0; i < MANY_ROWS; ++i)
        for (size_t k = 0; k < 3; ++k)
            *sgs_gaussians_at(model, i, SGS_PARAM_MEAN + (int)k) =
                (i % 97 ? 4 : 4000) * (float)(sgsi_random_uniform(31, 3 * i + k) - 0.5);
    if (sorted)
        assert_int_equal(sgsi_density_sort(model), SGS_STATUS_OK);
    *sgs_gaussians_at(model, 700, SGS_PARAM_MEAN + 1) = NAN;
    *sgs_gaussians_at(model, 701, SGS_PARAM_MEAN) = INFINITY;
    for (size_t v = 0; v < MANY_VIEWS; ++v) {
        const double far = 0.3 + 5 * sgsi_random_uniform(32, v),
                     a = 6.28 * sgsi_random_uniform(33, v),
                     b = 3 * sgsi_random_uniform(34, v) - 1.5;
        used[v] = v;
        views[v] = (sgs_view){.pose = oracle_pose_look_at(far * cos(a), far * sin(a), far * b)};
        views[v].camera = oracle_camera(v % 3 ? SGS_CAMERA_PINHOLE : SGS_CAMERA_OPENCV_FISHEYE,
                                        60 + (int)(v % 50), 50);
        views[v].camera.params[0] *= narrow;
        views[v].camera.params[1] *= narrow;
    }
    const sgs_scene set = {.view_count = MANY_VIEWS, .views = views};
    for (size_t i = 0; i < MANY_ROWS; ++i) {
        double mean[3];
        for (int k = 0; k < 3; ++k)
            mean[k] = (double)*sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k);
        const double nearest = nearest_of_all(views, mean, 0.2);
        expected[i] = isinf(nearest) ? -1.0f : (float)nearest;
        sampled += expected[i] > 0;
        expected_farthest = fmaxf(expected_farthest, expected[i]);
    }
    for (int threads = 1; threads < 5; threads += 3) {
        float farthest;
        sgsi_threads_set(threads);
        assert_int_equal(
            sgsi_filter_3d_sample(model, &set, used, MANY_VIEWS, 0.2, filter, &farthest),
            SGS_STATUS_OK);
        sgsi_threads_set(0);
        for (size_t i = 0; i < MANY_ROWS; ++i)
            if (filter[i] != expected[i])
                fail_msg("row %zu: %g, expected %g", i, (double)filter[i], (double)expected[i]);
        assert_true(farthest == expected_farthest);
    }
    assert_true(filter[700] == -1 && filter[701] == -1);
    assert_true(sampled > MANY_ROWS / 10 && (narrow == 1 || sampled < MANY_ROWS - 20));
    sgs_gaussians_destroy(model);
}

static void the_nearest_view_is_found_among_many(void **state)
{
    (void)state;
    for (int sorted = 0; sorted < 2; ++sorted) {
        check_nearest(sorted, 1.0);
        check_nearest(sorted, 15.0);
    }
}

// Values of rank k against a sorted copy; those that are not positive count as 0.
static void ranks_are_those_of_a_sorted_copy(void **state)
{
    (void)state;
    enum { N = 300000 };
    float *values = malloc(N * sizeof *values), *sorted = malloc(N * sizeof *sorted);
    for (size_t i = 0; i < N; ++i) {
        const double u = sgsi_random_uniform(8, i);
        values[i] = i % 11 ? (float)exp(60 * u - 40) : i % 2 ? 0.25f : -1.0f;
        if (i % 1000 == 1)
            values[i] = i % 3 ? NAN : INFINITY;
        sorted[i] = values[i] > 0 ? values[i] : 0;
    }
    qsort(sorted, N, sizeof *sorted, sgsi_compare_floats);
    for (int threads = 1; threads < 4; threads += 2) {
        sgsi_threads_set(threads);
        for (size_t k = 0; k < N; k += k % 2 ? 59999 : 1)
            assert_true(sgsi_positive_rank(values, N, k) == sorted[k]);
        assert_true(sgsi_positive_rank(values, N, N - 1) == sorted[N - 1]);
    }
    sgsi_threads_set(0);
    free(values);
    free(sorted);
}

static void fused_model_looks_the_same_without_its_filter(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(8, 60, NULL);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 30, 26);
    const sgs_pose pose = oracle_pose_look_at(1, -0.5, -4);
    float filter[64];
    for (size_t i = 0; i < 60; ++i)
        filter[i] = (float)(0.001 + 0.1 * sgsi_random_uniform(1, i));
    sgs_gaussians *fused;
    assert_int_equal(sgs_gaussians_fuse_filter_3d(scene.model, filter, &fused), SGS_STATUS_OK);
    double *params = oracle_memory(60 * SGS_PARAM_COUNT, sizeof *params);
    for (size_t i = 0; i < 60; ++i)
        for (int k = 0; k < SGS_PARAM_COUNT; ++k)
            params[i * SGS_PARAM_COUNT + (size_t)k] = (double)*sgs_gaussians_at(fused, i, k);
    sgs_render_options options = sgs_render_options_default();
    options.filter = SGS_FILTER_MIP;
    sgs_reference_frame with, without;
    assert_int_equal(sgs_reference_frame_create(30, 26, &with), SGS_STATUS_OK);
    assert_int_equal(sgs_reference_frame_create(30, 26, &without), SGS_STATUS_OK);
    assert_int_equal(sgs_reference_render(params, 60, &camera, &pose, &options, &without),
                     SGS_STATUS_OK);
    options.filter_3d = filter;
    assert_int_equal(sgs_reference_render(scene.params, 60, &camera, &pose, &options, &with),
                     SGS_STATUS_OK);
    double brightest = 0;
    for (int i = 0; i < 30 * 26; ++i)
        for (int c = 0; c < 3; ++c) {
            assert_true(fabs(with.color[c][i] - without.color[c][i]) <=
                        0.006); // a hit at the limit 1/255 may differ
            brightest = fmax(brightest, with.color[c][i]);
        }
    assert_true(brightest > 0.2);
    sgs_reference_frame_free(&with);
    sgs_reference_frame_free(&without);
    sgs_gaussians_destroy(fused);
    free(params);
    oracle_scene_free(&scene);
}

// Also where several threads share the rows.
static void models_are_filtered_row_by_row(void **state)
{
    (void)state;
    enum { N = 5000 };
    oracle_scene scene = oracle_random_model(3, N, NULL);
    sgs_gaussians *fused;
    float *filter = oracle_memory(N, sizeof *filter);
    for (size_t i = 0; i < N; ++i)
        filter[i] = i % 7 ? (float)(0.1 * sgsi_random_uniform(2, i)) : 0;
    for (int threads = 1; threads < 4; threads += 2) {
        sgsi_threads_set(threads);
        assert_int_equal(sgs_gaussians_fuse_filter_3d(scene.model, filter, &fused), SGS_STATUS_OK);
        for (int pass = 0; pass < 2; ++pass) {
            for (size_t i = 0; i < N; ++i) {
                float expected[SGS_PARAM_COUNT], row[SGS_PARAM_COUNT];
                sgs_gaussians_get(scene.model, i, expected);
                sgsi_filter_3d_fuse(expected, (double)filter[i]);
                if (pass)
                    sgsi_filter_3d_unfuse(expected, (double)filter[i]);
                sgs_gaussians_get(fused, i, row);
                assert_memory_equal(row, expected, sizeof row);
            }
            sgsi_filter_3d_unfuse_rows(fused, filter);
        }
        sgs_gaussians_destroy(fused);
    }
    sgsi_threads_set(0);
    free(filter);
    oracle_scene_free(&scene);
}

// Scales of a primitive and its opacity, from equations 6 and 9 of the paper: s'^2 = s^2 + f3^2 and
// o' = o product s / s'.
static void filtered(const double scale[3], double opacity, double filter, double out[4])
{
    out[3] = opacity;
    for (int k = 0; k < 3; ++k) {
        out[k] = sqrt(scale[k] * scale[k] + filter * filter);
        out[3] *= scale[k] / out[k];
    }
}

static void set_row(const double values[4], float row[SGS_PARAM_COUNT])
{
    for (int k = 0; k < 3; ++k)
        row[SGS_PARAM_SCALE + k] = (float)log(values[k]);
    row[SGS_PARAM_OPACITY] = (float)log(values[3] / (1 - values[3]));
}

static void get_row(const float row[SGS_PARAM_COUNT], double values[4])
{
    for (int k = 0; k < 3; ++k)
        values[k] = exp((double)row[SGS_PARAM_SCALE + k]);
    values[3] = 1 / (1 + exp(-(double)row[SGS_PARAM_OPACITY]));
}

// Raw scales from 0.15 f3 to 30 f3, opacities up to 0.999.
static void removing_the_filter_restores_the_raw_primitive(void **state)
{
    (void)state;
    for (uint64_t i = 0; i < 500; ++i) {
        const double filter = exp(-8 + 8 * sgsi_random_uniform(1, 5 * i));
        double raw[4], stored[4], got[4];
        for (uint64_t k = 0; k < 3; ++k)
            raw[k] = filter * exp(log(0.15) + log(200) * sgsi_random_uniform(1, 5 * i + k + 1));
        raw[3] = i % 10 ? 0.01 + 0.98 * sgsi_random_uniform(1, 5 * i + 4) : 0.999;
        filtered(raw, raw[3], filter, stored);
        float row[SGS_PARAM_COUNT] = {0};
        set_row(stored, row);
        sgsi_filter_3d_unfuse(row, filter);
        get_row(row, got);
        for (int k = 0; k < 4; ++k)
            if (!(fabs(got[k] / raw[k] - 1) <= 2e-4))
                fail_msg("%llu: value %d: %g, expected %g", (unsigned long long)i, k, got[k],
                         raw[k]);
        sgsi_filter_3d_fuse(row, filter);
        get_row(row, got);
        for (int k = 0; k < 4; ++k)
            assert_true(fabs(got[k] / stored[k] - 1) <= 5e-6);
    }
}

// No raw scale gives a scale below that of the filter, nor a raw opacity below 1 a high opacity of
// a scale slightly above it: what fusing makes of both is larger, by the filter at most, and has
// the same opacity times volume.
static void primitives_below_the_filter_keep_opacity_times_volume(void **state)
{
    (void)state;
    for (uint64_t i = 0; i < 500; ++i) {
        const double filter = 0.1;
        double stored[4], got[4], before = 1, after = 1;
        for (uint64_t k = 0; k < 3; ++k)
            stored[k] = filter * exp(log(0.01) + log(300) * sgsi_random_uniform(2, 5 * i + k));
        stored[i % 3] = fmin(stored[i % 3], filter);
        for (uint64_t k = 0; i >= 250 && k < 3; ++k)
            stored[k] = filter * (1.006 + 2 * sgsi_random_uniform(3, 5 * i + k));
        stored[3] = 0.01 + 0.98 * sgsi_random_uniform(2, 5 * i + 4);
        float row[SGS_PARAM_COUNT] = {0};
        set_row(stored, row);
        sgsi_filter_3d_unfuse(row, filter);
        sgsi_filter_3d_fuse(row, filter);
        get_row(row, got);
        for (int k = 0; k < 3; ++k)
            assert_true(got[k] >= stored[k] * (1 - 1e-6) &&
                        got[k] <= sqrt(stored[k] * stored[k] + filter * filter) * (1 + 1e-6));
        for (int k = 0; k < 4; ++k) {
            before *= stored[k];
            after *= got[k];
        }
        if (!(fabs(after / before - 1) <= 1e-5))
            fail_msg("%llu: %g, expected %g", (unsigned long long)i, after, before);
    }
    float row[SGS_PARAM_COUNT] = {0}; // a scale of 0, and no filter
    row[SGS_PARAM_SCALE] = -1000;
    sgsi_filter_3d_unfuse(row, 0.1);
    assert_true(isfinite(row[SGS_PARAM_SCALE]) && isfinite(row[SGS_PARAM_OPACITY]));
    const float scale = row[SGS_PARAM_SCALE + 1];
    sgsi_filter_3d_unfuse(row, 0);
    sgsi_filter_3d_fuse(row, 0);
    assert_true(row[SGS_PARAM_SCALE + 1] == scale);
}

static void filter_is_the_last_of_63_properties(void **state)
{
    (void)state;
    char path[64];
    snprintf(path, sizeof path, "/tmp/sparegs_mip_%ld.ply", (long)getpid());
    oracle_scene scene = oracle_random_model(2, 5, NULL);
    const float filter[5] = {0.5f, 0.25f, 1, 2, 4};
    scene.model->sh_degree = 3;
    assert_int_equal(sgs_ply_write_filter_3d(path, scene.model, filter), SGS_STATUS_OK);
    uint8_t *bytes;
    size_t size;
    assert_int_equal(sgsi_file_read(path, 0, &bytes, &size), SGS_STATUS_OK);
    const char *end = strstr((char *)bytes, "property float filter_3D\nend_header\n");
    assert_non_null(end);
    const size_t head =
        (size_t)(end - (char *)bytes) + strlen("property float filter_3D\nend_header\n");
    assert_int_equal(size, head + 5 * 63 * 4);
    for (size_t i = 0; i < 5; ++i) {
        float value;
        memcpy(&value, bytes + head + (i * 63 + 62) * 4, sizeof value);
        assert_true(value == filter[i]);
    }
    sgs_gaussians *back; // readers that do not know the property read the rest
    assert_int_equal(sgs_ply_read(path, &back), SGS_STATUS_OK);
    assert_int_equal(back->count, 5);
    sgs_gaussians_destroy(back);
    sgsi_free(bytes);
    oracle_scene_free(&scene);
    unlink(path);
}

static void reset_limits_the_filtered_opacity(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(5, 40, NULL);
    float filter[48] = {0},
          *m = sgsi_calloc(scene.model->capacity, SGS_PARAM_COUNT * sizeof(float));
    double before[40];
    for (size_t i = 0; i < 40; ++i) {
        filter[i] = 0.2f * (float)sgsi_random_uniform(4, i);
        before[i] = 1 / (1 + exp(-(double)*sgs_gaussians_at(scene.model, i, SGS_PARAM_OPACITY)));
    }
    sgsi_density_reset_opacity(scene.model, m, m, 0.01, filter);
    for (size_t i = 0; i < 40; ++i) {
        double factor = 1;
        for (int k = 0; k < 3; ++k) {
            const double s = exp((double)*sgs_gaussians_at(scene.model, i, SGS_PARAM_SCALE + k));
            factor *= s / sqrt(s * s + (double)filter[i] * (double)filter[i]);
        }
        const double after =
            1 / (1 + exp(-(double)*sgs_gaussians_at(scene.model, i, SGS_PARAM_OPACITY)));
        const double expected = fmin(before[i] * factor, 0.01) / factor;
        assert_true(fabs(after - expected) <= 1e-5 * expected + 1e-6);
    }
    sgsi_free(m);
    oracle_scene_free(&scene);
}

// As many rows pass the absolute threshold as the signed one.
static void absolute_gradients_select_as_many_as_signed_ones(void **state)
{
    (void)state;
    enum { N = 1000 };
    float x[N], score[N], absolute[N], weight[N], opacity[N], scale[N], priority[N];
    uint8_t redundant[N] = {0}, action[N] = {0}, removed[N] = {0}, prune_children[N] = {0};
    size_t pulled = 0;
    for (size_t i = 0; i < N; ++i) {
        score[i] = 4e-4f * (float)sgsi_random_uniform(1, i) * (float)sgsi_random_uniform(2, i);
        absolute[i] = (float)sgsi_random_uniform(3, i);
        x[i] = 0;
        weight[i] = 1;
        opacity[i] = 0.5f;
        scale[i] = i % 3 ? 0.01f : 1;
        pulled += score[i] >= 2e-4f;
    }
    sgsi_density_columns columns = {.count = N,
                                    .x = x,
                                    .y = x,
                                    .z = x,
                                    .opacity = opacity,
                                    .scale_max = scale,
                                    .score = score,
                                    .abs_grad = absolute,
                                    .weight = weight,
                                    .redundant = redundant,
                                    .action = action,
                                    .removed = removed,
                                    .prune_children = prune_children,
                                    .priority = priority};
    const sgsi_density_options options = {
        .gradient_threshold = 2e-4, .opacity_min = 0.005, .size_split = 0.1, .size_max = INFINITY};
    sgsi_density_result result = {0};
    assert_int_equal(sgsi_pipeline_mip.decide(&options, &columns, &result), SGS_STATUS_OK);
    size_t by_absolute = 0, both = 0;
    float least = INFINITY;
    for (size_t i = 0; i < N; ++i) {
        const bool grows = action[i] != SGSI_ACTION_KEEP;
        both += grows;
        if (grows && score[i] < 2e-4f) {
            least = fminf(least, absolute[i]);
            ++by_absolute;
        }
        assert_true(!grows || (action[i] == SGSI_ACTION_SPLIT) == (i % 3 == 0));
    }
    for (size_t i = 0; i < N; ++i) // all rows with a larger absolute gradient are selected
        assert_true(action[i] != SGSI_ACTION_KEEP || absolute[i] < least);
    size_t above = 0;
    for (size_t i = 0; i < N; ++i)
        above += absolute[i] >= least;
    assert_true(pulled > 20 && by_absolute > 0 && both < 2 * pulled + 2);
    assert_true(above + 2 >= pulled && above <= pulled + 2);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(filter_is_the_finest_sampling_of_all_views),
        cmocka_unit_test(the_nearest_view_is_found_among_many),
        cmocka_unit_test(ranks_are_those_of_a_sorted_copy),
        cmocka_unit_test(fused_model_looks_the_same_without_its_filter),
        cmocka_unit_test(models_are_filtered_row_by_row),
        cmocka_unit_test(removing_the_filter_restores_the_raw_primitive),
        cmocka_unit_test(primitives_below_the_filter_keep_opacity_times_volume),
        cmocka_unit_test(filter_is_the_last_of_63_properties),
        cmocka_unit_test(reset_limits_the_filtered_opacity),
        cmocka_unit_test(absolute_gradients_select_as_many_as_signed_ones),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
