// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The primitives along a ray are those of the brute-force reference over the whole model, bit for
// bit, although the model is passed in chunks.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "support/oracle_support.h"
#include "viewer/ray_inspect.h"

static const sgs_camera camera = {SGS_CAMERA_OPENCV, 40, 30, {45, 44, 20, 15, 0.05, 0, 0.001, 0}};
static const sgs_pose pose = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 3}};

static oracle_scene random_scene(size_t count, double opacity_high)
{
    oracle_random random = {.seed = 3};
    oracle_range range = oracle_range_default();
    range.scale_low = 0.02;
    range.scale_high = 0.2;
    range.opacity_high = opacity_high;
    oracle_scene scene = oracle_scene_create(count);
    for (size_t i = 0; i < count; ++i)
        oracle_random_primitive(&random, &range, oracle_primitive(&scene, i));
    oracle_scene_round(&scene);
    return scene;
}

// Compares all pixels of some columns. Returns the number of hits.
static size_t compare(const oracle_scene *scene, sgs_filter filter)
{
    const sgs_render_options options = oracle_render_options(filter, 3, NULL);
    sgs_hit *expected = oracle_memory(scene->count, sizeof *expected);
    size_t total = 0;
    for (int y = 0; y < camera.height; y += 7)
        for (int x = 0; x < camera.width; x += 9) {
            sgs_hit *hits;
            size_t count;
            const size_t known = oracle_hits(scene->params, scene->count, &camera, &pose, &options,
                                             x, y, expected, scene->count);
            assert_true(
                ray_hits(scene->model, NULL, &camera, &pose, &options, x, y, &hits, &count));
            assert_int_equal(count, known);
            for (size_t i = 0; i < count; ++i) {
                assert_int_equal(hits[i].primitive, expected[i].primitive);
                assert_true(hits[i].t == expected[i].t && hits[i].alpha == expected[i].alpha &&
                            hits[i].transmittance == expected[i].transmittance);
            }
            total += count;
            free(hits);
        }
    free(expected);
    return total;
}

// The hits without every third row are those of a scene that lacks these rows.
static void rows_that_are_not_kept_have_no_hits(void **state)
{
    (void)state;
    oracle_scene scene = random_scene(9000, 0.3);
    const sgs_render_options options = oracle_render_options(SGS_FILTER_3DGS, 3, NULL);
    unsigned char *keep = oracle_memory(scene.count, sizeof *keep);
    double *params = oracle_memory(scene.count * SGS_PARAM_COUNT, sizeof *params);
    uint32_t *rows = oracle_memory(scene.count, sizeof *rows);
    sgs_hit *expected = oracle_memory(scene.count, sizeof *expected);
    size_t kept = 0, total = 0;
    for (size_t i = 0; i < scene.count; ++i) {
        keep[i] = i % 3 != 0;
        if (!keep[i])
            continue;
        memcpy(params + kept * SGS_PARAM_COUNT, scene.params + i * SGS_PARAM_COUNT,
               SGS_PARAM_COUNT * sizeof *params);
        rows[kept++] = (uint32_t)i;
    }
    for (int y = 0; y < camera.height; y += 7)
        for (int x = 0; x < camera.width; x += 9) {
            sgs_hit *hits;
            size_t count;
            const size_t known =
                oracle_hits(params, kept, &camera, &pose, &options, x, y, expected, kept);
            assert_true(ray_hits(scene.model, keep, &camera, &pose, &options, x, y, &hits, &count));
            assert_int_equal(count, known);
            for (size_t i = 0; i < count; ++i)
                assert_int_equal(hits[i].primitive, rows[expected[i].primitive]);
            total += count;
            free(hits);
        }
    assert_true(total > 1000);
    free(keep);
    free(params);
    free(rows);
    free(expected);
    oracle_scene_free(&scene);
}

static void rays_through_many_chunks_equal_the_reference(void **state)
{
    (void)state;
    oracle_scene scene = random_scene(9000, 0.3);
    assert_true(compare(&scene, SGS_FILTER_3DGS) > 1000);
    assert_true(compare(&scene, SGS_FILTER_NONE) > 1000);
    assert_true(compare(&scene, SGS_FILTER_MIP) > 1000);
    oracle_scene_free(&scene);
}

static void opaque_primitives_end_the_list_at_the_same_hit(void **state)
{
    (void)state;
    oracle_scene scene = random_scene(9000, 0.999);
    assert_true(compare(&scene, SGS_FILTER_3DGS) > 100);
    oracle_scene_free(&scene);
}

static void equal_distances_keep_the_order_of_the_rows(void **state)
{
    (void)state;
    oracle_scene scene = random_scene(5000, 0.3);
    for (size_t i = 1; i < 60; ++i) // copies of row 0 in two chunks
        memcpy(oracle_primitive(&scene, i * 83), oracle_primitive(&scene, 0),
               SGS_PARAM_COUNT * sizeof(double));
    oracle_scene_round(&scene);
    assert_true(compare(&scene, SGS_FILTER_3DGS) > 500);
    oracle_scene_free(&scene);
}

static void an_empty_model_has_no_hits(void **state)
{
    (void)state;
    oracle_scene scene = oracle_scene_create(0);
    assert_int_equal(compare(&scene, SGS_FILTER_3DGS), 0);
    oracle_scene_free(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rays_through_many_chunks_equal_the_reference),
        cmocka_unit_test(rows_that_are_not_kept_have_no_hits),
        cmocka_unit_test(opaque_primitives_end_the_list_at_the_same_hit),
        cmocka_unit_test(equal_distances_keep_the_order_of_the_rows),
        cmocka_unit_test(an_empty_model_has_no_hits),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
