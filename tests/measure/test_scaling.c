// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The scaling prediction against cases computed by hand, and the clocks of parallel loops against
// loops of known composition.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include "base/core.h"
#include "bvh/bvh.h"
#include "support/rest.h"
#include "support/tracer_support.h"
#include "sparegs/bench.h"
#include "base/threads.h"

static void close_to(double value, double expected)
{
    if (!(fabs(value - expected) <= 1e-9 * fabs(expected)))
        fail_msg("%.12g instead of %.12g", value, expected);
}

static void prediction_is_amdahls_law_limited_by_bandwidth(void **state)
{
    (void)state;
    // One core, 1 % serial: 1 / (0.01 + 0.99 / P).
    const sgs_scaling one = {.seconds = 1.0, .serial = 0.01, .threads = 1};
    close_to(sgs_scaling_predict(&one, 1, 0), 1.0);
    close_to(sgs_scaling_predict(&one, 8, 0), 1.0 / (0.01 + 0.99 / 8));
    close_to(sgs_scaling_predict(&one, 64, 1e30), 1.0 / (0.01 + 0.99 / 64));
    // The same work measured with two threads that wait for each other.
    const sgs_scaling two = {.seconds = 0.6, .serial = 0.01, .waiting = 0.095, .threads = 2};
    close_to(sgs_scaling_predict(&two, 8, 0), 1.0 / (0.01 + 0.99 / 8));
    // 10 GB at 100 GB/s take 0.1 s on any number of cores.
    const sgs_scaling streaming = {.seconds = 1.0, .serial = 0.01, .bytes = 10e9, .threads = 1};
    close_to(sgs_scaling_predict(&streaming, 64, 100), 1.0 / 0.11);
    close_to(sgs_scaling_predict(&streaming, 4, 100), 1.0 / (0.01 + 0.99 / 4));
    // Macrotiles are half of the work. 96 of them take two rounds on 64 cores; on 8 cores they
    // divide evenly.
    const sgs_scaling macrotiles = {
        .seconds = 1.0, .serial = 0.0, .threads = 1, .macrotile_seconds = 0.5, .macrotiles = 96};
    close_to(sgs_scaling_predict(&macrotiles, 64, 0), 1.0 / (0.5 / 64 + 0.5 * 2 / 96));
    close_to(sgs_scaling_predict(&macrotiles, 8, 0), 8.0);
    close_to(sgs_scaling_predict(&macrotiles, 1000, 0), 1.0 / (0.5 / 1000 + 0.5 / 96));
    // Sixteen threads on two cores do the work of two.
    const sgs_scaling crowded = {
        .seconds = 0.6, .serial = 0.01, .waiting = 0.095, .threads = 16, .cores = 2};
    close_to(sgs_scaling_predict(&crowded, 8, 0), 1.0 / (0.01 + 0.99 / 8));
    const sgs_scaling nothing = {.threads = 1};
    close_to(sgs_scaling_predict(&nothing, 8, 10), 1.0);
}

// Each call takes its messages and its bytes; the headers take log2(ranks) rounds.
static void communication_takes_messages_and_bytes(void **state)
{
    (void)state;
    sgs_rank_prediction p = {.ranks = 4};
    p.calls[SGS_RANKS_RECORDS] = (sgs_rank_call){
        .calls = 1, .messages = 12, .bytes = 7e6, .max_messages = 3, .max_bytes = 2e6};
    p.calls[SGS_RANKS_IMAGE] = (sgs_rank_call){
        .calls = 1, .messages = 5, .bytes = 2e6, .max_messages = 2, .max_bytes = 1e6};
    close_to(sgs_rank_seconds(&p, 0, 1e9), 3e-3);
    close_to(sgs_rank_seconds(&p, 1e-3, 1e9), 3e-3 + 5e-3);
    p.calls[SGS_RANKS_STATUS] = (sgs_rank_call){.calls = 8, .max_messages = 24, .max_bytes = 0};
    close_to(sgs_rank_seconds(&p, 1e-3, 1e9), 3e-3 + 5e-3 + 8 * 2e-3);
    p.ranks = 5;
    p.calls[SGS_RANKS_STATUS].max_messages = 32;
    close_to(sgs_rank_seconds(&p, 1e-3, 1e9), 3e-3 + 5e-3 + 8 * 3e-3);
}

static void long_item(void *context, size_t item, int thread)
{
    (void)context;
    (void)thread;
    if (item == 0)
        rest(0.1);
}

static void loop_clocks_measure_serial_and_waiting_time(void **state)
{
    (void)state;
    for (int threads = 1; threads <= 4; ++threads) {
        sgsi_threads_set(threads);
        const sgsi_loop_seconds before = sgsi_threads_seconds();
        const double start = sgsi_seconds();
        sgsi_parallel_for(8, 1, long_item, NULL);
        const double wall = sgsi_seconds() - start;
        rest(0.01); // outside of loops
        const sgsi_loop_seconds after = sgsi_threads_seconds();
        const double inside = after.inside - before.inside,
                     waiting = after.waiting - before.waiting;
        assert_true(inside >= 0.1 && inside <= wall);
        assert_true(waiting >= 0.0 && waiting <= inside);
        if (threads == 1)
            assert_true(waiting == 0.0);
        else // one thread works, the others wait most of the time
            assert_true(waiting > 0.25 * inside * (threads - 1) / threads);
    }
    sgsi_threads_set(0);
}

static void single_items_count_as_serial_on_many_threads(void **state)
{
    (void)state;
    sgsi_threads_set(2);
    const sgsi_loop_seconds before = sgsi_threads_seconds();
    sgsi_parallel_for(1, 1, long_item, NULL);
    assert_true(sgsi_threads_seconds().inside == before.inside);
    sgsi_threads_set(0);
}

static sgsi_loop_seconds seconds_since(sgsi_loop_seconds before)
{
    const sgsi_loop_seconds now = sgsi_threads_seconds();
    return (sgsi_loop_seconds){now.inside - before.inside, now.waiting - before.waiting};
}

// Work in as many parts as threads is parallel work, with one thread as with several.
static void a_single_part_of_several_counts_as_parallel(void **state)
{
    (void)state;
    for (int threads = 1; threads <= 4; ++threads) {
        sgsi_threads_set(threads);
        const sgsi_loop_seconds before = sgsi_threads_seconds();
        const double start = sgsi_seconds();
        sgsi_parallel_parts(1, 8, long_item, NULL);
        const double wall = sgsi_seconds() - start;
        const sgsi_loop_seconds parts = seconds_since(before);
        assert_true(parts.inside >= 0.1 && parts.inside <= wall);
        // Work = threads * (inside - waiting), that of one thread.
        assert_true(fabs(threads * (parts.inside - parts.waiting) - parts.inside) <=
                    1e-9 * parts.inside);
        sgsi_parallel_parts(1, 1, long_item, NULL); // a single one with any number of threads
        assert_true(seconds_since(before).inside == parts.inside);
    }
    sgsi_threads_set(0);
}

static void loop_of_long_items(void *context, size_t item, int thread)
{
    (void)item;
    (void)thread;
    sgsi_parallel_for(8, 1, long_item, context);
}

static void loops_in_items_count_once(void **state)
{
    (void)state;
    for (int threads = 1; threads <= 2; ++threads) {
        sgsi_threads_set(threads);
        const sgsi_loop_seconds before = sgsi_threads_seconds();
        const double start = sgsi_seconds();
        sgsi_parallel_for(2, 1, loop_of_long_items, NULL);
        const double wall = sgsi_seconds() - start, inside = seconds_since(before).inside;
        assert_true(inside >= 0.1 && inside <= wall);
    }
    sgsi_threads_set(0);
}

static void builds_and_refits_of_one_thread_count_as_parallel(void **state)
{
    (void)state;
    enum { COUNT = 1000 };
    static sgsi_bounds boxes[COUNT];
    for (size_t i = 0; i < COUNT; ++i)
        for (int k = 0; k < 3; ++k) {
            boxes[i].lower[k] = (float)sgsi_random_uniform(3, 3 * i + (size_t)k);
            boxes[i].upper[k] = boxes[i].lower[k] + 0.01F;
        }
    sgsi_threads_set(1);
    sgsi_bvh *bvh;
    assert_int_equal(sgsi_bvh_create(&bvh), SGS_STATUS_OK);
    const sgsi_loop_seconds before = sgsi_threads_seconds();
    assert_int_equal(sgsi_bvh_build(bvh, boxes, COUNT, SGSI_BVH_REFIT), SGS_STATUS_OK);
    const sgsi_loop_seconds built = seconds_since(before);
    assert_true(built.inside > 0 && built.waiting == 0);
    assert_int_equal(sgsi_bvh_refit(bvh), SGS_STATUS_OK);
    assert_true(seconds_since(before).inside > built.inside);
    sgsi_bvh_destroy(bvh);
    sgsi_threads_set(0);
}

// In an image of a single tile, the sums of the primitives are the only parallel work of a backward
// pass: with several threads they are in several buckets.
static void sums_of_one_thread_count_as_parallel(void **state)
{
    (void)state;
    sgsi_threads_set(1);
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 16, 16);
    oracle_scene scene = oracle_random_model(7, 100, NULL);
    traced_view traced =
        traced_create(scene.model, &camera, &pose, SGS_FILTER_3DGS, 1, SGSI_BVH_REFIT);
    const sgsi_loop_seconds before = sgsi_threads_seconds();
    assert_int_equal(sgsi_tracer_backward(traced.tracer, &traced.view, &traced.planes,
                                          traced.planes.color, traced.planes.transmittance),
                     SGS_STATUS_OK);
    const double inside = seconds_since(before).inside;
    assert_true(inside > 0 && inside <= sgsi_tracer_seconds(traced.tracer).reduce);
    traced_destroy(&traced);
    oracle_scene_free(&scene);
    sgsi_threads_set(0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(prediction_is_amdahls_law_limited_by_bandwidth),
        cmocka_unit_test(communication_takes_messages_and_bytes),
        cmocka_unit_test(loop_clocks_measure_serial_and_waiting_time),
        cmocka_unit_test(single_items_count_as_serial_on_many_threads),
        cmocka_unit_test(a_single_part_of_several_counts_as_parallel),
        cmocka_unit_test(loops_in_items_count_once),
        cmocka_unit_test(builds_and_refits_of_one_thread_count_as_parallel),
        cmocka_unit_test(sums_of_one_thread_count_as_parallel),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
