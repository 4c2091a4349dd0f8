// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A model written in each format and read again: the error of every attribute is at most half a
// quantum of the format, and the order is the stated one.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "base/sh.h"
#include "sog/palette.h"
#include "support/files_support.h"
#include "support/model_support.h"
#include "sparegs/model_file.h"
#include "sparegs/runtime.h"

enum { COUNT = 700 };

// Largest accepted errors; a negative one is not checked.
typedef struct limits {
    double mean, log_scale, opacity, rotation, dc, rest;
} limits;

static sgs_gaussians *write_and_read(const temp_folder *folder, const char *name,
                                     const sgs_gaussians *model,
                                     const sgs_model_write_options *options, sgs_model_info *info,
                                     sgs_model_written *written)
{
    sgs_gaussians *back = NULL;
    if (sgs_model_write(temp_path(folder, name), model, options, written))
        fail_msg("%s", sgs_last_error());
    if (sgs_model_read(temp_path(folder, name), NULL, &back, info))
        fail_msg("%s", sgs_last_error());
    assert_int_equal(back->count, model->count);
    assert_int_equal(written->count, model->count);
    return back;
}

static void check_value(const char *name, size_t i, int param, double value, double expected,
                        double limit)
{
    if (limit >= 0.0 && !(fabs(value - expected) <= limit))
        fail_msg("%s: primitive %zu, parameter %d: %.9g instead of %.9g, limit %.3g", name, i,
                 param, value, expected, limit);
}

static void check_rotation(const char *name, size_t i, const sgs_gaussians *model,
                           const sgs_gaussians *back, size_t j, double limit)
{
    double a[4], b[4], dot = 0.0;
    for (int k = 0; k < 4; ++k) {
        a[k] = (double)model_value(model, i, SGS_PARAM_ROTATION + k);
        b[k] = (double)model_value(back, j, SGS_PARAM_ROTATION + k);
        dot += a[k] * b[k];
    }
    int largest = 0;
    for (int k = 1; k < 4; ++k)
        largest = fabs(a[k]) > fabs(a[largest]) ? k : largest;
    // A component that is computed from the other three has up to three times their error.
    for (int k = 0; k < 4; ++k)
        check_value(name, i, SGS_PARAM_ROTATION + k, dot < 0.0 ? -b[k] : b[k], a[k],
                    k == largest ? 3.1 * limit : limit);
}

static void check_model(const char *name, const sgs_gaussians *model, const sgs_gaussians *back,
                        const limits *most, bool kept)
{
    size_t *match = model_match(model, back);
    unsigned char seen[COUNT] = {0};
    for (size_t i = 0; i < model->count; ++i) {
        const size_t j = match[i];
        assert_true(!kept || i == j);
        assert_false(seen[j]++);
        for (int k = 0; k < 3; ++k) {
            check_value(name, i, k, (double)model_value(back, j, k),
                        (double)model_value(model, i, k), most->mean);
            check_value(name, i, SGS_PARAM_SCALE + k,
                        (double)model_value(back, j, SGS_PARAM_SCALE + k),
                        (double)model_value(model, i, SGS_PARAM_SCALE + k), most->log_scale);
            check_value(name, i, SGS_PARAM_SH_DC + k,
                        (double)model_value(back, j, SGS_PARAM_SH_DC + k),
                        (double)model_value(model, i, SGS_PARAM_SH_DC + k), most->dc);
        }
        check_value(name, i, SGS_PARAM_OPACITY, model_opacity(back, j), model_opacity(model, i),
                    most->opacity);
        check_rotation(name, i, model, back, j, most->rotation);
        const int rest = 3 * ((back->sh_degree + 1) * (back->sh_degree + 1) - 1);
        for (int k = 0; k < rest; ++k)
            check_value(name, i, SGS_PARAM_SH_REST + k,
                        (double)model_value(back, j, SGS_PARAM_SH_REST + k),
                        (double)model_value(model, i, SGS_PARAM_SH_REST + k), most->rest);
    }
    free(match);
}

// Rounding of a float near 1, as an error of a logarithm.
static const double FLOAT_STEP = 6e-8;
static const double ROUNDING = 1e-6; // of positions up to 256

static void ply_keeps_all_bits(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    for (int degree = 0; degree <= 3; ++degree) {
        sgs_gaussians *model = model_random(COUNT, degree);
        sgs_model_info info;
        sgs_model_written written;
        sgs_gaussians *back = write_and_read(&folder, "a.ply", model, NULL, &info, &written);
        char hashes[2][17];
        sgs_gaussians_hash(model, hashes[0]);
        sgs_gaussians_hash(back, hashes[1]);
        assert_string_equal(hashes[0], hashes[1]);
        assert_int_equal(info.format, SGS_MODEL_PLY);
        assert_int_equal(written.order, SGS_ROWS_KEPT);
        sgs_gaussians_destroy(model);
        sgs_gaussians_destroy(back);
    }
    temp_folder_remove(&folder);
}

static void spz_rounds_to_half_a_quantum(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    // |x| < 224 fits into 23 bits with 15 fractional bits. Steps: 1/16, 1/255, 1/511 of sqrt(1/2),
    // 1/(255 0.15), 16/128 above degree 1.
    const limits most = {0x1p-16 + ROUNDING,
                         1.0 / 32 + ROUNDING,
                         0.5 / 255 + ROUNDING,
                         0.5 / 511 * sqrt(0.5) + ROUNDING,
                         0.5 / (255 * 0.15) + ROUNDING,
                         8.0 / 128 + ROUNDING};
    for (int version = 3; version <= 4; ++version)
        for (int axes = SGS_SPZ_AXES_RUB; axes <= SGS_SPZ_AXES_LUF; ++axes)
            for (int degree = 0; degree <= 3; ++degree) {
                sgs_gaussians *model = model_random(COUNT, degree);
                sgs_model_write_options options = sgs_model_write_options_default();
                options.spz_version = version;
                options.spz_axes = (sgs_spz_axes)axes;
                options.antialiased = degree % 2;
                sgs_model_info info;
                sgs_model_written written;
                sgs_gaussians *back =
                    write_and_read(&folder, "a.spz", model, &options, &info, &written);
                assert_int_equal(info.format, SGS_MODEL_SPZ);
                assert_int_equal(info.version, version);
                assert_int_equal(info.axes, axes);
                assert_int_equal(info.antialiased, degree % 2);
                assert_int_equal(back->sh_degree, degree);
                assert_int_equal(written.order, SGS_ROWS_KEPT);
                check_model("spz", model, back, &most, true);
                for (size_t i = 0; degree && i < COUNT; ++i) // degree 1 has steps of 8/128
                    for (int k = 0; k < 9; ++k)
                        check_value("spz degree 1", i, k,
                                    (double)model_value(back, i, SGS_PARAM_SH_REST + k),
                                    (double)model_value(model, i, SGS_PARAM_SH_REST + k),
                                    4.0 / 128 + ROUNDING);
                sgs_gaussians_destroy(model);
                sgs_gaussians_destroy(back);
            }
    temp_folder_remove(&folder);
}

static void splat_rounds_to_half_a_quantum(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(COUNT, 3);
    sgs_model_info info;
    sgs_model_written written;
    sgs_gaussians *back = write_and_read(&folder, "a.splat", model, NULL, &info, &written);
    // 1 is stored as 127/128: the largest component may lose a whole step.
    const limits most = {0.0,
                         FLOAT_STEP * 16,
                         0.5 / 255 + ROUNDING,
                         0.5 / 128 + ROUNDING,
                         0.5 / 255 / SGSI_SH_C0 + ROUNDING,
                         -1.0};
    assert_int_equal(back->sh_degree, 0);
    assert_int_equal(written.order, SGS_ROWS_IMPORTANCE);
    assert_int_equal(written.bytes, 32 * COUNT);
    check_model("splat", model, back, &most, false);
    size_t *original = model_match(back, model);
    double before = INFINITY;
    for (size_t j = 0; j < COUNT; ++j) { // decreasing importance
        double size = 0.0;
        for (int k = 0; k < 3; ++k)
            size += (double)model_value(model, original[j], SGS_PARAM_SCALE + k);
        const double importance = exp(size) * model_opacity(model, original[j]);
        assert_true(importance <= before * (1.0 + 1e-6));
        before = importance;
    }
    free(original);
    sgs_gaussians_destroy(model);
    sgs_gaussians_destroy(back);
    temp_folder_remove(&folder);
}

static float float_at(const unsigned char *at)
{
    float value;
    memcpy(&value, at, sizeof value);
    return value;
}

static void compressed_ply_rounds_to_half_a_quantum(void **state)
{
    (void)state;
    static const int bits[3] = {11, 10, 11};
    const temp_folder folder = temp_folder_make();
    for (int degree = 0; degree <= 3; ++degree) {
        sgs_gaussians *model = model_random(COUNT, degree);
        sgs_model_info info;
        sgs_model_written written;
        sgs_gaussians *back =
            write_and_read(&folder, "a.compressed.ply", model, NULL, &info, &written);
        // 8/256 for SH; position, scale and colour depend on the bounds of the chunk.
        const limits most = {-1.0,
                             -1.0,
                             0.5 / 255 + ROUNDING,
                             0.5 / 1023 * sqrt(2.0) + ROUNDING,
                             -1.0,
                             4.0 / 256 + ROUNDING};
        assert_int_equal(info.format, SGS_MODEL_COMPRESSED_PLY);
        assert_int_equal(back->sh_degree, degree);
        assert_int_equal(written.order, SGS_ROWS_MORTON);
        check_model("compressed.ply", model, back, &most, false);
        size_t size, *match = model_match(model, back);
        unsigned char *bytes = file_get(temp_path(&folder, "a.compressed.ply"), &size);
        const unsigned char *data =
            (const unsigned char *)strstr((const char *)bytes, "end_header\n") + 11;
        for (size_t i = 0; i < COUNT; ++i)
            for (int k = 0; k < 3; ++k) {
                const unsigned char *bounds = data + 72 * (match[i] / 256);
                const struct {
                    int param, first, bits;
                    double unit;
                } rows[] = {{SGS_PARAM_MEAN, 0, bits[k], 1.0},
                            {SGS_PARAM_SCALE, 6, bits[k], 1.0},
                            {SGS_PARAM_SH_DC, 12, 8, SGSI_SH_C0}};
                for (int r = 0; r < 3; ++r) {
                    const double range = (double)float_at(bounds + 4 * (rows[r].first + 3 + k)) -
                                         (double)float_at(bounds + 4 * (rows[r].first + k));
                    const double quantum = range / ((1 << rows[r].bits) - 1) / rows[r].unit;
                    check_value("compressed.ply", i, rows[r].param + k,
                                (double)model_value(back, match[i], rows[r].param + k),
                                (double)model_value(model, i, rows[r].param + k),
                                0.5 * quantum + 2e-5);
                }
            }
        free(bytes);
        free(match);
        sgs_gaussians_destroy(model);
        sgs_gaussians_destroy(back);
    }
    temp_folder_remove(&folder);
}

static void ksplat_rounds_to_half_a_quantum(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const double half = 0x1p-11; // of a binary16 below 2, also relative
    const limits most[3] = {{0.0, FLOAT_STEP * 16, 0.5 / 255 + ROUNDING, FLOAT_STEP,
                             0.5 / 255 / SGSI_SH_C0 + ROUNDING, 0.0},
                            {2.5 / 32767 / 2 + 2e-5, half, 0.5 / 255 + ROUNDING, half / 2,
                             0.5 / 255 / SGSI_SH_C0 + ROUNDING, half / 2},
                            {2.5 / 32767 / 2 + 2e-5, half, 0.5 / 255 + ROUNDING, half / 2,
                             0.5 / 255 / SGSI_SH_C0 + ROUNDING, 1.8 / 255 / 2 + ROUNDING}};
    for (int level = 0; level <= 2; ++level)
        for (int degree = 0; degree <= 3; ++degree) {
            sgs_gaussians *model = model_random(COUNT, degree);
            sgs_model_write_options options = sgs_model_write_options_default();
            options.ksplat_level = level;
            sgs_model_info info;
            sgs_model_written written;
            sgs_gaussians *back =
                write_and_read(&folder, "a.ksplat", model, &options, &info, &written);
            assert_int_equal(back->sh_degree, degree < 2 ? degree : 2);
            assert_int_equal(written.order, level ? SGS_ROWS_BUCKETS : SGS_ROWS_KEPT);
            check_model("ksplat", model, back, &most[level], !level);
            sgs_gaussians_destroy(model);
            sgs_gaussians_destroy(back);
        }
    temp_folder_remove(&folder);
}

static void glb_and_usda_keep_all_values(void **state)
{
    (void)state;
    static const char *const names[] = {"a.glb", "a.usda"};
    const temp_folder folder = temp_folder_make();
    for (int degree = 0; degree <= 3; ++degree)
        for (int k = 0; k < 2; ++k) {
            sgs_gaussians *model = model_random(COUNT, degree);
            sgs_model_info info;
            sgs_model_written written;
            sgs_gaussians *back = write_and_read(&folder, names[k], model, NULL, &info, &written);
            // Linear scales and opacities are rounded to floats, unit quaternions too.
            const limits most = {0.0, 8 * FLOAT_STEP, FLOAT_STEP, 2 * FLOAT_STEP, 0.0, 0.0};
            assert_int_equal(info.format, k ? SGS_MODEL_USDA : SGS_MODEL_GLB);
            assert_int_equal(back->sh_degree, degree);
            check_model(names[k], model, back, &most, true);
            sgs_gaussians_destroy(model);
            sgs_gaussians_destroy(back);
        }
    temp_folder_remove(&folder);
}

// No value that the file can hold for this parameter group is nearer.
static void check_nearest(const sgs_gaussians *model, const sgs_gaussians *back,
                          const size_t *match, int param, int count)
{
    for (size_t i = 0; i < COUNT; i += 7)
        for (int k = 0; k < count; ++k) {
            const double value = (double)model_value(model, i, param + k);
            const double error = fabs((double)model_value(back, match[i], param + k) - value);
            for (size_t j = 0; j < COUNT; ++j)
                for (int c = 0; c < count; ++c)
                    assert_true(error <=
                                fabs((double)model_value(back, j, param + c) - value) + 1e-6);
        }
}

static void sog_rounds_to_the_nearest_value(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    for (int degree = 0; degree <= 3; ++degree) {
        sgs_gaussians *model = model_random(COUNT, degree);
        sgs_model_info info;
        sgs_model_written written;
        sgs_model_write_options options = sgs_model_write_options_default();
        options.antialiased = degree % 2;
        sgs_gaussians *back = write_and_read(&folder, "a.sog", model, &options, &info, &written);
        const limits most = {-1.0, -1.0, 0.5 / 255 + ROUNDING, 1.0 / 255 / sqrt(2.0) + ROUNDING,
                             -1.0, -1.0};
        assert_int_equal(info.format, SGS_MODEL_SOG);
        assert_int_equal(info.version, 2);
        assert_int_equal(info.antialiased, degree % 2);
        assert_int_equal(back->sh_degree, degree);
        assert_int_equal(written.order, SGS_ROWS_MORTON);
        check_model("sog", model, back, &most, false);
        size_t *match = model_match(model, back);
        double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
        for (size_t i = 0; i < COUNT; ++i)
            for (int k = 0; k < 3; ++k) {
                const double value = (double)model_value(model, i, k),
                             t = copysign(log(1.0 + fabs(value)), value);
                low[k] = fmin(low[k], t);
                high[k] = fmax(high[k], t);
            }
        for (size_t i = 0; i < COUNT; ++i)
            for (int k = 0; k < 3; ++k) {
                const double a = (double)model_value(model, i, k),
                             b = (double)model_value(back, match[i], k);
                check_value("sog", i, k, copysign(log(1.0 + fabs(b)), b),
                            copysign(log(1.0 + fabs(a)), a),
                            0.5 * (high[k] - low[k]) / 65535 + 1e-6);
            }
        check_nearest(model, back, match, SGS_PARAM_SCALE, 3);
        check_nearest(model, back, match, SGS_PARAM_SH_DC, 3);
        // Every primitive has its own palette entry.
        if (degree)
            check_nearest(model, back, match, SGS_PARAM_SH_REST,
                          3 * ((degree + 1) * (degree + 1) - 1));
        free(match);
        sgs_gaussians_destroy(model);
        sgs_gaussians_destroy(back);
    }
    temp_folder_remove(&folder);
}

static void same_file(const temp_folder *folder, const char *a, const char *b)
{
    size_t sizes[2];
    unsigned char *first = file_get(temp_path(folder, a), &sizes[0]),
                  *second = file_get(temp_path(folder, b), &sizes[1]);
    assert_int_equal(sizes[0], sizes[1]);
    assert_memory_equal(first, second, sizes[0]);
    free(first);
    free(second);
}

// Enough primitives for several ranges of each loop.
static void files_do_not_depend_on_threads(void **state)
{
    (void)state;
    static const char *const endings[] = {
        "ply", "compressed.ply", "splat", "spz", "ksplat", "glb", "sog", "usda"};
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(6000, 3);
    sgs_model_write_options options = sgs_model_write_options_default();
    options.palette_iterations = 2;
    options.sh_palette = 500;
    options.spz_version = 4;
    const int before = sgs_threads_get();
    for (size_t k = 0; k < sizeof endings / sizeof *endings; ++k) {
        char names[2][32];
        for (int threads = 1; threads <= 3; threads += 2) {
            snprintf(names[threads / 2], sizeof names[0], "%d.%s", threads, endings[k]);
            sgs_threads_set(threads);
            assert_int_equal(
                sgs_model_write(temp_path(&folder, names[threads / 2]), model, &options, NULL),
                SGS_STATUS_OK);
        }
        same_file(&folder, names[0], names[1]);
    }
    sgs_threads_set(before);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// The palette of a model with few different SH is exact but for the codebook.
static void palette_finds_clusters(void **state)
{
    (void)state;
    enum { MANY = 20000, KINDS = 60 };
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(MANY, 2), *back;
    for (size_t i = 0; i < MANY; ++i) {
        *sgs_gaussians_at(model, i, 0) = 0.001f * (float)i;
        const uint64_t kind = sgsi_random_bits(5, i) % KINDS;
        for (int k = 0; k < 24; ++k)
            *sgs_gaussians_at(model, i, SGS_PARAM_SH_REST + k) =
                (float)sgsi_random_uniform(kind, (uint64_t)k);
    }
    sgs_model_write_options options = sgs_model_write_options_default();
    options.sh_palette = 1024;
    assert_int_equal(sgs_model_write(temp_path(&folder, "a.sog"), model, &options, NULL),
                     SGS_STATUS_OK);
    assert_int_equal(sgs_model_read(temp_path(&folder, "a.sog"), NULL, &back, NULL), SGS_STATUS_OK);
    double sums[2] = {0};
    for (size_t i = 0; i < MANY; ++i)
        for (int k = 0; k < 24; ++k) {
            sums[0] += (double)model_value(model, i, SGS_PARAM_SH_REST + k);
            sums[1] += (double)model_value(back, i, SGS_PARAM_SH_REST + k);
        }
    assert_true(fabs(sums[0] - sums[1]) <= 1e-3 * sums[0]);
    // Each set of values of `back` is near one of the kinds.
    for (size_t i = 0; i < MANY; i += 97) {
        double best = INFINITY;
        for (uint64_t kind = 0; kind < KINDS; ++kind) {
            double most = 0.0;
            for (int k = 0; k < 24; ++k)
                most = fmax(most, fabs((double)model_value(back, i, SGS_PARAM_SH_REST + k) -
                                       sgsi_random_uniform(kind, (uint64_t)k)));
            best = fmin(best, most);
        }
        assert_true(best <= 0.01);
    }
    sgs_gaussians_destroy(model);
    sgs_gaussians_destroy(back);
    temp_folder_remove(&folder);
}

// Most models without SH have zeros in all primitives. Their palette has the distinct vectors, or
// entries in proportion to them, and not thousands of equal entries.
static void equal_vectors_share_an_entry(void **state)
{
    (void)state;
    enum { COUNT = 4000, DIMENSIONS = 9, SIZE = 256 };
    float *vectors = calloc(COUNT, DIMENSIONS * sizeof *vectors);
    for (size_t step = 1000; step >= 10; step /= 100) { // 4 and 400 vectors differ from 0
        sgsi_palette palette;
        sgsi_progress progress;
        size_t entries_of_others = 0;
        for (size_t i = 0; i < COUNT; i += step)
            for (size_t k = 0; k < DIMENSIONS; ++k)
                vectors[DIMENSIONS * i + k] = (float)sgsi_random_uniform(i, k) + 0.5f;
        sgsi_progress_begin(&progress, NULL, NULL, SGSI_PALETTE_STEPS);
        assert_int_equal(
            sgsi_palette_train(vectors, COUNT, DIMENSIONS, SIZE, 10, &progress, &palette),
            SGS_STATUS_OK);
        sgsi_progress_end(&progress);
        assert_int_equal(palette.size, step == 1000 ? 5 : SIZE);
        for (size_t i = 0; i < COUNT; ++i) {
            const float *entry = palette.entries + DIMENSIONS * palette.labels[i];
            assert_true(palette.labels[i] < palette.size);
            for (size_t k = 0; k < DIMENSIONS; ++k)
                assert_true(fabsf(entry[k] - vectors[DIMENSIONS * i + k]) <=
                            (step == 1000 || i % step ? 0 : 0.7f));
        }
        for (size_t e = 0; e < palette.size; ++e)
            entries_of_others += palette.entries[DIMENSIONS * e] >= 0.5f;
        assert_true(entries_of_others + 10 >= palette.size);
        sgsi_palette_free(&palette);
    }
    free(vectors);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ply_keeps_all_bits),
        cmocka_unit_test(spz_rounds_to_half_a_quantum),
        cmocka_unit_test(splat_rounds_to_half_a_quantum),
        cmocka_unit_test(compressed_ply_rounds_to_half_a_quantum),
        cmocka_unit_test(ksplat_rounds_to_half_a_quantum),
        cmocka_unit_test(glb_and_usda_keep_all_values),
        cmocka_unit_test(sog_rounds_to_the_nearest_value),
        cmocka_unit_test(files_do_not_depend_on_threads),
        cmocka_unit_test(palette_finds_clusters),
        cmocka_unit_test(equal_vectors_share_an_entry),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
