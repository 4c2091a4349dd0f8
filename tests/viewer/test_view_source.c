// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The memory of a viewer does not grow with the number of cameras that its pages show.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "support/oracle_support.h"
#include "viewer/view_crop.h"

enum { WIDTH = 1280, HEIGHT = 960, CAMERAS = 8 };
static const double pixel_bytes = 2 * sizeof(float); // at least: the two coordinates of a ray

// Renders with many fields of view; the ray tables of all of them would exceed the limit.
static void look_around(sgs_renderer *renderer)
{
    assert_true(CAMERAS * pixel_bytes * WIDTH * HEIGHT > VIEWER_RAY_BYTES);
    sgs_frame frame;
    sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, WIDTH, HEIGHT);
    const sgs_pose pose = oracle_pose_look_at(1.9, -1.2, -3.3);
    assert_int_equal(sgs_frame_create_with(WIDTH, HEIGHT, 0, &frame), SGS_STATUS_OK);
    for (int i = 0; i < CAMERAS; ++i) {
        camera.params[0] = camera.params[1] = 500 + 10 * i;
        assert_int_equal(sgs_renderer_render(renderer, &camera, &pose, NULL, &frame),
                         SGS_STATUS_OK);
        assert_true((double)sgs_renderer_ray_bytes(renderer) >= pixel_bytes * WIDTH * HEIGHT);
        assert_true(sgs_renderer_ray_bytes(renderer) <= VIEWER_RAY_BYTES);
    }
    sgs_frame_free(&frame);
}

static void ray_tables_of_viewer_and_preview_are_limited(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(5, 40, NULL);
    view_source source = {.name = "model"};
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(scene.count, &model), SGS_STATUS_OK);
    assert_true(model_copy(model, scene.model));
    assert_true(view_source_open(&source, model, NULL, 0));
    look_around(source.renderer);
    crop_preview preview = {0};
    const view_crop crop = {.preview = CROP_HIDE, .region = -1, .slack = -INFINITY, .opacity = 0.1};
    assert_true(crop_preview_prepare(&preview, &crop, &source));
    look_around(preview.renderer);
    crop_preview_free(&preview);
    view_source_close(&source);
    oracle_scene_free(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ray_tables_of_viewer_and_preview_are_limited),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
