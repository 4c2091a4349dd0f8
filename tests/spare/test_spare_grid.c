// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The region grid with a quantile. tests/spare/test_spare.c compares its regions with a slow
// implementation.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <string.h>

#include <cmocka.h>

#include "base/core.h"
#include "spare/spare.h"

enum { COUNT = 1000, FAR = 10, GRID = 8, LAST_VOXEL = GRID * GRID * GRID - 1 };

static float centres[3][COUNT], opacity[COUNT], gradient[COUNT], radius[COUNT], weights[COUNT];
static uint32_t views[COUNT];
static uint8_t redundant[COUNT];

// Most centres between 0 and 1, FAR of them on both sides of that cube.
static void place_centres(void)
{
    for (int axis = 0; axis < 3; ++axis)
        for (size_t i = 0; i < COUNT; ++i)
            centres[axis][i] = i < FAR ? (i % 2 ? 1e6f : -1e6f)
                                       : (float)sgsi_random_uniform(5 + (uint64_t)axis, i);
}

// The regions are in `memory`, which the caller frees.
static spare_result evaluate(double quantile, void **memory)
{
    spare_options options = spare_options_default();
    options.grid = GRID;
    options.grid_quantile = quantile;
    const spare_input input = {.count = COUNT,
                               .x = centres[0],
                               .y = centres[1],
                               .z = centres[2],
                               .opacity = opacity,
                               .gradient_sum = gradient,
                               .visible_count = views,
                               .radius_max = radius};
    spare_result result;
    *memory = sgsi_alloc(spare_workspace_size(&options, COUNT), 1);
    assert_non_null(*memory);
    spare_evaluate(&options, &input, *memory, weights, redundant, &result);
    return result;
}

static void far_primitives_leave_the_others_one_voxel(void **state)
{
    (void)state;
    place_centres();
    void *memory;
    const spare_result result = evaluate(0, &memory);
    assert_int_equal(result.region_count, 3);
    assert_true(result.voxel_size[0] > 2e6 / GRID);
    sgsi_free(memory);
}

static void a_quantile_places_the_grid_where_most_primitives_are(void **state)
{
    (void)state;
    place_centres();
    void *memory;
    const spare_result result = evaluate(0.01, &memory);
    assert_true(result.region_count > GRID * GRID * GRID / 2);
    for (int axis = 0; axis < 3; ++axis) {
        assert_true(result.low[axis] > -0.01 && result.low[axis] < 0.05);
        assert_true(result.voxel_size[axis] * GRID > 0.9 && result.voxel_size[axis] * GRID < 1.01);
    }
    for (size_t i = 0; i < FAR; ++i)
        assert_int_equal(result.regions[result.region_of[i]].voxel, i % 2 ? LAST_VOXEL : 0);
    sgsi_free(memory);
}

static void the_quantile_is_at_most_a_quarter(void **state)
{
    (void)state;
    place_centres();
    void *memory[2];
    const spare_result quarter = evaluate(0.25, &memory[0]), half = evaluate(0.5, &memory[1]);
    assert_memory_equal(quarter.low, half.low, sizeof quarter.low);
    assert_true(quarter.voxel_size[0] * GRID > 0.4 && quarter.voxel_size[0] * GRID < 0.6);
    sgsi_free(memory[0]);
    sgsi_free(memory[1]);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(far_primitives_leave_the_others_one_voxel),
        cmocka_unit_test(a_quantile_places_the_grid_where_most_primitives_are),
        cmocka_unit_test(the_quantile_is_at_most_a_quarter),
    };
    return cmocka_run_group_tests_name("spare_grid", tests, NULL, NULL);
}
