// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The loop of the caller: slices in any order, for any number of threads, give the bits of one
// pass, which test_spare.c compares with an independent implementation.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "base/core.h"
#include "spare/spare.h"

enum { COUNT = 100000 };

static float x[COUNT], y[COUNT], z[COUNT], opacity[COUNT], gradient[COUNT], radius[COUNT];
static uint32_t visible[COUNT];

// Centres that crowd at one corner; some values are not finite.
static int fill(void **state)
{
    (void)state;
    float *const axes[] = {x, y, z};
    for (size_t i = 0; i < COUNT; ++i) {
        for (uint64_t k = 0; k < 3; ++k)
            axes[k][i] = powf((float)sgsi_random_uniform(1 + k, i), 3);
        opacity[i] = (float)sgsi_random_uniform(4, i) * 0.2f;
        gradient[i] = 3e-3f * (float)sgsi_random_uniform(5, i);
        radius[i] = 30 * (float)sgsi_random_uniform(6, i);
        visible[i] = (uint32_t)(40 * sgsi_random_uniform(7, i));
    }
    x[70000] = NAN;
    gradient[500] = radius[501] = INFINITY;
    return 0;
}

typedef struct outcome {
    spare_result result; // its arrays are in `memory`
    float *weights;
    uint8_t *redundant;
    void *memory;
} outcome;

static outcome evaluate(const spare_options *options, spare_loop_fn loop, int threads)
{
    const spare_input input = {.count = COUNT,
                               .x = x,
                               .y = y,
                               .z = z,
                               .opacity = opacity,
                               .gradient_sum = gradient,
                               .visible_count = visible,
                               .radius_max = radius,
                               .loop = loop,
                               .threads = threads};
    outcome o = {.weights = sgsi_alloc(COUNT, sizeof(float)),
                 .redundant = sgsi_alloc(COUNT, 1),
                 .memory = sgsi_alloc(spare_workspace_size(options, COUNT), 1)};
    assert_true(o.weights && o.redundant && o.memory);
    spare_evaluate(options, &input, o.memory, o.weights, o.redundant, &o.result);
    return o;
}

static void release(outcome *o)
{
    sgsi_free(o->weights);
    sgsi_free(o->redundant);
    sgsi_free(o->memory);
}

static size_t slices_run;

static void run_backwards(size_t count, spare_slice_fn body, void *context)
{
    slices_run += count;
    for (size_t slice = count; slice-- > 0;)
        body(context, slice);
}

static void the_loop_of_the_caller_does_not_change_a_bit(void **state)
{
    (void)state;
    for (int kind = 0; kind < 3; ++kind) { // the default, a quantile, and few voxels
        spare_options options = spare_options_default();
        options.grid_quantile = kind == 1 ? 0.01 : 0.0;
        options.grid = kind == 2 ? 3 : 32;
        outcome expected = evaluate(&options, NULL, 0);
        const spare_result *a = &expected.result;
        assert_true(a->redundant_count > 100 && a->region_count > 20);
        for (int threads = 1; threads < 40; threads += 6) {
            slices_run = 0;
            outcome got = evaluate(&options, run_backwards, threads);
            const spare_result *b = &got.result;
            assert_true(slices_run >= 13); // at least two passes of six and the sums
            assert_memory_equal(expected.weights, got.weights, COUNT * sizeof *got.weights);
            assert_memory_equal(expected.redundant, got.redundant, COUNT);
            assert_int_equal(a->region_count, b->region_count);
            assert_memory_equal(a->regions, b->regions, a->region_count * sizeof *a->regions);
            assert_memory_equal(a->region_of, b->region_of, COUNT * sizeof *a->region_of);
            assert_int_equal(a->redundant_count, b->redundant_count);
            assert_memory_equal(a->low, b->low, sizeof a->low);
            assert_true(a->mean_weight == b->mean_weight &&
                        a->over_budget_share == b->over_budget_share);
            release(&got);
        }
        release(&expected);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_loop_of_the_caller_does_not_change_a_bit),
    };
    return cmocka_run_group_tests(tests, fill, NULL);
}
