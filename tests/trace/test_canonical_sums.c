// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The order of the gradient sums: bit for bit those of a plain loop over the cells of the image,
// their tiles in raster order and their primitives, for any number of threads, all instruction
// sets, and images with small and large cells.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "base/float_mode.h"
#include "support/tracer_support.h"

enum { FLOATS = SGSI_PROJECTED_FLOATS };

// Records of one cell, by primitive.
typedef struct plain_sums {
    size_t count;
    float *cell, *total; // [count][FLOATS]
    uint8_t *in_cell, *seen;
} plain_sums;

// Adds the records of a tile, computed by the kernel from the tile's list.
static void add_tile(const traced_view *traced, const float *const gradients[4], size_t tile,
                     plain_sums *sums)
{
    const sgsi_tile_list *list = &sgsi_tracer_lists(traced->tracer)[tile];
    if (!list->count)
        return;
    sgsi_scratch scratch = {0};
    assert_true(sgsi_scratch_reserve(&scratch, list->count + 16));
    scratch.sums = sgsi_calloc(list->count, FLOATS * sizeof *scratch.sums);
    assert_non_null(scratch.sums);
    sgsi_tile_target target = {.rays = &traced->rays->tiles[tile],
                               .width = traced->planes.width,
                               .height = traced->planes.height,
                               .stride = traced->planes.stride,
                               .d_color = {gradients[0], gradients[1], gradients[2]},
                               .d_transmittance = gradients[3],
                               .projected = sgsi_tracer_projected(traced->tracer),
                               .near_distance = traced->view.near_distance};
    sgsi_kernels_get()->tile_backward(&scratch, list, &target);
    for (uint32_t i = 0; i < list->count; ++i) {
        const size_t id = list->ids[i];
        sums->in_cell[id] = 1;
        for (size_t k = 0; k < FLOATS; ++k)
            sums->cell[id * FLOATS + k] += scratch.sums[i * FLOATS + k];
    }
    sgsi_free(scratch.sums);
    scratch.sums = NULL;
    sgsi_scratch_free(&scratch);
}

static void close_cell(plain_sums *sums)
{
    for (size_t id = 0; id < sums->count; ++id) {
        if (!sums->in_cell[id])
            continue;
        sums->seen[id] = 1;
        sums->in_cell[id] = 0;
        for (size_t k = 0; k < FLOATS; ++k) {
            sums->total[id * FLOATS + k] += sums->cell[id * FLOATS + k];
            sums->cell[id * FLOATS + k] = 0;
        }
    }
}

static plain_sums add_all(const traced_view *traced, const float *const gradients[4], size_t count)
{
    plain_sums sums = {.count = count,
                       .cell = oracle_memory(count, FLOATS * sizeof(float)),
                       .total = oracle_memory(count, FLOATS * sizeof(float)),
                       .in_cell = oracle_memory(count, 1),
                       .seen = oracle_memory(count, 1)};
    const sgsi_rays *rays = traced->rays;
    const int side = rays->cells.side;
    const sgsi_float_mode mode = sgsi_float_mode_enter();
    for (size_t i = 0; i < rays->cells.count; ++i) {
        const int x0 = (int)rays->cells.raster[i] % rays->cells.cells_x * side,
                  y0 = (int)rays->cells.raster[i] / rays->cells.cells_x * side;
        for (int y = y0; y < y0 + side && y < rays->tiles_y; ++y)
            for (int x = x0; x < x0 + side && x < rays->tiles_x; ++x)
                add_tile(traced, gradients, (size_t)y * (size_t)rays->tiles_x + (size_t)x, &sums);
        close_cell(&sums);
    }
    sgsi_float_mode_set(mode);
    return sums;
}

static void assert_equal_sums(const plain_sums *expected, const sgsi_tracer *tracer)
{
    const float *sums = sgsi_tracer_grad_sums(tracer);
    const uint8_t *touched = sgsi_tracer_touched(tracer);
    size_t found = 0;
    for (size_t id = 0; id < expected->count; ++id) {
        assert_true(!expected->seen[id] || touched[id / SGS_LANES]);
        if (!touched[id / SGS_LANES])
            continue;
        found += expected->seen[id];
        if (memcmp(sums + id * FLOATS, expected->total + id * FLOATS, FLOATS * sizeof *sums))
            fail_msg("sums of primitive %zu differ: weight %.9g, expected %.9g", id,
                     (double)sums[id * FLOATS + SGSI_GRAD_SUM_WEIGHT],
                     (double)expected->total[id * FLOATS + SGSI_GRAD_SUM_WEIGHT]);
    }
    assert_true(found > expected->count / 8);
}

// Random gradients of a traced view, and its sums with 1 to 64 threads.
static void compare(traced_view *traced, size_t count)
{
    sgsi_planes incoming = traced_planes_create(traced->camera.width, traced->camera.height);
    float *const planes[4] = {incoming.color[0], incoming.color[1], incoming.color[2],
                              incoming.transmittance};
    oracle_random random = {5, 0};
    for (size_t i = 0; i < incoming.stride * (size_t)incoming.height; ++i)
        for (int k = 0; k < 4; ++k)
            planes[k][i] = (float)oracle_normal(&random);
    const float *const gradients[4] = {planes[0], planes[1], planes[2], planes[3]};
    plain_sums expected = add_all(traced, gradients, count);
    static const int threads[] = {1, 2, 5, 64};
    for (size_t k = 0; k < sizeof threads / sizeof *threads; ++k) {
        sgsi_threads_set(threads[k]);
        traced_forward(traced, NULL); // state of the threads
        assert_int_equal(sgsi_tracer_backward(traced->tracer, &traced->view, &traced->planes,
                                              incoming.color, incoming.transmittance),
                         SGS_STATUS_OK);
        assert_equal_sums(&expected, traced->tracer);
    }
    sgsi_threads_set(1);
    free(expected.cell);
    free(expected.total);
    free(expected.in_cell);
    free(expected.seen);
    traced_planes_free(&incoming);
}

static void sums_follow_the_curve_of_the_cells(void **state)
{
    (void)state;
    static const int sizes[][2] = {{60, 44}, {640, 333}, {2048, 2048}};
    const sgs_pose pose = oracle_pose_look_at(0.2, -0.3, -4);
    oracle_range range = oracle_range_default();
    range.scale_low *= 0.2, range.scale_high *= 0.2;
    oracle_scene scene = oracle_random_model(7, 300, &range);
    sgs_gaussians *model = scene.model;
    for (int isa = 0; isa < SGS_ISA_COUNT; ++isa) {
        if (sgs_isa_set((sgs_isa)isa))
            continue; // not on this machine
        const size_t count = (sgs_isa)isa == *traced_best_isa() ? 3 : 2;
        for (size_t s = 0; s < count; ++s) {
            const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, sizes[s][0], sizes[s][1]);
            traced_view traced =
                traced_create(model, &camera, &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
            assert_int_equal(traced.rays->cells.side, sizes[s][0] == 2048 ? 8 : 4);
            compare(&traced, model->count);
            traced_destroy(&traced);
        }
    }
    oracle_scene_free(&scene);
}

// One thread adds the slots in several chunks, 64 in one.
static void sums_do_not_depend_on_the_size_of_the_chunks(void **state)
{
    (void)state;
    const sgs_pose pose = oracle_pose_look_at(0.2, -0.3, -4);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 640, 333);
    oracle_range range = oracle_range_default();
    range.opacity_low = 0.01, range.opacity_high = 0.04;
    oracle_scene scene = oracle_random_model(8, 14000, &range);
    traced_view traced =
        traced_create(scene.model, &camera, &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
    size_t slots = 0;
    for (size_t i = 0; i < traced.rays->cells.tiles; ++i)
        slots += sgsi_tracer_lists(traced.tracer)[i].count;
    print_message("%zu slots\n", slots);
    assert_true(slots > 2 << 18 && slots < 64 << 14);
    compare(&traced, scene.count);
    traced_destroy(&traced);
    oracle_scene_free(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(sums_follow_the_curve_of_the_cells, traced_restore),
        cmocka_unit_test_teardown(sums_do_not_depend_on_the_size_of_the_chunks, traced_restore),
    };
    return cmocka_run_group_tests(tests, traced_prepare, NULL);
}
