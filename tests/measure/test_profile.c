// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The profile's counts against the oracle's brute force, their order for each tree, and the cost of
// trees whose boxes allow a computation by hand.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "support/oracle_support.h"
#include "support/skip_support.h"
#include "support/task_support.h"

#include "base/core.h"
#include "bvh/bvh_cost.h"
#include "reference/reference.h"
#include "sparegs/profile.h"
#include "sparegs/runtime.h"

enum { WIDTH = 53, HEIGHT = 38, COUNT = 400 };

static sgs_profile *profile_of(const oracle_scene *scene, const sgs_camera *camera,
                               const sgs_pose *pose, int samples, double step)
{
    sgs_profile_options options = sgs_profile_options_default();
    options.repeat = 1;
    options.samples = samples;
    options.step = step;
    sgs_profile *profile;
    if (sgs_profile_view(scene->model, camera, pose, &options, &profile))
        fail_msg("%s", sgs_last_error());
    return profile;
}

static void hits_equal_brute_force(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(7, COUNT, NULL);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, WIDTH, HEIGHT);
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    const sgs_render_options options = sgs_render_options_default();
    sgs_profile *profile = profile_of(&scene, &camera, &pose, WIDTH * HEIGHT / 8, 0);
    sgs_reference_frame exact;
    assert_int_equal(sgs_reference_frame_create(WIDTH, HEIGHT, &exact), SGS_STATUS_OK);
    assert_int_equal(
        sgs_reference_render(scene.params, scene.count, &camera, &pose, &options, &exact),
        SGS_STATUS_OK);
    double sum = 0, off = 0;
    for (int i = 0; i < WIDTH * HEIGHT; ++i) {
        sum += exact.hits[i];
        off += fabs((double)profile->pixel_hits[i] - exact.hits[i]);
        assert_true(profile->pixel_hits[i] <= profile->pixel_block_hits[i]);
    }
    assert_true(sum > 3 * WIDTH * HEIGHT);
    print_message("%.0f hits, %.0f differ (alpha within rounding of 1/255); sampled %.2f per ray "
                  "against %.2f\n",
                  sum, off, profile->sampled_hits, sum / (WIDTH * HEIGHT));
    assert_true(off <= 1e-3 * sum);
    assert_true(fabs(profile->hits - sum) <= 1e-3 * sum);
    // A regular sample of an eighth of the pixels.
    assert_true(fabs(profile->sampled_hits / (sum / (WIDTH * HEIGHT)) - 1) < 0.1);
    assert_true(profile->sampled_hits_unterminated >= profile->sampled_hits);
    assert_true(profile->rays == WIDTH * HEIGHT);
    sgs_reference_frame_free(&exact);
    sgs_profile_destroy(profile);
    oracle_scene_free(&scene);
}

static void every_stage_is_conservative(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(11, COUNT, NULL);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, WIDTH, HEIGHT);
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    sgs_profile *p = profile_of(&scene, &camera, &pose, 0, 0.05);
    assert_true(p->primitives == (double)scene.count);
    assert_true(p->macrotile_hits > 0 && p->macrotile_hits <= p->tile_hits);
    assert_true(p->macrotile_hits <= p->gathered && p->gathered <= p->distinct);
    assert_true(p->distinct <= p->callbacks && p->gathered <= p->candidates);
    assert_true(p->traced > 0 && p->traced <= p->primitives);
    assert_true(isnan(p->noise)); // one repetition gives no estimate
    assert_true(p->tile_hits <= p->candidates && p->block_hits <= p->evaluations);
    assert_true(p->evaluations <= p->block_tests && p->block_tests == 16 * p->candidates);
    assert_true(p->hits <= 16 * p->block_hits && p->block_hits <= p->hits);
    for (int k = 0; k < SGS_PROFILE_KIND_COUNT; ++k) {
        const sgs_profile_tree *tree = &p->trees[k];
        assert_true(tree->distinct >= p->macrotile_hits); // conservative for any tree
        assert_true(tree->distinct <= tree->callbacks);
        // One primitive per leaf: Embree reports exactly the boxes that the packets cross.
        if (k < SGS_PROFILE_REFIT)
            assert_true(tree->distinct == p->trees[0].distinct && tree->leaves == COUNT);
        else
            assert_true(tree->distinct >= p->trees[0].distinct && tree->leaves < COUNT);
        double leaves = 0, primitives = 0;
        for (int n = 0; n < 8; ++n) {
            leaves += tree->leaf_sizes[n];
            primitives += n * tree->leaf_sizes[n];
        }
        assert_true(leaves == tree->leaves && primitives == COUNT && tree->nodes > leaves);
        assert_true(tree->node_visits > 0 &&
                    tree->box_tests >= tree->node_visits - p->tiles_x * p->tiles_y);
        assert_true(tree->build > 0 && tree->gather > 0 && tree->bytes > 16 * COUNT);
        assert_true((tree->refit > 0) == (k >= SGS_PROFILE_REFIT));
        assert_true(tree->cost >= 1 && tree->overlap >= 0);
    }
    // Boxes that moved apart in a tree built for their old positions.
    assert_true(p->trees[SGS_PROFILE_AGED].cost > p->trees[SGS_PROFILE_REFIT].cost);
    double candidates = 0, evaluations = 0;
    for (int t = 0; t < p->tiles_x * p->tiles_y; ++t) {
        candidates += (double)p->tile_candidates[t];
        evaluations += (double)p->tile_evaluations[t];
        assert_true(p->tile_seconds[t] >= 0);
    }
    assert_true(candidates == p->candidates && evaluations == p->evaluations);
    sgs_profile_destroy(p);
    oracle_scene_free(&scene);
}

// The primitive whose hit ends the ray of a pixel: the nearest of those that do not count. COUNT if
// there is none.
static size_t last_primitive(const sgsi_reference_view *view, int x, int y, const sgs_hit *counted,
                             size_t count)
{
    double direction[3], nearest = INFINITY;
    size_t last = COUNT;
    bool counts[COUNT] = {false};
    for (size_t i = 0; i < count; ++i)
        counts[counted[i].primitive] = true;
    assert_true(sgsi_reference_ray(view, x, y, direction));
    for (size_t i = 0; i < view->count; ++i) {
        double rho2, t;
        sgsi_reference_response(&view->primitives[i], direction, &rho2, &t);
        const bool hit = 255 * view->primitives[i].opacity * exp(-0.5 * rho2) >= 1;
        if (hit && t > view->near_distance && t < nearest && !counts[i]) {
            nearest = t;
            last = i;
        }
    }
    return last;
}

// Pairs of blocks of `side` pixels and primitives with a hit that counts or ends the ray, by the
// oracle.
static double pairs_with_a_hit(const oracle_scene *scene, const sgs_camera *camera,
                               const sgs_pose *pose, int side)
{
    const sgs_render_options options = sgs_render_options_default();
    sgs_hit hits[COUNT];
    double pairs = 0;
    sgsi_reference_view view;
    assert_int_equal(
        sgsi_reference_view_create(scene->params, scene->count, camera, pose, &options, &view),
        SGS_STATUS_OK);
    for (int y0 = 0; y0 < HEIGHT; y0 += side)
        for (int x0 = 0; x0 < WIDTH; x0 += side) {
            bool seen[COUNT] = {false};
            for (int y = y0; y < y0 + side && y < HEIGHT; ++y)
                for (int x = x0; x < x0 + side && x < WIDTH; ++x) {
                    const size_t count = oracle_hits(scene->params, scene->count, camera, pose,
                                                     &options, x, y, hits, COUNT);
                    for (size_t i = 0; i < count; ++i)
                        seen[hits[i].primitive] = true;
                    const size_t last = last_primitive(&view, x, y, hits, count);
                    if (last < COUNT)
                        seen[last] = true;
                }
            for (size_t i = 0; i < scene->count; ++i)
                pairs += seen[i];
        }
    sgsi_reference_view_free(&view);
    return pairs;
}

// Most rays end in front of most primitives, whose hits do not count.
static void pairs_have_a_hit_that_matters(void **state)
{
    (void)state;
    const oracle_range opaque = {1.0, 0.2, 0.5, 0.9, 0.99, 0};
    oracle_scene scene = oracle_random_model(12, 100, &opaque);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, WIDTH, HEIGHT);
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    sgs_profile *p = profile_of(&scene, &camera, &pose, 0, 0);
    const double blocks = pairs_with_a_hit(&scene, &camera, &pose, 4),
                 tiles = pairs_with_a_hit(&scene, &camera, &pose, 16);
    assert_true(tiles > 100 && fabs(p->tile_hits - tiles) <= 5e-3 * tiles);
    assert_true(fabs(p->block_hits - blocks) <= 5e-3 * blocks);
    assert_true(p->macrotile_hits == p->tile_hits); // one tile each in a small image
    sgs_profile_destroy(p);
    oracle_scene_free(&scene);
}

static sgsi_bounds box(float x, float y, float z, float size)
{
    return (sgsi_bounds){.lower = {x, y, z}, .upper = {x + size, y + size, z + size}};
}

static void cost_and_overlap_of_two_boxes_equal_hand_computed_values(void **state)
{
    (void)state;
    static const sgsi_bvh_quality qualities[] = {SGSI_BVH_LOW, SGSI_BVH_MEDIUM, SGSI_BVH_HIGH};
    for (int q = 0; q < 3; ++q) {
        // Unit cubes three units apart: the root is 4 x 1 x 1, surface 18; leaves 6 each.
        const sgsi_bounds apart[2] = {box(0, 0, 0, 1), box(3, 0, 0, 1)};
        sgsi_bvh_cost cost;
        assert_int_equal(sgsi_bvh_cost_measure(apart, apart, 2, qualities[q], NULL, &cost),
                         SGS_STATUS_OK);
        assert_int_equal(cost.nodes, 3);
        assert_int_equal(cost.leaves, 2);
        assert_true(fabs(cost.cost - (1 + 12.0 / 18)) < 1e-6);
        assert_true(cost.overlap == 0);
        // The same tree after the cubes moved onto each other: all surfaces are 6, with full
        // overlap.
        const sgsi_bounds moved[2] = {box(0, 0, 0, 1), box(0, 0, 0, 1)};
        assert_int_equal(sgsi_bvh_cost_measure(apart, moved, 2, qualities[q], NULL, &cost),
                         SGS_STATUS_OK);
        assert_true(fabs(cost.cost - 3) < 1e-6);
        assert_true(fabs(cost.overlap - 1) < 1e-6);
        assert_int_equal(sgsi_bvh_cost_measure(apart, apart, 0, qualities[q], NULL, &cost),
                         SGS_STATUS_OK);
        assert_true(cost.cost == 0 && cost.nodes == 0);
    }
}

enum { BOXES = 600, PACKETS = 100 };

static double uniform(uint64_t *counter)
{
    return (double)(sgsi_random_bits(5, (*counter)++) >> 11) * 0x1p-53;
}

// Whether a valid ray of the packet crosses the box, in double precision.
static bool crosses(const sgsi_packet *packet, const sgsi_bounds *b)
{
    for (int i = 0; i < 16; ++i) {
        double enter = 0, leave = (double)packet->far[i];
        for (int k = 0; k < 3; ++k) {
            const double o = (double)packet->origin[k], d = (double)packet->direction[k][i];
            const double t0 = ((double)b->lower[k] - o) / d, t1 = ((double)b->upper[k] - o) / d;
            enter = fmax(enter, fmin(t0, t1));
            leave = fmin(leave, fmax(t0, t1));
        }
        if (packet->valid >> i & 1 && enter <= leave)
            return true;
    }
    return false;
}

// The leaves that packets visit have at least the boxes that they cross, and exactly those if each
// leaf has one primitive.
static void packets_visit_the_boxes_that_they_cross(void **state)
{
    (void)state;
    static sgsi_bounds boxes[BOXES];
    static sgsi_packet packets[PACKETS];
    uint64_t counter = 0, pairs = 0;
    for (int i = 0; i < BOXES; ++i)
        boxes[i] = box((float)(8 * uniform(&counter)), (float)(8 * uniform(&counter)),
                       (float)(8 * uniform(&counter)), (float)uniform(&counter));
    for (int p = 0; p < PACKETS; ++p) {
        packets[p].valid = p % 4 ? 0xffff : 0x8421;
        for (int k = 0; k < 3; ++k)
            packets[p].origin[k] = (float)(12 * uniform(&counter) - 2);
        for (int i = 0; i < 16; ++i) {
            double d[3], length = 0;
            for (int k = 0; k < 3; ++k) {
                const double to = 4 + 2 * uniform(&counter) + 0.2 * i;
                d[k] = to - (double)packets[p].origin[k];
                length = hypot(length, d[k]);
            }
            for (int k = 0; k < 3; ++k)
                packets[p].direction[k][i] = (float)(d[k] / length);
            packets[p].far[i] = p % 3 ? INFINITY : (float)(6 * uniform(&counter));
        }
    }
    for (int p = 0; p < PACKETS; ++p)
        for (int i = 0; i < BOXES; ++i)
            pairs += crosses(&packets[p], &boxes[i]);
    assert_true(pairs > 500);
    for (int q = SGSI_BVH_LOW; q <= SGSI_BVH_REFIT; ++q) {
        sgsi_bvh_cost cost;
        sgsi_bvh_visits visits = {.packets = packets, .count = PACKETS};
        assert_int_equal(
            sgsi_bvh_cost_measure(boxes, boxes, BOXES, (sgsi_bvh_quality)q, &visits, &cost),
            SGS_STATUS_OK);
        print_message("quality %d: %llu primitives, %llu boxes crossed, %llu nodes, depth %d\n", q,
                      (unsigned long long)visits.primitives, (unsigned long long)pairs,
                      (unsigned long long)visits.nodes, cost.depth);
        if (q == SGSI_BVH_REFIT)
            assert_true(visits.primitives > pairs);
        else // a ray may touch a box within rounding
            assert_true(fabs((double)visits.primitives - (double)pairs) <= 1e-3 * (double)pairs);
        // Every visited node except the roots was a tested box; fewer tests than pairs.
        assert_true(visits.boxes >= visits.nodes - PACKETS);
        assert_true(visits.boxes < (uint64_t)PACKETS * BOXES / 2);
        assert_true(cost.depth >= 4 && cost.depth <= 40);
    }
}

// Time that other threads ran while a view was profiled.
static double others_while_profiled(const oracle_scene *scene, int threads)
{
    const sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, WIDTH, HEIGHT);
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    sgs_threads_set(threads);
    const double before = task_seconds_of_others();
    sgs_profile_destroy(profile_of(scene, &camera, &pose, 4, 0));
    const double busy = task_seconds_of_others() - before;
    sgs_threads_set(0);
    print_message("%d thread(s): others ran for %g ms\n", threads, 1e3 * busy);
    return busy;
}

// Embree's builder of the costs has threads of its own. TBB may start one when the builder's limit
// ends, but that one has nothing to do.
static void one_thread_is_one_thread(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(8, 15000, NULL);
    const double one = others_while_profiled(&scene, 1), four = others_while_profiled(&scene, 4);
    oracle_scene_free(&scene);
    if (!(four > 0))
        skip_because("the kernel reports no times of threads (CONFIG_SCHED_INFO)");
    assert_true(one < 0.005 * four); // 0.02 if only the builder has more threads
}

static void options_out_of_range_are_rejected(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(3, 20, NULL);
    const sgs_camera camera = oracle_camera(SGS_CAMERA_OPENCV, 20, 20);
    const sgs_pose pose = oracle_pose_look_at(0, 0, -4);
    for (int k = 0; k < 4; ++k) {
        sgs_profile_options options = sgs_profile_options_default();
        options.refits = k == 0 ? -1 : options.refits;
        options.repeat = k == 1 ? 0 : options.repeat;
        options.samples = k == 2 ? 1 << 20 : options.samples;
        options.step = k == 3 ? NAN : options.step;
        sgs_profile *profile = (sgs_profile *)&options;
        assert_int_equal(sgs_profile_view(scene.model, &camera, &pose, &options, &profile),
                         SGS_STATUS_INVALID_ARGUMENT);
        assert_null(profile);
    }
    for (int k = 0; k < 3; ++k) {
        sgs_render_options render = sgs_render_options_default();
        render.near_distance = k == 0 ? -1 : render.near_distance;
        render.sh_degree = k == 1 ? 4 : render.sh_degree;
        render.filter = k == 2 ? (sgs_filter)3 : render.filter;
        sgs_profile_options options = sgs_profile_options_default();
        options.render = &render;
        sgs_profile *profile = (sgs_profile *)&options;
        assert_int_equal(sgs_profile_view(scene.model, &camera, &pose, &options, &profile),
                         SGS_STATUS_INVALID_ARGUMENT);
        assert_null(profile);
    }
    sgs_profile_destroy(NULL);
    oracle_scene_free(&scene);
}

static void counters_count_or_report_the_reason(void **state)
{
    (void)state;
    sgs_counters *counters = sgs_counters_open();
    if (!counters) {
        assert_non_null(strstr(sgs_last_error(), "hardware counters"));
        skip_because("%s", sgs_last_error());
    }
    sgs_counter_values values[2];
    for (int k = 0; k < 2; ++k) {
        volatile double x = 1;
        sgs_counters_start(counters);
        for (int i = 0; i < (k ? 4000000 : 1000000); ++i)
            x = x * 1.0000001;
        values[k] = sgs_counters_stop(counters);
    }
    assert_true(values[0].instructions > 0);
    assert_true(values[1].instructions > 2 * values[0].instructions);
    sgs_counters_close(counters);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(one_thread_is_one_thread),
        cmocka_unit_test(hits_equal_brute_force),
        cmocka_unit_test(every_stage_is_conservative),
        cmocka_unit_test(pairs_have_a_hit_that_matters),
        cmocka_unit_test(cost_and_overlap_of_two_boxes_equal_hand_computed_values),
        cmocka_unit_test(packets_visit_the_boxes_that_they_cross),
        cmocka_unit_test(options_out_of_range_are_rejected),
        cmocka_unit_test(counters_count_or_report_the_reason),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
