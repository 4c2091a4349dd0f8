// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// SPZ files that are composed here after the specification of nianticlabs/spz, and the layout of
// written ones.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "formats/unpack.h"
#include "support/model_bytes.h"

static void put_spz_header(bytes *out, unsigned version, unsigned count, unsigned degree,
                           unsigned flags)
{
    put_u32(out, 0x5053474E);
    put_u32(out, version);
    put_u32(out, count);
    put_u8(out, degree);
    put_u8(out, 12);
    put_u8(out, flags);
    put_u8(out, 0);
}

// The streams of one primitive of SH degree 1, as separate pieces.
static void put_spz_stream(bytes *out, unsigned version, int stream)
{
    static const unsigned char position[] = {0x00, 0x10, 0x00, 0x00, 0xD8, 0xFF, 0x01, 0x00, 0x00};
    static const unsigned char sh[] = {144, 112, 128, 136, 120, 128, 0, 255, 160};
    switch (stream) {
    case 0:
        if (version > 1) {
            put(out, position, 9); // 1, -2.5, 1/4096
        } else {
            put_u16(out, 0x3C00); // binary16: 1, -2.5, 2^-24
            put_u16(out, 0xC100);
            put_u16(out, 0x0001);
        }
        break;
    case 1:
        put_u8(out, 204);
        break;
    case 2:
        put(out, (const unsigned char[]){153, 127, 0}, 3);
        break;
    case 3:
        put(out, (const unsigned char[]){96, 160, 0}, 3);
        break;
    case 4: // x = 256/511 sqrt(1/2), y = -100/511 sqrt(1/2), z = 0, w omitted
        if (version >= 3)
            put_u32(out, UINT32_C(3) << 30 | 256u << 20 | (512u | 100u) << 10);
        else
            put(out, (const unsigned char[]){191, 64, 127}, 3);
        break;
    default:
        put(out, sh, 9);
    }
}

static void check_spz(const sgs_gaussians *model, unsigned version, bool flip)
{
    const double sign = flip ? -1.0 : 1.0, half = sqrt(0.5);
    double x = 256.0 / 511 * half, y = -100.0 / 511 * half, z = 0;
    if (version < 3) {
        x = 191 / 127.5 - 1;
        y = 64 / 127.5 - 1;
        z = 127 / 127.5 - 1;
    }
    expect_row(model, 0, SGS_PARAM_MEAN, 3,
               (double[]){1, sign * -2.5, sign * (version > 1 ? 1.0 / 4096 : 0x1p-24)});
    expect(model, 0, SGS_PARAM_OPACITY, logit(0.8));
    expect_row(model, 0, SGS_PARAM_SH_DC, 3,
               (double[]){0.1 / 0.15, (127 / 255.0 - 0.5) / 0.15, -0.5 / 0.15});
    expect_row(model, 0, SGS_PARAM_SCALE, 3, (double[]){-4, 0, -10});
    expect_row(model, 0, SGS_PARAM_ROTATION, 4,
               (double[]){sqrt(1 - x * x - y * y - z * z), x, sign * y, sign * z});
    // Degree 1 is y, z, x: the first two change their signs.
    static const int raw[] = {16, -16, 0, 8, -8, 0, -128, 127, 32};
    for (int k = 0; k < 9; ++k)
        expect(model, 0, SGS_PARAM_SH_REST + k, (k < 6 ? sign : 1.0) * raw[k] / 128.0);
}

static void spz_in_gzip_is_read(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    for (unsigned version = 1; version <= 3; ++version)
        for (int record = 0; record < 2; ++record) {
            bytes payload = {.size = 0}, file = {.size = 0};
            sgs_model_info info;
            put_spz_header(&payload, version, 1, 1, record ? 3 : 0);
            for (int k = 0; k < 6; ++k)
                put_spz_stream(&payload, version, k);
            if (record) { // an unknown record, then the axes of the PLY
                put_u32(&payload, 0x12345678);
                put_u32(&payload, 3);
                put(&payload, "abc", 3);
                put_u32(&payload, 0xADBE0003);
                put_u32(&payload, 4);
                put_u32(&payload, 6);
            }
            uint8_t *packed;
            assert_int_equal(
                sgsi_pack(SGSI_PACKING_GZIP, 1, payload.data, payload.size, &packed, &file.size),
                SGS_STATUS_OK);
            memcpy(file.data, packed, file.size);
            sgsi_free(packed);
            sgs_gaussians *model = read_bytes(&folder, "a.spz", &payload, &info); // not compressed
            check_spz(model, version, !record);
            sgs_gaussians_destroy(model);
            model = read_bytes(&folder, "a.spz", &file, &info);
            assert_int_equal(info.version, version);
            assert_int_equal(info.antialiased, record);
            assert_int_equal(info.axes, record ? SGS_SPZ_AXES_RDF : SGS_SPZ_AXES_RUB);
            assert_int_equal(model->sh_degree, 1);
            check_spz(model, version, !record);
            sgs_gaussians_destroy(model);
            // The caller's word applies if the file names no axes.
            sgs_model_read_options options = sgs_model_read_options_default();
            options.spz_axes = SGS_SPZ_AXES_RDF;
            assert_int_equal(sgs_model_read(temp_path(&folder, "a.spz"), &options, &model, NULL),
                             SGS_STATUS_OK);
            check_spz(model, version, false);
            sgs_gaussians_destroy(model);
        }
    temp_folder_remove(&folder);
}

static void spz_with_frames_is_read(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    bytes file = {.size = 0}, frames = {.size = 0};
    sgs_model_info info;
    put_spz_header(&file, 4, 1, 1, 1);
    file.data[15] = 6;
    put_u32(&file, 32);
    for (int k = 0; k < 3; ++k)
        put_u32(&file, 0);
    for (int k = 0; k < 6; ++k) {
        bytes stream = {.size = 0};
        uint8_t *packed;
        size_t size;
        put_spz_stream(&stream, 4, k);
        assert_int_equal(sgsi_pack(SGSI_PACKING_ZSTD, 1, stream.data, stream.size, &packed, &size),
                         SGS_STATUS_OK);
        put(&frames, packed, size);
        put_u64(&file, size);
        put_u64(&file, stream.size);
        sgsi_free(packed);
    }
    put(&file, frames.data, frames.size);
    sgs_gaussians *model = read_bytes(&folder, "a.spz", &file, &info);
    assert_int_equal(info.version, 4);
    assert_true(info.antialiased);
    check_spz(model, 4, true);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// Positions far away keep their sign and size: fewer fractional bits instead of a wrap.
static void spz_does_not_wrap(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = model_random(3, 0), *back;
    *sgs_gaussians_at(model, 0, 0) = 5000.0f;
    *sgs_gaussians_at(model, 1, 1) = -8388600.0f;
    assert_int_equal(sgs_model_write(temp_path(&folder, "a.spz"), model, NULL, NULL),
                     SGS_STATUS_OK);
    assert_int_equal(sgs_model_read(temp_path(&folder, "a.spz"), NULL, &back, NULL), SGS_STATUS_OK);
    expect(back, 0, 0, 5000.0);
    expect(back, 1, 1, -8388600.0);
    sgs_gaussians_destroy(model);
    sgs_gaussians_destroy(back);
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(spz_in_gzip_is_read),
        cmocka_unit_test(spz_with_frames_is_read),
        cmocka_unit_test(spz_does_not_wrap),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
