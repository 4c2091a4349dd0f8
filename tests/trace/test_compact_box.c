// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Compact box of FastGS (Ren et al. 2025): a tile omits a primitive whose alpha in it is below o
// (255 o)^-share. Other tiles do not change.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "sparegs/trainer.h"
#include "support/tracer_support.h"

static traced_view trace(const sgs_gaussians *model, const sgs_camera *camera, double compact_box)
{
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    traced_view traced = {.options = sgs_render_options_default()};
    traced.options.compact_box = compact_box;
    assert_int_equal(sgsi_tracer_create(&traced.tracer), SGS_STATUS_OK);
    traced_aim(&traced, camera, &pose, 2);
    traced_project(&traced, model, true, SGSI_BVH_REFIT);
    traced_forward(&traced, NULL);
    return traced;
}

// Alpha of one primitive with and without a compact box, and the number of pixels it loses.
static size_t compare_one(const traced_view *exact, const traced_view *compact, double faintest)
{
    size_t lost = 0;
    for (int y = 0; y < exact->camera.height; ++y)
        for (int x = 0; x < exact->camera.width; ++x) {
            const size_t at = (size_t)y * exact->planes.stride + (size_t)x;
            const float t = compact->planes.transmittance[at],
                        before = exact->planes.transmittance[at];
            if (t == before)
                continue;
            assert_true(t == 1.0f && compact->planes.color[0][at] == 0.0f &&
                        compact->planes.hits[at] == 0.0f);
            if (!(1.0 - (double)before < faintest * 1.0001))
                fail_msg("pixel %d, %d lost alpha %g, the box spares less than %g", x, y,
                         1.0 - (double)before, faintest);
            ++lost;
        }
    return lost;
}

static void compact_box_keeps_alpha_in_tiles_and_drops_only_faint_parts(void **state)
{
    (void)state;
    static const sgs_camera_model lenses[] = {SGS_CAMERA_PINHOLE, SGS_CAMERA_OPENCV_FISHEYE};
    for (size_t lens = 0; lens < 2; ++lens) {
        const sgs_camera camera = oracle_camera(lenses[lens], 320, 240);
        for (int step = 1; step <= 4; ++step) {
            const double opacity = 0.24 * step;
            oracle_scene scene = oracle_scene_create(1);
            oracle_set_ball(oracle_primitive(&scene, 0), 0.1, -0.05, 0.3, 0.25, opacity);
            oracle_scene_round(&scene);
            traced_view exact = trace(scene.model, &camera, 1.0);
            size_t before = 0;
            for (double share = 0.8; share > 0.1; share -= 0.3) {
                traced_view compact = trace(scene.model, &camera, share);
                const size_t lost =
                    compare_one(&exact, &compact, opacity * pow(255 * opacity, -share));
                assert_true(lost >= before);
                before = lost;
                traced_destroy(&compact);
            }
            assert_true(before > 0);
            traced_destroy(&exact);
            oracle_scene_free(&scene);
        }
    }
}

static void lists_and_images_equal_those_without_a_bvh(void **state)
{
    (void)state;
    const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, 83, 61);
    for (int number = 0; number < TRACED_SCENE_COUNT; ++number) {
        oracle_scene scene = traced_scene(number);
        traced_view exact = trace(scene.model, &camera, 1.0),
                    compact = trace(scene.model, &camera, 0.5);
        traced_assert_matches_brute_force(&compact, scene.count, traced_scene_name(number));
        assert_true(sgsi_tracer_counts(compact.tracer).candidates <=
                    sgsi_tracer_counts(exact.tracer).candidates);
        traced_destroy(&compact);
        traced_destroy(&exact);
        oracle_scene_free(&scene);
    }
}

static void compact_box_out_of_range_is_rejected(void **state)
{
    (void)state;
    static const double bad[] = {0.0, -1.0, 1.5, NAN};
    oracle_scene scene = traced_scene(0);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 16, 16);
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    sgs_renderer *renderer;
    sgs_frame frame;
    assert_int_equal(sgs_renderer_create(scene.model, &renderer), SGS_STATUS_OK);
    assert_int_equal(sgs_frame_create(16, 16, &frame), SGS_STATUS_OK);
    for (size_t i = 0; i < sizeof bad / sizeof *bad; ++i) {
        sgs_render_options options = sgs_render_options_default();
        options.compact_box = bad[i];
        assert_int_equal(sgs_renderer_render(renderer, &camera, &pose, &options, &frame),
                         SGS_STATUS_INVALID_ARGUMENT);
        sgs_train_options train = sgs_train_options_default();
        train.compact_box = bad[i];
        sgs_trainer *trainer;
        assert_int_equal(sgs_trainer_create(NULL, &train, &trainer), SGS_STATUS_INVALID_ARGUMENT);
    }
    sgs_frame_free(&frame);
    sgs_renderer_destroy(renderer);
    oracle_scene_free(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(compact_box_keeps_alpha_in_tiles_and_drops_only_faint_parts),
        cmocka_unit_test(lists_and_images_equal_those_without_a_bvh),
        cmocka_unit_test(compact_box_out_of_range_is_rejected),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
