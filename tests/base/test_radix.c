// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Sorting of candidates by distance: the order is that of qsort for any distribution, and one key
// far from a cluster of others does not make the sort slow.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/core.h"
#include "base/radix.h"

enum { MOST = 100000 };

static uint64_t keys[MOST], expected[MOST], spare[MOST];
static uint32_t least, most;

static int compare_keys(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

static uint32_t bits_of(float x)
{
    uint32_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

// Distances of the primitives of one macrotile.
typedef enum spread {
    WIDE,    // from 0.1 to 1e4
    CLUSTER, // from 1e5 to 1.00001e5
    ONE_NEAR,
    ONE_FAR,
    EQUAL, // and one near
    SPREAD_COUNT
} spread;

static float distance_of(spread kind, size_t i, size_t count)
{
    const float u = (float)sgsi_random_uniform(7 + (uint64_t)kind, i),
                cluster = 1e5f * (1.0f + 1e-5f * u);
    switch (kind) {
    case WIDE:
        return 0.1f + 1e4f * u * u * u;
    case ONE_NEAR:
        return i == count / 2 ? 1.0f : cluster;
    case ONE_FAR:
        return i == count / 3 ? 1e15f : cluster;
    case EQUAL:
        return i == count - 1 ? 0.0f : 1e5f;
    default:
        return cluster;
    }
}

static void fill(spread kind, size_t count)
{
    least = UINT32_MAX;
    most = 0;
    for (size_t i = 0; i < count; ++i) {
        const uint32_t bits = bits_of(distance_of(kind, i, count));
        keys[i] = (uint64_t)bits << 32 | i;
        least = bits < least ? bits : least;
        most = bits > most ? bits : most;
    }
}

static void keys_are_in_the_order_of_qsort(void **state)
{
    (void)state;
    static const size_t counts[] = {0, 1, 2, 96, 97, 1000, 30000};
    for (int kind = 0; kind < SPREAD_COUNT; ++kind)
        for (size_t k = 0; k < sizeof counts / sizeof *counts; ++k) {
            fill((spread)kind, counts[k]);
            memcpy(expected, keys, sizeof keys);
            qsort(expected, counts[k], sizeof *expected, compare_keys);
            sgsi_sort_keys(keys, spare, counts[k], least, most);
            assert_memory_equal(keys, expected, counts[k] * sizeof *keys);
        }
}

static void insertion_stops_at_its_limit(void **state)
{
    (void)state;
    uint64_t few[] = {5, 4, 3, 2, 1}; // 10 moves
    assert_false(sgsi_insertion_sort(few, 5, 9));
    assert_true(few[0] == 1 || few[0] == 2);
    assert_true(sgsi_insertion_sort(few, 5, 4));
    for (uint64_t i = 0; i < 5; ++i)
        assert_true(few[i] == i + 1);
    assert_true(sgsi_insertion_sort(few, 5, 0)); // sorted
    assert_true(sgsi_insertion_sort(few, 0, 0));
}

static double seconds_of(spread kind)
{
    double best = 1e9;
    for (int run = 0; run < 5; ++run) {
        fill(kind, MOST);
        const double start = sgsi_thread_seconds();
        sgsi_sort_keys(keys, spare, MOST, least, most);
        const double seconds = sgsi_thread_seconds() - start;
        best = seconds < best ? seconds : best;
    }
    return best;
}

// A time proportional to the square of the count would be more than a hundred times as long.
static void one_distant_key_does_not_make_the_sort_slow(void **state)
{
    (void)state;
    const double alone = seconds_of(CLUSTER), near = seconds_of(ONE_NEAR),
                 far = seconds_of(ONE_FAR);
    print_message("one near key: %.1f times as long, one far key: %.1f times\n", near / alone,
                  far / alone);
    assert_true(near <= 20 * alone && far <= 20 * alone);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(keys_are_in_the_order_of_qsort),
        cmocka_unit_test(insertion_stops_at_its_limit),
        cmocka_unit_test(one_distant_key_does_not_make_the_sort_slow),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
