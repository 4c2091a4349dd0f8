// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// What holds for every compression method: files decode to the same bits with any number of threads
// and instruction set, a second compression gives the same file, and truncated, damaged or hostile
// files give one error that names the file.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/threads.h"
#include "sparegs/runtime.h"
#include "support/bad_input.h"
#include "support/compress_support.h"
#include "support/files_support.h"

static const sgs_compress_method tested[] = {SGS_COMPRESS_LIGHTGAUSSIAN, SGS_COMPRESS_SOG,
                                             SGS_COMPRESS_MESONGS, SGS_COMPRESS_GHAP,
                                             SGS_COMPRESS_FCGS_LIKE};
enum { TESTED = sizeof tested / sizeof *tested, COUNT = 600 };

// A small codebook keeps the test fast.
static sgs_compress_options options_of(sgs_compress_method method, int preset)
{
    sgs_compress_options options = sgs_compress_options_default();
    options.method = method;
    options.preset = preset;
    options.finetune = 0;
    options.codebook = 64;
    options.vq_steps = 20;
    return options;
}

static void compress_to(const char *path, const sgs_gaussians *model, sgs_compress_method method,
                        int preset)
{
    const sgs_compress_options options = options_of(method, preset);
    sgs_compress_info info;
    assert_int_equal(sgs_compress(model, &options, path, &info), SGS_STATUS_OK);
    assert_int_equal(info.input, model->count);
    assert_in_range(info.gaussians, 1, model->count);
    size_t size;
    free(file_get(path, &size));
    assert_int_equal(info.bytes, size);
}

static void files_decode_equally_with_any_threads(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = pack_model(COUNT, 3, 1);
    for (int m = 0; m < TESTED; ++m)
        for (int preset = 1; preset <= 3; ++preset) {
            unsigned char *first = NULL;
            size_t first_size = 0;
            compress_to(temp_path(&folder, "pack"), model, tested[m], preset);
            for (int threads = 1; threads <= 3; ++threads)
                for (int isa = 0; isa < 3; ++isa) {
                    if (sgs_isa_set((sgs_isa)isa))
                        continue; // not on this machine
                    sgsi_threads_set(threads);
                    sgs_gaussians *decoded;
                    size_t size;
                    assert_int_equal(sgs_decompress(temp_path(&folder, "pack"), &decoded, NULL), 0);
                    assert_int_equal(sgs_ply_write(temp_path(&folder, "out.ply"), decoded), 0);
                    sgs_gaussians_destroy(decoded);
                    unsigned char *bytes = file_get(temp_path(&folder, "out.ply"), &size);
                    if (first) {
                        assert_int_equal(size, first_size);
                        assert_memory_equal(bytes, first, size);
                        free(bytes);
                    } else {
                        first = bytes;
                        first_size = size;
                    }
                }
            free(first);
        }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

static void compression_does_not_depend_on_threads(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = pack_model(COUNT, 3, 2);
    for (int m = 0; m < TESTED; ++m) {
        size_t sizes[2];
        unsigned char *bytes[2];
        for (int k = 0; k < 2; ++k) {
            sgsi_threads_set(1 + 2 * k);
            compress_to(temp_path(&folder, "pack"), model, tested[m], 2);
            bytes[k] = file_get(temp_path(&folder, "pack"), &sizes[k]);
        }
        assert_int_equal(sizes[0], sizes[1]);
        assert_memory_equal(bytes[0], bytes[1], sizes[0]);
        free(bytes[0]);
        free(bytes[1]);
    }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// Models of 1 and 17 primitives and of every SH degree.
static void small_models_and_all_degrees_work(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    for (int m = 0; m < TESTED; ++m)
        for (int degree = 0; degree <= 3; ++degree)
            for (size_t count = 1; count < 40; count += 16) {
                sgs_gaussians *model = pack_model(count, degree, 3), *decoded;
                sgs_compress_info info;
                compress_to(temp_path(&folder, "pack"), model, tested[m], 1);
                assert_int_equal(sgs_decompress(temp_path(&folder, "pack"), &decoded, &info), 0);
                assert_int_equal(info.method, tested[m]);
                assert_int_equal(info.input, count);
                assert_int_equal(decoded->count, info.gaussians);
                assert_int_equal(decoded->sh_degree, degree);
                sgs_gaussians_destroy(model);
                sgs_gaussians_destroy(decoded);
            }
    temp_folder_remove(&folder);
}

// ---- Hostile files ----

typedef struct pack_bytes {
    unsigned char *bytes;
    size_t size;
    bool sealed; // checksums are corrected afterwards
} pack_bytes;

static size_t data_at(const pack_bytes *p)
{
    return PACK_HEADER + pack_get(p->bytes, 56, 4) * PACK_ENTRY + 8;
}

static void cut(pack_bytes *p, size_t size, bool sealed)
{
    p->size = size;
    p->sealed = sealed;
}

static void field(pack_bytes *p, size_t at, uint64_t value, size_t width)
{
    pack_put(p->bytes, at, value, width);
    p->sealed = true;
}

static void damage(pack_bytes *p, int kind)
{
    const size_t entry = PACK_HEADER, data = data_at(p);
    switch (kind) {
    case 0:
        return cut(p, 0, false);
    case 1:
        return cut(p, 7, false);
    case 2:
        p->bytes[7] = '2';
        return;
    case 3:
        return cut(p, 40, false);
    case 4:
        return cut(p, PACK_HEADER + 20, true);
    case 5:
        return cut(p, p->size - 1, false);
    case 6:
        return cut(p, p->size - 1, true);
    case 7:
        return cut(p, data, true);
    case 8:
        p->bytes[p->size++] = 0;
        return;
    case 9:
        p->bytes[p->size++] = 0;
        p->sealed = true;
        return;
    case 10:
        return field(p, 8, 0x7A7A7A7A, 4);
    case 11:
        return field(p, 24, 99, 4);
    case 12:
        return field(p, 28, 4, 4);
    case 13:
        return field(p, 32, 0, 8);
    case 14:
        return field(p, 32, UINT64_C(1) << 40, 8);
    case 15:
        return field(p, 32, pack_get(p->bytes, 32, 8) + 1, 8);
    case 16:
        return field(p, 40, 0, 8);
    case 17:
        return field(p, 56, 65, 4);
    case 18:
        return field(p, 56, 0, 4);
    case 19:
        return field(p, entry, 0x5A5A5A5A5A, 8);
    case 20:
        memcpy(p->bytes + entry + PACK_ENTRY, p->bytes + entry, 16);
        p->sealed = true;
        return;
    case 21:
        return field(p, entry + 16, 7, 4);
    case 22:
        return field(p, entry + 24, UINT64_C(1) << 62, 8);
    case 23:
        return field(p, entry + 32, UINT64_C(1) << 50, 8);
    case 24:
        p->bytes[data] ^= 1;
        return;
    case 25:
        p->bytes[entry + 32] ^= 1;
        return;
    case 26:
        return field(p, entry + 1, 7, 1);
    case 27:
        return field(p, 28, (pack_get(p->bytes, 28, 4) + 1) % 4, 4);
    case 28:
        return field(p, entry + 32, pack_get(p->bytes, entry + 32, 8) + 1, 8);
    default:
        return field(p, 0, 0x1A0A0D0A474E5089, 8);
    }
}

static const char *const messages[] = {
    "not a compressed model of sparegs",
    "not a compressed model of sparegs",
    "not a compressed model of sparegs",
    "the file ends inside the header",
    "sections are too many",
    "bytes instead of",
    "ends after the end of the file",
    "ends after the end of the file",
    "bytes instead of",
    "1 bytes after the last section",
    "unknown compression method",
    "version 99 of method",
    "SH degree 4 is above 3",
    "0 primitives do not fit into the file",
    "1099511627776 primitives do not fit into the file",
    "", // depends on the method
    "primitives do not fit into the file",
    "65 sections are too many",
    "bytes after the last section",
    "section '",
    "occurs twice",
    "has unknown coding 7",
    "ends after the end of the file",
    "cannot contain",
    "wrong checksum of section",
    "wrong checksum of the header",
    "has an invalid name",
    "",
    "",
    "not a compressed model of sparegs",
};
enum { DAMAGES = sizeof messages / sizeof *messages };

static void hostile_files_are_refused(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = pack_model(COUNT, 2, 4);
    const char *path = temp_path(&folder, "pack");
    for (int m = 0; m < TESTED; ++m) {
        size_t size;
        compress_to(path, model, tested[m], 1);
        unsigned char *good = file_get(path, &size);
        pack_bytes p = {.bytes = malloc(size + 8)};
        for (int kind = 0; kind < DAMAGES; ++kind) {
            memcpy(p.bytes, good, size);
            p.size = size;
            p.sealed = false;
            damage(&p, kind);
            if (p.sealed)
                pack_reseal(p.bytes, p.size);
            file_put(path, p.bytes, p.size);
            sgs_gaussians *decoded = model;
            const sgs_status status = sgs_decompress(path, &decoded, NULL);
            if (status != SGS_STATUS_FORMAT && status != SGS_STATUS_UNSUPPORTED)
                fail_msg("%s, damage %d: status %d", sgs_compress_method_name(tested[m]), kind,
                         status);
            assert_null(decoded);
            const char *error = sgs_last_error();
            if (strncmp(error, path, strlen(path)) || strchr(error, '\n') ||
                !strstr(error, messages[kind]))
                fail_msg("%s, damage %d: '%s'", sgs_compress_method_name(tested[m]), kind, error);
            bad_input();
        }
        free(p.bytes);
        free(good);
    }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// A changed byte in the content of a section is either refused or decodes to finite values.
static void changed_contents_never_give_broken_models(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = pack_model(300, 1, 5);
    const char *path = temp_path(&folder, "pack");
    for (int m = 0; m < TESTED; ++m) {
        size_t size, refused = 0;
        compress_to(path, model, tested[m], 3);
        unsigned char *bytes = file_get(path, &size);
        const size_t begin = PACK_HEADER + pack_get(bytes, 56, 4) * PACK_ENTRY + 8;
        for (uint64_t k = 0; k < 100; ++k) {
            const size_t at = begin + sgsi_random_bits(6, k) % (size - begin);
            const unsigned char kept = bytes[at];
            bytes[at] ^= (unsigned char)(1 + sgsi_random_bits(7, k) % 255);
            pack_reseal(bytes, size);
            file_put(path, bytes, size);
            bytes[at] = kept;
            sgs_gaussians *decoded;
            if (sgs_decompress(path, &decoded, NULL)) {
                assert_non_null(strstr(sgs_last_error(), path));
                assert_null(strchr(sgs_last_error(), '\n'));
                ++refused;
                continue;
            }
            for (size_t i = 0; i < decoded->count; ++i) {
                float row[SGS_PARAM_COUNT];
                sgs_gaussians_get(decoded, i, row);
                for (int c = 0; c < SGS_PARAM_COUNT; ++c)
                    assert_true(isfinite(row[c]));
            }
            sgs_gaussians_destroy(decoded);
        }
        free(bytes);
        print_message("%s: %zu of 100 changed files refused\n", sgs_compress_method_name(tested[m]),
                      refused);
    }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// ---- Options ----

static void invalid_options_are_refused(void **state)
{
    (void)state;
    sgs_gaussians *model = pack_model(20, 0, 8), *empty = pack_model(0, 0, 8);
    sgs_compress_options options = sgs_compress_options_default();
    options.method = SGS_COMPRESS_FCGS;
    assert_int_equal(sgs_compress(model, &options, "none", NULL), SGS_STATUS_UNSUPPORTED);
    assert_non_null(strstr(sgs_last_error(), "fcgs-like"));
    options.method = SGS_COMPRESS_GHAP;
    options.preset = 4;
    assert_int_equal(sgs_compress(model, &options, "none", NULL), SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "preset = 4 is not in [1, 3]"));
    options.preset = 1;
    assert_int_equal(sgs_compress(empty, &options, "none", NULL), SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "no primitives"));
    *sgs_gaussians_at(model, 7, SGS_PARAM_MEAN) = NAN;
    assert_int_equal(sgs_compress(model, &options, "none", NULL), SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "primitive 7"));
    *sgs_gaussians_at(model, 7, SGS_PARAM_MEAN) = 0;
    for (int method = 0; method < SGS_COMPRESS_FCGS; ++method)
        for (int degree = -1; degree <= 4; degree += 5) {
            options.method = (sgs_compress_method)method;
            model->sh_degree = degree;
            assert_int_equal(sgs_compress(model, &options, "none", NULL),
                             SGS_STATUS_INVALID_ARGUMENT);
            assert_non_null(strstr(sgs_last_error(), "none: SH degree"));
        }
    assert_int_equal(access("none", F_OK), -1);
    sgs_gaussians_destroy(model);
    sgs_gaussians_destroy(empty);
}

static bool stop(void *user, const char *stage, size_t done, size_t total)
{
    assert_non_null(stage);
    assert_true(done <= total);
    ++*(int *)user;
    return false;
}

// What would be stored as an infinite scale, or as a covariance beyond float, is refused by name.
static void scales_out_of_range_are_refused(void **state)
{
    (void)state;
    static const float values[] = {44.5f, 45, 89, 1e30f, INFINITY};
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "pack");
    for (int m = 0; m < TESTED; ++m) {
        sgs_gaussians *model = pack_model(COUNT, 1, 9), *decoded;
        const sgs_compress_options options = options_of(tested[m], 1);
        for (size_t k = 0; k < sizeof values / sizeof *values; ++k) {
            *sgs_gaussians_at(model, 7, SGS_PARAM_SCALE + 1) = values[k];
            assert_int_equal(sgs_compress(model, &options, path, NULL),
                             SGS_STATUS_INVALID_ARGUMENT);
            assert_non_null(strstr(sgs_last_error(), "primitive 7 has a "));
            assert_int_equal(temp_folder_count(&folder), 0);
        }
        *sgs_gaussians_at(model, 7, SGS_PARAM_SCALE + 1) = 44;
        if (sgs_compress(model, &options, path, NULL) || sgs_decompress(path, &decoded, NULL))
            fail_msg("%s: %s", sgs_compress_method_name(tested[m]), sgs_last_error());
        sgs_gaussians_destroy(decoded);
        sgs_gaussians_destroy(model);
        remove(path);
    }
    temp_folder_remove(&folder);
}

// Opacity 1 and 0, as in files that other programs write; sgs_ply_read documents the same logits.
static void infinite_logits_are_opacities(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "pack");
    for (int m = 0; m < TESTED; ++m) {
        sgs_gaussians *model = pack_model(COUNT, 1, 9), *finite = pack_model(COUNT, 1, 9);
        sgs_gaussians *decoded[2];
        const sgs_compress_options options = options_of(tested[m], 1);
        *sgs_gaussians_at(model, 7, SGS_PARAM_OPACITY) = INFINITY;
        *sgs_gaussians_at(model, 8, SGS_PARAM_OPACITY) = -INFINITY;
        *sgs_gaussians_at(finite, 7, SGS_PARAM_OPACITY) = 13.8155096f;
        *sgs_gaussians_at(finite, 8, SGS_PARAM_OPACITY) = -13.8155096f;
        for (int k = 0; k < 2; ++k)
            if (sgs_compress(k ? finite : model, &options, path, NULL) ||
                sgs_decompress(path, &decoded[k], NULL))
                fail_msg("%s: %s", sgs_compress_method_name(tested[m]), sgs_last_error());
        char hashes[2][17];
        for (int k = 0; k < 2; ++k)
            sgs_gaussians_hash(decoded[k], hashes[k]);
        assert_string_equal(hashes[0], hashes[1]);
        sgs_gaussians_linearize_opacity(model);
        *sgs_gaussians_at(model, 7, SGS_PARAM_OPACITY) = INFINITY;
        assert_int_equal(sgs_compress(model, &options, path, NULL), SGS_STATUS_INVALID_ARGUMENT);
        assert_string_equal(sgs_last_error(),
                            "primitive 7 has a parameter that is not finite; remove it");
        for (int k = 0; k < 2; ++k)
            sgs_gaussians_destroy(decoded[k]);
        sgs_gaussians_destroy(model);
        sgs_gaussians_destroy(finite);
    }
    temp_folder_remove(&folder);
}

static void cancelling_leaves_the_old_file(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = pack_model(COUNT, 1, 9);
    const char *path = temp_path(&folder, "pack");
    file_put(path, "old", 3);
    for (int m = 0; m < TESTED; ++m) {
        sgs_compress_options options = options_of(tested[m], 1);
        int calls = 0;
        options.progress = stop;
        options.progress_user = &calls;
        assert_int_equal(sgs_compress(model, &options, path, NULL), SGS_STATUS_CANCELLED);
        assert_int_equal(calls, 1);
        size_t size;
        free(file_get(path, &size));
        assert_int_equal(size, 3);
        assert_int_equal(temp_folder_count(&folder), 1);
    }
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// Position of the section with these marks in a file, or SIZE_MAX.
static size_t find_marks(const unsigned char *bytes, size_t size)
{
    static const unsigned char marks[16] = {1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x10, 0x40};
    const unsigned char *at = memmem(bytes, size, marks, sizeof marks);
    return at ? (size_t)(at - bytes) : SIZE_MAX;
}

static void marks_are_kept(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = NULL, *decoded;
    const char *path = temp_path(&folder, "pack");
    sgs_compress_info info;
    size_t size;
    for (int k = 0; k < 2 * TESTED; ++k) { // without SH, then of degree 1
        const int m = k % TESTED;
        sgs_gaussians_destroy(model);
        model = pack_model(COUNT, k / TESTED, 9);
        sgs_compress_options options = options_of(tested[m], 3);
        options.antialiased = true;
        options.colors = (sgs_model_colors){true, SGS_SPACE_LINEAR, 4.0};
        assert_int_equal(sgs_compress(model, &options, path, &info), SGS_STATUS_OK);
        memset(&info, 0, sizeof info);
        assert_int_equal(sgs_decompress(path, &decoded, &info), SGS_STATUS_OK);
        sgs_gaussians_destroy(decoded);
        sgs_compress_info described = {0};
        assert_true(sgs_is_compressed(path));
        assert_int_equal(sgs_compress_info_read(path, &described), SGS_STATUS_OK);
        assert_int_equal(described.method, tested[m]);
        assert_int_equal(described.input, COUNT);
        assert_int_equal(described.gaussians, info.gaussians);
        assert_int_equal(described.bytes, info.bytes);
        assert_int_equal(described.sh_degree, k / TESTED);
        assert_true(described.antialiased && described.colors.space_known);
        assert_int_equal(described.colors.space, SGS_SPACE_LINEAR);
        assert_true(described.colors.white_point == 4.0);
        assert_true(info.antialiased && info.colors.space_known);
        assert_int_equal(info.colors.space, SGS_SPACE_LINEAR);
        assert_true(info.colors.white_point == 4.0);
    }
    static const struct {
        size_t at;
        unsigned char value;
    } wrong[] = {{0, 2}, {1, 2}, {2, 2}, {15, 0xC0}, {15, 0x7F}}; // the last: 2^1009, still finite
    unsigned char *bytes = file_get(path, &size);
    const size_t marks = find_marks(bytes, size);
    assert_true(marks < size);
    for (size_t k = 0; k < sizeof wrong / sizeof *wrong; ++k) {
        const unsigned char kept = bytes[marks + wrong[k].at];
        bytes[marks + wrong[k].at] = wrong[k].value;
        pack_reseal(bytes, size);
        file_put(path, bytes, size);
        bytes[marks + wrong[k].at] = kept;
        const sgs_status status = sgs_decompress(path, &decoded, NULL);
        sgs_gaussians_destroy(decoded);
        assert_int_equal(status, k < 4 ? SGS_STATUS_FORMAT : SGS_STATUS_OK);
        assert_true(k == 4 || strstr(sgs_last_error(), "section 'marks'"));
        assert_int_equal(sgs_compress_info_read(path, &info), status);
    }
    file_put(path, "SGSPACK", 7);
    assert_false(sgs_is_compressed(path));
    assert_false(sgs_is_compressed(temp_path(&folder, "missing")));
    free(bytes);
    // The usual model has no such section.
    sgs_compress_options options = options_of(SGS_COMPRESS_GHAP, 3);
    options.colors.space_known = true;
    assert_int_equal(sgs_compress(model, &options, path, NULL), SGS_STATUS_OK);
    bytes = file_get(path, &size);
    assert_null(memmem(bytes, size, "marks", 5));
    free(bytes);
    assert_int_equal(sgs_decompress(path, &decoded, &info), SGS_STATUS_OK);
    assert_false(info.antialiased || info.colors.space_known || info.colors.white_point > 0.0);
    sgs_gaussians_destroy(decoded);
    options.colors.white_point = (double)NAN;
    assert_int_equal(sgs_compress(model, &options, path, NULL), SGS_STATUS_INVALID_ARGUMENT);
    options.colors.white_point = 0.0;
    options.colors.space = (sgs_space)2;
    assert_int_equal(sgs_compress(model, &options, path, NULL), SGS_STATUS_INVALID_ARGUMENT);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(files_decode_equally_with_any_threads),
        cmocka_unit_test(compression_does_not_depend_on_threads),
        cmocka_unit_test(small_models_and_all_degrees_work),
        cmocka_unit_test(hostile_files_are_refused),
        cmocka_unit_test(changed_contents_never_give_broken_models),
        cmocka_unit_test(invalid_options_are_refused),
        cmocka_unit_test(cancelling_leaves_the_old_file),
        cmocka_unit_test(scales_out_of_range_are_refused),
        cmocka_unit_test(infinite_logits_are_opacities),
        cmocka_unit_test(marks_are_kept),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
