// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Order and hits. The tracer's images and hit lists must equal those of the same kernels without a
// BVH to the bit, for each scene, lens, build quality, macrotile size, refit history, depth bound
// and number of threads. test_tracer_oracle.c compares with the oracle in double precision,
// test_tracer_gradient.c tests gradients.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <sys/resource.h>
#include <unistd.h>

#include "support/skip_support.h"
#include "support/tracer_support.h"
#include "trace/tracer_state.h"

static const sgs_isa all_isas[SGS_ISA_COUNT] = {SGS_ISA_BASELINE, SGS_ISA_AVX2, SGS_ISA_AVX512};

static const char *label(const char *scene, const char *rest, int number)
{
    static char text[160];
    snprintf(text, sizeof text, "%s, %s %d", scene, rest, number);
    return text;
}

// ---- With and without a BVH ----

static void lists_and_images_equal_those_without_a_bvh(void **state)
{
    (void)state;
    static const int macrotiles[] = {1, 2, 4};
    const sgs_pose poses[2] = {oracle_pose_look_at(0, 0, -4), oracle_pose_look_at(2.1, -1.3, -3.2)};
    int run = 0;
    for (int number = 0; number < TRACED_SCENE_COUNT; ++number) {
        oracle_scene scene = traced_scene(number);
        for (int lens = 0; lens < TRACED_LENS_COUNT; ++lens) {
            for (int filter = SGS_FILTER_3DGS; filter <= SGS_FILTER_NONE; ++filter, ++run) {
                const sgs_camera camera = oracle_camera(traced_lenses[lens], 83, 61);
                traced_view traced =
                    traced_create(scene.model, &camera, &poses[run % 2], (sgs_filter)filter,
                                  macrotiles[(run + number) % 3],
                                  (sgsi_bvh_quality)((run + run / 4) % SGSI_BVH_QUALITY_COUNT));
                traced_assert_matches_brute_force(&traced, scene.count,
                                                  label(traced_scene_name(number), "lens", lens));
                traced_destroy(&traced);
            }
        }
        oracle_scene_free(&scene);
    }
}

static void every_isa_equals_itself_without_a_bvh(void **state)
{
    (void)state;
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, 63, 47);
    for (int i = 0; i < SGS_ISA_COUNT; ++i) {
        if (!sgs_isa_supported(all_isas[i]))
            continue;
        assert_int_equal(sgs_isa_set(all_isas[i]), SGS_STATUS_OK);
        for (int number = 0; number < TRACED_SCENE_COUNT; ++number) {
            oracle_scene scene = traced_scene(number);
            traced_view traced =
                traced_create(scene.model, &camera, &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
            traced_assert_matches_brute_force(&traced, scene.count,
                                              label(traced_scene_name(number), "isa", i));
            traced_destroy(&traced);
            oracle_scene_free(&scene);
        }
    }
}

// Trees of any quality: refitted for other cameras and moved primitives, and newly built.
static void morton_sah_and_refitted_trees_give_the_same_bits(void **state)
{
    (void)state;
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4), away = oracle_pose_look_at(-9, 3, 5);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, 83, 61),
                     other = oracle_camera(SGS_CAMERA_OPENCV_FISHEYE, 40, 30);
    for (int number = 0; number < TRACED_SCENE_COUNT; ++number) {
        const char *name = traced_scene_name(number);
        oracle_scene scene = traced_scene(number), moved = traced_scene(number);
        for (size_t i = 0; i < moved.count; ++i)
            for (int k = 0; k < 3; ++k)
                oracle_primitive(&moved, i)[SGS_PARAM_MEAN + k] += sin((double)i * (k + 1));
        oracle_scene_round(&moved);
        const int macrotile = 1 << number % 3;
        traced_view first =
            traced_create(scene.model, &camera, &pose, SGS_FILTER_3DGS, macrotile, SGSI_BVH_REFIT);
        const traced_lists lists = traced_lists_of(first.tracer, first.rays);
        for (int quality = SGSI_BVH_LOW; quality < SGSI_BVH_QUALITY_COUNT; ++quality) {
            traced_view again = traced_create(scene.model, &camera, &pose, SGS_FILTER_3DGS,
                                              macrotile, (sgsi_bvh_quality)quality);
            traced_assert_same_image(&first.planes, &again.planes, label(name, "quality", quality));
            traced_aim(&again, &other, &away, 1);
            traced_project(&again, scene.model, false, (sgsi_bvh_quality)quality);
            traced_forward(&again, NULL);
            traced_assert_matches_brute_force(&again, scene.count,
                                              label(name, "refitted away, quality", quality));
            traced_project(&again, moved.model, false, (sgsi_bvh_quality)quality);
            traced_forward(&again, NULL);
            traced_assert_matches_brute_force(&again, scene.count,
                                              label(name, "moved, quality", quality));
            traced_aim(&again, &camera, &pose, macrotile);
            traced_project(&again, scene.model, false, (sgsi_bvh_quality)quality);
            traced_forward(&again, NULL);
            traced_assert_same_image(&first.planes, &again.planes,
                                     label(name, "refitted back, quality", quality));
            traced_lists back = traced_lists_of(again.tracer, again.rays);
            traced_assert_same_lists(&lists, &back, label(name, "refitted back, quality", quality));
            traced_lists_free(&back);
            traced_destroy(&again);
        }
        traced_lists_free(&(traced_lists){.begin = lists.begin, .ids = lists.ids});
        traced_destroy(&first);
        oracle_scene_free(&scene);
        oracle_scene_free(&moved);
    }
}

// ---- Depth bounds ----

// Nearly opaque slanted layers: depth bounds cull most of the scene, and most blocks need order
// corrections.
static oracle_scene opaque_scene(uint64_t seed, size_t count)
{
    const oracle_range range = {1.5, 0.02, 0.9, 0.6, 0.99, 0.15};
    return oracle_random_model(seed, count, &range);
}

// Flat discs seen nearly edge-on: distances vary so much within a block that hits far behind a
// depth bound precede counted ones in the list.
static oracle_scene slanted_scene(uint64_t seed, size_t count)
{
    const oracle_range range = {2, 0.005, 3, 0.5, 0.95, 0.15};
    oracle_scene scene = oracle_random_model(seed, count, &range);
    oracle_random random = {seed + 1, 0};
    for (size_t i = 0; i < count; ++i) {
        double *p = oracle_primitive(&scene, i);
        const double turn = oracle_uniform(&random, 0, 6.28),
                     tilt = oracle_uniform(&random, -0.15, 0.15);
        double normal[3] = {cos(turn), sin(turn), tilt};
        oracle_normalize(normal);
        // Rotation from local y to the normal.
        const double rotation[4] = {1 + normal[1] + 1e-9, normal[2], 0, -normal[0]};
        memcpy(p + SGS_PARAM_ROTATION, rotation, sizeof rotation);
        oracle_set_scales(p, oracle_uniform(&random, 0.3, 2), oracle_uniform(&random, 0.005, 0.05),
                          oracle_uniform(&random, 0.3, 2));
    }
    oracle_scene_round(&scene);
    return scene;
}

// Negative numbers: two opaque scenes, six slanted ones.
enum { GUESS_SCENES = 8 };

static oracle_scene depth_bound_scene(int number)
{
    if (number >= 0)
        return traced_scene(number);
    return number >= -2 ? opaque_scene((uint64_t)(20 - number), 1500)
                        : slanted_scene((uint64_t)(500 - number), 1500);
}

static size_t tile_count(const traced_view *traced)
{
    return (size_t)traced->rays->tiles_x * (size_t)traced->rays->tiles_y;
}

static void depth_bounds_change_no_bit_and_reduce_work(void **state)
{
    (void)state;
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, 150, 110);
    for (int number = -GUESS_SCENES; number < TRACED_SCENE_COUNT; ++number) {
        oracle_scene scene = depth_bound_scene(number);
        const char *name = number < 0 ? "opaque or slanted" : traced_scene_name(number);
        for (int macrotile = 1; macrotile <= SGSI_MACROTILE_SIDE; macrotile *= 4) {
            traced_view traced = traced_create(scene.model, &camera, &pose, SGS_FILTER_3DGS,
                                               macrotile, SGSI_BVH_REFIT);
            sgsi_planes plain = traced.planes;
            traced.planes = (sgsi_planes){0};
            const uint64_t candidates = sgsi_tracer_counts(traced.tracer).candidates;
            float *depth_bound = oracle_memory(tile_count(&traced), sizeof *depth_bound);
            for (size_t i = 0; i < tile_count(&traced); ++i)
                depth_bound[i] = INFINITY;
            for (int visit = 0; visit < 3; ++visit) {
                traced_forward(&traced, depth_bound);
                traced_assert_same_image(&plain, &traced.planes, label(name, "visit", visit));
                if (visit)
                    assert_int_equal(sgsi_tracer_counts(traced.tracer).fallback_gathers, 0);
            }
            if (number < 0)
                assert_true(sgsi_tracer_counts(traced.tracer).candidates < candidates * 3 / 4);
            free(depth_bound);
            traced_planes_free(&plain);
            traced_destroy(&traced);
        }
        oracle_scene_free(&scene);
    }
}

static void depth_bounds_too_near_trigger_exact_fallback_gathers(void **state)
{
    (void)state;
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    const sgs_camera cameras[2] = {
        oracle_camera(SGS_CAMERA_PINHOLE, 150, 110),
        {SGS_CAMERA_OPENCV_FISHEYE, 140, 140, {42, 42, 70, 70}}}; // corners without rays
    uint64_t fallback_gathers = 0;
    for (int number = -GUESS_SCENES; number < TRACED_SCENE_COUNT; ++number) {
        oracle_scene scene = depth_bound_scene(number);
        const sgs_camera *camera = &cameras[(number + GUESS_SCENES) % 2];
        traced_view traced = traced_create(scene.model, camera, &pose, SGS_FILTER_3DGS,
                                           1 << (number + GUESS_SCENES) / 2 % 3, SGSI_BVH_REFIT);
        sgsi_planes plain = traced.planes;
        traced.planes = (sgsi_planes){0};
        float *depth_bound = oracle_memory(tile_count(&traced), sizeof *depth_bound);
        for (int plant = 0; plant < 6; ++plant) {
            for (size_t i = 0; i < tile_count(&traced); ++i) {
                const float planted[6] = {
                    0.0f, 3.0f,  (float)(2 + (i * 7) % 5),
                    NAN,  -1.0f, (float)(2.5 + 3 * sgsi_random_uniform((uint64_t)number + 50, i))};
                depth_bound[i] = planted[plant];
            }
            traced_forward(&traced, depth_bound);
            fallback_gathers += sgsi_tracer_counts(traced.tracer).fallback_gathers;
            traced_assert_same_image(&plain, &traced.planes,
                                     label("depth_bound", "planted", plant));
            traced_forward(&traced, depth_bound); // the repaired depth bounds are valid
            assert_int_equal(sgsi_tracer_counts(traced.tracer).fallback_gathers, 0);
            traced_assert_same_image(&plain, &traced.planes,
                                     label("depth_bound", "repaired", plant));
        }
        free(depth_bound);
        traced_planes_free(&plain);
        traced_destroy(&traced);
        oracle_scene_free(&scene);
    }
    assert_true(fallback_gathers > 100);
}

// A depth bound removes hidden entries from the middle of a block's list, so a hidden entry must
// not change a bit at any position. The entries are constructed directly: response 1 everywhere, t
// equal to the distance.
static void hidden_entries_change_no_bit_at_any_position(void **state)
{
    (void)state;
    enum { SEEN = 12, HIDDEN = 4, COUNT = SEEN + HIDDEN };
    sgsi_scratch scratch = {0};
    sgsi_tile_rays rays = {.valid = {0xFFFF}};
    assert_true(sgsi_scratch_reserve(&scratch, COUNT));
    for (uint64_t seed = 0; seed < 2000; ++seed) {
        uint32_t order[COUNT] = {0};
        for (uint32_t i = 0; i < COUNT; ++i) {
            float *r = scratch.tile_projected + SGSI_PROJECTED_FLOATS * i;
            const bool hidden = i >= SEEN,
                       wall = i < 3; // three entries of alpha 0.99 end every ray at t <= 9
            memset(r, 0, SGSI_PROJECTED_FLOATS * sizeof *r);
            r[SGSI_PROJECTED_C] = 1.0f;
            r[SGSI_PROJECTED_INV_KAPPA] = 1.0f;
            r[SGSI_PROJECTED_LOG_OPACITY] = wall ? 0.0f : -(float)sgsi_random_uniform(seed, 4 * i);
            r[SGSI_PROJECTED_DISTANCE] = hidden ? 10 + (float)i
                                         : wall
                                             ? 7 + (float)i
                                             : 1 + 5 * (float)sgsi_random_uniform(seed, 4 * i + 1);
            r[SGSI_PROJECTED_COLOR] = (float)sgsi_random_uniform(seed, 4 * i + 2);
            scratch.tile_ids[i] = i;
            const uint32_t at = (uint32_t)(sgsi_random_bits(seed, 4 * i + 3) % (i + 1));
            order[i] = order[at];
            order[at] = i;
        }
        sgsi_planes planes[2];
        for (int k = 0; k < 2; ++k) {
            planes[k] = traced_planes_create(4, 4);
            memset(scratch.entry_count, 0, sizeof scratch.entry_count);
            for (uint32_t i = 0; i < COUNT; ++i)
                if (k == 0 || order[i] < SEEN)
                    scratch.order[scratch.entry_count[0]++] = order[i];
            sgsi_tile_target target = {
                .rays = &rays,
                .width = 4,
                .height = 4,
                .stride = planes[k].stride,
                .color = {planes[k].color[0], planes[k].color[1], planes[k].color[2]},
                .transmittance = planes[k].transmittance,
                .depth_mean = planes[k].depth_mean,
                .depth_median = planes[k].depth_median,
                .depth_first = planes[k].depth_first,
                .hits = planes[k].hits,
                .near_distance = 0.2f};
            sgsi_kernels_get()->tile_forward(&scratch, &target);
        }
        traced_assert_same_image(&planes[0], &planes[1], "without the hidden elements");
        traced_planes_free(&planes[0]);
        traced_planes_free(&planes[1]);
    }
    sgsi_scratch_free(&scratch);
}

// ---- Threads and instruction sets ----

typedef struct frozen {
    sgsi_planes planes;
    float *sums;
    uint8_t *touched;
    size_t capacity;
} frozen;

// Forward and backward pass with fixed pseudo-random gradients; keeps images and sums.
static frozen trace_and_freeze(const oracle_scene *scene, const sgs_camera *camera,
                               const sgs_pose *pose, sgs_filter filter)
{
    traced_view traced = traced_create(scene->model, camera, pose, filter, 2, SGSI_BVH_REFIT);
    sgsi_planes d = traced_planes_create(camera->width, camera->height);
    oracle_random random = {5, 0};
    for (size_t i = 0; i < 4 * d.stride * (size_t)d.height; ++i)
        d.color[0][i] = (float)oracle_normal(&random);
    assert_int_equal(
        sgsi_tracer_backward(traced.tracer, &traced.view, &traced.planes, d.color, d.transmittance),
        SGS_STATUS_OK);
    frozen kept = {.planes = traced.planes, .capacity = scene->model->capacity};
    kept.sums = oracle_memory(kept.capacity, SGSI_PROJECTED_FLOATS * sizeof *kept.sums);
    kept.touched = oracle_memory(kept.capacity / 16, 1);
    memcpy(kept.touched, sgsi_tracer_touched(traced.tracer), kept.capacity / 16);
    for (size_t block = 0; block < kept.capacity / 16; ++block)
        if (kept.touched[block])
            memcpy(kept.sums + block * 256, sgsi_tracer_grad_sums(traced.tracer) + block * 256,
                   256 * sizeof *kept.sums);
    traced.planes = (sgsi_planes){0};
    traced_planes_free(&d);
    traced_destroy(&traced);
    return kept;
}

static void frozen_free(frozen *kept)
{
    traced_planes_free(&kept->planes);
    free(kept->sums);
    free(kept->touched);
}

static void assert_same_frozen(const frozen *a, const frozen *b, const char *what)
{
    traced_assert_same_image(&a->planes, &b->planes, what);
    assert_memory_equal(a->touched, b->touched, a->capacity / 16);
    assert_memory_equal(a->sums, b->sums, a->capacity * SGSI_PROJECTED_FLOATS * sizeof *a->sums);
}

static void one_two_and_three_threads_give_the_same_bits(void **state)
{
    (void)state;
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, 150, 110);
    for (int number = 0; number < TRACED_SCENE_COUNT; number += 3) {
        oracle_scene scene = traced_scene(number);
        sgsi_threads_set(1);
        frozen one = trace_and_freeze(&scene, &camera, &pose, SGS_FILTER_3DGS);
        for (int threads = 2; threads <= 3; ++threads) {
            sgsi_threads_set(threads);
            frozen more = trace_and_freeze(&scene, &camera, &pose, SGS_FILTER_3DGS);
            assert_same_frozen(&one, &more, label(traced_scene_name(number), "threads", threads));
            frozen_free(&more);
        }
        frozen_free(&one);
        oracle_scene_free(&scene);
    }
}

static void avx2_and_avx512_trace_the_same_bits(void **state)
{
    (void)state;
    if (!sgs_isa_supported(SGS_ISA_AVX512) || !sgs_isa_supported(SGS_ISA_AVX2))
        skip_because("no AVX-512, or a build without it");
    const sgs_pose pose = oracle_pose_look_at(0.3, -0.2, -4);
    for (int number = 0; number < TRACED_SCENE_COUNT; ++number) {
        oracle_scene scene = traced_scene(number);
        for (int filter = SGS_FILTER_3DGS; filter <= SGS_FILTER_NONE; ++filter) {
            const sgs_camera camera = oracle_camera(traced_lenses[number % 3], 63, 47);
            sgs_isa_set(SGS_ISA_AVX2);
            frozen narrow = trace_and_freeze(&scene, &camera, &pose, (sgs_filter)filter);
            sgs_isa_set(SGS_ISA_AVX512);
            frozen wide = trace_and_freeze(&scene, &camera, &pose, (sgs_filter)filter);
            assert_same_frozen(&narrow, &wide, label(traced_scene_name(number), "filter", filter));
            frozen_free(&narrow);
            frozen_free(&wide);
        }
        oracle_scene_free(&scene);
    }
}

// ---- Rounding of depth bounds ----

// Far, small primitives before one pixel: the lower bound on t nearly equals t, so that rounding
// decides. A bound equal to the distance of the last hit must not exclude that hit.
static void depth_bounds_equal_to_the_last_distance_keep_its_hit(void **state)
{
    (void)state;
    enum { WALL = 6 };
    const sgs_camera camera = {SGS_CAMERA_PINHOLE, 1, 1, {1000, 1000, 0.5, 0.5}};
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    uint64_t fallback_gathers = 0;
    for (uint64_t seed = 0; seed < 400; ++seed) {
        oracle_scene scene = oracle_scene_create(WALL);
        oracle_random random = {seed, 0};
        for (size_t i = 0; i < WALL; ++i)
            oracle_set_ball(oracle_primitive(&scene, i), oracle_uniform(&random, -4e-6, 4e-6),
                            oracle_uniform(&random, -4e-6, 4e-6), oracle_uniform(&random, 1, 9),
                            2e-5, 0.9999);
        oracle_scene_round(&scene);
        traced_view traced =
            traced_create(scene.model, &camera, &pose, SGS_FILTER_NONE, 1, SGSI_BVH_REFIT);
        sgsi_planes plain = traced.planes;
        traced.planes = (sgsi_planes){0};
        float depth_bound = INFINITY;
        traced_forward(&traced, &depth_bound);
        assert_true(isfinite(depth_bound)); // 1.05 times the distance
        float last = 0.999999f * (depth_bound / 1.05f);
        while (nextafterf(last, INFINITY) * 1.05f <= depth_bound)
            last = nextafterf(last, INFINITY);
        depth_bound = last;
        traced_forward(&traced, &depth_bound);
        fallback_gathers += sgsi_tracer_counts(traced.tracer).fallback_gathers;
        traced_assert_same_image(&plain, &traced.planes, "bound at the last hit");
        traced_planes_free(&plain);
        traced_destroy(&traced);
        oracle_scene_free(&scene);
    }
    assert_int_equal(fallback_gathers, 0);
}

// ---- Lack of memory for what later passes would use ----

static const sgs_camera memory_camera = {SGS_CAMERA_PINHOLE, 150, 110, {140, 140, 75, 55}};

static traced_view memory_view(const oracle_scene *scene)
{
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    return traced_create(scene->model, &memory_camera, &pose, SGS_FILTER_3DGS, 2, SGSI_BVH_REFIT);
}

static void assert_traces_as(traced_view *traced, const sgsi_planes *planes,
                             const traced_lists *lists, const char *what)
{
    traced_assert_complete(&traced->planes);
    traced_assert_same_image(planes, &traced->planes, what);
    traced_lists own = traced_lists_of(traced->tracer, traced->rays);
    traced_assert_same_lists(lists, &own, what);
    traced_lists_free(&own);
}

static void failed_reservations_do_not_fail_a_pass(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(3, 1500, NULL);
    traced_view plain = memory_view(&scene);
    traced_lists lists = traced_lists_of(plain.tracer, plain.rays);
    size_t failures = 0;
    for (bool failed = true; failed; failures += failed) {
        sgsi_threads_set(1);
        traced_view traced = memory_view(&scene);
        sgsi_threads_set(2); // the second thread has its state, but no memory yet
        assert_int_equal(sgsi_tracer_prepare_threads(traced.tracer), SGS_STATUS_OK);
        const size_t before = sgsi_allocation_count();
        sgsi_fail_allocation(failures + 1);
        const sgs_status status =
            sgsi_tracer_forward(traced.tracer, &traced.view, &traced.planes, NULL, true);
        failed = sgsi_allocation_count() - before > failures;
        sgsi_fail_allocation(0);
        assert_int_equal(status, SGS_STATUS_OK);
        assert_traces_as(&traced, &plain.planes, &lists, label("failure", "of", (int)failures));
        traced_destroy(&traced);
    }
    assert_true(failures >= 4);
    traced_lists_free(&lists);
    traced_destroy(&plain);
    oracle_scene_free(&scene);
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
static size_t address_space(void)
{
    size_t pages = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    if (file && fscanf(file, "%zu", &pages) != 1)
        pages = 0;
    if (file)
        fclose(file);
    return pages * (size_t)sysconf(_SC_PAGESIZE);
}

// The limit leaves room for the reservation of one thread but not of two. One that is kept would
// leave little to the other thread and to the rest of the program.
static void reservations_leave_address_space_to_the_lists(void **state)
{
    (void)state;
    enum { STEP = 1 << 18, STEPS = 24 };
    const size_t words = (size_t)1 << 28;
    oracle_scene scene = oracle_random_model(3, 1500, NULL);
    sgsi_threads_set(2);
    traced_view traced = memory_view(&scene), plain = memory_view(&scene);
    traced_lists lists = traced_lists_of(plain.tracer, plain.rays);
    struct rlimit all;
    assert_int_equal(getrlimit(RLIMIT_AS, &all), 0);
    for (size_t step = 0; step < STEPS && address_space(); ++step) {
        traced.tracer->list_words = words;
        size_t reserved = 0;
        for (int i = 0; i < 2; ++i)
            sgsi_arena_free(&traced.tracer->threads[i]->arena);
        const struct rlimit tight = {address_space() + 4 * words - 4 * STEP + step * STEP,
                                     all.rlim_max};
        assert_int_equal(setrlimit(RLIMIT_AS, &tight), 0);
        const sgs_status status =
            sgsi_tracer_forward(traced.tracer, &traced.view, &traced.planes, NULL, true);
        assert_int_equal(setrlimit(RLIMIT_AS, &all), 0);
        assert_int_equal(status, SGS_STATUS_OK);
        for (int i = 0; i < 2; ++i) {
            const sgsi_arena *arena = &traced.tracer->threads[i]->arena;
            reserved += arena->chunk_count && arena->chunks[0].capacity >= words;
        }
        assert_int_equal(reserved, 0);
        assert_traces_as(&traced, &plain.planes, &lists, label("limit", "step", (int)step));
    }
    traced_lists_free(&lists);
    traced_destroy(&plain);
    traced_destroy(&traced);
    oracle_scene_free(&scene);
}
#else // the sanitizers reserve the address space for themselves
static void reservations_leave_address_space_to_the_lists(void **state)
{
    (void)state;
    skip_because("the sanitizer reserves the address space");
}
#endif

static void thread_counts_are_clamped_to_what_the_tracer_holds(void **state)
{
    (void)state;
    sgsi_threads_set(1 << 20);
    assert_int_equal(sgsi_threads(), SGSI_THREADS_MAX);
    sgsi_threads_set(-3);
    assert_true(sgsi_threads() >= 1 && sgsi_threads() <= SGSI_THREADS_MAX);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(lists_and_images_equal_those_without_a_bvh),
        cmocka_unit_test_teardown(every_isa_equals_itself_without_a_bvh, traced_restore),
        cmocka_unit_test(morton_sah_and_refitted_trees_give_the_same_bits),
        cmocka_unit_test(depth_bounds_change_no_bit_and_reduce_work),
        cmocka_unit_test(depth_bounds_too_near_trigger_exact_fallback_gathers),
        cmocka_unit_test(hidden_entries_change_no_bit_at_any_position),
        cmocka_unit_test_teardown(one_two_and_three_threads_give_the_same_bits, traced_restore),
        cmocka_unit_test_teardown(avx2_and_avx512_trace_the_same_bits, traced_restore),
        cmocka_unit_test(depth_bounds_equal_to_the_last_distance_keep_its_hit),
        cmocka_unit_test_teardown(failed_reservations_do_not_fail_a_pass, traced_restore),
        cmocka_unit_test_teardown(reservations_leave_address_space_to_the_lists, traced_restore),
        cmocka_unit_test_teardown(thread_counts_are_clamped_to_what_the_tracer_holds,
                                  traced_restore),
    };
    return cmocka_run_group_tests(tests, traced_prepare, NULL);
}
