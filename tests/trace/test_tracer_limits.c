// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Limits of the tracer: invariants without an oracle, empty models and views, extreme parameters. A
// primitive with non-finite parameters, or too large for single precision, may disappear or fill
// the image. It must not crash, hang, or affect its neighbours in memory or in the tree.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>

#include "support/tracer_support.h"

// ---- Invariants ----

static void white_over_white_is_white(void **state)
{
    (void)state;
    for (int number = 0; number < TRACED_SCENE_COUNT; ++number) {
        oracle_scene scene = traced_scene(number);
        for (size_t i = 0; i < scene.count; ++i) {
            memset(oracle_primitive(&scene, i) + SGS_PARAM_SH_REST, 0, 45 * sizeof(double));
            oracle_set_color(oracle_primitive(&scene, i), 1, 1, 1);
        }
        oracle_scene_round(&scene);
        const sgs_camera camera = oracle_camera(traced_lenses[number % 3], 50, 37);
        const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
        traced_view traced =
            traced_create(scene.model, &camera, &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
        for (int y = 0; y < camera.height; ++y)
            for (int x = 0; x < camera.width; ++x)
                for (int c = 0; c < 3; ++c) {
                    const size_t at = (size_t)y * traced.planes.stride + (size_t)x;
                    assert_true(fabsf(traced.planes.color[c][at] + traced.planes.transmittance[at] -
                                      1) <= 2e-5f);
                }
        traced_destroy(&traced);
        oracle_scene_free(&scene);
    }
}

// Ids only break ties, so permuting primitives in memory changes nothing where all t differ: the
// block lists are equal, and so is every bit. (Duplicates do tie, and equal primitives may be
// swapped.)
static void permuting_primitives_changes_no_bit(void **state)
{
    (void)state;
    for (int number = 0; number < TRACED_RANDOM_SCENES; ++number) {
        oracle_scene scene = traced_scene(number), permuted = oracle_scene_create(scene.count);
        for (size_t i = 0; i < scene.count; ++i)
            memcpy(oracle_primitive(&permuted, i * 7 % scene.count), oracle_primitive(&scene, i),
                   SGS_PARAM_COUNT * sizeof(double));
        assert_true(scene.count % 7 != 0);
        oracle_scene_round(&permuted);
        const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, 63, 47);
        const sgs_pose pose = oracle_pose_look_at(1, 2, -4);
        traced_view one =
            traced_create(scene.model, &camera, &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
        traced_view two =
            traced_create(permuted.model, &camera, &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
        traced_assert_same_image(&one.planes, &two.planes, "permuted");
        traced_destroy(&one);
        traced_destroy(&two);
        oracle_scene_free(&scene);
        oracle_scene_free(&permuted);
    }
}

static void assert_empty_image(const traced_view *traced)
{
    for (int k = 0; k < TRACED_PLANES; ++k)
        for (int y = 0; y < traced->planes.height; ++y)
            for (int x = 0; x < traced->planes.width; ++x)
                assert_true(traced_plane(&traced->planes,
                                         k)[(size_t)y * traced->planes.stride + (size_t)x] ==
                            (k == 3 ? 1.0f : 0.0f));
}

static void backward_of_nothing_is_nothing(traced_view *traced, const sgs_gaussians *model)
{
    sgsi_planes d = traced_planes_create(traced->camera.width, traced->camera.height);
    assert_int_equal(sgsi_tracer_backward(traced->tracer, &traced->view, &traced->planes, d.color,
                                          d.transmittance),
                     SGS_STATUS_OK);
    for (size_t block = 0; block < model->count / SGS_LANES; ++block)
        assert_int_equal(sgsi_tracer_touched(traced->tracer)[block], 0);
    traced_planes_free(&d);
}

static void an_empty_model_gives_an_empty_image(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(1, 40, NULL);
    sgs_gaussians *empty;
    assert_int_equal(sgs_gaussians_create(0, &empty), SGS_STATUS_OK);
    for (int lens = 0; lens < TRACED_LENS_COUNT; ++lens) {
        const sgs_camera camera = oracle_camera(traced_lenses[lens], 35, 18);
        const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
        traced_view traced =
            traced_create(empty, &camera, &pose, SGS_FILTER_3DGS, 2, (sgsi_bvh_quality)lens);
        assert_empty_image(&traced);
        backward_of_nothing_is_nothing(&traced, empty);
        // The same tracer renders a model, then the empty one again.
        traced_project(&traced, scene.model, false, SGSI_BVH_REFIT);
        traced_forward(&traced, NULL);
        traced_assert_matches_brute_force(&traced, scene.count, "filled");
        traced_project(&traced, empty, false, SGSI_BVH_REFIT);
        traced_forward(&traced, NULL);
        assert_empty_image(&traced);
        traced_destroy(&traced);
    }
    sgs_gaussians_destroy(empty);
    oracle_scene_free(&scene);
}

static void primitives_behind_the_camera_are_invisible(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(2, 300, NULL);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 40, 30);
    const sgs_pose pose = oracle_pose_look_at(0, 0, 9);
    sgs_pose turned = pose; // half a turn about the camera's y axis
    for (int k = 0; k < 3; ++k) {
        turned.rotation[k] = -pose.rotation[k], turned.rotation[6 + k] = -pose.rotation[6 + k];
    }
    turned.translation[0] = -pose.translation[0], turned.translation[2] = -pose.translation[2];
    traced_view traced =
        traced_create(scene.model, &camera, &turned, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
    assert_empty_image(&traced);
    backward_of_nothing_is_nothing(&traced, scene.model);
    traced_destroy(&traced);
    oracle_scene_free(&scene);
}

// The model grows and shrinks between calls.
static void tracer_follows_changes_of_model_size(void **state)
{
    (void)state;
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 50, 37);
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    static const size_t counts[] = {5, 400, 17, 16, 1, 3000, 2999};
    oracle_scene first = oracle_random_model(3, 64, NULL);
    traced_view traced =
        traced_create(first.model, &camera, &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
    for (size_t i = 0; i < sizeof counts / sizeof *counts; ++i) {
        oracle_scene scene = oracle_random_model(4 + i, counts[i], NULL);
        traced_project(&traced, scene.model, false, SGSI_BVH_REFIT);
        traced_forward(&traced, NULL);
        traced_assert_matches_brute_force(&traced, scene.count, "resized");
        oracle_scene_free(&scene);
    }
    traced_destroy(&traced);
    oracle_scene_free(&first);
}

// ---- Extreme parameters ----

// Sets one parameter of every fifth primitive.
static void poison(oracle_scene *scene, int param, float value)
{
    for (size_t i = 2; i < scene->count; i += 5)
        *sgs_gaussians_at(scene->model, i, param) = value;
}

static void extinguish(oracle_scene *scene)
{
    for (size_t i = 2; i < scene->count; i += 5)
        *sgs_gaussians_at(scene->model, i, SGS_PARAM_OPACITY) = -30.0f;
}

static const int shape_params[] = {SGS_PARAM_MEAN,         SGS_PARAM_MEAN + 2, SGS_PARAM_ROTATION,
                                   SGS_PARAM_ROTATION + 3, SGS_PARAM_SCALE,    SGS_PARAM_SCALE + 2,
                                   SGS_PARAM_OPACITY};
enum { SHAPE_PARAM_COUNT = 7 };

// New trees, and trees built from finite primitives and refitted with non-finite ones.
static void nonfinite_primitives_vanish_without_side_effects(void **state)
{
    (void)state;
    static const float values[] = {NAN, INFINITY, -INFINITY};
    const sgs_pose pose = oracle_pose_look_at(0.5, 0, -4);
    for (int run = 0; run < SHAPE_PARAM_COUNT * 3; ++run) {
        const int param = shape_params[run / 3];
        const float value = values[run % 3];
        const sgs_camera camera = oracle_camera(traced_lenses[run % 3], 50, 37);
        oracle_scene healthy = oracle_random_model(9, 200, NULL),
                     sick = oracle_random_model(9, 200, NULL);
        traced_view traced =
            traced_create(sick.model, &camera, &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
        extinguish(&healthy);
        poison(&sick, param, value);
        traced_view expected =
            traced_create(healthy.model, &camera, &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
        traced_project(&traced, sick.model, false, SGSI_BVH_REFIT);
        traced_forward(&traced, NULL);
        traced_assert_same_image(&expected.planes, &traced.planes, "refitted over sick primitives");
        traced_project(&traced, sick.model, true, SGSI_BVH_REFIT);
        traced_forward(&traced, NULL);
        traced_assert_same_image(&expected.planes, &traced.planes, "built over sick primitives");
        traced_project(&traced, healthy.model, false, SGSI_BVH_REFIT);
        traced_forward(&traced, NULL);
        traced_assert_same_image(&expected.planes, &traced.planes,
                                 "refitted over cured primitives");
        traced_destroy(&traced);
        traced_destroy(&expected);
        oracle_scene_free(&healthy);
        oracle_scene_free(&sick);
    }
}

static void nonfinite_colours_do_not_spread_to_other_pixels(void **state)
{
    (void)state;
    static const float values[] = {NAN, INFINITY, -INFINITY, 3e38f};
    const sgs_pose pose = oracle_pose_look_at(0.5, 0, -4);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 50, 37);
    for (int run = 0; run < 8; ++run) {
        oracle_scene sick = oracle_random_model(9, 200, NULL);
        for (size_t i = 0; i < sick.count; ++i) // one small invalid primitive in the centre
            if (i == 37) {
                oracle_set_ball(oracle_primitive(&sick, i), 0, 0, 0, 0.02, 0.9);
                oracle_scene_round(&sick);
                *sgs_gaussians_at(sick.model, i,
                                  run < 4 ? SGS_PARAM_SH_DC + 1 : SGS_PARAM_SH_REST + 7) =
                    values[run % 4];
            }
        traced_view traced = {.options = sgs_render_options_default()};
        assert_int_equal(sgsi_tracer_create(&traced.tracer), SGS_STATUS_OK);
        traced_aim(&traced, &camera, &pose, 2);
        traced_project(&traced, sick.model, true, SGSI_BVH_REFIT);
        traced.planes = traced_planes_create(camera.width, camera.height);
        assert_int_equal(
            sgsi_tracer_forward(traced.tracer, &traced.view, &traced.planes, NULL, true),
            SGS_STATUS_OK);
        size_t broken = 0;
        for (int y = 0; y < camera.height; ++y)
            for (int x = 0; x < camera.width; ++x)
                for (int k = 0; k < TRACED_PLANES; ++k)
                    broken += !isfinite(traced_plane(
                        &traced.planes, k)[(size_t)y * traced.planes.stride + (size_t)x]);
        assert_int_equal(broken, 0);
        traced_destroy(&traced);
        oracle_scene_free(&sick);
    }
}

// Log scales of +-40 and beyond, logits of +-40, means a million units away: the image is finite,
// and the tree finds what brute force finds.
static void extreme_parameters_give_finite_images_and_complete_lists(void **state)
{
    (void)state;
    static const struct {
        int param;
        float value;
    } extremes[] = {
        {SGS_PARAM_SCALE, 40},
        {SGS_PARAM_SCALE, -40},
        {SGS_PARAM_SCALE + 1, 1e30f},
        {SGS_PARAM_SCALE + 2, -1e30f},
        {SGS_PARAM_SCALE, INFINITY},
        {SGS_PARAM_OPACITY, 40},
        {SGS_PARAM_OPACITY, -40},
        {SGS_PARAM_OPACITY, 1e30f},
        {SGS_PARAM_MEAN, 1e6f},
        {SGS_PARAM_MEAN + 1, -1e6f},
        {SGS_PARAM_MEAN + 2, 1e12f},
        {SGS_PARAM_MEAN, 1e25f},
        {SGS_PARAM_MEAN + 2, 3e38f},
        {SGS_PARAM_ROTATION, 1e30f},
        {SGS_PARAM_ROTATION + 1, 1e-30f},
        {SGS_PARAM_SCALE + 2, 20},
    };
    const sgs_pose pose = oracle_pose_look_at(0.5, 0, -4);
    for (int isa = 0; isa < SGS_ISA_COUNT; ++isa) {
        if (!sgs_isa_supported((sgs_isa)isa))
            continue;
        sgs_isa_set((sgs_isa)isa);
        for (size_t run = 0; run < 2 * sizeof extremes / sizeof *extremes; ++run) {
            // 210 degrees, with wide macrotile cones: the largest margins on the largest boxes.
            const sgs_camera wide = {SGS_CAMERA_OPENCV_FISHEYE, 33, 21, {9, 9, 16.5, 10.5}};
            const sgs_camera camera =
                run % 3 ? oracle_camera(traced_lenses[run % 3 - 1], 33, 21) : wide;
            oracle_scene scene = oracle_random_model(9, 150, NULL);
            poison(&scene, extremes[run / 2].param, extremes[run / 2].value);
            traced_view traced =
                traced_create(scene.model, &camera, &pose,
                              run % 2 ? SGS_FILTER_NONE : SGS_FILTER_3DGS, 4, SGSI_BVH_REFIT);
            char what[64];
            snprintf(what, sizeof what, "parameter %d = %g", extremes[run / 2].param,
                     extremes[run / 2].value);
            traced_assert_matches_brute_force(&traced, scene.count, what);
            traced_project(&traced, scene.model, false, SGSI_BVH_REFIT);
            traced_forward(&traced, NULL);
            traced_assert_matches_brute_force(&traced, scene.count, what);
            backward_of_nothing_is_nothing(&(traced_view){.tracer = traced.tracer,
                                                          .view = traced.view,
                                                          .camera = camera,
                                                          .planes = traced.planes},
                                           &(sgs_gaussians){0});
            traced_destroy(&traced);
            oracle_scene_free(&scene);
        }
    }
}

// A primitive with a non-finite gradient is not updated, its neighbours are, and statistics stay
// finite.
static void optimiser_skips_primitives_with_nonfinite_gradients(void **state)
{
    (void)state;
    const sgs_pose pose = oracle_pose_look_at(0.5, 0, -4);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 50, 37);
    for (int dense = 0; dense < 2; ++dense) {
        oracle_scene scene = oracle_random_model(9, 200, NULL);
        for (int p = 0; p < SHAPE_PARAM_COUNT; ++p)
            *sgs_gaussians_at(scene.model, 10 + 7 * (size_t)p, shape_params[p]) =
                p % 2 ? NAN : INFINITY;
        traced_view traced =
            traced_create(scene.model, &camera, &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
        sgsi_planes d = traced_planes_create(camera.width, camera.height);
        for (size_t i = 0; i < 4 * d.stride * (size_t)d.height; ++i)
            d.color[0][i] = (float)(sgsi_random_uniform(6, i) - 0.5);
        assert_int_equal(sgsi_tracer_backward(traced.tracer, &traced.view, &traced.planes, d.color,
                                              d.transmittance),
                         SGS_STATUS_OK);
        const size_t capacity = scene.model->capacity, floats = capacity * SGS_PARAM_COUNT;
        float *m = sgsi_calloc(floats, sizeof *m), *v = sgsi_calloc(floats, sizeof *v),
              *sum = sgsi_calloc(capacity, sizeof *sum);
        float *before = sgsi_alloc(floats, sizeof *before);
        memcpy(before, scene.model->data, floats * sizeof *before);
        const sgsi_optimize input = {.params = scene.model->data,
                                     .m = m,
                                     .v = v,
                                     .count = scene.count,
                                     .view = traced.view,
                                     .sums = sgsi_tracer_grad_sums(traced.tracer),
                                     .touched = sgsi_tracer_touched(traced.tracer),
                                     .dense = dense,
                                     .apply = true,
                                     .lr_mean = 1e-3f,
                                     .lr_rotation = 1e-3f,
                                     .lr_scale = 1e-3f,
                                     .lr_opacity = 1e-3f,
                                     .lr_dc = 1e-3f,
                                     .lr_rest = 1e-3f,
                                     .beta1 = 0.9f,
                                     .beta2 = 0.999f,
                                     .epsilon = 1e-15f,
                                     .correction1 = 1,
                                     .correction2 = 1,
                                     .gradient_sum = sum,
                                     .tan_half_x = 0.5f,
                                     .tan_half_y = 0.4f};
        sgsi_optimize_blocks(&input, 0, capacity / SGS_LANES);
        size_t stepped = 0;
        for (size_t i = 0; i < scene.count; ++i) {
            const bool sick = i >= 10 && (i - 10) % 7 == 0 && (i - 10) / 7 < SHAPE_PARAM_COUNT;
            assert_true(isfinite(sum[i]));
            for (int k = 0; k < SGS_PARAM_COUNT && !sick; ++k) {
                const size_t at =
                    ((i / SGS_LANES) * SGS_PARAM_COUNT + (size_t)k) * SGS_LANES + i % SGS_LANES;
                assert_true(isfinite(scene.model->data[at]) && isfinite(m[at]) && isfinite(v[at]));
                stepped += scene.model->data[at] != before[at];
            }
        }
        assert_true(stepped > 1000);
        void *const arrays[] = {m, v, sum, before};
        for (size_t k = 0; k < 4; ++k)
            sgsi_free(arrays[k]);
        traced_planes_free(&d);
        traced_destroy(&traced);
        oracle_scene_free(&scene);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(white_over_white_is_white),
        cmocka_unit_test(permuting_primitives_changes_no_bit),
        cmocka_unit_test(an_empty_model_gives_an_empty_image),
        cmocka_unit_test(primitives_behind_the_camera_are_invisible),
        cmocka_unit_test(tracer_follows_changes_of_model_size),
        cmocka_unit_test(nonfinite_primitives_vanish_without_side_effects),
        cmocka_unit_test(nonfinite_colours_do_not_spread_to_other_pixels),
        cmocka_unit_test_teardown(extreme_parameters_give_finite_images_and_complete_lists,
                                  traced_restore),
        cmocka_unit_test(optimiser_skips_primitives_with_nonfinite_gradients),
    };
    return cmocka_run_group_tests(tests, traced_prepare, NULL);
}
