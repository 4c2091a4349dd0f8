// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The conclusions of a profile and the summary of a training run from times chosen by hand.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "report/profile_report.h"
#include "report/scaling_report.h"
#include "sparegs/runtime.h"

typedef struct tree_times {
    double build, refit, gather; // milliseconds; gather: of all threads
} tree_times;

// A profile of one view with these times of low, medium, high, refit and aged.
static json_t *report_of(const tree_times times[SGS_PROFILE_KIND_COUNT], double noise)
{
    float tile[1] = {1};
    sgs_profile profile = {
        .width = 16, .height = 16, .tiles_x = 1, .tiles_y = 1, .rays = 256, .noise = noise};
    profile.tile_seconds = tile;
    for (int k = 0; k < SGS_PROFILE_KIND_COUNT; ++k)
        profile.trees[k] = (sgs_profile_tree){.build = 1e-3 * times[k].build,
                                              .refit = 1e-3 * times[k].refit,
                                              .gather = 1e-3 * times[k].gather,
                                              .gather_with_depth_bound = 1e-3 * times[k].gather,
                                              .callbacks = k};
    profile_report report = {.no_counters = "none", .model = "m", .scene = "s", .repeat = 3};
    profile_report_add(&report, "one", "two", &profile);
    profile_report_finish(&report);
    json_t *json = profile_json(&report);
    json_decref(report.per_view);
    return json;
}

static const char *answer(const json_t *report, const char *name)
{
    return json_string_value(json_object_get(json_object_get(report, "answers"), name));
}

static void contains(const char *text, const char *part)
{
    if (!text || !strstr(text, part))
        fail_msg("'%s' is not in '%s'", part, text ? text : "(null)");
}

// The boxes depend on the camera: a fast gather does not pay for a build per view.
static void a_fixed_model_rebuilds_or_refits_for_every_view(void **state)
{
    (void)state;
    static const tree_times times[] = {{1, 0, 4}, {5, 0, 2}, {5, 0, 2}, {5, 0.25, 3}, {5, 0.25, 3}};
    for (int threads = 1; threads <= 2; ++threads) {
        sgs_threads_set(threads);
        json_t *report = report_of(times, 0.05);
        assert_string_equal(answer(report, "quality_drawing"), "refit");
        contains(answer(report, "quality_text"),
                 threads == 1 ? "For a fixed model: refit (3.25 ms per view for tree and gather; "
                                "low 5.00, medium 7.00, high 7.00, refit 3.25; "
                              : "For a fixed model: refit (1.75 ms per view for tree and gather; "
                                "low 3.00, medium 6.00, high 6.00, refit 1.75; ");
        json_decref(report);
    }
    sgs_threads_set(1);
    // A rebuild that is cheaper than the difference between the gathers.
    static const tree_times cheap[] = {
        {0.5, 0, 4}, {0.75, 0, 2}, {5, 0, 2}, {5, 0.25, 3}, {5, 0.25, 3}};
    json_t *report = report_of(cheap, 0.05);
    assert_string_equal(answer(report, "quality_drawing"), "medium");
    json_decref(report);
    sgs_threads_set(0);
}

static void unknown_or_large_noise_decides_nothing(void **state)
{
    (void)state;
    static const tree_times times[] = {
        {0.5, 0, 4}, {0.75, 0, 2}, {5, 0, 2}, {5, 0.25, 3}, {5, 0.25, 3}};
    sgs_threads_set(1);
    json_t *report = report_of(times, NAN);
    assert_null(answer(report, "quality_drawing"));
    assert_true(json_is_null(json_object_get(json_object_get(report, "view"), "gather_noise")));
    contains(answer(report, "quality_text"),
             "undecided (one repetition gives no estimate of the timing noise");
    json_decref(report);
    report = report_of(times, 0.21);
    assert_null(answer(report, "quality_drawing"));
    contains(answer(report, "quality_text"), "undecided (gather times differ by 21 % between");
    json_decref(report);
    sgs_threads_set(0);
}

static void views_name_the_camera_that_their_trees_were_built_for(void **state)
{
    (void)state;
    static const tree_times times[SGS_PROFILE_KIND_COUNT] = {{1, 0, 1}};
    json_t *report = report_of(times, 0);
    const json_t *view = json_array_get(json_object_get(report, "per_view"), 0);
    assert_string_equal(json_string_value(json_object_get(view, "built_for")), "two");
    json_decref(report);
}

static void a_counter_missing_in_one_view_is_missing_in_the_mean(void **state)
{
    (void)state;
    const sgs_counter_values views[] = {{.cycles = 10,
                                         .instructions = 20,
                                         .cache_references = -1,
                                         .cache_misses = 8,
                                         .branch_misses = -1},
                                        {.cycles = 30,
                                         .instructions = -1,
                                         .cache_references = 6,
                                         .cache_misses = 0,
                                         .branch_misses = -1}};
    sgs_counter_values sum = {0};
    for (int v = 0; v < 2; ++v)
        profile_counters_add(&sum, &views[v], 0.5);
    assert_true(sum.cycles == 20 && sum.cache_misses == 4);
    assert_true(sum.instructions == -1 && sum.cache_references == -1 && sum.branch_misses == -1);
}

// 96 macrotiles take two rounds on 64 cores; the projection is divided among all cores.
static void projection_is_not_work_of_macrotiles(void **state)
{
    (void)state;
    sgs_threads_set(1);
    const sgs_train_seconds seconds = {
        .gather = 0.2, .forward = 0.6, .project = 0.3, .backward = 0.2, .total = 1};
    const sgs_train_bytes bytes = {.iterations = 10, .macrotiles = 960};
    json_t *summary = json_object();
    scaling_add_training(summary, &seconds, &bytes);
    const json_t *machine =
        json_array_get(json_object_get(summary, "predicted_speedup"), SCALING_TARGETS - 1);
    assert_int_equal(json_integer_value(json_object_get(machine, "cores")), 64);
    const double speedup = json_number_value(json_object_get(machine, "speedup"));
    assert_true(fabs(speedup * (0.5 / 64 + 0.5 * 2 / 96) - 1) <= 1e-6);
    json_decref(summary);
    sgs_threads_set(0);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_fixed_model_rebuilds_or_refits_for_every_view),
        cmocka_unit_test(unknown_or_large_noise_decides_nothing),
        cmocka_unit_test(views_name_the_camera_that_their_trees_were_built_for),
        cmocka_unit_test(a_counter_missing_in_one_view_is_missing_in_the_mean),
        cmocka_unit_test(projection_is_not_work_of_macrotiles),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
