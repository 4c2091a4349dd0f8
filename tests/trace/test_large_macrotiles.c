// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A distant camera sees all primitives in one tile. Its scratch exists once, whatever the number of
// threads and of passes, and is freed after passes that do not need it. Image, lists and gradient
// sums do not change.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "support/tracer_support.h"
#include "trace/tracer_state.h"

enum { COUNT = 110000, THREADS = 4, PASSES = 12, TRIMS = 40 };

// Transparent points on a disc of 14 pixels within a tile.
static oracle_scene distant_points(void)
{
    oracle_scene scene = oracle_scene_create(COUNT);
    oracle_random random = {.seed = 4};
    for (size_t i = 0; i < COUNT; ++i) {
        double *primitive = oracle_primitive(&scene, i);
        const double radius = sqrt(oracle_uniform(&random, 0, 1)),
                     angle = oracle_uniform(&random, 0, 6.2832);
        oracle_set_ball(primitive, radius * cos(angle), radius * sin(angle),
                        oracle_uniform(&random, -1, 1), 0.001, 0.006);
        oracle_set_color(primitive, oracle_uniform(&random, 0, 1), oracle_uniform(&random, 0, 1),
                         oracle_uniform(&random, 0, 1));
    }
    oracle_scene_round(&scene);
    return scene;
}

static const sgs_camera camera = {SGS_CAMERA_PINHOLE, 64, 48, {700, 700, 24, 24}};

static traced_view look(const oracle_scene *scene)
{
    const sgs_pose pose = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 100}};
    return traced_create(scene->model, &camera, &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
}

// Rows of the scratches of all threads and of the shared ones; their number.
static size_t scratch_rows(const sgsi_tracer *tracer, size_t *shared)
{
    size_t rows = 0;
    *shared = 0;
    for (int i = 0; i < THREADS && tracer->threads[i]; ++i) {
        const thread_state *state = tracer->threads[i];
        assert_false(state->shared.taken);
        rows += state->own.capacity + state->shared.scratch.capacity;
        *shared += state->shared.scratch.capacity > 0;
    }
    return rows;
}

static float *backward(traced_view *traced)
{
    sgsi_planes d = traced_planes_create(camera.width, camera.height);
    for (size_t i = 0; i < 4 * d.stride * (size_t)d.height; ++i)
        d.color[0][i] = (float)(sgsi_random_uniform(6, i) - 0.5);
    assert_int_equal(sgsi_tracer_backward(traced->tracer, &traced->view, &traced->planes, d.color,
                                          d.transmittance),
                     SGS_STATUS_OK);
    traced_planes_free(&d);
    const size_t floats = (size_t)COUNT * SGSI_PROJECTED_FLOATS;
    float *sums = oracle_memory(floats, sizeof *sums);
    memcpy(sums, sgsi_tracer_grad_sums(traced->tracer), floats * sizeof *sums);
    for (size_t i = 0; i < COUNT; ++i)
        if (!sgsi_tracer_touched(traced->tracer)[i / SGS_LANES])
            memset(sums + i * SGSI_PROJECTED_FLOATS, 0, SGSI_PROJECTED_FLOATS * sizeof *sums);
    return sums;
}

static void passes_share_the_scratch_of_a_full_macrotile(void **state)
{
    (void)state;
    oracle_scene scene = distant_points();
    traced_view single = look(&scene);
    traced_lists lists = traced_lists_of(single.tracer, single.rays);
    float *expected = backward(&single);
    size_t fullest = 0, shared;
    for (int t = 0; t < 12; ++t) {
        const size_t count = sgsi_tracer_lists(single.tracer)[t].count;
        fullest = count > fullest ? count : fullest;
    }
    print_message("%zu primitives in the fullest tile\n", fullest);
    assert_true(fullest > SGSI_OWN_ROWS); // the backward pass requires a large scratch, too
    traced_assert_matches_brute_force(&single, COUNT, "one thread");
    sgsi_threads_set(THREADS);
    traced_view traced = look(&scene);
    for (int pass = 0; pass < PASSES; ++pass) {
        traced_forward(&traced, NULL);
        float *sums = backward(&traced);
        const size_t rows = scratch_rows(traced.tracer, &shared);
        assert_int_equal(shared, 1);
        assert_true(rows >= COUNT && rows < COUNT * 3); // the BVH may report some twice
        assert_memory_equal(sums, expected, (size_t)COUNT * SGSI_PROJECTED_FLOATS * sizeof *sums);
        free(sums);
    }
    traced_assert_same_image(&single.planes, &traced.planes, "threads");
    traced_lists own = traced_lists_of(traced.tracer, traced.rays);
    traced_assert_same_lists(&lists, &own, "threads");
    const sgs_pose away = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, -100}};
    traced_aim(&traced, &camera, &away, 0);
    traced_project(&traced, scene.model, false, SGSI_BVH_REFIT);
    for (int pass = 0; pass < TRIMS; ++pass)
        traced_forward(&traced, NULL);
    scratch_rows(traced.tracer, &shared);
    assert_int_equal(shared, 0);
    traced_lists_free(&own);
    traced_lists_free(&lists);
    free(expected);
    traced_destroy(&single);
    traced_destroy(&traced);
    oracle_scene_free(&scene);
}

// Steady passes over a full macrotile allocate nothing.
static void passes_over_a_full_macrotile_allocate_nothing(void **state)
{
    (void)state;
    oracle_scene scene = distant_points();
    sgsi_threads_set(THREADS);
    traced_view traced = look(&scene);
    size_t before = 0;
    for (int pass = 0; pass < 3 * TRIMS; ++pass) {
        if (pass == TRIMS)
            before = sgsi_allocation_count();
        assert_int_equal(
            sgsi_tracer_forward(traced.tracer, &traced.view, &traced.planes, NULL, true),
            SGS_STATUS_OK);
    }
    assert_int_equal(sgsi_allocation_count(), before);
    traced_destroy(&traced);
    oracle_scene_free(&scene);
}

static void failed_allocations_of_a_full_macrotile_are_reported(void **state)
{
    (void)state;
    oracle_scene scene = distant_points();
    traced_view traced = look(&scene), plain = look(&scene);
    sgsi_scratch_free(&traced.tracer->threads[0]->shared.scratch);
    sgsi_fail_allocation(1);
    assert_int_equal(sgsi_tracer_forward(traced.tracer, &traced.view, &traced.planes, NULL, true),
                     SGS_STATUS_OUT_OF_MEMORY);
    sgsi_fail_allocation(0);
    traced_forward(&traced, NULL);
    traced_assert_same_image(&plain.planes, &traced.planes, "after a failure");
    traced_destroy(&traced);
    traced_destroy(&plain);
    oracle_scene_free(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(passes_share_the_scratch_of_a_full_macrotile, traced_restore),
        cmocka_unit_test_teardown(passes_over_a_full_macrotile_allocate_nothing, traced_restore),
        cmocka_unit_test_teardown(failed_allocations_of_a_full_macrotile_are_reported,
                                  traced_restore),
    };
    return cmocka_run_group_tests(tests, traced_prepare, NULL);
}
