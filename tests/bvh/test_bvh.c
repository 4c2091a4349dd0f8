// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A gather must report every box that a ray of the packet crosses within its limit. Compared with a
// brute-force slab test in double precision, for each build quality, after small and large refits,
// for 0, 1 and 100 000 primitives. The result must also be smaller than the whole set.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "bvh/bvh.h"
#include "bvh/bvh_cost.h"
#include "sparegs/render.h"
#include "base/core.h"
#include "base/threads.h"
#include "support/task_support.h"

static const char *const quality_names[] = {"low", "medium", "high", "refit"};

static double uniform(uint64_t seed, uint64_t *counter, double low, double high)
{
    return low + (high - low) * sgsi_random_uniform(seed, (*counter)++);
}

// Boxes in [-spread, spread]^3 with log-uniform edges.
static void fill_boxes(sgsi_bounds *boxes, size_t count, uint64_t seed, double spread,
                       double edge_low, double edge_high)
{
    uint64_t counter = 0;
    for (size_t i = 0; i < count; ++i) {
        for (int k = 0; k < 3; ++k) {
            const double centre = uniform(seed, &counter, -spread, spread);
            const double half = 0.5 * exp(uniform(seed, &counter, log(edge_low), log(edge_high)));
            boxes[i].lower[k] = (float)(centre - half);
            boxes[i].upper[k] = (float)(centre + half);
        }
        boxes[i].align0 = boxes[i].align1 = 0.0f;
    }
}

static sgsi_bounds *make_boxes(size_t count, uint64_t seed)
{
    sgsi_bounds *boxes = sgsi_alloc(count ? count : 1, sizeof *boxes);
    assert_non_null(boxes);
    fill_boxes(boxes, count, seed, 10, 0.01, 1);
    return boxes;
}

// Sixteen rays around one direction, as in a macrotile; `width` is the half angle of the packet.
static sgsi_packet make_packet(uint64_t seed, double width, float far)
{
    uint64_t counter = 1000;
    sgsi_packet packet = {.valid = 0xFFFF};
    double axis[3], length = 0;
    for (int k = 0; k < 3; ++k) {
        packet.origin[k] = (float)uniform(seed, &counter, -12, 12);
        axis[k] = uniform(seed, &counter, -3, 3) - packet.origin[k];
        length += axis[k] * axis[k];
    }
    for (int i = 0; i < 16; ++i) {
        double d[3], norm = 0;
        for (int k = 0; k < 3; ++k) {
            d[k] = axis[k] / sqrt(length) + uniform(seed, &counter, -width, width);
            norm += d[k] * d[k];
        }
        for (int k = 0; k < 3; ++k)
            packet.direction[k][i] = (float)(d[k] / sqrt(norm));
        packet.far[i] = far;
    }
    return packet;
}

// Distance at which a ray enters a box (0 from inside), or INFINITY. Exact up to rounding in double
// precision.
static double entry(const sgsi_packet *packet, int ray, const sgsi_bounds *box)
{
    double near = 0, far = INFINITY;
    for (int k = 0; k < 3; ++k) {
        const double o = packet->origin[k], d = packet->direction[k][ray];
        if (d == 0) {
            if (o < box->lower[k] || o > box->upper[k])
                return INFINITY;
            continue;
        }
        const double a = (box->lower[k] - o) / d, b = (box->upper[k] - o) / d;
        near = fmax(near, fmin(a, b));
        far = fmin(far, fmax(a, b));
    }
    return near <= far ? near : INFINITY;
}

// A box is required if a valid ray crosses it before its far distance. Callers pad boxes and far
// distances by more than the rounding of the box tests, so boxes hit by less than 1e-6 are not
// required.
static bool required(const sgsi_packet *packet, const sgsi_bounds *box)
{
    sgsi_bounds inner = *box;
    for (int k = 0; k < 3; ++k) {
        const float slack =
            4e-6f * (fabsf(box->lower[k]) + fabsf(box->upper[k]) + fabsf(packet->origin[k]));
        inner.lower[k] += slack;
        inner.upper[k] -= slack;
        if (inner.lower[k] > inner.upper[k])
            return false;
    }
    for (int i = 0; i < 16; ++i)
        if ((packet->valid >> i & 1) && entry(packet, i, &inner) < packet->far[i] * (1 - 1e-6))
            return true;
    return false;
}

typedef struct gather_result {
    size_t required, unique;
} gather_result;

// Gathers and asserts that ids are in range and every required box is reported.
static gather_result check_gather(const sgsi_bvh *bvh, const sgsi_bounds *boxes, size_t count,
                                  const sgsi_packet *packet, sgsi_gather_list *list, uint8_t *seen)
{
    gather_result result = {0};
    memset(seen, 0, count);
    list->count = 0;
    assert_int_equal(sgsi_bvh_gather(bvh, packet, list), SGS_STATUS_OK);
    assert_true(list->count <= list->capacity);
    for (size_t i = 0; i < list->count; ++i) {
        assert_true(list->ids[i] < count);
        result.unique += !seen[list->ids[i]];
        seen[list->ids[i]] = 1;
    }
    for (size_t i = 0; i < count; ++i) {
        if (!required(packet, &boxes[i]))
            continue;
        ++result.required;
        if (!seen[i])
            fail_msg("box %zu of %zu is missing", i, count);
    }
    return result;
}

static gather_result check_packets(const sgsi_bvh *bvh, const sgsi_bounds *boxes, size_t count,
                                   int packets, float far)
{
    gather_result total = {0};
    sgsi_gather_list list = {0};
    uint8_t *seen = sgsi_calloc(count + 1, 1);
    for (int p = 0; p < packets; ++p) {
        const sgsi_packet packet = make_packet((uint64_t)p,
                                               p % 3 == 0   ? 1e-3
                                               : p % 3 == 1 ? 0.05
                                                            : 0.5,
                                               far);
        const gather_result one = check_gather(bvh, boxes, count, &packet, &list, seen);
        total.required += one.required;
        total.unique += one.unique;
    }
    sgsi_free(list.ids);
    sgsi_free(seen);
    return total;
}

static sgsi_bvh *make_bvh(const sgsi_bounds *boxes, size_t count, sgsi_bvh_quality quality)
{
    sgsi_bvh *bvh;
    assert_int_equal(sgsi_bvh_create(&bvh), SGS_STATUS_OK);
    assert_int_equal(sgsi_bvh_build(bvh, boxes, count, quality), SGS_STATUS_OK);
    return bvh;
}

static void every_crossed_box_is_gathered_at_every_quality(void **state)
{
    (void)state;
    enum { COUNT = 5000 };
    sgsi_bounds *boxes = make_boxes(COUNT, 1);
    for (int quality = SGSI_BVH_LOW; quality < SGSI_BVH_QUALITY_COUNT; ++quality) {
        sgsi_bvh *bvh = make_bvh(boxes, COUNT, (sgsi_bvh_quality)quality);
        const gather_result found = check_packets(bvh, boxes, COUNT, 60, INFINITY);
        print_message("%s: %zu gathered, %zu required\n", quality_names[quality], found.unique,
                      found.required);
        assert_true(found.required > 300);
        // Not all boxes (Embree's refittable trees have leaves of up to seven boxes).
        assert_true(found.unique < (quality == SGSI_BVH_REFIT ? 20 : 3) * found.required);
        sgsi_bvh_destroy(bvh);
    }
    sgsi_free(boxes);
}

// The optimiser moves boxes slightly, the next camera dilates them and an opacity reset shrinks
// them. Refits must also handle boxes that exchange their positions.
static void refitted_trees_gather_every_crossed_box(void **state)
{
    (void)state;
    enum { COUNT = 3000 };
    sgsi_bounds *boxes = make_boxes(COUNT, 2);
    for (int quality = SGSI_BVH_LOW; quality < SGSI_BVH_QUALITY_COUNT; ++quality) {
        fill_boxes(boxes, COUNT, 2, 10, 0.01, 1);
        sgsi_bvh *bvh = make_bvh(boxes, COUNT, (sgsi_bvh_quality)quality);
        for (int round = 0; round < 6; ++round) {
            uint64_t counter = 0;
            const double motion = round < 3 ? 0.01 : round < 5 ? 1 : 0;
            for (size_t i = 0; i < COUNT; ++i)
                for (int k = 0; k < 3; ++k) {
                    const float shift =
                        (float)uniform(70 + (uint64_t)round, &counter, -motion, motion);
                    const float grow = (float)uniform(80 + (uint64_t)round, &counter, -0.004, 0.05);
                    boxes[i].lower[k] += shift - grow;
                    boxes[i].upper[k] += shift + grow;
                }
            if (round == 5) // all boxes move
                fill_boxes(boxes, COUNT, 99, 8, 0.02, 2);
            assert_int_equal(sgsi_bvh_refit(bvh), SGS_STATUS_OK);
            assert_true(check_packets(bvh, boxes, COUNT, 20, INFINITY).required > 100);
        }
        // Rebuilds the same object after refits, with another number of boxes and another quality.
        assert_int_equal(sgsi_bvh_build(bvh, boxes, COUNT / 2, (sgsi_bvh_quality)quality),
                         SGS_STATUS_OK);
        check_packets(bvh, boxes, COUNT / 2, 10, INFINITY);
        assert_int_equal(sgsi_bvh_build(bvh, boxes, COUNT,
                                        (sgsi_bvh_quality)((quality + 1) % SGSI_BVH_QUALITY_COUNT)),
                         SGS_STATUS_OK);
        check_packets(bvh, boxes, COUNT, 10, INFINITY);
        sgsi_bvh_destroy(bvh);
    }
    sgsi_free(boxes);
}

static void small_trees_are_complete(void **state)
{
    (void)state;
    static const size_t counts[] = {0, 1, 2, 3, 4, 5, 8, 9, 15, 16, 17, 33, 64, 100};
    for (int quality = SGSI_BVH_LOW; quality < SGSI_BVH_QUALITY_COUNT; ++quality) {
        for (size_t c = 0; c < sizeof counts / sizeof *counts; ++c) {
            sgsi_bounds *boxes = make_boxes(counts[c], c);
            fill_boxes(boxes, counts[c], c, 4, 1, 8); // large, so that most packets hit some
            sgsi_bvh *bvh = make_bvh(boxes, counts[c], (sgsi_bvh_quality)quality);
            const gather_result built = check_packets(bvh, boxes, counts[c], 12, INFINITY);
            assert_true(built.required > 0 || counts[c] == 0);
            fill_boxes(boxes, counts[c], c + 50, 4, 1, 8);
            assert_int_equal(sgsi_bvh_refit(bvh), SGS_STATUS_OK);
            check_packets(bvh, boxes, counts[c], 12, INFINITY);
            sgsi_bvh_destroy(bvh);
            sgsi_free(boxes);
        }
    }
}

static void no_box_of_a_hundred_thousand_is_lost(void **state)
{
    (void)state;
    enum { COUNT = 100000 };
    sgsi_bounds *boxes = make_boxes(COUNT, 3);
    for (int quality = SGSI_BVH_LOW; quality < SGSI_BVH_QUALITY_COUNT; ++quality) {
        sgsi_bvh *bvh = make_bvh(boxes, COUNT, (sgsi_bvh_quality)quality);
        const gather_result found = check_packets(bvh, boxes, COUNT, 12, INFINITY);
        assert_true(found.required > 1000 &&
                    found.unique < (quality == SGSI_BVH_REFIT ? 20 : 3) * found.required);
        sgsi_bvh_destroy(bvh);
    }
    sgsi_free(boxes);
}

static void far_limits_cull_only_boxes_behind_them(void **state)
{
    (void)state;
    enum { COUNT = 20000 };
    sgsi_bounds *boxes = make_boxes(COUNT, 4);
    sgsi_bvh *bvh = make_bvh(boxes, COUNT, SGSI_BVH_REFIT);
    const gather_result all = check_packets(bvh, boxes, COUNT, 30, INFINITY);
    size_t before = 0;
    static const float limits[] = {0.0f, 0.5f, 2.0f, 8.0f, 30.0f, 1e6f};
    for (size_t i = 0; i < sizeof limits / sizeof *limits; ++i) {
        const gather_result found = check_packets(bvh, boxes, COUNT, 30, limits[i]);
        assert_true(found.unique >= before && found.unique <= all.unique);
        before = found.unique;
        if (limits[i] == 2.0f)
            assert_true(found.unique < all.unique / 2); // the limit reduces work
    }
    assert_int_equal(before, all.unique);
    sgsi_bvh_destroy(bvh);
    sgsi_free(boxes);
}

static void invalid_lanes_gather_nothing(void **state)
{
    (void)state;
    enum { COUNT = 2000 };
    sgsi_bounds *boxes = make_boxes(COUNT, 5);
    sgsi_bvh *bvh = make_bvh(boxes, COUNT, SGSI_BVH_REFIT);
    sgsi_gather_list list = {0};
    uint8_t *seen = sgsi_calloc(COUNT, 1);
    sgsi_packet packet = make_packet(9, 0.5, INFINITY);
    packet.valid = 0;
    assert_int_equal(check_gather(bvh, boxes, COUNT, &packet, &list, seen).unique, 0);
    size_t sum = 0;
    for (int i = 0; i < 16; ++i) {
        packet.valid = 1u << i;
        sum += check_gather(bvh, boxes, COUNT, &packet, &list, seen).unique;
    }
    packet.valid = 0xFFFF;
    const gather_result together = check_gather(bvh, boxes, COUNT, &packet, &list, seen);
    assert_true(together.unique <= sum && together.unique > 0);
    sgsi_free(list.ids);
    sgsi_free(seen);
    sgsi_bvh_destroy(bvh);
    sgsi_free(boxes);
}

// Rays along the axes, on the faces of a grid of touching boxes; the origin is inside a box.
static void axis_aligned_rays_in_a_grid_lose_no_box(void **state)
{
    (void)state;
    enum { SIDE = 12, COUNT = SIDE * SIDE * SIDE };
    sgsi_bounds *boxes = make_boxes(COUNT, 6);
    for (int i = 0; i < COUNT; ++i) {
        const int cell[3] = {i % SIDE, i / SIDE % SIDE, i / SIDE / SIDE};
        for (int k = 0; k < 3; ++k) {
            boxes[i].lower[k] = (float)(cell[k] - SIDE / 2);
            boxes[i].upper[k] = (float)(cell[k] - SIDE / 2 + 1);
        }
    }
    sgsi_bvh *bvh = make_bvh(boxes, COUNT, SGSI_BVH_REFIT);
    sgsi_gather_list list = {0};
    uint8_t *seen = sgsi_calloc(COUNT, 1);
    for (int axis = 0; axis < 6; ++axis) {
        sgsi_packet packet = {.origin = {0.5f, 0.25f, 0.5f}, .valid = 0xFFFF};
        for (int i = 0; i < 16; ++i) {
            packet.direction[axis % 3][i] = axis < 3 ? 1.0f : -1.0f;
            packet.far[i] = INFINITY;
        }
        assert_true(check_gather(bvh, boxes, COUNT, &packet, &list, seen).required >= SIDE / 2);
    }
    sgsi_free(list.ids);
    sgsi_free(seen);
    sgsi_bvh_destroy(bvh);
    sgsi_free(boxes);
}

// A uniform random line: a packet of one ray that starts outside of all boxes.
static sgsi_packet make_line(uint64_t *counter)
{
    enum { SEED = 40 };
    const double radius = 25, turn = uniform(SEED, counter, 0, 6.283185307179586),
                 z = uniform(SEED, counter, -1, 1), across = sqrt(1 - z * z);
    const double d[3] = {across * cos(turn), across * sin(turn), z},
                 e[3] = {-sin(turn), cos(turn), 0}, f[3] = {-z * cos(turn), -z * sin(turn), across};
    const double r = radius * sqrt(uniform(SEED, counter, 0, 1)),
                 a = uniform(SEED, counter, 0, 6.283185307179586);
    sgsi_packet packet = {.valid = 1, .far = {INFINITY}};
    for (int k = 0; k < 3; ++k) {
        packet.origin[k] = (float)(r * (cos(a) * e[k] + sin(a) * f[k]) - 2 * radius * d[k]);
        packet.direction[k][0] = (float)d[k];
    }
    return packet;
}

// Mean number of primitives that a tree reports for lines through the box around all of them.
static double reported_per_line(const sgsi_bvh *bvh, const sgsi_bounds *boxes, size_t count)
{
    enum { LINES = 20000 };
    sgsi_bounds all = boxes[0];
    for (size_t i = 0; i < count; ++i)
        for (int k = 0; k < 3; ++k) {
            all.lower[k] = fminf(all.lower[k], boxes[i].lower[k]);
            all.upper[k] = fmaxf(all.upper[k], boxes[i].upper[k]);
        }
    sgsi_gather_list list = {0};
    uint64_t counter = 0;
    double lines = 0;
    for (int i = 0; i < LINES; ++i) {
        const sgsi_packet packet = make_line(&counter);
        assert_int_equal(sgsi_bvh_gather(bvh, &packet, &list), SGS_STATUS_OK);
        lines += isfinite(entry(&packet, 0, &all));
    }
    const double reported = (double)list.count / lines;
    sgsi_free(list.ids);
    return reported;
}

// The surface-area cost describes the trees of Embree's scenes, also of refitted ones: lines hit
// boxes in proportion to their surface.
static void the_cost_predicts_the_reported_primitives(void **state)
{
    (void)state;
    enum { COUNT = 3000 };
    sgsi_bounds *boxes = make_boxes(COUNT, 12), *moved = make_boxes(COUNT, 12);
    uint64_t counter = 0;
    for (size_t i = 0; i < COUNT; ++i)
        for (int k = 0; k < 3; ++k) {
            const float shift = (float)uniform(41, &counter, -0.5, 0.5);
            moved[i].lower[k] += shift;
            moved[i].upper[k] += shift;
        }
    for (int quality = SGSI_BVH_LOW; quality < SGSI_BVH_QUALITY_COUNT; ++quality) {
        sgsi_bvh_cost cost;
        sgsi_bounds *now = make_boxes(COUNT, 12); // the tree reads the boxes when it is refitted
        sgsi_bvh *bvh = make_bvh(now, COUNT, (sgsi_bvh_quality)quality);
        const bool refits = quality == SGSI_BVH_REFIT;
        for (int round = 0; round < 1 + refits; ++round) {
            memcpy(now, round ? moved : boxes, COUNT * sizeof *now);
            assert_int_equal(sgsi_bvh_refit(bvh), SGS_STATUS_OK);
            assert_int_equal(
                sgsi_bvh_cost_measure(boxes, now, COUNT, (sgsi_bvh_quality)quality, NULL, &cost),
                SGS_STATUS_OK);
            const double reported = reported_per_line(bvh, now, COUNT);
            print_message("%s%s: %.2f primitives per line, %.2f expected, cost %.2f\n",
                          quality_names[quality], round ? ", refitted" : "", reported,
                          cost.primitives, cost.cost);
            assert_true(fabs(reported / cost.primitives - 1) < 0.05);
            assert_true(cost.cost > cost.primitives + 1);
        }
        sgsi_bvh_destroy(bvh);
        sgsi_free(now);
    }
    sgsi_free(boxes);
    sgsi_free(moved);
}

static void failed_list_growth_is_reported_and_list_stays_usable(void **state)
{
    (void)state;
    enum { COUNT = 30000 };
    sgsi_bounds *boxes = make_boxes(COUNT, 7);
    fill_boxes(boxes, COUNT, 7, 1, 4, 8); // all overlap: exceeds the initial capacity of the list
    sgsi_bvh *bvh = make_bvh(boxes, COUNT, SGSI_BVH_REFIT);
    sgsi_gather_list list = {0};
    const sgsi_packet packet = make_packet(1, 0.1, INFINITY);
    for (size_t n = 1; n <= 3; ++n) {
        list.count = 0;
        sgsi_free(list.ids);
        list = (sgsi_gather_list){0};
        sgsi_fail_allocation(n);
        assert_int_equal(sgsi_bvh_gather(bvh, &packet, &list), SGS_STATUS_OUT_OF_MEMORY);
        sgsi_fail_allocation(0);
        assert_true(list.count <= list.capacity);
    }
    list.count = 0;
    assert_int_equal(sgsi_bvh_gather(bvh, &packet, &list), SGS_STATUS_OK);
    assert_true(list.count >= COUNT);
    sgsi_free(list.ids);
    sgsi_bvh_destroy(bvh);
    sgsi_free(boxes);
}

// The linker replaces Embree's functions by these (tests/CMakeLists.txt). Without an Embree header:
// only bvh/ includes them, and all arguments are pointers and an enumeration.
static bool device_fails, scene_fails, geometry_fails;
static int device_error;

// NOLINTBEGIN(bugprone-reserved-identifier,cert-dcl*): names of the linker
void *__real_rtcNewDevice(const char *config);
int __real_rtcGetDeviceError(void *device);
void *__real_rtcNewScene(void *device);
void *__real_rtcNewGeometry(void *device, int type);
void *__wrap_rtcNewDevice(const char *config);
int __wrap_rtcGetDeviceError(void *device);
void *__wrap_rtcNewScene(void *device);
void *__wrap_rtcNewGeometry(void *device, int type);

static char device_config[64];

void *__wrap_rtcNewDevice(const char *config)
{
    snprintf(device_config, sizeof device_config, "%s", config);
    return device_fails ? NULL : __real_rtcNewDevice(config);
}

int __wrap_rtcGetDeviceError(void *device)
{
    return device_fails ? device_error : __real_rtcGetDeviceError(device);
}

void *__wrap_rtcNewScene(void *device)
{
    return scene_fails ? NULL : __real_rtcNewScene(device);
}

void *__wrap_rtcNewGeometry(void *device, int type)
{
    return geometry_fails ? NULL : __real_rtcNewGeometry(device, type);
}
// NOLINTEND(bugprone-reserved-identifier,cert-dcl*)

static void a_missing_device_reports_the_reason(void **state)
{
    (void)state;
    enum { NONE = 0, OUT_OF_MEMORY = 4, UNSUPPORTED_CPU = 5 }; // RTC_ERROR_*
    sgsi_bvh *bvh;
    const sgsi_bounds box = {.upper = {1, 1, 1}};
    sgsi_bvh_cost cost = {.cost = 1};
    device_fails = true;
    device_error = OUT_OF_MEMORY;
    assert_int_equal(sgsi_bvh_create(&bvh), SGS_STATUS_OUT_OF_MEMORY);
    assert_string_equal(sgs_last_error(), "Embree ran out of memory while creating a device");
    assert_null(bvh);
    device_error = NONE;
    assert_int_equal(sgsi_bvh_create(&bvh), SGS_STATUS_INTERNAL);
    assert_string_equal(sgs_last_error(), "Embree failed while creating a device");
    device_error = UNSUPPORTED_CPU;
    assert_int_equal(sgsi_bvh_create(&bvh), SGS_STATUS_UNSUPPORTED);
    assert_int_equal(sgsi_bvh_cost_measure(&box, &box, 1, SGSI_BVH_LOW, NULL, &cost),
                     SGS_STATUS_UNSUPPORTED);
    assert_string_equal(sgs_last_error(), "Embree does not support this processor");
    assert_true(cost.cost == 0);
    device_fails = false;
    assert_int_equal(sgsi_bvh_create(&bvh), SGS_STATUS_OK);
    sgsi_bvh_destroy(bvh);
}

// TBB's threads are those of the whole process, and a host program may use them, too.
static void a_device_limits_no_other_user_of_tbb(void **state)
{
    (void)state;
    const int before = task_count(0), cores = sgsi_affine_cores();
    assert_true(cores > 0);
    for (int threads = 1; threads <= cores + 3; ++threads) {
        int allowed, joined;
        sgsi_bvh *bvh;
        sgsi_bounds *boxes = make_boxes(20000, 3);
        sgsi_threads_set(threads);
        assert_int_equal(sgsi_bvh_create(&bvh), SGS_STATUS_OK);
        assert_int_equal(sscanf(device_config, "threads=%d,user_threads=%d", &allowed, &joined), 2);
        assert_int_equal(allowed, threads > cores ? threads : cores);
        assert_int_equal(joined, allowed); // no slot is left for a worker of TBB
        for (int k = 0; k < SGSI_BVH_QUALITY_COUNT; ++k)
            assert_int_equal(sgsi_bvh_build(bvh, boxes, 20000, (sgsi_bvh_quality)k), SGS_STATUS_OK);
        assert_int_equal(task_count(0), before + threads - 1);
        sgsi_bvh_destroy(bvh);
        sgsi_free(boxes);
    }
    sgsi_threads_set(0);
}

// Embree stores no error here.
static void a_missing_scene_or_geometry_fails_the_build_only(void **state)
{
    (void)state;
    enum { COUNT = 500 };
    sgsi_bounds *boxes = make_boxes(COUNT, 10);
    sgsi_bvh *bvh;
    assert_int_equal(sgsi_bvh_create(&bvh), SGS_STATUS_OK);
    for (int missing = 1; missing <= 3; ++missing) {
        scene_fails = missing & 1;
        geometry_fails = missing & 2;
        for (int again = 0; again < 2; ++again)
            assert_int_equal(sgsi_bvh_build(bvh, boxes, COUNT, SGSI_BVH_REFIT),
                             SGS_STATUS_INTERNAL);
        assert_string_equal(sgs_last_error(), "Embree failed while creating a scene");
        scene_fails = geometry_fails = false;
        assert_int_equal(sgsi_bvh_build(bvh, boxes, COUNT, SGSI_BVH_REFIT), SGS_STATUS_OK);
        check_packets(bvh, boxes, COUNT, 10, INFINITY);
    }
    sgsi_bvh_destroy(bvh);
    sgsi_free(boxes);
}

// Embree asserts that the boxes of a small scene have a size.
static void few_boxes_at_one_point_are_built_and_refitted(void **state)
{
    (void)state;
    static const float places[] = {0, 1e-20f, -3, 1e18f};
    for (size_t count = 1; count <= 10; ++count)
        for (int k = 0; k < 4 * SGSI_BVH_QUALITY_COUNT; ++k) {
            sgsi_bounds boxes[10];
            sgsi_bvh *bvh;
            memset(boxes, 0, sizeof boxes);
            for (size_t i = 0; i < count; ++i)
                for (int axis = 0; axis < 3; ++axis)
                    boxes[i].lower[axis] = boxes[i].upper[axis] = places[k % 4];
            assert_int_equal(sgsi_bvh_create(&bvh), SGS_STATUS_OK);
            assert_int_equal(sgsi_bvh_build(bvh, boxes, count, (sgsi_bvh_quality)(k / 4)),
                             SGS_STATUS_OK);
            assert_int_equal(sgsi_bvh_refit(bvh), SGS_STATUS_OK);
            sgsi_bvh_destroy(bvh);
        }
}

// A refit of the missing tree would crash.
static void a_rendering_after_a_failed_build_builds_again(void **state)
{
    (void)state;
    const sgs_camera camera = {SGS_CAMERA_PINHOLE, 20, 10, {20, 20, 10, 5}};
    const sgs_pose pose = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 4}};
    sgs_gaussians *model;
    sgs_renderer *renderer;
    sgs_frame plain, counted;
    assert_int_equal(sgs_gaussians_create(3, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, 3), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_create(model, &renderer), SGS_STATUS_OK);
    assert_int_equal(sgs_frame_create_with(20, 10, 0, &plain), SGS_STATUS_OK);
    assert_int_equal(sgs_frame_create_with(20, 10, SGS_AOV_CANDIDATES, &counted), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_render(renderer, &camera, &pose, NULL, &plain), SGS_STATUS_OK);
    geometry_fails = true; // of the tree that the number of candidates requires
    assert_int_equal(sgs_renderer_render(renderer, &camera, &pose, NULL, &counted),
                     SGS_STATUS_INTERNAL);
    geometry_fails = false;
    assert_int_equal(sgs_renderer_render(renderer, &camera, &pose, NULL, &plain), SGS_STATUS_OK);
    sgs_frame_free(&plain);
    sgs_frame_free(&counted);
    sgs_renderer_destroy(renderer);
    sgs_gaussians_destroy(model);
}

// Includes the first refit: Embree rebuilds a geometry that becomes refittable after its first
// commit.
static void every_refit_is_cheaper_than_a_build(void **state)
{
    (void)state;
    enum { COUNT = 200000 };
    sgsi_bounds *boxes = make_boxes(COUNT, 9);
    sgsi_bvh *bvh = make_bvh(boxes, COUNT, SGSI_BVH_REFIT);
    double build = INFINITY, first = INFINITY, second = INFINITY;
    for (int run = 0; run < 5; ++run) { // best time of five: other programs may interfere
        double *const best[] = {&build, &first, &second};
        for (int k = 0; k < 3; ++k) {
            const double start = sgsi_seconds();
            assert_int_equal(k ? sgsi_bvh_refit(bvh)
                               : sgsi_bvh_build(bvh, boxes, COUNT, SGSI_BVH_REFIT),
                             SGS_STATUS_OK);
            *best[k] = fmin(*best[k], sgsi_seconds() - start);
        }
    }
    print_message("build %.4f s, first refit %.4f s, second refit %.4f s\n", build, first, second);
    assert_true(first < 0.6 * build);
    assert_true(second < 0.6 * build);
    sgsi_bvh_destroy(bvh);
    sgsi_free(boxes);
}

static void memory_use_is_counted(void **state)
{
    (void)state;
    enum { COUNT = 50000 };
    sgsi_bounds *boxes = make_boxes(COUNT, 8);
    sgsi_bvh *bvh = make_bvh(boxes, COUNT, SGSI_BVH_REFIT);
    const size_t bytes = sgsi_bvh_bytes();
    print_message("%s: %.0f bytes per box\n", sgsi_bvh_version(), (double)bytes / COUNT);
    assert_true(bytes > 16 * (size_t)COUNT && bytes < 1000 * (size_t)COUNT);
    sgsi_bvh_destroy(bvh);
    sgsi_bvh_destroy(NULL);
    sgsi_free(boxes);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_device_limits_no_other_user_of_tbb), // first: there is no team yet
        cmocka_unit_test(every_crossed_box_is_gathered_at_every_quality),
        cmocka_unit_test(refitted_trees_gather_every_crossed_box),
        cmocka_unit_test(small_trees_are_complete),
        cmocka_unit_test(no_box_of_a_hundred_thousand_is_lost),
        cmocka_unit_test(far_limits_cull_only_boxes_behind_them),
        cmocka_unit_test(invalid_lanes_gather_nothing),
        cmocka_unit_test(axis_aligned_rays_in_a_grid_lose_no_box),
        cmocka_unit_test(the_cost_predicts_the_reported_primitives),
        cmocka_unit_test(failed_list_growth_is_reported_and_list_stays_usable),
        cmocka_unit_test(a_missing_device_reports_the_reason),
        cmocka_unit_test(a_missing_scene_or_geometry_fails_the_build_only),
        cmocka_unit_test(few_boxes_at_one_point_are_built_and_refitted),
        cmocka_unit_test(a_rendering_after_a_failed_build_builds_again),
        cmocka_unit_test(every_refit_is_cheaper_than_a_build),
        cmocka_unit_test(memory_use_is_counted),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
