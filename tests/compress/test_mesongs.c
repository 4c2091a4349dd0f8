// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// MesonGS: the transform against its definition, error bounds from the steps of octree and
// quantiser, and constants of the released code. test_cli_compress.sh tests the fine-tuning.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "compress/eigen3.h"
#include "compress/meson_codec.h"
#include "compress/meson_finetune.h"
#include "compress/raht.h"
#include "support/compress_support.h"
#include "support/files_support.h"

static void transform_is_orthonormal(void **state)
{
    (void)state;
    enum { COUNT = 200, BITS = 12 };
    uint64_t cells[COUNT];
    double x[COUNT], original[COUNT], energy[2] = {0}, sum = 0;
    for (uint64_t i = 0; i < COUNT; ++i) {
        cells[i] = 20 * i + sgsi_random_bits(1, i) % 20;
        x[i] = original[i] = sgsi_random_normal(2, i);
        energy[0] += x[i] * x[i];
        sum += x[i];
    }
    sgsi_raht raht;
    assert_int_equal(sgsi_raht_create(cells, COUNT, BITS, &raht), 0);
    sgsi_raht_forward(&raht, x);
    for (int i = 0; i < COUNT; ++i)
        energy[1] += x[i] * x[i];
    assert_true(fabs(energy[0] - energy[1]) <= 1e-10 * energy[0]);
    assert_true(fabs(x[0] - sum / sqrt(COUNT)) <= 1e-10);
    sgsi_raht_inverse(&raht, x);
    for (int i = 0; i < COUNT; ++i)
        assert_true(fabs(x[i] - original[i]) <= 1e-12);
    sgsi_raht_free(&raht);
}

// Cells 0, 1 and 6: first 0 and 1 are merged, then their node with 6.
static void transform_of_three_cells_is_known(void **state)
{
    (void)state;
    const uint64_t cells[3] = {0, 1, 6};
    double x[3] = {1, 3, 7};
    sgsi_raht raht;
    assert_int_equal(sgsi_raht_create(cells, 3, 3, &raht), 0);
    sgsi_raht_forward(&raht, x);
    assert_true(fabs(x[1] - 2 / sqrt(2)) <= 1e-15);
    assert_true(fabs(x[0] - (sqrt(2) * (4 / sqrt(2)) + 7) / sqrt(3)) <= 1e-14);
    assert_true(fabs(x[2] - (-(4 / sqrt(2)) + sqrt(2) * 7) / sqrt(3)) <= 1e-14);
    sgsi_raht_free(&raht);
}

static sgs_gaussians *through(const sgs_gaussians *model, const sgs_compress_options *options)
{
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *decoded;
    assert_int_equal(sgs_compress(model, options, temp_path(&folder, "pack"), NULL), 0);
    assert_int_equal(sgs_decompress(temp_path(&folder, "pack"), &decoded, NULL), 0);
    temp_folder_remove(&folder);
    return decoded;
}

static sgs_compress_options all_kept(void)
{
    sgs_compress_options options = sgs_compress_options_default();
    options.method = SGS_COMPRESS_MESONGS;
    options.keep = 1;
    options.codebook = 512;
    options.vq_steps = 20;
    options.finetune = 0;
    return options;
}

// Index of the original nearest in position to a decoded one.
static size_t nearest_original(const sgs_gaussians *model, const float *row, double *distance)
{
    size_t best = 0;
    *distance = INFINITY;
    for (size_t i = 0; i < model->count; ++i) {
        double d = 0;
        for (int k = 0; k < 3; ++k)
            d = fmax(d, fabs((double)*sgs_gaussians_at(model, i, k) - (double)row[k]));
        if (d < *distance) {
            *distance = d;
            best = i;
        }
    }
    return best;
}

static void positions_are_within_a_cell(void **state)
{
    (void)state;
    sgs_gaussians *model = pack_model(500, 0, 3);
    sgs_compress_options options = all_kept();
    double span = 0;
    for (int k = 0; k < 3; ++k) {
        double low = INFINITY, high = -INFINITY;
        for (size_t i = 0; i < 500; ++i) {
            low = fmin(low, (double)*sgs_gaussians_at(model, i, k));
            high = fmax(high, (double)*sgs_gaussians_at(model, i, k));
        }
        span = fmax(span, high - low);
    }
    for (int center = 0; center < 2; ++center)
        for (int depth = 10; depth <= 20; depth += 5) {
            options.depth = depth;
            options.cell_center = center;
            sgs_gaussians *decoded = through(model, &options);
            const double cell = span / (double)(1 << depth);
            for (size_t i = 0; i < decoded->count; ++i) {
                float row[SGS_PARAM_COUNT];
                double distance;
                sgs_gaussians_get(decoded, i, row);
                nearest_original(model, row, &distance);
                assert_true(distance <= (center ? 0.5 : 1) * cell + 1e-6);
            }
            assert_true(decoded->count >= 490 && decoded->count <= 500);
            sgs_gaussians_destroy(decoded);
        }
    sgs_gaussians_destroy(model);
}

// A scale is half a step of its block from the original; a block's range is at most 4 here. The
// transform is orthonormal: the mean squared error of transformed channels is that of their
// coefficients.
static void attributes_are_within_their_steps(void **state)
{
    (void)state;
    sgs_gaussians *model = pack_model(500, 0, 4);
    sgs_compress_options options = all_kept();
    options.blocks = 499;
    sgs_gaussians *decoded = through(model, &options);
    double squares[2] = {0};
    for (size_t i = 0; i < decoded->count; ++i) {
        float a[SGS_PARAM_COUNT], b[SGS_PARAM_COUNT];
        double distance, s[6], t[6];
        sgs_gaussians_get(decoded, i, b);
        sgs_gaussians_get(model, nearest_original(model, b, &distance), a);
        for (int k = 0; k < 3; ++k) {
            assert_true(fabs((double)a[SGS_PARAM_SCALE + k] - (double)b[SGS_PARAM_SCALE + k]) <=
                        4.1 / 255);
            squares[0] += pow((double)a[SGS_PARAM_SH_DC + k] - (double)b[SGS_PARAM_SH_DC + k], 2);
        }
        squares[1] += pow((double)a[SGS_PARAM_OPACITY] - (double)b[SGS_PARAM_OPACITY], 2);
        sgsi_covariance3(a + SGS_PARAM_ROTATION, a + SGS_PARAM_SCALE, s);
        sgsi_covariance3(b + SGS_PARAM_ROTATION, b + SGS_PARAM_SCALE, t);
        for (int k = 0; k < 6; ++k)
            assert_true(fabs(s[k] - t[k]) <= 0.15 * (s[0] + s[3] + s[5]));
    }
    assert_true(sqrt(squares[0] / (3.0 * (double)decoded->count)) <= 0.01);
    assert_true(sqrt(squares[1] / (double)decoded->count) <= 0.05);
    sgs_gaussians_destroy(decoded);
    sgs_gaussians_destroy(model);
}

static void pruning_keeps_the_share(void **state)
{
    (void)state;
    sgs_gaussians *model = pack_model(2000, 1, 5);
    for (int preset = 1; preset <= 3; ++preset) {
        sgs_compress_options options = all_kept();
        const double keep[] = {0.7, 0.5, 0.3};
        options.preset = preset;
        options.keep = 0;
        sgs_gaussians *decoded = through(model, &options);
        assert_true(fabs((double)decoded->count - 2000 * keep[preset - 1]) <= 5);
        sgs_gaussians_destroy(decoded);
    }
    sgs_gaussians_destroy(model);
}

// Values: opacity, quaternion, band 0, scales. `released`: arguments/__init__.py and
// finetuning_setup of the release at e491557, before finetune_lr_scale = 0.1 * 4 of most of its
// scenes. The release multiplies by that factor twice; here, it is applied once.
static void rates_are_the_released_ones_times_the_scale(void **state)
{
    (void)state;
    const double extent = 3.5;
    for (size_t k = 0; k < SGSI_MESON_VALUES; ++k) {
        const double released = k == 0 ? 0.05 : k < 5 ? 0.001 : k < 8 ? 0.0025 : 0.001 * extent;
        const double rate = sgsi_meson_rate(k, extent);
        if (!(fabs(rate - 0.1 * 4 * released) <= 1e-15))
            fail_msg("value %zu: rate %g", k, rate);
    }
}

// With one code and equal weights, the code is a moving average of batch means with decay 0.8. Its
// deviation from the mean of all rows has the variance of the rows / batch * 0.2^2 / (1 - 0.8^2).
static void codebook_steps_use_the_released_batch(void **state)
{
    (void)state;
    enum { COUNT = 500, DIM = 45 };
    const double batch = 262144; // batch_size in arguments/__init__.py of the release
    sgs_gaussians *model = pack_model(COUNT, 3, 6);
    for (size_t i = 0; i < COUNT; ++i) {
        *sgs_gaussians_at(model, i, SGS_PARAM_OPACITY) = 1;
        for (int k = 0; k < 3; ++k)
            *sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k) = -4;
    }
    sgs_compress_options options = all_kept();
    options.codebook = 1;
    options.vq_steps = 100;
    sgs_gaussians *decoded = through(model, &options);
    double ratio = 0;
    for (int d = 0; d < DIM; ++d) {
        double mean = 0, variance = 0;
        for (size_t i = 0; i < COUNT; ++i)
            mean += (double)*sgs_gaussians_at(model, i, SGS_PARAM_SH_REST + d) / COUNT;
        for (size_t i = 0; i < COUNT; ++i)
            variance +=
                pow((double)*sgs_gaussians_at(model, i, SGS_PARAM_SH_REST + d) - mean, 2) / COUNT;
        const double code = (double)*sgs_gaussians_at(decoded, 0, SGS_PARAM_SH_REST + d);
        ratio += pow(code - mean, 2) / (variance / batch * 0.04 / 0.36) / DIM;
    }
    if (!(ratio > 0.5 && ratio < 1.7)) // 45 dimensions: 1 +- 0.21
        fail_msg("variance of the code is %g of the expected", ratio);
    sgs_gaussians_destroy(decoded);
    sgs_gaussians_destroy(model);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(transform_is_orthonormal),
        cmocka_unit_test(transform_of_three_cells_is_known),
        cmocka_unit_test(positions_are_within_a_cell),
        cmocka_unit_test(attributes_are_within_their_steps),
        cmocka_unit_test(pruning_keeps_the_share),
        cmocka_unit_test(rates_are_the_released_ones_times_the_scale),
        cmocka_unit_test(codebook_steps_use_the_released_batch),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
