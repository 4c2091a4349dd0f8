// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The codec fcgs-like: the range coder, error bounds from the quantiser steps, and the gain of the
// context over values that have none.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "compress/cell_codes.h"
#include "compress/range_coder.h"
#include "support/compress_support.h"
#include "support/files_support.h"

static void coded_bits_come_back_at_their_entropy(void **state)
{
    (void)state;
    enum { COUNT = 200000 };
    sgsi_range_encoder encoder;
    sgsi_bit_model models[3] = {32768, 32768, 32768};
    sgsi_range_encode_begin(&encoder);
    const double shares[3] = {0.5, 0.03, 0.9999};
    for (uint64_t i = 0; i < COUNT; ++i)
        sgsi_range_encode(&encoder, &models[i % 3], sgsi_random_uniform(1, i) < shares[i % 3]);
    sgsi_range_encode_end(&encoder);
    assert_false(encoder.failed);
    // Entropies 1, 0.194 and 0.0015 bits; adaptation by 1/32 costs a few percent.
    const double bits = 8.0 * (double)encoder.size / COUNT, entropy = (1 + 0.1944 + 0.0015) / 3;
    assert_true(bits > entropy && bits < 1.1 * entropy);
    sgsi_range_decoder decoder;
    for (int k = 0; k < 3; ++k)
        models[k] = 32768;
    sgsi_range_decode_begin(&decoder, encoder.bytes, encoder.size);
    for (uint64_t i = 0; i < COUNT; ++i)
        assert_int_equal(sgsi_range_decode(&decoder, &models[i % 3]),
                         sgsi_random_uniform(1, i) < shares[i % 3]);
    assert_false(decoder.overrun);
    assert_int_equal(decoder.at, encoder.size);
    sgsi_free(encoder.bytes);
}

static double step_of(int param)
{
    const int coefficient = (param - SGS_PARAM_SH_REST) / 3;
    return param < SGS_PARAM_SCALE     ? 0.02
           : param < SGS_PARAM_OPACITY ? 0.08
           : param < SGS_PARAM_SH_DC   ? 0.25
           : param < SGS_PARAM_SH_REST ? 0.04
           : coefficient < 3           ? 0.05
           : coefficient < 8           ? 0.075
                                       : 0.1;
}

static bool row_matches(const float *a, const float *b, double scale, double cell)
{
    const float *q = a + SGS_PARAM_ROTATION;
    const double length = sqrt((double)q[0] * q[0] + (double)q[1] * q[1] + (double)q[2] * q[2] +
                               (double)q[3] * q[3]) *
                          (q[0] < 0 ? -1 : 1);
    for (int k = 0; k < SGS_PARAM_COUNT; ++k) {
        const double unit = k >= SGS_PARAM_ROTATION && k < SGS_PARAM_SCALE ? 1 / length : 1;
        const double bound = k < 3 ? cell / 2 : scale * step_of(k) / 2;
        if (!(fabs((double)a[k] * unit - (double)b[k]) <= bound + 1e-5))
            return false;
    }
    return true;
}

static void errors_are_at_most_half_a_step(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = pack_model(700, 3, 1), *decoded;
    const double scales[3] = {0.3, 1, 4};
    for (int s = 0; s < 3; ++s) {
        sgs_compress_options options = sgs_compress_options_default();
        options.method = SGS_COMPRESS_FCGS_LIKE;
        options.step_scale = scales[s];
        assert_int_equal(sgs_compress(model, &options, temp_path(&folder, "pack"), NULL), 0);
        assert_int_equal(sgs_decompress(temp_path(&folder, "pack"), &decoded, NULL), 0);
        assert_int_equal(decoded->count, 700);
        for (size_t j = 0; j < 700; ++j) {
            float a[SGS_PARAM_COUNT], b[SGS_PARAM_COUNT];
            size_t i = 0;
            sgs_gaussians_get(decoded, j, b);
            do
                sgs_gaussians_get(model, i, a);
            while (!row_matches(a, b, scales[s], 6.0 / 65536) && ++i < 700);
            assert_true(i < 700);
        }
        sgs_gaussians_destroy(decoded);
    }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

static size_t bytes_of(const sgs_gaussians *model)
{
    const temp_folder folder = temp_folder_make();
    sgs_compress_options options = sgs_compress_options_default();
    sgs_compress_info info;
    options.method = SGS_COMPRESS_FCGS_LIKE;
    assert_int_equal(sgs_compress(model, &options, temp_path(&folder, "pack"), &info), 0);
    temp_folder_remove(&folder);
    return info.bytes;
}

// Values that depend on the position cost less than the same values in a random order.
static void neighbours_are_used(void **state)
{
    (void)state;
    enum { COUNT = 4000 };
    sgs_gaussians *model = pack_model(COUNT, 0, 2);
    size_t bytes[2];
    for (int shuffled = 0; shuffled < 2; ++shuffled) {
        for (size_t i = 0; i < COUNT; ++i) {
            const size_t from = shuffled ? i * 2741 % COUNT : i;
            const double y = (double)*sgs_gaussians_at(model, from, 1);
            for (int k = 0; k < 3; ++k)
                *sgs_gaussians_at(model, i, SGS_PARAM_SH_DC + k) = (float)(2 * sin(0.5 * y + k));
        }
        bytes[shuffled] = bytes_of(model);
    }
    // Three values per primitive; at least 1 bit each.
    assert_true((double)bytes[1] - (double)bytes[0] >= 3 * 1.0 / 8 * COUNT);
    sgs_gaussians_destroy(model);
}

// Bits per value of colours with one of two deviations, chosen per cell of a grid, in quantiser
// steps.
static double bits_of_deviations(const double deviations[2], double mean)
{
    enum { COUNT = 12000, SIDE = 8 };
    sgs_gaussians *model = pack_model(COUNT, 0, 2);
    size_t bytes[2];
    for (int constant = 0; constant < 2; ++constant) {
        for (uint64_t i = 0; i < COUNT; ++i) {
            uint64_t cell = 0;
            for (uint64_t k = 0; k < 3; ++k) {
                const double x = sgsi_random_uniform(3, 3 * i + k);
                cell = SIDE * cell + (uint64_t)(x * SIDE);
                *sgs_gaussians_at(model, i, (int)k) = (float)x;
            }
            const double deviation = deviations[sgsi_random_bits(5, cell) & 1];
            for (uint64_t k = 0; k < 3; ++k)
                *sgs_gaussians_at(model, i, SGS_PARAM_SH_DC + (int)k) =
                    constant
                        ? 0
                        : (float)(0.04 * (mean + deviation * sgsi_random_normal(4, 3 * i + k)));
        }
        bytes[constant] = bytes_of(model);
    }
    sgs_gaussians_destroy(model);
    return 8.0 * ((double)bytes[0] - (double)bytes[1]) / (3 * COUNT);
}

// Entropies of rounded normal values are log2(deviation sqrt(2 pi e)) bits, for 0.3 steps 0.55
// bits. With one class for both deviations, codes have 7.75 and 3.2 bits.
static void deviations_are_told_apart(void **state)
{
    (void)state;
    static const struct {
        double deviations[2], mean, entropy, limit;
    } cases[] = {{{8, 96}, 0, 6.84, 7.5}, {{0.3, 7}, 50, 2.7, 3.1}, {{0.3, 7}, -50, 2.7, 3.1}};
    for (size_t c = 0; c < sizeof cases / sizeof *cases; ++c) {
        const double bits = bits_of_deviations(cases[c].deviations, cases[c].mean);
        print_message("%.3f bits per value, entropy %.2f\n", bits, cases[c].entropy);
        if (!(bits > cases[c].entropy && bits < cases[c].limit))
            fail_msg("case %zu: %g bits per value", c, bits);
    }
}

// Layout 1 had 12 classes and another variance.
static void files_of_layout_1_are_refused(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "pack");
    sgs_gaussians *model = pack_model(50, 0, 1), *decoded;
    sgs_compress_options options = sgs_compress_options_default();
    options.method = SGS_COMPRESS_FCGS_LIKE;
    assert_int_equal(sgs_compress(model, &options, path, NULL), 0);
    size_t size;
    unsigned char *file = file_get(path, &size);
    pack_put(file, 24, 1, 4);
    pack_reseal(file, size);
    file_put(path, file, size);
    assert_int_equal(sgs_decompress(path, &decoded, NULL), SGS_STATUS_UNSUPPORTED);
    assert_non_null(strstr(sgs_last_error(), "version 1 of method 'fcgs-like' is unknown; this "
                                             "program reads version 2"));
    free(file);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// A single distant primitive determines the size of the cells; methods with cells warn about it.
static void large_cells_cause_a_warning(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = pack_model(200, 0, 7); // scales from 0.02
    sgs_compress_options options = sgs_compress_options_default();
    const struct {
        sgs_compress_method method;
        float limit; // of the distance: cells of 0.02 units
    } cases[] = {{SGS_COMPRESS_FCGS_LIKE, 1e3f}, {SGS_COMPRESS_MESONGS, 2e4f}};
    for (size_t c = 0; c < sizeof cases / sizeof *cases; ++c)
        for (int far = 0; far < 2; ++far) {
            *sgs_gaussians_at(model, 100, SGS_PARAM_MEAN) =
                far ? 100 * cases[c].limit : cases[c].limit;
            options.method = cases[c].method;
            options.keep = cases[c].method == SGS_COMPRESS_MESONGS ? 1 : 0;
            char warning[512];
            const char *pack = temp_path(&folder, "pack");
            assert_int_equal(pack_with_warning(model, &options, pack, warning), SGS_STATUS_OK);
            assert_int_equal(strstr(warning, "more than the size of") != NULL, far);
            assert_true(far || !*warning);
        }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(coded_bits_come_back_at_their_entropy),
        cmocka_unit_test(errors_are_at_most_half_a_step),
        cmocka_unit_test(neighbours_are_used),
        cmocka_unit_test(deviations_are_told_apart),
        cmocka_unit_test(files_of_layout_1_are_refused),
        cmocka_unit_test(large_cells_cause_a_warning),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
