// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The bench: its scenes are deterministic and have the documented statistics, its counts equal the
// oracle's, its times add up, its model does not drift, and the machine limits are plausibly
// ordered. No absolute times.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "support/oracle_support.h"

#include "sparegs/bench.h"
#include "sparegs/runtime.h"

enum { WIDTH = 53, HEIGHT = 38, COUNT = 400 };

static void scenes_are_determined_by_name_and_seed(void **state)
{
    (void)state;
    char hex[3][17];
    for (int k = 0; k < 3; ++k) {
        sgs_bench_scene *scene;
        sgs_threads_set(1 + 2 * (k == 1));
        assert_int_equal(sgs_bench_scene_create("sparse-32k", k == 2, &scene), SGS_STATUS_OK);
        assert_int_equal(scene->model->count, 32768);
        sgs_gaussians_hash(scene->model, hex[k]);
        sgs_bench_scene_destroy(scene);
    }
    sgs_threads_set(0);
    assert_string_equal(hex[0], hex[1]);
    assert_string_not_equal(hex[0], hex[2]);
    sgs_bench_scene *none;
    assert_int_equal(sgs_bench_scene_create("sparse-33k", 0, &none), SGS_STATUS_INVALID_ARGUMENT);
    assert_null(none);
    sgs_bench_scene_destroy(NULL);
}

// The sizes of the primitives follow the pixels: a scene for larger images has smaller primitives.
static void large_images_have_smaller_primitives(void **state)
{
    (void)state;
    static const char *const names[] = {"dense-500k", "dense-1m-1.3mp"};
    double size[2], width[2];
    for (int k = 0; k < 2; ++k) {
        sgs_bench_scene *scene;
        assert_int_equal(sgs_bench_scene_create(names[k], 0, &scene), SGS_STATUS_OK);
        size[k] = 0;
        for (size_t i = 0; i < 10000; ++i) {
            float p[SGS_PARAM_COUNT];
            sgs_gaussians_get(scene->model, i, p);
            size[k] += p[SGS_PARAM_SCALE] / 10000.0;
        }
        const sgs_camera *camera = &scene->views[1].camera;
        width[k] = camera->width;
        assert_true(fabs(camera->params[0] / camera->width - 0.85) < 1e-12);
        assert_true(camera->width * camera->height > 480000 * (k + 1));
        sgs_bench_scene_destroy(scene);
    }
    // Means of log-scales: 2.0 and 1.75 pixels, and a pixel is 800/1312 as large.
    assert_true(fabs(exp(size[1] - size[0]) - 2.0 / 1.75 * width[0] / width[1]) < 0.03);
}

static void scenes_have_statistics_of_trained_models(void **state)
{
    (void)state;
    sgs_bench_scene *scene;
    assert_int_equal(sgs_bench_scene_create("sparse-32k", 0, &scene), SGS_STATUS_OK);
    const size_t n = scene->model->count;
    size_t faint = 0, thin = 0, far = 0;
    double sum = 0, square = 0;
    for (size_t i = 0; i < n; ++i) {
        float p[SGS_PARAM_COUNT];
        sgs_gaussians_get(scene->model, i, p);
        for (int k = 0; k < SGS_PARAM_COUNT; ++k)
            assert_true(isfinite(p[k]));
        faint += p[SGS_PARAM_OPACITY] < -2.19f; // opacity 0.1
        thin += p[SGS_PARAM_SCALE + 2] < fminf(p[SGS_PARAM_SCALE], p[SGS_PARAM_SCALE + 1]);
        const double distance = sqrt((double)(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]));
        far += distance > 20;
        // Log of size over distance: normal with standard deviation 0.5, plus the spread of
        // distances to the camera.
        if (distance < 20)
            continue;
        const double size = (double)p[SGS_PARAM_SCALE] - log(distance);
        sum += size;
        square += size * size;
    }
    assert_true(fabs((double)faint / (double)n - 0.5) < 0.02);
    assert_true((double)thin > 0.85 * (double)n);
    assert_true((double)far > 0.1 * (double)n && (double)far < 0.4 * (double)n);
    const double deviation = sqrt(square / (double)far - sum * sum / ((double)far * (double)far));
    assert_true(deviation > 0.45 && deviation < 0.55);
    sgs_bench_scene_destroy(scene);
}

static void counts_equal_the_oracle_and_times_add_up(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(21, COUNT, NULL);
    sgs_view views[2] = {{.name = "a",
                          .camera = oracle_camera(SGS_CAMERA_OPENCV, WIDTH, HEIGHT),
                          .pose = oracle_pose_look_at(0, 0, -4)},
                         {.name = "b",
                          .camera = oracle_camera(SGS_CAMERA_OPENCV, WIDTH, HEIGHT),
                          .pose = oracle_pose_look_at(1, 0, -4)}};
    const sgs_render_options options = sgs_render_options_default();
    double hits = 0;
    for (int v = 0; v < 2; ++v) {
        sgs_reference_frame exact;
        assert_int_equal(sgs_reference_frame_create(WIDTH, HEIGHT, &exact), SGS_STATUS_OK);
        assert_int_equal(sgs_reference_render(scene.params, scene.count, &views[v].camera,
                                              &views[v].pose, &options, &exact),
                         SGS_STATUS_OK);
        for (int i = 0; i < WIDTH * HEIGHT; ++i)
            hits += 0.5 * exact.hits[i];
        sgs_reference_frame_free(&exact);
    }
    sgs_bench *bench;
    assert_int_equal(sgs_bench_create(scene.model, views, 2, &bench), SGS_STATUS_OK);
    sgs_bench_counts before = {0};
    for (int run = 0; run < 3; ++run) {
        sgs_bench_sample s;
        assert_int_equal(sgs_bench_run(bench, &s), SGS_STATUS_OK);
        const sgs_bench_counts c = sgs_bench_counts_get(bench);
        assert_true(fabs(c.hits - hits) <= 1e-3 * hits);
        assert_true(c.primitives == (double)scene.count && c.pixels == WIDTH * HEIGHT &&
                    c.tiles == 4 * 3);
        assert_true(c.hits <= 16 * c.block_hits && c.block_hits <= c.evaluations &&
                    c.evaluations <= 16 * c.candidates);
        if (run) // the model is restored: the same work each time
            assert_true(c.evaluations == before.evaluations && c.block_hits == before.block_hits);
        before = c;
        const double parts = s.refit + s.gather + s.forward + s.loss + s.backward + s.optimizer;
        assert_true(s.build > 0 && parts > 0 && parts <= s.iteration * (1 + 1e-9));
        assert_true(s.project <= s.forward && s.reduce <= s.backward);
        assert_true(s.serial >= 0 && s.serial + s.waiting <= s.iteration);
        const double bytes = c.bytes.project + c.bytes.bvh + c.bytes.gather + c.bytes.forward +
                             c.bytes.loss + c.bytes.backward + c.bytes.optimizer;
        assert_true(fabs(bytes / c.bytes.total - 1) < 1e-9);
        assert_true(c.forward_flops >= 16 * 40 * c.evaluations &&
                    c.backward_flops > 16 * 40 * c.block_hits);
    }
    sgs_bench_destroy(bench);
    assert_int_equal(sgs_bench_create(scene.model, views, 0, &bench), SGS_STATUS_INVALID_ARGUMENT);
    assert_null(bench);
    oracle_scene_free(&scene);
}

// Steps as in sgs_bench_run, which sets the counts to 0.
static void restored_steps_do_the_same_work(void **state)
{
    (void)state;
    enum { VIEWS = 2, ROUNDS = 3 };
    oracle_scene scene = oracle_random_model(23, COUNT, NULL);
    sgs_view views[VIEWS];
    for (int v = 0; v < VIEWS; ++v)
        views[v] = (sgs_view){.name = v ? "b" : "a",
                              .camera = oracle_camera(SGS_CAMERA_OPENCV, WIDTH, HEIGHT),
                              .pose = oracle_pose_look_at(v, 0, -4)};
    sgs_bench *bench;
    sgs_bench_sample sample;
    double work[ROUNDS][VIEWS], total = 0;
    assert_int_equal(sgs_bench_create(scene.model, views, VIEWS, &bench), SGS_STATUS_OK);
    assert_int_equal(sgs_bench_run(bench, &sample), SGS_STATUS_OK);
    const sgs_bench_counts run = sgs_bench_counts_get(bench);
    sample = (sgs_bench_sample){.iteration = 1};
    assert_int_equal(sgs_bench_build(bench, &sample), SGS_STATUS_OK);
    assert_true(sample.build > 0 && sample.iteration == 1 && sample.refit == 0);
    const double build = sample.build;
    double evaluations = run.evaluations;
    for (int round = 0; round < ROUNDS; ++round)
        for (int v = 0; v < VIEWS; ++v) {
            const double before = sample.iteration;
            assert_int_equal(sgs_bench_step(bench, &sample), SGS_STATUS_OK);
            assert_true(sample.iteration > before && sample.build == build);
            const double now = sgs_bench_counts_get(bench).evaluations;
            work[round][v] = now - evaluations;
            total += round ? 0 : work[round][v];
            evaluations = now;
            sgs_bench_restore(bench);
        }
    assert_true(total == VIEWS * run.evaluations);
    for (int round = 0; round < ROUNDS; ++round) { // each view once, in any order
        const double least = fmin(work[round][0], work[round][1]);
        assert_true(least > 0 && least == fmin(work[0][0], work[0][1]));
        assert_true(fmax(work[round][0], work[round][1]) == total - least && total > 2 * least);
    }
    assert_int_equal(sgs_bench_rank_build(bench, &sample), SGS_STATUS_OK);
    assert_true(sample.rank_build > 0 && sample.build == build);
    sgs_bench_destroy(bench);
    oracle_scene_free(&scene);
}

// The bench draws with the given filter and near distance: of a small scene the default limit would
// remove all hits.
static void a_small_scene_is_measured_with_its_near_limit(void **state)
{
    (void)state;
    const double size = 0.02;
    oracle_scene scene = oracle_random_model(22, COUNT, NULL);
    for (size_t i = 0; i < scene.count; ++i)
        for (int k = 0; k < 3; ++k) {
            oracle_primitive(&scene, i)[SGS_PARAM_MEAN + k] *= size;
            oracle_primitive(&scene, i)[SGS_PARAM_SCALE + k] += log(size);
        }
    oracle_scene_round(&scene);
    const sgs_view view = {.name = "a",
                           .camera = oracle_camera(SGS_CAMERA_OPENCV, WIDTH, HEIGHT),
                           .pose = oracle_pose_look_at(0, 0, -4 * size)};
    for (int filter = SGS_FILTER_3DGS; filter <= SGS_FILTER_MIP; ++filter) {
        sgs_render_options options = oracle_render_options((sgs_filter)filter, 3, NULL);
        options.near_distance = sgs_near_distance(size);
        sgs_reference_frame exact;
        assert_int_equal(sgs_reference_frame_create(WIDTH, HEIGHT, &exact), SGS_STATUS_OK);
        assert_int_equal(sgs_reference_render(scene.params, scene.count, &view.camera, &view.pose,
                                              &options, &exact),
                         SGS_STATUS_OK);
        double hits = 0;
        for (int i = 0; i < WIDTH * HEIGHT; ++i)
            hits += exact.hits[i];
        sgs_reference_frame_free(&exact);
        sgs_bench *bench;
        sgs_bench_sample sample;
        assert_int_equal(sgs_bench_create_with(scene.model, &view, 1, &options, &bench),
                         SGS_STATUS_OK);
        assert_int_equal(sgs_bench_run(bench, &sample), SGS_STATUS_OK);
        const sgs_bench_counts counts = sgs_bench_counts_get(bench);
        assert_true(hits > WIDTH * HEIGHT && fabs(counts.hits - hits) <= 1e-3 * hits);
        // The trained iteration draws the same: lists hold pairs with a counted hit only.
        assert_true(counts.block_hits <= hits && hits <= 16 * counts.block_hits);
        sgs_bench_destroy(bench);
    }
    sgs_render_options options = oracle_render_options(SGS_FILTER_MIP, 3, scene.filter_3d);
    sgs_bench *bench;
    assert_int_equal(sgs_bench_create_with(scene.model, &view, 1, &options, &bench),
                     SGS_STATUS_UNSUPPORTED);
    assert_null(bench);
    oracle_scene_free(&scene);
}

static void machine_limits_are_plausibly_ordered(void **state)
{
    (void)state;
    sgs_machine_limits limits = {0};
    sgs_threads_set(1);
    // Several attempts, because other programs may interfere.
    for (int k = 0; k < 8 && !(limits.l2_gbs > limits.memory_read_gbs); ++k)
        assert_int_equal(sgs_machine_limits_measure(&limits), SGS_STATUS_OK);
    sgs_threads_set(0);
    assert_true(limits.fma_gflops > 0 && limits.memory_read_gbs > 0 &&
                limits.memory_update_gbs > 0);
    assert_true(limits.memory_gbs == fmax(limits.memory_read_gbs, limits.memory_update_gbs));
    // A core reads its cache faster than memory.
    assert_true(limits.l2_gbs > limits.memory_read_gbs);
    assert_true(limits.l2_bytes >= 1 << 16);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(scenes_are_determined_by_name_and_seed),
        cmocka_unit_test(scenes_have_statistics_of_trained_models),
        cmocka_unit_test(large_images_have_smaller_primitives),
        cmocka_unit_test(counts_equal_the_oracle_and_times_add_up),
        cmocka_unit_test(restored_steps_do_the_same_work),
        cmocka_unit_test(a_small_scene_is_measured_with_its_near_limit),
        cmocka_unit_test(machine_limits_are_plausibly_ordered),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
