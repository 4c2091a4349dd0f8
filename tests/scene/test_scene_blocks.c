// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Blocks of a scene: every point belongs to exactly one, faces and distant points included; the
// work is balanced; the views are those with enough of their points, by an independent count. Views
// that are not kept count for the extent and the digest of a scene.

#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "base/core.h"
#include "sparegs/blocks.h"

enum { VIEWS = 60, POINTS = 4000, SIZE = 64, FOCAL = 60 };

static sgs_scene *scene;

static double uniform(uint64_t stream, size_t i)
{
    return sgsi_random_uniform(stream, i);
}

// A strip along x, photographed from above and from all sides, with denser points on one half.
static int make_strip(void **state)
{
    (void)state;
    static uint8_t pixels[SIZE * SIZE * 3];
    static sgs_view_source views[VIEWS];
    static float points[3 * POINTS];
    for (size_t i = 0; i < POINTS; ++i) {
        const double u = uniform(1, i);
        points[3 * i] = (float)(10 * (i % 3 ? 0.5 * u : u));
        points[3 * i + 1] = (float)(3 * uniform(2, i));
        points[3 * i + 2] = (float)(uniform(3, i));
    }
    for (size_t v = 0; v < VIEWS; ++v) {
        const double angle = 6.28 * uniform(6, v), c = cos(angle), s = sin(angle);
        const double center[3] = {10 * uniform(4, v), 3 * uniform(5, v), -2};
        sgs_view_source *view = &views[v];
        *view = (sgs_view_source){.channels = 3, .pixels = pixels};
        view->camera = (sgs_camera){.model = SGS_CAMERA_PINHOLE, .width = SIZE, .height = SIZE};
        const double params[] = {FOCAL, FOCAL, SIZE / 2.0, SIZE / 2.0};
        memcpy(view->camera.params, params, sizeof params);
        const double rotation[9] = {c, s, 0, -s, c, 0, 0, 0, 1};
        memcpy(view->pose.rotation, rotation, sizeof rotation);
        for (int r = 0; r < 3; ++r)
            for (int k = 0; k < 3; ++k)
                view->pose.translation[r] -= rotation[3 * r + k] * center[k];
    }
    return sgs_scene_create(views, VIEWS, points, NULL, POINTS, NULL, &scene) != SGS_STATUS_OK;
}

static int free_strip(void **state)
{
    (void)state;
    sgs_scene_destroy(scene);
    return 0;
}

static sgs_blocks plan(int count)
{
    sgs_block_options options = sgs_block_options_default();
    options.count = count;
    sgs_blocks blocks;
    if (sgs_blocks_plan(scene, &options, &blocks))
        fail_msg("%s", sgs_last_error());
    assert_int_equal(blocks.count, count);
    return blocks;
}

static void assert_one_owner(const sgs_blocks *blocks, const float point[3])
{
    size_t owners = 0;
    for (size_t b = 0; b < blocks->count; ++b)
        owners += sgs_box_contains(&blocks->blocks[b].box, point);
    if (owners != 1)
        fail_msg("(%.9g, %.9g, %.9g) has %zu owners", (double)point[0], (double)point[1],
                 (double)point[2], owners);
}

static void every_point_has_exactly_one_owner(void **state)
{
    (void)state;
    static const int counts[] = {2, 3, 4, 7, 16};
    for (size_t k = 0; k < sizeof counts / sizeof *counts; ++k) {
        sgs_blocks blocks = plan(counts[k]);
        // Every face of every box, exactly, and one unit in the last place beside it.
        for (size_t b = 0; b < blocks.count; ++b)
            for (int face = 0; face < 6; ++face) {
                const sgs_box *box = &blocks.blocks[b].box;
                const float x = face < 3 ? box->low[face] : box->high[face - 3];
                if (isinf(x))
                    continue;
                for (size_t i = 0; i < 300; ++i) {
                    float point[3];
                    for (size_t c = 0; c < 3; ++c)
                        point[c] = (float)(40 * uniform(7, 3 * i + c) - 20);
                    const float around[] = {nextafterf(x, -FLT_MAX), x, nextafterf(x, FLT_MAX)};
                    point[face % 3] = around[i % 3];
                    assert_one_owner(&blocks, point);
                }
            }
        size_t owned = 0;
        for (size_t i = 0; i < POINTS; ++i)
            assert_one_owner(&blocks, scene->points + 3 * i);
        for (size_t b = 0; b < blocks.count; ++b)
            owned += blocks.blocks[b].points;
        assert_int_equal(owned, POINTS);
        static const float far[3] = {-FLT_MAX, FLT_MAX, 0};
        for (size_t i = 0; i < 27; ++i) {
            const float point[3] = {far[i % 3], far[i / 3 % 3], far[i / 9]};
            assert_one_owner(&blocks, point);
        }
        sgs_blocks_free(&blocks);
    }
}

static void work_is_balanced(void **state)
{
    (void)state;
    for (int count = 2; count <= 4; ++count) {
        sgs_blocks blocks = plan(count);
        double work[4], mean = 0;
        for (size_t b = 0; b < blocks.count; ++b) {
            size_t cameras = 0;
            for (size_t v = 0; v < scene->view_count; ++v) {
                double center[3];
                sgs_pose_center(&scene->views[v].pose, center);
                const float at[3] = {(float)center[0], (float)center[1], (float)center[2]};
                cameras += sgs_box_contains(&blocks.blocks[b].box, at);
            }
            work[b] = sqrt((double)cameras * (double)blocks.blocks[b].points);
            mean += work[b] / count;
        }
        // A camera more or less is 4 % of the views of a quarter.
        for (size_t b = 0; b < blocks.count; ++b)
            if (!(fabs(work[b] - mean) <= 0.12 * mean))
                fail_msg("block %zu of %d: work %g, mean %g", b, count, work[b], mean);
        // Across the long side first.
        assert_true(isfinite(blocks.blocks[0].box.high[0]));
        sgs_blocks_free(&blocks);
    }
}

// Pinhole by hand; lines of sight sampled densely; the cells grow by a fifth of their side within
// the box of the cameras.
static void a_quarter_of_the_lines_of_sight_pass_the_grown_cell(void **state)
{
    (void)state;
    double low[3] = {1e9, 1e9, 1e9}, high[3] = {-1e9, -1e9, -1e9};
    for (size_t v = 0; v < VIEWS; ++v) {
        double center[3];
        sgs_pose_center(&scene->views[v].pose, center);
        for (int k = 0; k < 3; ++k) {
            low[k] = fmin(low[k], (float)center[k]);
            high[k] = fmax(high[k], (float)center[k]);
        }
    }
    sgs_blocks blocks;
    sgs_block_options options = sgs_block_options_default();
    options.count = 3;
    options.share = 0.25;
    assert_int_equal(sgs_blocks_plan(scene, &options, &blocks), SGS_STATUS_OK);
    size_t members = 0;
    for (size_t b = 0; b < blocks.count; ++b) {
        const sgs_block *block = &blocks.blocks[b];
        for (size_t v = 0; v < VIEWS; ++v) {
            size_t seen = 0, inside = 0;
            const sgs_pose *pose = &scene->views[v].pose;
            for (size_t i = 0; i < POINTS; ++i) {
                const float *p = scene->points + 3 * i;
                double c[3];
                for (int r = 0; r < 3; ++r)
                    c[r] = pose->rotation[3 * r] * p[0] + pose->rotation[3 * r + 1] * p[1] +
                           pose->rotation[3 * r + 2] * p[2] + pose->translation[r];
                const double x = FOCAL * c[0] / c[2] + SIZE / 2.0,
                             y = FOCAL * c[1] / c[2] + SIZE / 2.0;
                if (!(x >= 0 && x < SIZE && y >= 0 && y < SIZE))
                    continue;
                ++seen;
                double eye[3];
                sgs_pose_center(pose, eye);
                bool in = false;
                for (int step = 0; step <= 200 && !in; ++step) {
                    in = true;
                    for (int k = 0; k < 3; ++k) {
                        const double x_k = eye[k] + (p[k] - eye[k]) * step / 200.0,
                                     a = fmax(low[k], (double)block->box.low[k]),
                                     e = fmin(high[k], (double)block->box.high[k]),
                                     margin = 0.2 * (e - a);
                        in = in && x_k >= (double)block->box.low[k] - margin &&
                             x_k < (double)block->box.high[k] + margin;
                    }
                }
                inside += in;
            }
            bool member = false;
            for (size_t m = 0; m < block->view_count; ++m)
                member = member || block->views[m] == v;
            members += member;
            const double share = (double)inside / (double)seen;
            if (!(fabs(share - 0.25) <= 5e-3) && member != (share >= 0.25))
                fail_msg("view %zu, block %zu: share %g, member %d", v, b, share, member);
        }
    }
    assert_true(members > VIEWS && members < 2 * VIEWS); // some in two, none in all
    sgs_blocks_free(&blocks);
}

// A scene of so many points that every third one is used. Those have x < 5, all others x > 5. The
// cameras stand in a line and look along z.
static sgs_scene many_points(void)
{
    const size_t count = 2 * SGS_BLOCKS_MAX_SIGHT_LINES + 1;
    sgs_scene many = *scene;
    many.point_count = count;
    many.points = malloc(3 * count * sizeof *many.points);
    for (size_t i = 0; i < count; ++i) {
        many.points[3 * i] = (float)(5 * uniform(21, i) + (i % 3 ? 5.01 : 0));
        many.points[3 * i + 1] = (float)(3 * uniform(22, i));
        many.points[3 * i + 2] = (float)uniform(23, i);
    }
    many.views = malloc(VIEWS * sizeof *many.views);
    for (size_t v = 0; v < VIEWS; ++v) {
        many.views[v] = scene->views[v];
        many.views[v].pose = (sgs_pose){.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                                        .translation = {-10.0 * (double)v / VIEWS, -1.5, 2}};
    }
    return many;
}

static bool is_member(const sgs_block *block, size_t view)
{
    for (size_t m = 0; m < block->view_count; ++m)
        if (block->views[m] == view)
            return true;
    return false;
}

// Number of every `step`-th point in the image of a view with x in [low, high), pinhole by hand.
static size_t points_in_image(const sgs_scene *of, size_t v, size_t step, float low, float high)
{
    size_t seen = 0;
    const double *t = of->views[v].pose.translation;
    for (size_t i = 0; i < of->point_count; i += step) {
        const float *p = of->points + 3 * i;
        const double z = p[2] + t[2], x = FOCAL * (p[0] + t[0]) / z + SIZE / 2.0,
                     y = FOCAL * (p[1] + t[1]) / z + SIZE / 2.0;
        seen += x >= 0 && x < SIZE && y >= 0 && y < SIZE && p[0] >= low && p[0] < high;
    }
    return seen;
}

// Where every third point decides, views on the left see none of the right; where there is no third
// point, all of them decide.
static void of_many_points_every_kth_one_is_a_line_of_sight(void **state)
{
    (void)state;
    sgs_scene many = many_points();
    sgs_block_options options = sgs_block_options_default();
    options.share = 0.02;
    options.margin = 0.0;
    sgs_blocks blocks;
    if (sgs_blocks_plan(&many, &options, &blocks))
        fail_msg("%s", sgs_last_error());
    const float plane = blocks.blocks[0].box.high[0];
    size_t by_thirds = 0, by_all = 0;
    assert_true(plane > 5.1f && plane < 8.0f);
    for (size_t v = 0; v < VIEWS; ++v) {
        const bool on_left = -many.views[v].pose.translation[0] < (double)plane;
        const size_t thirds = points_in_image(&many, v, 3, -INFINITY, INFINITY),
                     left = points_in_image(&many, v, 1, -INFINITY, plane),
                     right = points_in_image(&many, v, 1, plane, INFINITY);
        if (on_left && thirds && right > (left + right) / 20) {
            assert_true(is_member(&blocks.blocks[0], v) && !is_member(&blocks.blocks[1], v));
            ++by_thirds;
        }
        if (!on_left && !thirds && left > (left + right) / 20) {
            assert_true(is_member(&blocks.blocks[0], v) && is_member(&blocks.blocks[1], v));
            ++by_all;
        }
    }
    assert_true(by_thirds > 0 && by_all > 0);
    assert_int_equal(blocks.blocks[0].points + blocks.blocks[1].points, many.point_count);
    sgs_blocks_free(&blocks);
    free(many.points);
    free(many.views);
}

static size_t views_planned;
static bool count_views(void *user, size_t done, size_t total)
{
    assert_true(done == ++views_planned && total == VIEWS);
    return done < *(const size_t *)user;
}

static void planning_reports_every_view_and_can_be_cancelled(void **state)
{
    (void)state;
    sgs_blocks blocks;
    sgs_block_options options = sgs_block_options_default();
    size_t limit = SIZE_MAX;
    options.progress = count_views;
    options.progress_user = &limit;
    views_planned = 0;
    assert_int_equal(sgs_blocks_plan(scene, &options, &blocks), SGS_STATUS_OK);
    assert_int_equal(views_planned, VIEWS);
    sgs_blocks_free(&blocks);
    limit = 5;
    views_planned = 0;
    assert_int_equal(sgs_blocks_plan(scene, &options, &blocks), SGS_STATUS_CANCELLED);
    assert_int_equal(views_planned, 5);
    assert_null(blocks.blocks);
}

static void impossible_plans_are_refused(void **state)
{
    (void)state;
    sgs_blocks blocks;
    sgs_block_options options = sgs_block_options_default();
    options.count = 1;
    assert_int_equal(sgs_blocks_plan(scene, &options, &blocks), SGS_STATUS_INVALID_ARGUMENT);
    assert_string_equal(sgs_last_error(), "the number of blocks must be 2 to 256");
    options = sgs_block_options_default();
    options.share = NAN;
    assert_int_equal(sgs_blocks_plan(scene, &options, &blocks), SGS_STATUS_INVALID_ARGUMENT);
    sgs_scene bare = *scene;
    bare.point_count = 0;
    assert_int_equal(sgs_blocks_plan(&bare, NULL, &blocks), SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "blocks require sparse points"));
    bare.point_count = 3;
    options = sgs_block_options_default();
    options.count = 8;
    assert_int_equal(sgs_blocks_plan(&bare, &options, &blocks), SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "choose fewer blocks than 8"));
    assert_null(blocks.blocks);
}

static void views_that_are_not_kept_count_for_the_scene(void **state)
{
    (void)state;
    sgs_scene *whole, *part;
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 16;
    options.test_every = 8;
    assert_int_equal(sgs_scene_load(SGSI_TEST_DATA "/room", &options, &whole), SGS_STATUS_OK);
    const char *names[] = {whole->views[9].name, "none.png", whole->views[8].name,
                           whole->views[3].name};
    for (int limited = 0; limited < 2; ++limited) {
        options.kept = names;
        options.kept_count = 4;
        options.image_cache = limited ? 1 : 0;
        assert_int_equal(sgs_scene_load(SGSI_TEST_DATA "/room", &options, &part), SGS_STATUS_OK);
        assert_int_equal(part->view_count, 3);
        static const size_t indices[] = {3, 8, 9};
        for (size_t i = 0; i < 3; ++i) {
            const sgs_view *view = &whole->views[indices[i]];
            const sgs_photo *photo;
            assert_string_equal(part->views[i].name, view->name);
            assert_int_equal(part->views[i].split, view->split);
            assert_int_equal(sgs_scene_photo(part, i, &photo), SGS_STATUS_OK);
            assert_memory_equal(photo->pixels, view->image.pixels,
                                3 * (size_t)photo->width * (size_t)photo->height);
        }
        assert_true(part->extent == whole->extent && part->digest == whole->digest);
        assert_memory_equal(part->center, whole->center, sizeof part->center);
        assert_true(part->photo_bytes * 10 < whole->photo_bytes);
        sgs_scene_destroy(part);
    }
    options.kept_count = 0;
    assert_int_equal(sgs_scene_load(SGSI_TEST_DATA "/room", &options, &part),
                     SGS_STATUS_INVALID_ARGUMENT);
    options = sgs_scene_options_default();
    options.cameras_only = true;
    options.load_images = false;
    assert_int_equal(sgs_scene_load(SGSI_TEST_DATA "/room", &options, &part), SGS_STATUS_OK);
    assert_true(part->digest == whole->digest && part->digest != scene->digest);
    sgs_scene_destroy(part);
    sgs_scene_destroy(whole);
}

static void the_nearest_finite_face_of_a_box_counts(void **state)
{
    (void)state;
    sgs_box box = sgs_box_infinite();
    const float point[3] = {1, -2, 0.5f};
    assert_true(sgs_box_is_infinite(&box));
    assert_true(isinf(sgs_box_face_distance(&box, point)));
    static const float low[3] = {-1, -10, -0.25f}, high[3] = {1.5f, -1.75f, 8};
    for (int k = 0; k < 6; ++k) { // one face
        sgs_box one = sgs_box_infinite();
        *(k < 3 ? &one.low[k] : &one.high[k - 3]) = k < 3 ? low[k] : high[k - 3];
        assert_false(sgs_box_is_infinite(&one));
        const float expected = k < 3 ? point[k] - low[k] : high[k - 3] - point[k - 3];
        assert_true(sgs_box_face_distance(&one, point) == expected);
    }
    memcpy(box.low, low, sizeof low);
    memcpy(box.high, high, sizeof high);
    assert_true(sgs_box_face_distance(&box, point) == 0.25f); // to the upper face in y
    assert_true(sgs_box_face_distance(&box, low) == 0);
    // Infinite on the wrong side is not infinite.
    box = sgs_box_infinite();
    box.low[2] = INFINITY;
    assert_false(sgs_box_is_infinite(&box));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_nearest_finite_face_of_a_box_counts),
        cmocka_unit_test(every_point_has_exactly_one_owner),
        cmocka_unit_test(work_is_balanced),
        cmocka_unit_test(a_quarter_of_the_lines_of_sight_pass_the_grown_cell),
        cmocka_unit_test(of_many_points_every_kth_one_is_a_line_of_sight),
        cmocka_unit_test(planning_reports_every_view_and_can_be_cancelled),
        cmocka_unit_test(impossible_plans_are_refused),
        cmocka_unit_test(views_that_are_not_kept_count_for_the_scene),
    };
    return cmocka_run_group_tests(tests, make_strip, free_strip);
}
