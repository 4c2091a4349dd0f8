// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Self-Organizing Gaussians: error bounds from the quantiser steps, also far from the origin, the
// sorting, files of layout 1 and with another image codec, and the functions of the decoder against
// those of the C library.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/threads.h"
#include "compress/plas.h"
#include "compress/portable_math.h"
#include "support/compress_support.h"
#include "support/files_support.h"

static void portable_functions_match_the_c_library(void **state)
{
    (void)state;
    for (int i = 0; i <= 20000; ++i) {
        const double x = i < 10000 ? i * 1e-4 : (i - 10000) * 0.05;
        const double e = expm1(x), got = sgsi_portable_expm1(x);
        assert_true(x > 700 || fabs(got - e) <= 1e-14 * e);
        double s, c;
        const double angle = i < 10000 ? (i - 5000) * 0.01 : (i - 15000) * 0.2;
        sgsi_portable_sincos(angle, &s, &c);
        assert_true(fabs(angle) > 1000 || fabs(s - sin(angle)) <= 1e-13);
        assert_true(fabs(angle) > 1000 || fabs(c - cos(angle)) <= 1e-13);
    }
    assert_true(sgsi_portable_expm1(0) == 0);
}

// Largest steps: range / 2^bits, half of it as error.
typedef struct sog_bound {
    int param, count;
    double step, low, high;
} sog_bound;

static double in_log_domain(double x)
{
    return x < 0 ? -log1p(-x) : log1p(x);
}

// True if a decoded row is this original row within half a step of every attribute.
static bool row_matches(const float *a, const float *b, const sog_bound *bounds, size_t count)
{
    for (size_t k = 0; k < count; ++k)
        for (int c = 0; c < bounds[k].count; ++c) {
            double x = (double)a[bounds[k].param + c];
            double y = (double)b[bounds[k].param + c];
            if (bounds[k].param == SGS_PARAM_MEAN) {
                x = in_log_domain(x);
                y = in_log_domain(y);
            }
            x = fmin(fmax(x, bounds[k].low), bounds[k].high);
            if (!(fabs(x - y) <= bounds[k].step / 2 + 1e-5))
                return false;
        }
    return true;
}

static void errors_are_at_most_half_a_step(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = pack_model(500, 3, 1), *decoded;
    double low = INFINITY, high = -INFINITY;
    // Beyond the limits, in a primitive that is kept.
    *sgs_gaussians_at(model, 7, SGS_PARAM_OPACITY) = 15;
    *sgs_gaussians_at(model, 7, SGS_PARAM_SH_DC) = -3;
    *sgs_gaussians_at(model, 7, SGS_PARAM_SH_REST + 4) = 2;
    for (size_t i = 0; i < 500; ++i) {
        float row[SGS_PARAM_COUNT];
        sgs_gaussians_get(model, i, row);
        float *q = row + SGS_PARAM_ROTATION;
        const float length = sqrtf(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
        for (int k = 0; k < 4; ++k)
            *sgs_gaussians_at(model, i, SGS_PARAM_ROTATION + k) =
                copysignf(q[k], q[k] * q[0]) / length;
        for (int k = 0; k < 3; ++k) {
            low = fmin(low, in_log_domain((double)row[k]));
            high = fmax(high, in_log_domain((double)row[k]));
        }
    }
    const int bits[6] = {12, 9, 6, 8, 7, 5};
    const sog_bound bounds[6] = {
        {SGS_PARAM_MEAN, 3, (high - low) / (1 << bits[0]), -1e9, 1e9},
        {SGS_PARAM_SH_DC, 3, 6.0 / (1 << bits[1]), -2, 4},
        {SGS_PARAM_SH_REST, 45, 2.0 / (1 << bits[2]), -1, 1},
        {SGS_PARAM_SCALE, 3, 2.0 / (1 << bits[3]), -1e9, 1e9},
        {SGS_PARAM_ROTATION, 4, 3.0 / (1 << bits[4]), -1, 2},
        {SGS_PARAM_OPACITY, 1, 18.0 / (1 << bits[5]), -6, 12},
    };
    for (int codec = 0; codec < 3; ++codec) {
        sgs_compress_options options = sgs_compress_options_default();
        options.codec = (sgs_image_codec)codec;
        options.position_bits = bits[0];
        options.dc_bits = bits[1];
        options.sh_bits = bits[2];
        options.scale_bits = bits[3];
        options.rotation_bits = bits[4];
        options.opacity_bits = bits[5];
        assert_int_equal(sgs_compress(model, &options, temp_path(&folder, "pack"), NULL), 0);
        assert_int_equal(sgs_decompress(temp_path(&folder, "pack"), &decoded, NULL), 0);
        assert_int_equal(decoded->count, 22 * 22); // the grid of int(sqrt(500))
        for (size_t j = 0; j < decoded->count; ++j) {
            float a[SGS_PARAM_COUNT], b[SGS_PARAM_COUNT];
            size_t i = 0;
            sgs_gaussians_get(decoded, j, b);
            do
                sgs_gaussians_get(model, i, a);
            while (!row_matches(a, b, bounds, 6) && ++i < 500);
            assert_true(i < 500);
        }
        sgs_gaussians_destroy(decoded);
    }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// Most coefficients of trained models are about 0: an offset of all of them would change colours.
static void zero_is_a_level_of_the_other_bands(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = pack_model(400, 3, 1), *decoded;
    for (size_t i = 0; i < 400; ++i)
        for (int k = 0; k < 45; ++k)
            if (i != 7)
                *sgs_gaussians_at(model, i, SGS_PARAM_SH_REST + k) = 0;
    *sgs_gaussians_at(model, 7, SGS_PARAM_OPACITY) = 5; // not among the omitted ones
    *sgs_gaussians_at(model, 7, SGS_PARAM_SH_REST) = 0.47f;
    *sgs_gaussians_at(model, 7, SGS_PARAM_SH_REST + 1) = -0.41f;
    for (int bits = 1; bits <= 6; ++bits) {
        sgs_compress_options options = sgs_compress_options_default();
        options.sh_bits = bits;
        assert_int_equal(sgs_compress(model, &options, temp_path(&folder, "pack"), NULL), 0);
        assert_int_equal(sgs_decompress(temp_path(&folder, "pack"), &decoded, NULL), 0);
        size_t others = 0;
        for (size_t i = 0; i < decoded->count; ++i)
            for (int k = 0; k < 45; ++k)
                others += *sgs_gaussians_at(decoded, i, SGS_PARAM_SH_REST + k) != 0;
        assert_in_range(others, 0, 45);
        sgs_gaussians_destroy(decoded);
    }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// A logarithm far below those of floats: the file must be readable, and the range of the others
// stays fine enough to tell them from 0.
static void vanishing_scales_are_stored(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = pack_model(400, 0, 1), *decoded;
    *sgs_gaussians_at(model, 7, SGS_PARAM_SCALE) = -2e6f;
    *sgs_gaussians_at(model, 7, SGS_PARAM_OPACITY) = 5; // not among the omitted ones
    sgs_compress_options options = sgs_compress_options_default();
    assert_int_equal(sgs_compress(model, &options, temp_path(&folder, "pack"), NULL), 0);
    if (sgs_decompress(temp_path(&folder, "pack"), &decoded, NULL))
        fail_msg("%s", sgs_last_error());
    size_t vanishing = 0;
    for (size_t i = 0; i < decoded->count; ++i)
        for (int k = 0; k < 3; ++k)
            vanishing += *sgs_gaussians_at(decoded, i, SGS_PARAM_SCALE + k) < -50;
    assert_int_equal(vanishing, 1);
    sgs_gaussians_destroy(decoded);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// The largest distance per axis of a decoded primitive from the nearest original one.
static double largest_error(const sgs_gaussians *model, const sgs_gaussians *decoded)
{
    double largest = 0;
    for (size_t j = 0; j < decoded->count; ++j) {
        double nearest = INFINITY;
        for (size_t i = 0; i < model->count; ++i) {
            double distance = 0;
            for (int k = 0; k < 3; ++k)
                distance = fmax(distance, fabs((double)*sgs_gaussians_at(model, i, k) -
                                               (double)*sgs_gaussians_at(decoded, j, k)));
            nearest = fmin(nearest, distance);
        }
        largest = fmax(largest, nearest);
    }
    return largest;
}

// The coordinates of the model are within 2.4 of the offset. Half a cell is (high - low) / 2^14
// (1 + |x|) / 2. At an offset of 3 the published origin remains, with the largest cells:
// (ln 6.4 + ln 3.4) / 2^14 * 3.2 = 0.0006. Half a step of floats is added.
static void positions_far_from_the_origin_keep_their_accuracy(void **state)
{
    (void)state;
    static const struct {
        float offset[3];
        double float_step;
    } cases[] = {{{0, 0, 0}, 0},
                 {{3, 0, 0}, 0},
                 {{0, -20, 0}, 0x1p-19},
                 {{3000, 0, 0}, 0x1p-12},
                 {{-5, -50000, 30000}, 0x1p-8}};
    const temp_folder folder = temp_folder_make();
    for (size_t c = 0; c < sizeof cases / sizeof *cases; ++c) {
        sgs_gaussians *model = pack_model(900, 0, 1), *decoded;
        for (size_t i = 0; i < model->count; ++i)
            for (int k = 0; k < 3; ++k)
                *sgs_gaussians_at(model, i, k) += cases[c].offset[k];
        sgs_compress_options options = sgs_compress_options_default();
        assert_int_equal(sgs_compress(model, &options, temp_path(&folder, "pack"), NULL), 0);
        assert_int_equal(sgs_decompress(temp_path(&folder, "pack"), &decoded, NULL), 0);
        const double error = largest_error(model, decoded),
                     bound = 0.00061 + cases[c].float_step / 2;
        if (!(error <= bound))
            fail_msg("case %zu: %g, bound %g", c, error, bound);
        sgs_gaussians_destroy(decoded);
        sgs_gaussians_destroy(model);
    }
    temp_folder_remove(&folder);
}

// Positions up to 2000 units away, all other attributes equal. The rows of a decoded model are the
// cells of the grid. Sorting by the contracted positions would leave a mean squared step of the
// positions that is several times larger.
static void primitives_are_sorted_by_their_positions(void **state)
{
    (void)state;
    enum { SIDE = 40, CELLS = SIDE * SIDE };
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = pack_model(CELLS, 0, 1), *decoded;
    for (size_t i = 0; i < CELLS; ++i)
        for (size_t k = 0; k < 3; ++k) {
            const double u = 2 * sgsi_random_uniform(9, 3 * i + k) - 1;
            *sgs_gaussians_at(model, i, (int)k) = (float)copysign(expm1(7.6 * fabs(u)), u);
            *sgs_gaussians_at(model, i, SGS_PARAM_SH_DC + (int)k) = 0.5f;
            *sgs_gaussians_at(model, i, SGS_PARAM_SCALE + (int)k) = -1;
        }
    sgs_compress_options options = sgs_compress_options_default();
    assert_int_equal(sgs_compress(model, &options, temp_path(&folder, "pack"), NULL), 0);
    assert_int_equal(sgs_decompress(temp_path(&folder, "pack"), &decoded, NULL), 0);
    assert_int_equal(decoded->count, CELLS);
    double power = 0, steps = 0;
    for (size_t i = 0; i < CELLS; ++i)
        for (int k = 0; k < 3; ++k) {
            const double x = (double)*sgs_gaussians_at(decoded, i, k);
            power += x * x / CELLS;
            if (i % SIDE + 1 < SIDE)
                steps += pow((double)*sgs_gaussians_at(decoded, i + 1, k) - x, 2);
            if (i + SIDE < CELLS)
                steps += pow((double)*sgs_gaussians_at(decoded, i + SIDE, k) - x, 2);
        }
    steps /= 2 * SIDE * (SIDE - 1);
    print_message("squared step %.4f of that of a random order\n", steps / (2 * power));
    if (!(steps <= 0.1 * 2 * power))
        fail_msg("squared step %g of that of a random order", steps / (2 * power));
    sgs_gaussians_destroy(decoded);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// Scales are from 0.02, the largest of three from about 0.04. Cells at distance 2: 2 ln 3 / 2^bits
// * 3, that is 0.0004 and 0.05.
static void large_cells_cause_a_warning(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = pack_model(400, 0, 7);
    for (int bits = 7; bits <= 14; bits += 7) {
        sgs_compress_options options = sgs_compress_options_default();
        options.position_bits = bits;
        char warning[512];
        const char *pack = temp_path(&folder, "pack");
        assert_int_equal(pack_with_warning(model, &options, pack, warning), SGS_STATUS_OK);
        if (bits == 7)
            assert_non_null(strstr(warning, "more than the size of"));
        else
            assert_string_equal(warning, "");
        assert_int_equal(strstr(warning, "; increase option position_bits, or") != NULL, bits == 7);
    }
    // At most 15 bits: nothing to increase.
    for (size_t i = 0; i < model->count; ++i)
        for (int k = 0; k < 3; ++k)
            *sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k) = -20;
    sgs_compress_options finest = sgs_compress_options_default();
    finest.position_bits = 15;
    char advice[512];
    const char *pack = temp_path(&folder, "pack");
    assert_int_equal(pack_with_warning(model, &finest, pack, advice), SGS_STATUS_OK);
    assert_non_null(strstr(advice, "of 400 primitives; remove the primitives"));
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// A model of room far from the origin, with the hash that the last program of layout 1 printed.
static void files_of_layout_1_are_read(void **state)
{
    (void)state;
    sgs_gaussians *decoded;
    sgs_compress_info info;
    char hash[17];
    if (sgs_decompress(SGSI_TEST_DATA "/sog_layout_1.bin", &decoded, &info))
        fail_msg("%s", sgs_last_error());
    sgs_gaussians_hash(decoded, hash);
    assert_string_equal(hash, "36a4e456bfed9184");
    assert_int_equal(decoded->count, 16);
    assert_int_equal(info.input, 18);
    sgs_gaussians_destroy(decoded);
}

// The last 12 bytes of section 'grid', which is 92 bytes long.
static void an_origin_that_is_not_finite_is_refused(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "pack");
    sgs_gaussians *model = pack_model(300, 0, 1), *decoded;
    sgs_compress_options options = sgs_compress_options_default();
    assert_int_equal(sgs_compress(model, &options, path, NULL), 0);
    size_t size;
    unsigned char *file = file_get(path, &size);
    assert_int_equal(pack_get(file, PACK_HEADER + 24, 8), 92);
    pack_put(file, PACK_HEADER + pack_get(file, 56, 4) * PACK_ENTRY + 8 + 84, 0x7f800000, 4);
    pack_reseal(file, size);
    file_put(path, file, size);
    assert_int_equal(sgs_decompress(path, &decoded, NULL), SGS_STATUS_FORMAT);
    assert_non_null(strstr(sgs_last_error(), "section 'grid': the origin is not finite"));
    free(file);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// Mean squared difference of horizontal and vertical neighbours.
static double roughness(const float *features, size_t side)
{
    double sum = 0;
    for (size_t y = 0; y < side; ++y)
        for (size_t x = 0; x + 1 < side; ++x)
            for (size_t c = 0; c < SGSI_PLAS_CHANNELS; ++c) {
                const float *row = features + (y * side + x) * SGSI_PLAS_CHANNELS + c;
                const float *column = features + (x * side + y) * SGSI_PLAS_CHANNELS + c;
                const double dx = (double)row[SGSI_PLAS_CHANNELS] - (double)row[0];
                const double dy = (double)column[side * SGSI_PLAS_CHANNELS] - (double)column[0];
                sum += dx * dx + dy * dy;
            }
    return sum / (double)(2 * side * (side - 1));
}

static void sorting_makes_neighbours_similar(void **state)
{
    (void)state;
    enum { SIDE = 48, CELLS = SIDE * SIDE };
    static float features[CELLS][SGSI_PLAS_CHANNELS], original[CELLS][SGSI_PLAS_CHANNELS];
    static uint32_t order[2][CELLS];
    double sorted = 0, random = 0;
    for (int run = 0; run < 2; ++run) {
        sgsi_threads_set(1 + run);
        for (uint64_t i = 0; i < CELLS; ++i)
            for (uint64_t c = 0; c < SGSI_PLAS_CHANNELS; ++c)
                original[i][c] = features[i][c] =
                    c < 3 ? (float)sgsi_random_uniform(3, 3 * i + c) : 0;
        random = roughness(features[0], SIDE);
        sgsi_plas plas = {.side = SIDE,
                          .features = features[0],
                          .order = order[run],
                          .seed = 5,
                          .improvement_break = 1e-4};
        assert_int_equal(sgsi_plas_sort(&plas), 0);
        sorted = roughness(features[0], SIDE);
    }
    assert_memory_equal(order[0], order[1], sizeof order[0]);
    static bool seen[CELLS];
    for (size_t i = 0; i < CELLS; ++i) {
        assert_true(order[0][i] < CELLS && !seen[order[0][i]]);
        seen[order[0][i]] = true;
        assert_memory_equal(features[i], original[order[0][i]], sizeof features[0]);
    }
    // A random order of points in the unit cube has 1/2. The authors' program reaches a tenth of
    // the random value on grids of this size.
    assert_true(fabs(random - 0.5) < 0.03);
    assert_true(sorted < 0.1 * random);
    print_message("roughness %.4f, random %.4f\n", sorted, random);
}

// Cancels at the third pass of the first radius.
static bool two_passes(void *user, size_t done, size_t total)
{
    assert_int_equal(done, 0);
    assert_true(total > 10);
    return ++*(int *)user < 3;
}

static void sorting_is_cancelled_between_passes(void **state)
{
    (void)state;
    enum { SIDE = 48, CELLS = SIDE * SIDE };
    static float features[CELLS * SGSI_PLAS_CHANNELS];
    static uint32_t order[CELLS];
    int calls = 0;
    for (uint64_t i = 0; i < CELLS * SGSI_PLAS_CHANNELS; ++i)
        features[i] = (float)sgsi_random_uniform(3, i);
    sgsi_plas plas = {.side = SIDE,
                      .features = features,
                      .order = order,
                      .seed = 5,
                      .improvement_break = 1e-4,
                      .progress = two_passes,
                      .progress_user = &calls};
    assert_int_equal(sgsi_plas_sort(&plas), SGS_STATUS_CANCELLED);
    assert_int_equal(calls, 3);
}

// Of the section 'grid', the first one.
static size_t codec_at(const unsigned char *file)
{
    return PACK_HEADER + pack_get(file, 56, 4) * PACK_ENTRY + 8 + 4;
}

static void other_codecs_are_refused(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "pack");
    sgs_gaussians *model = pack_model(300, 1, 1), *decoded;
    for (int codec = 0; codec < 3; ++codec) {
        sgs_compress_options options = sgs_compress_options_default();
        options.codec = (sgs_image_codec)codec;
        assert_int_equal(sgs_compress(model, &options, path, NULL), 0);
        size_t size;
        unsigned char *file = file_get(path, &size);
        assert_int_equal(pack_get(file, codec_at(file), 4), codec);
        for (int other = 0; other <= 3; ++other) {
            pack_put(file, codec_at(file), (uint64_t)other, 4);
            pack_reseal(file, size);
            file_put(path, file, size);
            const sgs_status status = sgs_decompress(path, &decoded, NULL);
            if (other == codec) {
                assert_int_equal(status, 0);
                sgs_gaussians_destroy(decoded);
                continue;
            }
            assert_int_equal(status, other < 3 ? SGS_STATUS_FORMAT : SGS_STATUS_UNSUPPORTED);
            assert_non_null(strstr(sgs_last_error(),
                                   other < 3 ? "section 'mean_0' is not an image of 17 x 17 pixels"
                                             : "unknown image codec 3"));
        }
        free(file);
    }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(portable_functions_match_the_c_library),
        cmocka_unit_test(errors_are_at_most_half_a_step),
        cmocka_unit_test(zero_is_a_level_of_the_other_bands),
        cmocka_unit_test(vanishing_scales_are_stored),
        cmocka_unit_test(positions_far_from_the_origin_keep_their_accuracy),
        cmocka_unit_test(primitives_are_sorted_by_their_positions),
        cmocka_unit_test(large_cells_cause_a_warning),
        cmocka_unit_test(files_of_layout_1_are_read),
        cmocka_unit_test(an_origin_that_is_not_finite_is_refused),
        cmocka_unit_test(sorting_makes_neighbours_similar),
        cmocka_unit_test(sorting_is_cancelled_between_passes),
        cmocka_unit_test(other_codecs_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
