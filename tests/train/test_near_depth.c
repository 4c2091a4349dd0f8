// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The limit of the depth below which gradients count less, in scenes of elongated captures.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include <cmocka.h>

#include "base/core.h"
#include "sparegs/scene.h"
#include "support/trainer_support.h"
#include "train/near_depth.h"
#include "train/trainer_state.h"

enum { VIEWS = 21, POINTS = 840 };

// `views` cameras on a line of this length look at a wall in front of them, `depth` away. Every
// eighth one is held out.
static sgs_scene *make_wall(size_t views, double length, double depth, sgs_camera camera)
{
    static float points[3 * POINTS];
    static unsigned char colors[3 * POINTS];
    sgs_view_source *sources = calloc(views, sizeof *sources);
    char(*names)[32] = calloc(views, sizeof *names);
    unsigned char *pixels = calloc((size_t)camera.width * (size_t)camera.height, 3);
    for (size_t v = 0; v < views; ++v) {
        const double x = length * (double)v / (double)(views - 1);
        snprintf(names[v], sizeof names[v], "%05zu.png", v);
        sources[v] = (sgs_view_source){
            .name = names[v],
            .camera = camera,
            .pose = {.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .translation = {-x, 0, 0}},
            .pixel_type = SGS_PIXEL_UINT8,
            .channels = 3,
            .pixels = pixels};
    }
    for (size_t i = 0; i < POINTS; ++i) {
        points[3 * i] = (float)(length * sgsi_random_uniform(1, i));
        points[3 * i + 1] = (float)(depth * (sgsi_random_uniform(2, i) - 0.5));
        points[3 * i + 2] = (float)depth;
    }
    sgs_scene_options options = sgs_scene_options_default();
    options.test_every = 8;
    sgs_scene *scene = NULL;
    if (sgs_scene_create(sources, views, points, colors, POINTS, &options, &scene))
        fail_msg("%s", sgs_last_error());
    free(sources);
    free(names);
    free(pixels);
    return scene;
}

static sgs_camera pinhole(int width, int height)
{
    return (sgs_camera){.model = SGS_CAMERA_PINHOLE,
                        .width = width,
                        .height = height,
                        .params = {0.8 * width, 0.8 * width, 0.5 * width, 0.5 * height}};
}

static double limit_of(sgs_scene *scene)
{
    double limit = -1.0;
    assert_int_equal(sgsi_near_depth_limit(scene, &limit), SGS_STATUS_OK);
    return limit;
}

static void limit_is_low_on_elongated_paths(void **state)
{
    (void)state;
    static const double lengths[] = {1.0, 10.0, 200.0};
    for (size_t k = 0; k < 3; ++k) {
        sgs_scene *scene = make_wall(VIEWS, lengths[k], 10.0, pinhole(64, 48));
        const double expected = 0.45 * 10.0 / scene->extent;
        assert_true(fabs(limit_of(scene) - expected) < 1e-6 * expected);
        assert_true((expected < 0.37) == (k == 2));
        sgs_scene_destroy(scene);
    }
}

// The median distance from the cameras, by brute force.
static void distances_count_in_panoramas(void **state)
{
    (void)state;
    sgs_scene *scene = make_wall(VIEWS, 200.0, 10.0, sgs_camera_equirectangular(64, 32));
    static double distances[VIEWS * POINTS];
    size_t count = 0;
    for (size_t v = 0; v < scene->view_count; ++v) {
        if (scene->views[v].split != SGS_SPLIT_TRAIN)
            continue;
        double center[3];
        sgs_pose_center(&scene->views[v].pose, center);
        for (size_t i = 0; i < POINTS; ++i) {
            double sum = 0.0;
            for (size_t a = 0; a < 3; ++a)
                sum += pow((double)scene->points[3 * i + a] - center[a], 2);
            distances[count++] = sqrt(sum);
        }
    }
    size_t below = 0, above = 0;
    const double limit = limit_of(scene), median = limit * scene->extent / 0.45;
    for (size_t i = 0; i < count; ++i) {
        below += distances[i] < median - 1e-3;
        above += distances[i] > median + 1e-3;
    }
    assert_true(limit > 0.0 && below <= count / 2 + 1 && above <= count / 2 + 1);
    sgs_scene_destroy(scene);
}

static void points_outside_all_images_give_no_limit(void **state)
{
    (void)state;
    sgs_scene *scene = make_wall(VIEWS, 200.0, -10.0, pinhole(64, 48));
    assert_true(limit_of(scene) == 0.0);
    sgs_scene_destroy(scene);
}

// More views than are looked at: with every eighth one of 1800, all would be held out.
static void training_views_are_sampled(void **state)
{
    (void)state;
    sgs_scene *scene = make_wall(1800, 200.0, 10.0, pinhole(8, 6));
    assert_true(fabs(limit_of(scene) - 4.5 / scene->extent) < 1e-6);
    sgs_scene_destroy(scene);
}

// Also if the points have changed in between.
static void a_resumed_run_keeps_its_limit(void **state)
{
    (void)state;
    char path[64];
    snprintf(path, sizeof path, "/tmp/sparegs_near_%ld", (long)getpid());
    double depths[2];
    for (int k = 0; k < 2; ++k) {
        sgs_scene *scene = make_wall(VIEWS, 200.0, k ? 2.0 : 1.0, pinhole(640, 500));
        sgs_train_options options = sgs_train_options_default();
        options.iterations = 7000;
        sgs_trainer *trainer = trainer_create(scene, &options);
        assert_true(
            fabs(sgsi_trainer_near_depth(trainer) - 0.45 * (k ? 2.0 : 1.0) / scene->extent) < 1e-6);
        if (k)
            assert_int_equal(sgs_trainer_load_checkpoint(trainer, path), SGS_STATUS_OK);
        else
            assert_int_equal(sgs_trainer_save_checkpoint(trainer, path), SGS_STATUS_OK);
        depths[k] = sgsi_trainer_near_depth(trainer);
        sgs_trainer_destroy(trainer);
        sgs_scene_destroy(scene);
    }
    remove(path);
    assert_true(depths[0] > 0.0 && depths[0] == depths[1]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(limit_is_low_on_elongated_paths),
        cmocka_unit_test(distances_count_in_panoramas),
        cmocka_unit_test(points_outside_all_images_give_no_limit),
        cmocka_unit_test(training_views_are_sampled),
        cmocka_unit_test(a_resumed_run_keeps_its_limit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
