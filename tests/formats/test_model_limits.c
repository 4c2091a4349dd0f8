// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Small files that expand to huge models: equal bytes compress a thousandfold, and manifests repeat
// units. They are refused before their data is decoded; compressible models of a plausible size are
// read.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <jansson.h>
#include <time.h>

#include "formats/model_rows.h"
#include "formats/sog.h"
#include "formats/unpack.h"
#include "support/bad_input.h"
#include "support/files_support.h"
#include "support/model_support.h"
#include "sparegs/model_file.h"

enum { MANY = 300000, SIDE = 600 }; // SIDE^2 >= MANY

static void refuse(const char *path, sgs_status expected, const char *message)
{
    sgs_gaussians *model = (sgs_gaussians *)path;
    const sgs_status status = sgs_model_read(path, NULL, &model, NULL);
    if (status != expected || strncmp(sgs_last_error(), path, strlen(path)) ||
        !strstr(sgs_last_error(), message))
        fail_msg("status %d with '%s', expected %d with '%s'", status, sgs_last_error(), expected,
                 message);
    assert_null(model);
    bad_input();
}

static void accept(const char *path, size_t count)
{
    sgs_gaussians *model;
    if (sgs_model_read(path, NULL, &model, NULL))
        fail_msg("%s", sgs_last_error());
    assert_int_equal(model->count, count);
    sgs_gaussians_destroy(model);
}

// ---- SPZ ----

static void put_spz_header(uint8_t *at, uint32_t version, uint32_t count)
{
    memcpy(at, "NGSP", 4);
    sgsi_store_u32(at + 4, version);
    sgsi_store_u32(at + 8, count);
    at[13] = 12; // fractional bits
}

// Version 4 with streams of zeros.
static void put_spz_4(const char *path, uint32_t count)
{
    static const size_t widths[5] = {9, 1, 3, 3, 4};
    uint8_t *file = calloc(1, 1 << 16), *zeros = calloc(count, 9);
    size_t at = 32 + 5 * 16;
    assert_true(file && zeros);
    put_spz_header(file, 4, count);
    file[15] = 5;
    sgsi_store_u32(file + 16, 32);
    for (size_t k = 0; k < 5; ++k) {
        uint8_t *packed;
        size_t size;
        assert_int_equal(sgsi_pack(SGSI_PACKING_ZSTD, 1, zeros, widths[k] * count, &packed, &size),
                         SGS_STATUS_OK);
        assert_true(at + size < 1 << 16);
        memcpy(file + at, packed, size);
        sgsi_store_u64(file + 32 + 16 * k, size);
        sgsi_store_u64(file + 40 + 16 * k, widths[k] * count);
        at += size;
        sgsi_free(packed);
    }
    file_put(path, file, at);
    free(file);
    free(zeros);
}

// Version 3: a header and `size` zeros.
static void put_spz_3(const char *path, uint32_t count, size_t size)
{
    uint8_t *plain = calloc(1, 16 + size), *packed;
    size_t packed_size;
    assert_non_null(plain);
    put_spz_header(plain, 3, count);
    assert_int_equal(sgsi_pack(SGSI_PACKING_GZIP, 9, plain, 16 + size, &packed, &packed_size),
                     SGS_STATUS_OK);
    file_put(path, packed, packed_size);
    sgsi_free(packed);
    free(plain);
}

static void spz_of_zeros_is_refused(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a.spz");
    put_spz_4(path, MANY);
    refuse(path, SGS_STATUS_LIMIT, "byte 8: 300000 primitives are more than a file of");
    put_spz_4(path, 65536);
    accept(path, 65536);
    put_spz_3(path, MANY, 20 * (size_t)MANY);
    refuse(path, SGS_STATUS_LIMIT, "byte 8: 300000 primitives are more than a file of");
    put_spz_3(path, 65536, 20 * 65536);
    accept(path, 65536);
    put_spz_3(path, 1, (size_t)32 << 20);
    refuse(path, SGS_STATUS_FORMAT, "gzip data decompresses to more than");
    temp_folder_remove(&folder);
}

// `count` primitives of equal shape and colour: at one place, or on a grid.
static sgs_gaussians *model_uniform(size_t count, size_t side)
{
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(count, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, count), SGS_STATUS_OK);
    model->sh_degree = 0;
    for (size_t i = 0; i < count; ++i) {
        float p[SGS_PARAM_COUNT] = {0};
        if (side) {
            p[SGS_PARAM_MEAN] = (float)(i % side) / 256.0f;
            p[SGS_PARAM_MEAN + 1] = (float)(i / side % side) / 256.0f;
            p[SGS_PARAM_MEAN + 2] = (float)(i / side / side) / 256.0f;
        }
        p[SGS_PARAM_ROTATION] = 1.0f;
        sgs_gaussians_set(model, i, p);
    }
    return model;
}

static void compressible_spz_is_read_back(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "a.spz");
    sgs_model_write_options options = sgs_model_write_options_default();
    for (size_t side = 0; side <= 64; side += 64) {
        sgs_gaussians *model = model_uniform(64 * 64 * 64, side);
        for (options.spz_version = 3; options.spz_version <= 4; ++options.spz_version) {
            assert_int_equal(sgs_model_write(path, model, &options, NULL), SGS_STATUS_OK);
            accept(path, model->count);
        }
        sgs_gaussians_destroy(model);
    }
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(spz_of_zeros_is_refused),
        cmocka_unit_test(compressible_spz_is_read_back),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
