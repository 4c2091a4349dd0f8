// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The division of rows among ranks: owners and places, lengths of messages, cones of cells, and
// the lists of records that ranks send each other. Every primitive that a ray of a rank's cells
// hits, by the formula of its response in double precision, is in the list of that rank, for all
// lenses and cuts; few others are.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/core.h"
#include "cluster/cut.h"
#include "cluster/shards.h"
#include "train/shard_routes.h"

enum { ROWS = 400, MAX_RANKS = 70 };

// ---- Owners and messages ----

static void places_are_dense_and_ascend(void **state)
{
    (void)state;
    static const size_t sizes[] = {0, 1, 15, 255, 256, 257, 3000, 5120, 10241};
    for (size_t s = 0; s < sizeof sizes / sizeof *sizes; ++s)
        for (int ranks = 1; ranks <= 7; ++ranks) {
            size_t owned[7] = {0};
            for (size_t row = 0; row < sizes[s]; ++row) {
                const int owner = sgsi_shard_owner(row, ranks);
                assert_in_range(owner, 0, ranks - 1);
                assert_int_equal(sgsi_shard_place(row, ranks), owned[owner]);
                assert_int_equal(sgsi_shard_row(owned[owner]++, owner, ranks), row);
            }
            for (int r = 0; r < ranks; ++r)
                assert_int_equal(sgsi_shard_count(sizes[s], r, ranks), owned[r]);
        }
}

static void lengths_of_messages_give_their_items(void **state)
{
    (void)state;
    static const size_t items[] = {SGSI_SHARD_RECORD, SGSI_SHARD_SUM};
    for (size_t k = 0; k < 2; ++k)
        for (size_t count = 0; count < 1000; ++count) {
            const size_t bytes = sgsi_shard_bytes(count, items[k]);
            assert_true(bytes % 64 == 0 && bytes >= count * items[k]);
            assert_int_equal(sgsi_shard_items(bytes, items[k]), count);
        }
}

static void lists_hold_the_rows_of_each_rank(void **state)
{
    (void)state;
    enum { MANY = 9000 };
    uint64_t *found = calloc(2 * MANY, sizeof *found);
    sgsi_send_lists lists = {0};
    for (int ranks = 1; ranks <= MAX_RANKS; ranks += 23) {
        const size_t words = ((size_t)ranks + 63) / 64;
        for (size_t i = 0; i < MANY; ++i)
            for (size_t w = 0; w < words; ++w) {
                const size_t bits = (size_t)ranks - 64 * w < 64 ? (size_t)ranks - 64 * w : 64;
                found[i * words + w] = sgsi_random_bits((uint64_t)ranks, 2 * i + w) &
                                       sgsi_random_bits(7, 2 * i + w) &
                                       (bits < 64 ? ((uint64_t)1 << bits) - 1 : UINT64_MAX);
            }
        assert_int_equal(sgsi_send_lists_make(&lists, found, MANY, ranks), SGS_STATUS_OK);
        size_t at = 0;
        for (int r = 0; r < ranks; ++r) {
            assert_int_equal(lists.begin[r], at);
            for (size_t i = 0; i < MANY; ++i)
                if (found[i * words + (size_t)r / 64] >> (r % 64) & 1)
                    assert_int_equal(lists.places[at++], i);
        }
        assert_int_equal(lists.begin[ranks], at);
    }
    sgsi_send_lists_free(&lists);
    free(found);
}

// ---- Records ----

static const sgs_camera lenses[] = {
    {SGS_CAMERA_PINHOLE, 640, 480, {500, 510, 300, 250}},
    {SGS_CAMERA_PINHOLE, 640, 480, {90000, 90000, 320, 240}},
    {SGS_CAMERA_SIMPLE_RADIAL, 640, 480, {400, 320, 240, -0.14}},
    {SGS_CAMERA_RADIAL, 640, 480, {400, 330, 235, -0.31, 0.12}},
    {SGS_CAMERA_OPENCV, 640, 480, {500, 500, 320, 240, -0.1, 0.05, 0.02, -0.03}},
    {SGS_CAMERA_OPENCV_FISHEYE, 1024, 1024, {300, 300, 512, 512, 0.02, -0.004, 0.001, 0}},
    {SGS_CAMERA_FULL_OPENCV,
     1280,
     720,
     {610, 610, 640, 360, 0.6, -2.5, 8e-4, -4e-4, 1.4, 0.5, -2.3, 1.35}},
    {SGS_CAMERA_FOV, 752, 480, {350, 352, 370, 245, 0.92}},
    {SGS_CAMERA_SIMPLE_RADIAL_FISHEYE, 1000, 1000, {260, 500, 500, -0.01}},
    {SGS_CAMERA_RADIAL_FISHEYE, 1000, 800, {400, 510, 390, -0.05, 0.01}},
    {SGS_CAMERA_THIN_PRISM_FISHEYE,
     1000,
     700,
     {450, 452, 500, 350, 0.03, -0.02, 2e-3, -1e-3, 0.01, -0.001, 3e-3, -2e-3}},
};

// Primitives on rays through random pixels, also behind the camera, around it and off the image;
// flat ones and needles, small and large.
static sgs_gaussians *scatter(const sgs_camera *camera, const sgs_pose *pose, uint64_t seed)
{
    sgs_gaussians *model;
    double center[3];
    assert_int_equal(sgs_gaussians_create(ROWS, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, ROWS), SGS_STATUS_OK);
    sgs_pose_center(pose, center);
    for (uint64_t i = 0; i < ROWS; ++i) {
        float p[SGS_PARAM_COUNT] = {0};
        double d[3] = {0, 0, 1};
        const double pixel[2] = {camera->width * (1.2 * sgsi_random_uniform(seed, 20 * i) - 0.1),
                                 camera->height *
                                     (1.2 * sgsi_random_uniform(seed, 20 * i + 1) - 0.1)};
        const double distance = exp(2.0 * sgsi_random_normal(seed, 20 * i + 2));
        sgs_camera_unproject(camera, pixel, d);
        for (int k = 0; k < 3; ++k) {
            p[SGS_PARAM_MEAN + k] =
                (float)(center[k] + (i % 16 ? 1.0 : -1.0) * distance *
                                        (pose->rotation[k] * d[0] + pose->rotation[3 + k] * d[1] +
                                         pose->rotation[6 + k] * d[2]));
            // A footprint of 1 to 100 pixels; some contain the camera.
            const double focal = camera->params[0];
            p[SGS_PARAM_SCALE + k] =
                (float)(log(distance / focal) +
                        5.0 * sgsi_random_uniform(seed, 20 * i + 3 + (uint64_t)k) - 1.0 +
                        (i % 50 ? 0.0 : 6.0));
        }
        for (int k = 0; k < 4; ++k)
            p[SGS_PARAM_ROTATION + k] = (float)sgsi_random_normal(seed, 20 * i + 6 + (uint64_t)k);
        p[SGS_PARAM_OPACITY] = (float)(4.0 * sgsi_random_normal(seed, 20 * i + 10));
        sgs_gaussians_set(model, i, p);
    }
    return model;
}

// rows[3][3] = S^-1 R^T of a primitive; returns its squared support radius 2 ln(255 o).
static double metric_of(const sgs_gaussians *model, size_t i, double rows[3][3])
{
    double q[4], norm = 0.0;
    for (int k = 0; k < 4; ++k) {
        q[k] = (double)*sgs_gaussians_at(model, i, SGS_PARAM_ROTATION + k);
        norm += q[k] * q[k];
    }
    for (int k = 0; k < 4; ++k)
        q[k] /= sqrt(norm);
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double r[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - w * z),     2 * (x * z + w * y),
                         2 * (x * y + w * z),     1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
                         2 * (x * z - w * y),     2 * (y * z + w * x),     1 - 2 * (x * x + y * y)};
    for (int a = 0; a < 3; ++a)
        for (int k = 0; k < 3; ++k)
            rows[a][k] =
                r[3 * k + a] * exp(-(double)*sgs_gaussians_at(model, i, SGS_PARAM_SCALE + a));
    const double logit = (double)*sgs_gaussians_at(model, i, SGS_PARAM_OPACITY);
    return 2.0 * log(255.0 / (1.0 + exp(-logit)));
}

// True if the ray from `center` has a response of at least 1 / 255.
static bool hits(const double rows[3][3], double support, const double center[3],
                 const double mean[3], const double d[3])
{
    double o[3] = {0}, v[3] = {0}, ov = 0, vv = 0, oo = 0;
    for (int a = 0; a < 3; ++a) {
        for (int k = 0; k < 3; ++k) {
            o[a] += rows[a][k] * (mean[k] - center[k]);
            v[a] += rows[a][k] * d[k];
        }
        ov += o[a] * v[a];
        vv += v[a] * v[a];
        oo += o[a] * o[a];
    }
    return ov > 0.0 && oo - ov * ov / vv <= support;
}

// Sets bit `rank` of needed[i] for each primitive that a ray of the rank's cells hits.
static void hit_by_rays(const sgs_camera *camera, const sgs_pose *pose, const sgs_gaussians *model,
                        const uint8_t *rank_of_tile, int tiles_x, uint64_t *needed)
{
    double(*directions)[3] =
        calloc((size_t)camera->width * (size_t)camera->height, sizeof *directions);
    double center[3];
    sgs_pose_center(pose, center);
    for (int y = 0; y < camera->height; ++y)
        for (int x = 0; x < camera->width; ++x) {
            double local[3], *d = directions[y * camera->width + x];
            if (!sgs_camera_unproject(camera, (double[2]){x + 0.5, y + 0.5}, local))
                continue;
            for (int k = 0; k < 3; ++k)
                d[k] = pose->rotation[k] * local[0] + pose->rotation[3 + k] * local[1] +
                       pose->rotation[6 + k] * local[2];
        }
    for (size_t i = 0; i < model->count; ++i) {
        double rows[3][3], mean[3];
        const double support = metric_of(model, i, rows);
        for (int k = 0; k < 3; ++k)
            mean[k] = (double)*sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k);
        for (int y = 0; y < camera->height && support > 0.0; ++y)
            for (int x = 0; x < camera->width; ++x) {
                const uint64_t bit = (uint64_t)1 << rank_of_tile[y / 16 * tiles_x + x / 16];
                const double *d = directions[y * camera->width + x];
                if (!(needed[i] & bit) && d[0] * d[0] + d[1] * d[1] + d[2] * d[2] > 0.0 &&
                    hits(rows, support, center, mean, d))
                    needed[i] |= bit;
            }
    }
    free(directions);
}

typedef struct sent {
    size_t needed, listed;
} sent;

// Every primitive that a rank hits is in its list.
static sent check_lists(const sgsi_shard_routes *routes, const uint64_t *needed, size_t lens)
{
    sent total = {0, 0};
    for (int r = 0; r < routes->ranks; ++r) {
        const size_t *begin = routes->lists.begin;
        size_t at = begin[r];
        for (size_t i = 0; i < ROWS; ++i) {
            const bool listed = at < begin[r + 1] && routes->lists.places[at] == i;
            at += listed;
            total.listed += listed;
            total.needed += needed[i] >> r & 1;
            if ((needed[i] >> r & 1) && !listed)
                fail_msg("lens %zu: rank %d of %d hits primitive %zu but does not receive it", lens,
                         r, routes->ranks, i);
        }
        assert_int_equal(at, begin[r + 1]);
    }
    return total;
}

static void lists_contain_every_hit(void **state)
{
    (void)state;
    sent total = {0, 0};
    for (size_t lens = 0; lens < sizeof lenses / sizeof *lenses; ++lens) {
        const sgs_camera camera =
            sgs_camera_resized(&lenses[lens], lenses[lens].width / 4, lenses[lens].height / 4);
        const sgs_pose pose = {.rotation = {0.36, 0.48, -0.8, -0.8, 0.6, 0, 0.48, 0.64, 0.6},
                               .translation = {1.5, -2, 0.25}};
        sgs_gaussians *model = scatter(&camera, &pose, lens);
        sgsi_rays *rays;
        sgsi_tracer *tracer;
        assert_int_equal(sgsi_rays_create(&camera, sgsi_macrotile_side(&camera), &rays),
                         SGS_STATUS_OK);
        assert_int_equal(sgsi_tracer_create(&tracer), SGS_STATUS_OK);
        sgs_render_options options = sgs_render_options_default();
        options.filter = SGS_FILTER_NONE;
        sgsi_view view;
        sgsi_view_set(&view, rays, &pose, &options);
        assert_int_equal(sgsi_tracer_project(tracer, model, &view, NULL, NULL), SGS_STATUS_OK);
        for (int ranks = 1; ranks <= 12; ranks += 1 + ranks / 2) {
            size_t cut[13];
            uint8_t *rank_of_tile = calloc(rays->cells.tiles, 1);
            uint64_t needed[ROWS] = {0};
            sgsi_shard_routes routes;
            if (ranks % 2)
                sgsi_cut_randomly(&rays->cells, lens, ranks, cut);
            else
                sgsi_cut_by_cost(&rays->cells, NULL, ranks, cut);
            for (int r = 0; r < ranks; ++r)
                for (size_t i = rays->cells.tile_begin[cut[r]];
                     i < rays->cells.tile_begin[cut[r + 1]]; ++i)
                    rank_of_tile[rays->cells.tile_order[i]] = (uint8_t)r;
            hit_by_rays(&camera, &pose, model, rank_of_tile, rays->tiles_x, needed);
            assert_int_equal(sgsi_shard_routes_create(ranks, &routes), SGS_STATUS_OK);
            assert_int_equal(sgsi_shard_routes_find(&routes, &view, sgsi_tracer_projected(tracer),
                                                    sgsi_tracer_bounds(tracer), ROWS, cut),
                             SGS_STATUS_OK);
            const sent found = check_lists(&routes, needed, lens);
            total.needed += found.needed;
            total.listed += found.listed;
            sgsi_shard_routes_free(&routes);
            free(rank_of_tile);
        }
        sgsi_tracer_destroy(tracer);
        sgsi_rays_destroy(rays);
        sgs_gaussians_destroy(model);
    }
    assert_true(total.needed > 10000);
    print_message("%zu of %zu records have a hit\n", total.needed, total.listed);
    assert_true(total.listed < 2 * total.needed);
}

// A guess saves work but changes nothing, also for spheres that just touch the cone of a cell.
static void guesses_do_not_change_the_ranks(void **state)
{
    (void)state;
    enum { CELLS = 90, SPHERES = 20000, RANKS = 5 };
    sgsi_cone cones[CELLS];
    const size_t cut[RANKS + 1] = {0, 7, 30, 30, 61, CELLS};
    sgsi_router *router;
    uint32_t carried = 0;
    size_t found[2] = {0, 0};
    for (int i = 0; i < CELLS; ++i) {
        const double x = 0.1 * (i % 10 - 4.5), y = 0.1 * (i / 10 - 4), z = 1.0;
        const double length = sqrt(x * x + y * y + z * z);
        cones[i] = (sgsi_cone){{x / length, y / length, z / length}, cos(0.07 / length), i != 40};
    }
    assert_int_equal(sgsi_router_create(RANKS, &router), SGS_STATUS_OK);
    assert_int_equal(sgsi_router_set(router, cones, CELLS, cut), SGS_STATUS_OK);
    for (uint64_t i = 0; i < SPHERES; ++i) {
        const sgsi_cone *cone = &cones[(int)(CELLS * sgsi_random_uniform(3, 4 * i))];
        float center[3];
        double along = 0.0, distance2 = 0.0;
        for (int k = 0; k < 3; ++k) {
            center[k] = (float)((i % 5 ? 4.0 : -4.0) *
                                (cone->axis[k] + 0.1 * sgsi_random_normal(5, 3 * i + (uint64_t)k)));
            along += (double)center[k] * cone->axis[k];
            distance2 += (double)center[k] * (double)center[k];
        }
        const double touching = sqrt(fmax(0.0, distance2 - along * along)) * cone->cosine -
                                along * sqrt(1.0 - cone->cosine * cone->cosine);
        const double enlarged = 1e-4 * sqrt(distance2);
        float radius = (float)fmax(touching - enlarged, 0.0);
        if (i % 3)
            radius = i % 3 == 1 ? nextafterf(radius, 100.0f) : 0.01f * (float)(i % 100);
        uint32_t none = 0, random = (uint32_t)(200.0 * sgsi_random_uniform(9, i));
        uint64_t expected, actual;
        sgsi_router_find(router, center, radius, &none, &expected);
        sgsi_router_find(router, center, radius, &carried, &actual);
        assert_int_equal(actual, expected);
        sgsi_router_find(router, center, radius, &random, &actual);
        assert_int_equal(actual, expected);
        found[0] += expected == 0;
        found[1] += (expected & (expected - 1)) != 0;
    }
    assert_true(found[0] > 10 && found[1] > 1000); // none, and several ranks
    sgsi_router_destroy(router);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(places_are_dense_and_ascend),
        cmocka_unit_test(lengths_of_messages_give_their_items),
        cmocka_unit_test(lists_hold_the_rows_of_each_rank),
        cmocka_unit_test(lists_contain_every_hit),
        cmocka_unit_test(guesses_do_not_change_the_ranks),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
