// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The depth below which gradients count less, in scenes whose points are close to the cameras.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>

#include <cmocka.h>

#include "base/core.h"
#include "sparegs/scene.h"
#include "train/near_depth.h"

enum { VIEWS = 21, SIDE = 40, POINTS = VIEWS * SIDE };

// Cameras on a line of this length look at a wall in front of them, `depth` away.
static sgs_scene *make_wall(double length, double depth, sgs_camera camera)
{
    static float points[3 * POINTS];
    static unsigned char colors[3 * POINTS], pixels[3 * 64 * 48];
    sgs_view_source views[VIEWS] = {0};
    for (int v = 0; v < VIEWS; ++v) {
        const double x = length * v / (VIEWS - 1);
        views[v] = (sgs_view_source){
            .name = "view",
            .camera = camera,
            .pose = {.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .translation = {-x, 0, 0}},
            .pixel_type = SGS_PIXEL_UINT8,
            .channels = 3,
            .pixels = pixels};
    }
    static char names[VIEWS][16];
    for (int v = 0; v < VIEWS; ++v) {
        snprintf(names[v], sizeof names[v], "%02d.png", v);
        views[v].name = names[v];
    }
    for (size_t i = 0; i < POINTS; ++i) {
        points[3 * i] = (float)(length * sgsi_random_uniform(1, i));
        points[3 * i + 1] = (float)(depth * (sgsi_random_uniform(2, i) - 0.5));
        points[3 * i + 2] = (float)depth;
    }
    const sgs_scene_options options = sgs_scene_options_default();
    sgs_scene *scene = NULL;
    if (sgs_scene_create(views, VIEWS, points, colors, POINTS, &options, &scene))
        fail_msg("%s", sgs_last_error());
    return scene;
}

static double limit_of(sgs_scene *scene)
{
    double share = 0.37;
    assert_int_equal(sgsi_near_depth_limit(scene, &share), SGS_STATUS_OK);
    return share;
}

static void depth_is_limited_on_elongated_paths(void **state)
{
    (void)state;
    const sgs_camera camera = {
        .model = SGS_CAMERA_PINHOLE, .width = 64, .height = 48, .params = {50, 50, 32, 24}};
    static const double lengths[] = {1.0, 10.0, 200.0};
    for (size_t k = 0; k < 3; ++k) {
        sgs_scene *scene = make_wall(lengths[k], 10.0, camera);
        const double expected = fmin(0.37, 0.45 * 10.0 / scene->extent);
        assert_true(fabs(limit_of(scene) - expected) < 1e-6);
        assert_true((expected < 0.37) == (k == 2));
        sgs_scene_destroy(scene);
    }
}

// The median distance from the cameras, by brute force.
static void distances_count_in_panoramas(void **state)
{
    (void)state;
    sgs_scene *scene = make_wall(200.0, 10.0, sgs_camera_equirectangular(64, 32));
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
    assert_true(limit < 0.37 && below <= count / 2 + 1 && above <= count / 2 + 1);
    sgs_scene_destroy(scene);
}

static void scenes_without_visible_points_keep_the_share(void **state)
{
    (void)state;
    const sgs_camera camera = {
        .model = SGS_CAMERA_PINHOLE, .width = 64, .height = 48, .params = {50, 50, 32, 24}};
    sgs_scene *scene = make_wall(200.0, -10.0, camera);
    assert_true(limit_of(scene) == 0.37);
    sgs_scene_destroy(scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(depth_is_limited_on_elongated_paths),
        cmocka_unit_test(distances_count_in_panoramas),
        cmocka_unit_test(scenes_without_visible_points_keep_the_share),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
