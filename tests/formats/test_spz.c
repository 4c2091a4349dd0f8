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

#include "formats/small_formats.h"
#include "storage/unpack.h"
#include "support/model_bytes.h"
#include "support/warning_support.h"

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

// ---- Coordinate systems ----

// By the value of the record, after nianticlabs/spz: the directions of x, y and z. Its library
// reads 9, 10, 15 and 16 with other axes than their names say; they are refused.
static const char *const names[] = {"",    "LDB", "RDB", "LUB", "RUB", "LDF", "RDF", "LUF",
                                    "RUF", "",    "",    "LFU", "RFU", "LBD", "RBD"};
static const sgs_spz_axes systems[] = {0,
                                       SGS_SPZ_AXES_LDB,
                                       SGS_SPZ_AXES_RDB,
                                       SGS_SPZ_AXES_LUB,
                                       SGS_SPZ_AXES_RUB,
                                       SGS_SPZ_AXES_LDF,
                                       SGS_SPZ_AXES_RDF,
                                       SGS_SPZ_AXES_LUF,
                                       SGS_SPZ_AXES_RUF,
                                       0,
                                       0,
                                       SGS_SPZ_AXES_LFU,
                                       SGS_SPZ_AXES_RFU,
                                       SGS_SPZ_AXES_LBD,
                                       SGS_SPZ_AXES_RBD};

// Rows: right, down and front of the file's axes.
static void to_ply(const char *name, double map[3][3])
{
    static const char positive[] = "RDF", negative[] = "LUB";
    for (int k = 0; k < 3; ++k)
        for (int j = 0; j < 3; ++j)
            map[j][k] = (name[k] == positive[j]) - (name[k] == negative[j]);
}

static void multiply(const double map[3][3], const double v[3], double out[3])
{
    for (int j = 0; j < 3; ++j)
        out[j] = map[j][0] * v[0] + map[j][1] * v[1] + map[j][2] * v[2];
}

static void covariance(const sgs_gaussians *model, double out[3][3])
{
    double q[4], r[3][3];
    for (int k = 0; k < 4; ++k)
        q[k] = (double)model_value(model, 0, SGS_PARAM_ROTATION + k);
    const double w = q[0], x = q[1], y = q[2], z = q[3];
    const double rotation[3][3] = {
        {1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
        {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
        {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
    for (int j = 0; j < 3; ++j)
        for (int k = 0; k < 3; ++k)
            r[j][k] = rotation[j][k] * exp((double)model_value(model, 0, SGS_PARAM_SCALE + k));
    for (int j = 0; j < 3; ++j)
        for (int k = 0; k < 3; ++k)
            out[j][k] = r[j][0] * r[k][0] + r[j][1] * r[k][1] + r[j][2] * r[k][2];
}

// A primitive of SH degree 3 in axes of which the record has this value.
static sgs_gaussians *read_system(const temp_folder *folder, unsigned record, sgs_model_info *info)
{
    bytes file = {.size = 0};
    put_spz_header(&file, 3, 1, 3, 2);
    for (int k = 0; k < 5; ++k)
        put_spz_stream(&file, 3, k);
    for (unsigned k = 0; k < 45; ++k)
        put_u8(&file, 37 * k * k % 251);
    put_u32(&file, 0xADBE0003);
    put_u32(&file, 4);
    put_u32(&file, record);
    return read_bytes(folder, "a.spz", &file, info);
}

// Positions, shapes and colours are those that the letters name. A file in the axes of the PLY
// holds the values as they are.
static void spz_in_any_axes_is_read(void **state)
{
    (void)state;
    static const double directions[][3] = {{1, 0, 0},      {0, 1, 0},         {0, 0, 1},
                                           {0.6, 0, -0.8}, {0.48, 0.64, 0.6}, {-0.36, 0.48, -0.8}};
    const temp_folder folder = temp_folder_make();
    sgs_model_info info;
    sgs_gaussians *raw = read_system(&folder, 6, &info);
    double shape[3][3];
    covariance(raw, shape);
    for (unsigned record = 1; record < sizeof names / sizeof *names; ++record) {
        if (!*names[record])
            continue;
        sgs_gaussians *model = read_system(&folder, record, &info);
        double map[3][3], mean[3], turned[3], actual[3][3];
        assert_int_equal(info.axes, systems[record]);
        to_ply(names[record], map);
        multiply(map, (const double[]){1, -2.5, 1.0 / 4096}, mean);
        expect_row(model, 0, SGS_PARAM_MEAN, 3, mean);
        covariance(model, actual);
        for (int j = 0; j < 3; ++j)
            for (int k = 0; k < 3; ++k) {
                double sum = 0;
                for (int m = 0; m < 9; ++m)
                    sum += map[j][m / 3] * shape[m / 3][m % 3] * map[k][m % 3];
                if (!(fabs(actual[j][k] - sum) <= 1e-6))
                    fail_msg("%s: covariance %d, %d is %.9g, expected %.9g", names[record], j, k,
                             actual[j][k], sum);
            }
        for (size_t k = 0; k < sizeof directions / sizeof *directions; ++k) {
            multiply(map, directions[k], turned);
            const double here = model_radiance(model, 0, turned, 0),
                         there = model_radiance(raw, 0, directions[k], 0);
            if (!(fabs(here - there) <= 1e-5))
                fail_msg("%s: direction %zu is %.9g, expected %.9g", names[record], k, here, there);
        }
        sgs_gaussians_destroy(model);
    }
    sgs_gaussians_destroy(raw);
    temp_folder_remove(&folder);
}

// The option names the axes of a file without the record. Only three systems are written.
static void spz_axes_are_an_option(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_model_info info;
    sgs_model_read_options options = sgs_model_read_options_default();
    sgs_model_write_options write = sgs_model_write_options_default();
    sgs_gaussians *model = model_random(2, 3), *back, *rub;
    write.spz_version = 3;
    assert_int_equal(sgs_model_write(temp_path(&folder, "a.spz"), model, &write, NULL),
                     SGS_STATUS_OK);
    assert_int_equal(sgs_model_read(temp_path(&folder, "a.spz"), NULL, &rub, NULL), SGS_STATUS_OK);
    options.spz_axes = SGS_SPZ_AXES_RFU;
    assert_int_equal(sgs_model_read(temp_path(&folder, "a.spz"), &options, &back, &info),
                     SGS_STATUS_OK);
    assert_int_equal(info.axes, SGS_SPZ_AXES_RFU);
    expect(back, 1, 0, (double)model_value(rub, 1, 0)); // y is front, z is up
    expect(back, 1, 1, (double)model_value(rub, 1, 2));
    expect(back, 1, 2, -(double)model_value(rub, 1, 1));
    sgs_gaussians_destroy(back);
    options.spz_axes = SGS_SPZ_AXES_COUNT;
    assert_int_equal(sgs_model_read(temp_path(&folder, "a.spz"), &options, &back, NULL),
                     SGS_STATUS_INVALID_ARGUMENT);
    write.spz_axes = SGS_SPZ_AXES_RUF;
    assert_int_equal(sgs_model_write(temp_path(&folder, "a.spz"), model, &write, NULL),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "a.spz: spz_axes 7 cannot be written"));
    sgs_gaussians_destroy(model);
    sgs_gaussians_destroy(rub);
    temp_folder_remove(&folder);
}

// The library of nianticlabs/spz read at most 10,000,000 primitives before it had version 4.
static void spz_beyond_the_limit_of_older_readers_is_reported(void **state)
{
    (void)state;
    static const struct {
        int version;
        size_t count;
        bool warns;
    } cases[] = {{3, 10000000, false}, {3, 10000001, true}, {4, 10000001, false}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        warnings_begin(NULL);
        sgsi_spz_warn_count("a.spz", cases[k].version, cases[k].count);
        warnings_end();
        assert_string_equal(warnings, cases[k].warns
                                          ? "a.spz: older readers refuse SPZ files of version 3 "
                                            "with more than 10000000 primitives; this one has "
                                            "10000001; use option spz_version 4, whose readers "
                                            "have no limit, or prune the model\n"
                                          : "");
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(spz_in_gzip_is_read),
        cmocka_unit_test(spz_with_frames_is_read),
        cmocka_unit_test(spz_does_not_wrap),
        cmocka_unit_test(spz_in_any_axes_is_read),
        cmocka_unit_test(spz_axes_are_an_option),
        cmocka_unit_test(spz_beyond_the_limit_of_older_readers_is_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
