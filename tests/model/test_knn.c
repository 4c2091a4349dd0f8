// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The neighbour search gives exactly the distances of brute force, for any cloud and number of
// threads.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <math.h>

#include "base/compare.h"
#include "base/core.h"
#include "model/knn.h"
#include "sparegs/runtime.h"

enum { MAX_CLOUD = 20000 };

static void brute_force(const float *points, size_t n, size_t i, double best[3])
{
    best[0] = best[1] = best[2] = INFINITY;
    for (size_t k = 0; k < n; ++k) {
        if (k == i)
            continue;
        double d = 0.0;
        for (int axis = 0; axis < 3; ++axis) {
            const double side = (double)points[3 * i + (size_t)axis] - points[3 * k + (size_t)axis];
            d += side * side;
        }
        for (int place = 0; place < 3; ++place) {
            if (d < best[place]) {
                const double kept = best[place];
                best[place] = d;
                d = kept;
            }
        }
    }
}

// Compares every point of small clouds, and every 17th of large ones.
static void check_cloud(const float *points, size_t n)
{
    double *distances = malloc((3 * n + 1) * sizeof *distances);
    assert_non_null(distances);
    distances[3 * n] = -7.0; // guard
    assert_int_equal(sgsi_knn(points, n, distances), SGS_STATUS_OK);
    for (size_t i = 0; i<n; i += n> 2000 ? 17 : 1) {
        double best[3];
        brute_force(points, n, i, best);
        for (int k = 0; k < 3; ++k) {
            if (!(distances[3 * i + (size_t)k] == best[k]))
                fail_msg("point %zu of %zu, neighbour %d: %.17g, brute force has %.17g", i, n, k,
                         distances[3 * i + (size_t)k], best[k]);
        }
    }
    assert_true(distances[3 * n] == -7.0);
    free(distances);
}

typedef float (*coordinate_fn)(uint64_t point, int axis);

static float uniform(uint64_t point, int axis)
{
    return (float)(10.0 * sgsi_random_uniform(1, 3 * point + (uint64_t)axis) - 5.0);
}

static float collinear(uint64_t point, int axis)
{
    return (float)(sgsi_random_uniform(2, point) * (axis + 1));
}

static float on_axis(uint64_t point, int axis)
{
    return axis == 1 ? (float)(point % 977) : 3.0f;
}

static float coplanar_grid(uint64_t point, int axis)
{
    return axis == 0 ? (float)(point % 64) : axis == 1 ? (float)(point / 64) : 0.0f;
}

static float all_equal(uint64_t point, int axis)
{
    (void)point;
    return (float)axis - 0.3f;
}

static float pairs_of_duplicates(uint64_t point, int axis)
{
    return uniform(point / 2, axis);
}

static float few_places(uint64_t point, int axis)
{
    return uniform(point % 5, axis);
}

// Clusters of size 1e-4 at large distances: a grid over the whole box would put each into one cell.
static float clusters(uint64_t point, int axis)
{
    const uint64_t cluster = point % 7;
    return (float)(1e3 * sgsi_random_uniform(3, 3 * cluster + (uint64_t)axis) +
                   1e-1 * sgsi_random_normal(4, 3 * point + (uint64_t)axis));
}

static float far_outlier(uint64_t point, int axis)
{
    return point == 11 ? 1e30f : 1e-3f * uniform(point, axis);
}

static float huge_and_tiny(uint64_t point, int axis)
{
    const double exponent = 60.0 * sgsi_random_uniform(5, point) - 30.0;
    return (float)(pow(10.0, exponent) *
                   (sgsi_random_uniform(6, 3 * point + (uint64_t)axis) - 0.5));
}

static const coordinate_fn clouds[] = {uniform,     collinear,           on_axis,    coplanar_grid,
                                       all_equal,   pairs_of_duplicates, few_places, clusters,
                                       far_outlier, huge_and_tiny};

static float *make_cloud(coordinate_fn fn, size_t n)
{
    float *points = malloc((3 * n + 1) * sizeof *points);
    assert_non_null(points);
    for (size_t i = 0; i < n; ++i) {
        for (int axis = 0; axis < 3; ++axis)
            points[3 * i + (size_t)axis] = fn(i, axis);
    }
    return points;
}

static void knn_equals_brute_force(void **state)
{
    (void)state;
    static const size_t sizes[] = {1,  2,  3,  4,  5,   7,    8,    9,        16,
                                   17, 63, 64, 65, 129, 1000, 1025, MAX_CLOUD};
    for (size_t c = 0; c < sizeof clouds / sizeof *clouds; ++c) {
        for (size_t s = 0; s < sizeof sizes / sizeof *sizes; ++s) {
            float *points = make_cloud(clouds[c], sizes[s]);
            check_cloud(points, sizes[s]);
            free(points);
        }
    }
}

static void knn_of_nothing_is_fine(void **state)
{
    (void)state;
    assert_int_equal(sgsi_knn(NULL, 0, NULL), SGS_STATUS_OK);
}

static void knn_is_the_same_for_every_thread_count(void **state)
{
    (void)state;
    static double expected[3 * MAX_CLOUD], got[3 * MAX_CLOUD];
    float *points = make_cloud(clusters, MAX_CLOUD);
    const int before = sgs_threads_get();
    sgs_threads_set(1);
    assert_int_equal(sgsi_knn(points, MAX_CLOUD, expected), SGS_STATUS_OK);
    for (int threads = 2; threads <= 5; ++threads) {
        sgs_threads_set(threads);
        assert_int_equal(sgsi_knn(points, MAX_CLOUD, got), SGS_STATUS_OK);
        assert_memory_equal(got, expected, sizeof expected);
    }
    sgs_threads_set(before);
    free(points);
}

static void knn_fails_cleanly_without_memory(void **state)
{
    (void)state;
    static double distances[3 * 100];
    float *points = make_cloud(uniform, 100);
    for (size_t n = 1; n <= 2; ++n) {
        sgsi_fail_allocation(n);
        assert_int_equal(sgsi_knn(points, 100, distances), SGS_STATUS_OUT_OF_MEMORY);
    }
    sgsi_fail_allocation(0);
    free(points);
}

static double distance_of(const float *points, size_t i, size_t k)
{
    double d = 0.0;
    for (size_t axis = 0; axis < 3; ++axis) {
        const double side = (double)points[3 * i + axis] - points[3 * k + axis];
        d += side * side;
    }
    return d;
}

// Distances of the k neighbours of point i against all distances, sorted; no neighbour twice.
static void check_neighbours(const float *points, size_t n, size_t i, const uint32_t *neighbours,
                             size_t k, double *all)
{
    size_t others = 0;
    for (size_t j = 0; j < n; ++j)
        if (j != i)
            all[others++] = distance_of(points, i, j);
    qsort(all, others, sizeof *all, sgsi_compare_doubles);
    for (size_t place = 0; place < k; ++place) {
        assert_true(neighbours[place] < n && neighbours[place] != i);
        if (!(distance_of(points, i, neighbours[place]) == all[place]))
            fail_msg("point %zu of %zu, neighbour %zu: %.17g, sorting has %.17g", i, n, place,
                     distance_of(points, i, neighbours[place]), all[place]);
        for (size_t before = 0; before < place; ++before)
            assert_int_not_equal(neighbours[before], neighbours[place]);
    }
}

static void many_neighbours_equal_sorting(void **state)
{
    (void)state;
    enum { MAX_POINTS = 3000, MAX_NEIGHBOURS = 256 };
    static double all[MAX_POINTS];
    static uint32_t neighbours[MAX_POINTS * MAX_NEIGHBOURS], again[MAX_POINTS * MAX_NEIGHBOURS];
    static const size_t counts[][2] = {
        {2, 1}, {130, 128}, {129, 128}, {3000, 128}, {MAX_POINTS, MAX_NEIGHBOURS}, {700, 5}};
    for (size_t c = 0; c < sizeof clouds / sizeof *clouds; ++c)
        for (size_t s = 0; s < sizeof counts / sizeof *counts; ++s) {
            const size_t n = counts[s][0], k = counts[s][1];
            float *points = make_cloud(clouds[c], n);
            sgsi_knn_tree *tree;
            assert_int_equal(sgsi_knn_tree_create(points, n, &tree), SGS_STATUS_OK);
            sgsi_knn_tree_search(tree, 0, n, k, neighbours);
            for (size_t i = 0; i < n; i += 1 + n / 40)
                check_neighbours(points, n, i, neighbours + i * k, k, all);
            for (size_t begin = 0; begin < n; begin += 1000) // in parts
                sgsi_knn_tree_search(tree, begin, begin + 1000 < n ? begin + 1000 : n, k, again);
            assert_memory_equal(neighbours, again, n * k * sizeof *again);
            sgsi_knn_tree_destroy(tree);
            free(points);
        }
}

// Every point receives k different other points, whatever the coordinates are.
static void points_that_are_not_finite_have_neighbours(void **state)
{
    (void)state;
    enum { POINTS = 400, NEIGHBOURS = 128 };
    static const float values[] = {INFINITY, -INFINITY, NAN};
    static uint32_t neighbours[POINTS * NEIGHBOURS];
    for (size_t v = 0; v < sizeof values / sizeof *values; ++v)
        for (size_t step = 1; step < POINTS; step = 4 * step + 2) {
            float *points = make_cloud(uniform, POINTS);
            for (size_t i = 0; i < POINTS; i += step)
                points[3 * i + i % 3] = values[v];
            memset(neighbours, 0xFF, sizeof neighbours);
            sgsi_knn_tree *tree;
            assert_int_equal(sgsi_knn_tree_create(points, POINTS, &tree), SGS_STATUS_OK);
            sgsi_knn_tree_search(tree, 0, POINTS, NEIGHBOURS, neighbours);
            for (size_t i = 0; i < POINTS; ++i) {
                bool seen[POINTS] = {false};
                for (size_t k = 0; k < NEIGHBOURS; ++k) {
                    const uint32_t j = neighbours[i * NEIGHBOURS + k];
                    assert_true(j < POINTS && j != i && !seen[j]);
                    seen[j] = true;
                }
            }
            sgsi_knn_tree_destroy(tree);
            free(points);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(knn_equals_brute_force),
        cmocka_unit_test(many_neighbours_equal_sorting),
        cmocka_unit_test(points_that_are_not_finite_have_neighbours),
        cmocka_unit_test(knn_of_nothing_is_fine),
        cmocka_unit_test(knn_is_the_same_for_every_thread_count),
        cmocka_unit_test(knn_fails_cleanly_without_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
