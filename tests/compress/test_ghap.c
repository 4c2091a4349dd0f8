// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Mixture reduction of GHAP on cases with known results, and its eigen-decomposition
// against the covariance it comes from.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "compress/eigen3.h"
#include "model/filter_3d.h"
#include "support/compress_support.h"
#include "support/files_support.h"
#include "support/prune_support.h"

static void covariance_survives_the_eigen_decomposition(void **state)
{
    (void)state;
    for (uint64_t k = 0; k < 200; ++k) {
        float q[4], s[3];
        for (uint64_t c = 0; c < 4; ++c)
            q[c] = (float)sgsi_random_normal(1, 8 * k + c);
        for (uint64_t c = 0; c < 3; ++c)
            s[c] = (float)(k % 5 == 0 ? -3 : 2 * sgsi_random_normal(2, 8 * k + c) - 3);
        double covariance[6], values[3], rotation[4], again[6];
        sgsi_covariance3(q, s, covariance);
        sgsi_eigen3(covariance, values, rotation);
        assert_true(values[0] <= values[1] && values[1] <= values[2]);
        for (int c = 0; c < 3; ++c)
            s[c] = (float)(0.5 * log(values[c]));
        for (int c = 0; c < 4; ++c)
            q[c] = (float)rotation[c];
        sgsi_covariance3(q, s, again);
        for (int c = 0; c < 6; ++c)
            assert_true(fabs(again[c] - covariance[c]) <= 2e-6 * values[2]);
    }
}

static sgs_gaussians *reduced_with(const sgs_gaussians *model, double keep, uint64_t seed)
{
    const temp_folder folder = temp_folder_make();
    sgs_compress_options options = sgs_compress_options_default();
    options.method = SGS_COMPRESS_GHAP;
    options.keep = keep;
    options.seed = seed;
    options.finetune = 0;
    sgs_gaussians *decoded;
    assert_int_equal(sgs_compress(model, &options, temp_path(&folder, "pack"), NULL), 0);
    assert_int_equal(sgs_decompress(temp_path(&folder, "pack"), &decoded, NULL), 0);
    temp_folder_remove(&folder);
    return decoded;
}

static sgs_gaussians *reduced(const sgs_gaussians *model, double keep)
{
    return reduced_with(model, keep, 0);
}

// Two distant clusters of identical Gaussians and two components: mean and covariance of each
// cluster.
static void a_cluster_becomes_its_weighted_mean(void **state)
{
    (void)state;
    sgs_gaussians *model = pack_model(8, 0, 3);
    double mean[2][3] = {{0}}, weight[2] = {0};
    for (size_t i = 0; i < 8; ++i) {
        const float at = i < 4 ? 0.0f : 50.0f;
        for (int k = 0; k < 3; ++k)
            *sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k) =
                at + (float)sgsi_random_uniform(5, 3 * i + (uint64_t)k);
        const double o = 1 / (1 + exp(-(double)*sgs_gaussians_at(model, i, SGS_PARAM_OPACITY)));
        weight[i / 4] += o;
        for (int k = 0; k < 3; ++k)
            mean[i / 4][k] += o * (double)*sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k);
    }
    // k-means depends on its start: some seed has a start in both clusters.
    bool separated = false;
    for (uint64_t seed = 0; seed < 16 && !separated; ++seed) {
        sgs_gaussians *decoded = reduced_with(model, 0.25, seed);
        assert_true(decoded->count <= 2);
        if (decoded->count == 2) {
            const int far = *sgs_gaussians_at(decoded, 1, SGS_PARAM_MEAN) > 25 ? 1 : 0;
            double worst = 0;
            for (size_t c = 0; c < 2; ++c)
                for (int k = 0; k < 3; ++k) {
                    const size_t row = c ? (size_t)far : (size_t)(1 - far);
                    worst = fmax(worst, fabs((double)*sgs_gaussians_at(decoded, row, k) -
                                             mean[c][k] / weight[c]));
                }
            separated = worst <= 1e-5;
        }
        sgs_gaussians_destroy(decoded);
    }
    assert_true(separated);
    sgs_gaussians_destroy(model);
}

// One step of weighted k-means from two of the points, each of which is nearest to itself: the
// means of both components.
static void one_step(const double points[8][3], const double weights[8], const size_t start[2],
                     double means[2][3])
{
    double sums[2][4] = {{0}};
    for (size_t i = 0; i < 8; ++i) {
        double cost[2] = {0};
        for (int c = 0; c < 2; ++c)
            for (int k = 0; k < 3; ++k)
                cost[c] += pow(points[i][k] - points[start[c]][k], 2);
        double *sum = sums[cost[1] < cost[0]];
        for (int k = 0; k < 3; ++k)
            sum[k] += weights[i] * points[i][k];
        sum[3] += weights[i];
    }
    for (int c = 0; c < 2; ++c)
        for (int k = 0; k < 3; ++k)
            means[c][k] = sums[c][k] / sums[c][3];
}

// The released code stops after either half of an iteration. Here all objectives are below its
// tolerance of 1e-5, so the first update of the means is the last one.
static void a_small_change_after_either_half_step_stops(void **state)
{
    (void)state;
    sgs_gaussians *model = pack_model(8, 0, 3);
    double points[8][3], weights[8];
    for (size_t i = 0; i < 8; ++i) {
        for (int k = 0; k < 3; ++k) {
            const float x = (float)(1e-3 * sgsi_random_uniform(9, 3 * i + (uint64_t)k));
            *sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k) = x;
            *sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k) = -15;
            points[i][k] = (double)x;
        }
        weights[i] = 1 / (1 + exp(-(double)*sgs_gaussians_at(model, i, SGS_PARAM_OPACITY)));
    }
    for (uint64_t seed = 0; seed < 16; ++seed) {
        sgs_gaussians *decoded = reduced_with(model, 0.25, seed);
        assert_int_equal(decoded->count, 2);
        double least = INFINITY;
        for (size_t s = 0; s < 64; ++s) { // some start has this result
            const size_t start[2] = {s / 8, s % 8};
            double means[2][3], worst = 0;
            if (start[0] == start[1])
                continue;
            one_step(points, weights, start, means);
            for (size_t c = 0; c < 2; ++c)
                for (int k = 0; k < 3; ++k)
                    worst =
                        fmax(worst, fabs((double)*sgs_gaussians_at(decoded, c, k) - means[c][k]));
            least = fmin(least, worst);
        }
        if (!(least <= 1e-9))
            fail_msg("seed %d: not one step from any start, nearest %g", (int)seed, least);
        sgs_gaussians_destroy(decoded);
    }
    sgs_gaussians_destroy(model);
}

// With almost no reduction every component is one primitive: means and covariances are kept.
static void keeping_all_changes_no_covariance(void **state)
{
    (void)state;
    sgs_gaussians *model = pack_model(500, 3, 4), *decoded = reduced(model, 1.0);
    assert_true(decoded->count > 480); // quotas of blocks are rounded down
    size_t matched = 0;
    for (size_t i = 0; i < 500; ++i)
        for (size_t j = 0; j < decoded->count; ++j) {
            float a[SGS_PARAM_COUNT], b[SGS_PARAM_COUNT];
            sgs_gaussians_get(model, i, a);
            sgs_gaussians_get(decoded, j, b);
            if (a[0] != b[0] || a[1] != b[1] || a[2] != b[2])
                continue;
            double s[6], t[6];
            sgsi_covariance3(a + SGS_PARAM_ROTATION, a + SGS_PARAM_SCALE, s);
            sgsi_covariance3(b + SGS_PARAM_ROTATION, b + SGS_PARAM_SCALE, t);
            for (int k = 0; k < 6; ++k)
                assert_true(fabs(s[k] - t[k]) <= 1e-5 * (s[0] + s[3] + s[5]));
            assert_memory_equal(a + SGS_PARAM_OPACITY, b + SGS_PARAM_OPACITY, 49 * sizeof *a);
            ++matched;
        }
    assert_true(matched >= 2 * decoded->count - 500); // the others are merged
    sgs_gaussians_destroy(model);
    sgs_gaussians_destroy(decoded);
}

static void counts_are_the_share_to_keep(void **state)
{
    (void)state;
    sgs_gaussians *model = pack_model(20000, 0, 6);
    const double keep[] = {0.7, 0.5, 0.3, 0.01};
    for (size_t k = 0; k < 4; ++k) {
        sgs_gaussians *decoded = reduced(model, keep[k]);
        const double wanted = 20000 * keep[k];
        assert_true((double)decoded->count <= wanted && (double)decoded->count >= 0.97 * wanted);
        sgs_gaussians_destroy(decoded);
    }
    sgs_gaussians_destroy(model);
}

// A model trained with Mip-Splatting's 3D filter is saved with it: no axis is shorter.
static void fine_tuning_applies_the_3d_filter(void **state)
{
    (void)state;
    enum { COUNT = 300 };
    sgs_gaussians *model = pack_model(COUNT, 0, 8), *decoded;
    for (size_t i = 0; i < COUNT; ++i)
        for (int k = 0; k < 3; ++k)
            *sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k) = -12;
    sgs_scene *scene = prune_scene(48, 32);
    sgs_render_options render = sgs_render_options_default();
    render.filter = SGS_FILTER_MIP;
    sgs_compress_options options = sgs_compress_options_default();
    options.method = SGS_COMPRESS_GHAP;
    options.scene = scene;
    options.render = &render;
    options.keep = 0.5;
    options.finetune = 2;
    const temp_folder folder = temp_folder_make();
    assert_int_equal(sgs_compress(model, &options, temp_path(&folder, "pack"), NULL), 0);
    assert_int_equal(sgs_decompress(temp_path(&folder, "pack"), &decoded, NULL), 0);
    float filter[COUNT];
    const size_t views[] = {0, 1, 2};
    float farthest;
    assert_int_equal(
        sgsi_filter_3d_sample(decoded, scene, views, PRUNE_VIEWS, 0.2, filter, &farthest),
        SGS_STATUS_OK);
    sgsi_filter_3d_scale(scene, views, PRUNE_VIEWS, farthest, filter, decoded->count);
    for (size_t i = 0; i < decoded->count; ++i)
        for (int k = 0; k < 3; ++k) {
            const float s = expf(*sgs_gaussians_at(decoded, i, SGS_PARAM_SCALE + k));
            assert_true(filter[i] > 0 && s >= 0.999f * filter[i]);
        }
    temp_folder_remove(&folder);
    sgs_gaussians_destroy(decoded);
    sgs_gaussians_destroy(model);
    sgs_scene_destroy(scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(covariance_survives_the_eigen_decomposition),
        cmocka_unit_test(a_cluster_becomes_its_weighted_mean),
        cmocka_unit_test(a_small_change_after_either_half_step_stops),
        cmocka_unit_test(keeping_all_changes_no_covariance),
        cmocka_unit_test(counts_are_the_share_to_keep),
        cmocka_unit_test(fine_tuning_applies_the_3d_filter),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
