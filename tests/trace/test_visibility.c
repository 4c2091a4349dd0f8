// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Visibility statistics of primitives around the near distance. A primitive that cannot have a
// counted hit must not count as visible, because it would dilute mean gradients and visibilities;
// one that has a hit must.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "support/tracer_support.h"

enum { COUNT = 800, WIDTH = 128, HEIGHT = 64 };

// Even rows are balls, whose hits are at most as far as their centres. Odd rows are discs and
// needles, which may have hits beyond the near distance with a centre in front of it.
static oracle_scene around_the_near_distance(void)
{
    oracle_scene scene = oracle_scene_create(COUNT);
    oracle_random random = {3, 0};
    for (size_t i = 0; i < COUNT; ++i) {
        double *p = oracle_primitive(&scene, i), mean[3];
        const double distance = oracle_uniform(&random, 0.01, 0.6);
        for (int k = 0; k < 3; ++k)
            mean[k] = oracle_normal(&random);
        oracle_normalize(mean);
        const double scale = exp(oracle_uniform(&random, log(0.01), log(0.2)));
        oracle_set_ball(p, distance * mean[0], distance * mean[1], distance * mean[2], scale, 0.1);
        if (i % 2)
            p[SGS_PARAM_SCALE + i / 2 % 3] -= 3;
        for (int k = 0; k < 4; ++k)
            p[SGS_PARAM_ROTATION + k] = oracle_normal(&random);
    }
    oracle_scene_round(&scene);
    return scene;
}

typedef struct statistics {
    _Alignas(64) uint32_t visible_count[COUNT];
    _Alignas(64) float radius_max[COUNT];
    _Alignas(64) float gradient_sum[COUNT];
    traced_view traced;
} statistics;

static double distance_of(const oracle_scene *scene, size_t i)
{
    const double *p = oracle_primitive(scene, i);
    return sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
}

// The statistics of one view from the origin along z, as in training.
static void collect(const oracle_scene *scene, const sgs_camera *camera, sgs_filter filter,
                    statistics *s)
{
    const sgs_pose pose = {.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    memset(s, 0, sizeof *s);
    s->traced = traced_create(scene->model, camera, &pose, filter, 2, SGSI_BVH_REFIT);
    traced_view *t = &s->traced;
    assert_int_equal(
        sgsi_tracer_project(t->tracer, scene->model, &t->view, s->visible_count, s->radius_max),
        SGS_STATUS_OK);
    sgsi_planes colors = t->planes;
    colors.depth_mean = colors.depth_median = colors.depth_first = colors.hits = NULL;
    assert_int_equal(sgsi_tracer_forward(t->tracer, &t->view, &colors, NULL, true), SGS_STATUS_OK);
    sgsi_planes d = traced_planes_create(WIDTH, HEIGHT);
    for (size_t i = 0; i < d.stride * HEIGHT; ++i)
        d.color[0][i] = d.color[1][i] = d.color[2][i] = d.transmittance[i] = (float)(i % 7) - 2.0f;
    assert_int_equal(
        sgsi_tracer_backward(t->tracer, &t->view, &t->planes, d.color, d.transmittance),
        SGS_STATUS_OK);
    traced_planes_free(&d);
    const sgsi_optimize input = {.params = scene->model->data,
                                 .count = COUNT,
                                 .view = t->view,
                                 .sums = sgsi_tracer_grad_sums(t->tracer),
                                 .touched = sgsi_tracer_touched(t->tracer),
                                 .gradient_sum = s->gradient_sum,
                                 .tan_half_x = 1.0f,
                                 .tan_half_y = 0.5f};
    sgsi_optimize_blocks(&input, 0, COUNT / SGS_LANES);
}

static bool has_hit(const statistics *s, size_t i)
{
    return sgsi_tracer_touched(s->traced.tracer)[i / SGS_LANES] &&
           sgsi_tracer_grad_sums(s->traced.tracer)[i * 16 + SGSI_GRAD_SUM_WEIGHT] > 0.0f;
}

// Counts of a visible row.
static bool is_visible(const statistics *s, size_t i)
{
    const bool visible = sgsi_tracer_visible(s->traced.tracer)[i / SGS_LANES] >> i % SGS_LANES & 1;
    assert_int_equal(s->visible_count[i], visible);
    assert_true((s->radius_max[i] > 0.0f) == visible);
    return visible;
}

static void fisheye_lenses_and_panoramas_see_what_may_have_a_hit(void **state)
{
    (void)state;
    const sgs_camera cameras[] = {
        {SGS_CAMERA_OPENCV_FISHEYE, WIDTH, HEIGHT, {40, 40, 64, 32}},
        sgs_camera_equirectangular(WIDTH, HEIGHT),
    };
    oracle_scene scene = around_the_near_distance();
    statistics s;
    for (int isa = 0; isa < SGS_ISA_COUNT; ++isa) {
        if (!sgs_isa_supported((sgs_isa)isa))
            continue;
        sgs_isa_set((sgs_isa)isa);
        for (int run = 0; run < 6; ++run) {
            const bool panorama = run % 2;
            collect(&scene, &cameras[run % 2], (sgs_filter)(run / 2), &s);
            const double near = s.traced.options.near_distance, focal = s.traced.rays->focal;
            size_t inside = 0, hidden = 0;
            for (size_t i = 0; i < COUNT; ++i) {
                const double distance = distance_of(&scene, i);
                const bool visible = is_visible(&s, i), hit = has_hit(&s, i);
                assert_true(visible || (!hit && s.gradient_sum[i] == 0.0f));
                inside += hit && distance < near;
                if (i % 2 == 0 && fabs(distance / near - 1) > 0.002) {
                    assert_true(!visible || distance > near);
                    assert_true(!panorama || visible == (distance > near));
                }
                hidden += !visible && distance < near;
                // Three standard deviations; the largest is 0.2, and 0.22 with the 3D filter.
                assert_true(s.radius_max[i] < 3.2 * hypot(0.3 * focal / near, 1));
            }
            traced_destroy(&s.traced);
            print_message("%s, run %d: of the centres in front of the near distance, %zu have a "
                          "hit and %zu are invisible\n",
                          sgs_isa_name((sgs_isa)isa), run, inside, hidden);
            assert_true(inside > 3 && hidden > COUNT / 8);
        }
    }
    oracle_scene_free(&scene);
}

// As in 3DGS. The gradients of such hits are not part of the statistics either.
static void perspective_lenses_see_centres_beyond_the_near_distance(void **state)
{
    (void)state;
    const sgs_camera cameras[] = {
        {SGS_CAMERA_PINHOLE, WIDTH, HEIGHT, {60, 60, 64, 32}},
        {SGS_CAMERA_OPENCV, WIDTH, HEIGHT, {60, 60, 64, 32, 0.01, -0.01}},
    };
    oracle_scene scene = around_the_near_distance();
    statistics s;
    for (int run = 0; run < 6; ++run) {
        collect(&scene, &cameras[run % 2], (sgs_filter)(run / 2), &s);
        size_t seen = 0;
        for (size_t i = 0; i < COUNT; ++i) {
            const bool beyond = oracle_primitive(&scene, i)[SGS_PARAM_MEAN + 2] > 0.2;
            assert_true(beyond || (!is_visible(&s, i) && s.gradient_sum[i] == 0.0f));
            seen += is_visible(&s, i);
        }
        assert_true(seen > COUNT / 16);
        traced_destroy(&s.traced);
    }
    oracle_scene_free(&scene);
}

// Without a near distance the radius is limited as for perspective lenses.
static void the_radius_is_limited(void **state)
{
    (void)state;
    const sgs_pose pose = {.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    const sgs_camera cameras[] = {
        {SGS_CAMERA_PINHOLE, WIDTH, HEIGHT, {60, 60, 64, 32}},
        {SGS_CAMERA_OPENCV_FISHEYE, WIDTH, HEIGHT, {40, 40, 64, 32}},
        sgs_camera_equirectangular(WIDTH, HEIGHT),
    };
    oracle_scene scene = oracle_scene_create(1);
    oracle_set_ball(oracle_primitive(&scene, 0), 0, 0, 1e-6, 0.3, 0.5);
    oracle_scene_round(&scene);
    for (int lens = 0; lens < 3; ++lens) {
        traced_view traced =
            traced_create(scene.model, &cameras[lens], &pose, SGS_FILTER_3DGS, 1, SGSI_BVH_REFIT);
        _Alignas(64) uint32_t count[SGS_LANES] = {0};
        _Alignas(64) float radius[SGS_LANES] = {0};
        traced.view.near_distance = 0.0f;
        assert_int_equal(
            sgsi_tracer_project(traced.tracer, scene.model, &traced.view, count, radius),
            SGS_STATUS_OK);
        assert_int_equal(count[0], 1);
        assert_true(radius[0] > 1e6f && radius[0] <= 3e6f + 1.0f);
        traced_destroy(&traced);
    }
    oracle_scene_free(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(fisheye_lenses_and_panoramas_see_what_may_have_a_hit,
                                  traced_restore),
        cmocka_unit_test(perspective_lenses_see_centres_beyond_the_near_distance),
        cmocka_unit_test(the_radius_is_limited),
    };
    return cmocka_run_group_tests(tests, traced_prepare, NULL);
}
