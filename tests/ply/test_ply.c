// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Model files: the layout equals that of 3DGS byte by byte, values survive bit by bit, other
// property orders and types are read, and a failed write preserves the previous file.
// test_ply_errors.c covers invalid files.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <math.h>

#include "base/core.h"
#include "support/files_support.h"
#include "support/locale_support.h"
#include "support/skip_support.h"
#include "support/warning_support.h"
#include "sparegs/gaussians.h"
#include "sparegs/render.h"

static sgs_gaussians *random_model(size_t count, int degree)
{
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(count, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, count), SGS_STATUS_OK);
    model->sh_degree = degree;
    const int used = SGS_PARAM_SH_REST + 3 * ((degree + 1) * (degree + 1) - 1);
    for (size_t i = 0; i < count; ++i) {
        for (int k = 0; k < used; ++k)
            *sgs_gaussians_at(model, i, k) = (float)sgsi_random_normal(i, (uint64_t)k);
    }
    return model;
}

static void assert_same_model(const sgs_gaussians *a, const sgs_gaussians *b)
{
    char x[17], y[17];
    sgs_gaussians_hash(a, x);
    sgs_gaussians_hash(b, y);
    assert_int_equal(a->count, b->count);
    assert_int_equal(a->sh_degree, b->sh_degree);
    assert_string_equal(x, y);
}

static void ply_survives_a_round_trip_bit_by_bit(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    static const size_t counts[] = {0, 1, 15, 16, 17, 255, 256, 257, 2000};
    for (int degree = 0; degree <= 3; ++degree) {
        for (size_t c = 0; c < sizeof counts / sizeof *counts; ++c) {
            sgs_gaussians *model = random_model(counts[c], degree), *back;
            if (counts[c] > 1) {
                *sgs_gaussians_at(model, 1, SGS_PARAM_MEAN) = -0.0f;
                *sgs_gaussians_at(model, 1, SGS_PARAM_MEAN + 1) = 1e-42f; // subnormal
                *sgs_gaussians_at(model, 1, SGS_PARAM_OPACITY) = 3.4028235e38f;
            }
            assert_int_equal(sgs_ply_write(temp_path(&folder, "a.ply"), model), SGS_STATUS_OK);
            assert_int_equal(sgs_ply_read(temp_path(&folder, "a.ply"), &back), SGS_STATUS_OK);
            assert_same_model(model, back);
            sgs_gaussians_destroy(model);
            sgs_gaussians_destroy(back);
        }
    }
    assert_int_equal(temp_folder_count(&folder), 1); // no temporary file remains
    temp_folder_remove(&folder);
}

static const char header_3dgs[] =
    "ply\nformat binary_little_endian 1.0\nelement vertex 2\n"
    "property float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float "
    "ny\nproperty float nz\n"
    "property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\n"
    "property float f_rest_0\nproperty float f_rest_1\nproperty float f_rest_2\nproperty float "
    "f_rest_3\n"
    "property float f_rest_4\nproperty float f_rest_5\nproperty float f_rest_6\nproperty float "
    "f_rest_7\n"
    "property float f_rest_8\nproperty float f_rest_9\nproperty float f_rest_10\nproperty float "
    "f_rest_11\n"
    "property float f_rest_12\nproperty float f_rest_13\nproperty float f_rest_14\nproperty float "
    "f_rest_15\n"
    "property float f_rest_16\nproperty float f_rest_17\nproperty float f_rest_18\nproperty float "
    "f_rest_19\n"
    "property float f_rest_20\nproperty float f_rest_21\nproperty float f_rest_22\nproperty float "
    "f_rest_23\n"
    "property float f_rest_24\nproperty float f_rest_25\nproperty float f_rest_26\nproperty float "
    "f_rest_27\n"
    "property float f_rest_28\nproperty float f_rest_29\nproperty float f_rest_30\nproperty float "
    "f_rest_31\n"
    "property float f_rest_32\nproperty float f_rest_33\nproperty float f_rest_34\nproperty float "
    "f_rest_35\n"
    "property float f_rest_36\nproperty float f_rest_37\nproperty float f_rest_38\nproperty float "
    "f_rest_39\n"
    "property float f_rest_40\nproperty float f_rest_41\nproperty float f_rest_42\nproperty float "
    "f_rest_43\n"
    "property float f_rest_44\nproperty float opacity\n"
    "property float scale_0\nproperty float scale_1\nproperty float scale_2\n"
    "property float rot_0\nproperty float rot_1\nproperty float rot_2\nproperty float "
    "rot_3\nend_header\n";

static float little_endian_float(const unsigned char *bytes)
{
    const uint32_t bits =
        bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void ply_has_the_layout_of_3dgs(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = random_model(2, 3);
    assert_int_equal(sgs_ply_write(temp_path(&folder, "a.ply"), model), SGS_STATUS_OK);
    size_t size;
    unsigned char *bytes = file_get(temp_path(&folder, "a.ply"), &size);
    const size_t header = strlen(header_3dgs);
    assert_int_equal(size, header + 2 * 248);
    assert_memory_equal(bytes, header_3dgs, header);
    for (size_t i = 0; i < 2; ++i) {
        float p[SGS_PARAM_COUNT], row[62];
        sgs_gaussians_get(model, i, p);
        for (size_t k = 0; k < 62; ++k)
            row[k] = little_endian_float(bytes + header + 248 * i + 4 * k);
        for (int k = 0; k < 3; ++k) {
            assert_true(row[k] == p[SGS_PARAM_MEAN + k]);
            assert_true(row[3 + k] == 0.0f);
            assert_true(row[6 + k] == p[SGS_PARAM_SH_DC + k]);
            assert_true(row[55 + k] == p[SGS_PARAM_SCALE + k]);
            for (int j = 0; j < 15; ++j) // channel-major in the file
                assert_true(row[9 + 15 * k + j] == p[SGS_PARAM_SH_REST + 3 * j + k]);
        }
        assert_true(row[54] == p[SGS_PARAM_OPACITY]);
        for (int k = 0; k < 4; ++k)
            assert_true(row[58 + k] == p[SGS_PARAM_ROTATION + k]);
    }
    free(bytes);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

static void ply_points_have_the_layout_of_input_ply(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const float points[] = {1, 2, 3, -4, 5.5f, 6};
    const unsigned char colors[] = {0, 128, 255, 7, 8, 9};
    assert_int_equal(sgs_ply_write_points(temp_path(&folder, "input.ply"), points, colors, 2),
                     SGS_STATUS_OK);
    static const char header[] =
        "ply\nformat binary_little_endian 1.0\nelement vertex 2\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property float nx\nproperty float ny\nproperty float nz\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
    size_t size;
    unsigned char *bytes = file_get(temp_path(&folder, "input.ply"), &size);
    assert_int_equal(size, strlen(header) + 2 * 27);
    assert_memory_equal(bytes, header, strlen(header));
    const unsigned char *row = bytes + strlen(header) + 27;
    for (size_t k = 0; k < 3; ++k) {
        assert_true(little_endian_float(row + 4 * k) == points[3 + k]);
        assert_true(little_endian_float(row + 12 + 4 * k) == 0.0f);
        assert_int_equal(row[24 + k], colors[3 + k]);
    }
    free(bytes);
    sgs_gaussians *model;
    assert_int_equal(sgs_ply_read(temp_path(&folder, "input.ply"), &model), SGS_STATUS_FORMAT);
    assert_non_null(
        strstr(sgs_last_error(), "property 'f_dc_0' is missing; this is a point cloud"));
    temp_folder_remove(&folder);
}

// ---- Files of other programs ----

enum { ASCII, LITTLE, BIG };

// Writes a model in a chosen order, format and type, surrounded by unknown properties and elements.
typedef struct foreign {
    int format;
    const char *type; // of every property
    unsigned shuffle; // 0 keeps the order
    bool surrounded;
} foreign;

static void put_value(FILE *stream, const foreign *how, double value)
{
    if (how->format == ASCII) {
        fprintf(stream, "%.9g ", value);
        return;
    }
    unsigned char bytes[8];
    size_t size = 4;
    const float single = (float)value;
    if (!strcmp(how->type, "double")) {
        size = 8;
        memcpy(bytes, &value, 8);
    } else {
        memcpy(bytes, &single, 4);
    }
    for (size_t k = 0; k < size; ++k) // the tests run on little-endian machines
        fputc(bytes[how->format == BIG ? size - 1 - k : k], stream);
}

static const char *const formats[] = {"ascii", "binary_little_endian", "binary_big_endian"};

static void put_list(FILE *stream, int format, int items)
{
    if (format == ASCII) {
        fprintf(stream, "%d ", items);
        for (int k = 0; k < items; ++k)
            fprintf(stream, "%d ", k);
        fputc('\n', stream);
        return;
    }
    fputc(items, stream);
    for (int k = 0; k < 4 * items; ++k)
        fputc(k, stream);
}

static void write_foreign(const char *path, const sgs_gaussians *model, const foreign *how)
{
    FILE *stream = fopen(path, "wb");
    assert_non_null(stream);
    char names[80][32];
    int params[80], count = 0;
    const int rest = 3 * ((model->sh_degree + 1) * (model->sh_degree + 1) - 1);
    for (int k = 0; k < SGS_PARAM_SH_REST; ++k) {
        static const char *const fixed[] = {"x",       "y",      "z",       "rot_0",   "rot_1",
                                            "rot_2",   "rot_3",  "scale_0", "scale_1", "scale_2",
                                            "opacity", "f_dc_0", "f_dc_1",  "f_dc_2"};
        params[count] = k;
        snprintf(names[count++], sizeof names[0], "%s", fixed[k]);
    }
    for (int k = 0; k < rest; ++k) {
        params[count] = SGS_PARAM_SH_REST + 3 * (k % (rest / 3)) + k / (rest / 3);
        snprintf(names[count++], sizeof names[0], "f_rest_%d", k);
    }
    for (int k = 0; k < 5; ++k) {
        params[count] = -1;
        snprintf(names[count++], sizeof names[0], "other_%d", k);
    }
    int order[80];
    for (int k = 0; k < count; ++k)
        order[k] = k;
    for (int k = count - 1; k > 0 && how->shuffle; --k) {
        const int other = (int)(sgsi_random_bits(how->shuffle, (uint64_t)k) % (uint64_t)(k + 1));
        const int kept = order[k];
        order[k] = order[other];
        order[other] = kept;
    }
    fprintf(stream, "ply\nformat %s 1.0\ncomment from another program, \xc3\xa9\nobj_info 3\n",
            formats[how->format]);
    if (how->surrounded)
        fputs("element strange 2\nproperty short a\nproperty list uchar int b\nelement none 7\n",
              stream);
    fprintf(stream, "element vertex %zu\n", model->count);
    for (int k = 0; k < count; ++k)
        fprintf(stream, "property %s %s\n", how->type, names[order[k]]);
    if (how->surrounded)
        fputs("element face 1\nproperty list uchar int vertex_indices\n", stream);
    fputs("end_header\n", stream);
    for (int k = 0; k < 2 && how->surrounded; ++k) {
        how->format == ASCII ? fputs("5 ", stream) : fputs("ab", stream);
        put_list(stream, how->format, 3 * k);
    }
    for (size_t i = 0; i < model->count; ++i) {
        for (int k = 0; k < count; ++k)
            put_value(stream, how,
                      params[order[k]] < 0 ? 7.0 : *sgs_gaussians_at(model, i, params[order[k]]));
        if (how->format == ASCII)
            fputc('\n', stream);
    }
    if (how->surrounded)
        put_list(stream, how->format, 3);
    assert_int_equal(fclose(stream), 0);
}

static void ply_reads_any_order_type_format_and_degree(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    warnings_begin(NULL);
    for (int degree = 0; degree <= 3; ++degree) {
        sgs_gaussians *model = random_model(37, degree), *back;
        for (int variant = 0; variant < 3 * 2 * 2 * 3; ++variant) {
            const foreign how = {.format = variant % 3,
                                 .type = variant / 3 % 2 ? "double" : "float32",
                                 .surrounded = variant / 6 % 2,
                                 .shuffle = (unsigned)(variant / 12)};
            write_foreign(temp_path(&folder, "b.ply"), model, &how);
            if (sgs_ply_read(temp_path(&folder, "b.ply"), &back))
                fail_msg("degree %d, variant %d: %s", degree, variant, sgs_last_error());
            assert_same_model(model, back);
            sgs_gaussians_destroy(back);
        }
        sgs_gaussians_destroy(model);
    }
    warnings_end();
    assert_int_equal(warning_count, 0);
    temp_folder_remove(&folder);
}

static const char ascii_head[] =
    "property float x\r\nproperty float y\r\nproperty float z\r\n"
    "property int f_dc_0\r\nproperty uchar f_dc_1\r\nproperty short f_dc_2\r\n"
    "property double opacity\r\n"
    "property float scale_0\r\nproperty float scale_1\r\nproperty float scale_2\r\n"
    "property float rot_0\r\nproperty float rot_1\r\nproperty float rot_2\r\n"
    "property float rot_3\r\nend_header\r\n";

static sgs_gaussians *read_text(const temp_folder *folder, int count, const char *rows)
{
    char text[4096];
    snprintf(text, sizeof text, "ply\r\nformat ascii 1.0\r\nelement vertex %d\r\n%s%s", count,
             ascii_head, rows);
    file_put(temp_path(folder, "c.ply"), text, strlen(text));
    sgs_gaussians *model;
    if (sgs_ply_read(temp_path(folder, "c.ply"), &model))
        fail_msg("%s", sgs_last_error());
    return model;
}

static void ply_reads_text_in_any_language(void **state)
{
    (void)state;
    if (!decimal_comma_set())
        skip_because("the system cannot make a locale");
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = read_text(
        &folder, 1, "1.5 -2e-3 +3\n\n4 5 -6\t.25 1 1 1 \r\n1 0 0 0"); // no final line feed
    static const float expected[] = {1.5f, -2e-3f, 3, 1, 0, 0, 0, 1, 1, 1, 0.25f, 4, 5, -6};
    for (int k = 0; k < SGS_PARAM_SH_REST; ++k)
        assert_true(*sgs_gaussians_at(model, 0, k) == expected[k]);
    assert_int_equal(model->sh_degree, 0);
    sgs_gaussians_destroy(model);
    decimal_comma_unset();
    temp_folder_remove(&folder);
}

// SuperSplat and splat-transform write logits of opaque primitives as +inf.
static void ply_reads_infinite_logits_as_opaque_and_transparent(void **state)
{
    (void)state;
    static const float logits[] = {1.0f, INFINITY, -INFINITY, NAN};
    static const struct {
        int format;
        const char *type;
    } kinds[] = {{LITTLE, "float"}, {LITTLE, "double"}, {BIG, "float"},
                 {BIG, "double"},   {ASCII, "float"},   {ASCII, "double"}};
    const temp_folder folder = temp_folder_make();
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; ++k) {
        sgs_gaussians *model = random_model(4, 0), *back;
        for (size_t i = 0; i < 4; ++i) {
            float p[SGS_PARAM_COUNT] = {[SGS_PARAM_ROTATION] = 1, [SGS_PARAM_OPACITY] = logits[i]};
            p[SGS_PARAM_MEAN] = 10 * (float)i;
            sgs_gaussians_set(model, i, p);
        }
        const foreign how = {.format = kinds[k].format, .type = kinds[k].type};
        write_foreign(temp_path(&folder, "a.ply"), model, &how);
        warnings_begin(NULL);
        assert_int_equal(sgs_ply_read(temp_path(&folder, "a.ply"), &back), SGS_STATUS_OK);
        assert_int_equal(back->count, 3);
        assert_int_equal(warning_count, 1);
        assert_non_null(strstr(warnings, "1 of 4 primitives are not finite and were dropped"));
        assert_true(*sgs_gaussians_at(back, 0, SGS_PARAM_OPACITY) == 1.0f);
        const float opaque = *sgs_gaussians_at(back, 1, SGS_PARAM_OPACITY);
        assert_true(opaque > 12 &&
                    opaque < 17); // below the logit of 1 - 2^-24, so that it has a gradient
        assert_true(*sgs_gaussians_at(back, 2, SGS_PARAM_OPACITY) == -opaque);
        // Renders rows 1 and 2 separately, from a camera in front of each.
        const sgs_camera camera = {
            .model = SGS_CAMERA_PINHOLE, .width = 9, .height = 9, .params = {9, 9, 4.5, 4.5}};
        sgs_renderer *renderer;
        sgs_frame frame;
        assert_int_equal(sgs_renderer_create(back, &renderer), SGS_STATUS_OK);
        assert_int_equal(sgs_frame_create(9, 9, &frame), SGS_STATUS_OK);
        for (int i = 1; i < 3; ++i) {
            const sgs_pose pose = {.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                                   .translation = {-10.0 * i, 0, 5}};
            assert_int_equal(sgs_renderer_render(renderer, &camera, &pose, NULL, &frame),
                             SGS_STATUS_OK);
            const double alpha = 1 - (double)frame.transmittance[9 * 4 + 4];
            assert_true(fabs(alpha - (i == 1 ? 0.99 : 0.0)) < 1e-6);
        }
        sgs_frame_free(&frame);
        sgs_renderer_destroy(renderer);
        sgs_gaussians_destroy(model);
        sgs_gaussians_destroy(back);
    }
    warnings_end();
    temp_folder_remove(&folder);
}

static void ply_drops_rows_that_are_not_finite(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    warnings_begin(NULL);
    sgs_gaussians *model = read_text(&folder, 6,
                                     "nan 0 0 0 0 0 0 0 0 0 1 0 0 0\n"
                                     "1 0 0 0 0 0 0 0 0 0 1 0 0 0\n"
                                     "0 1e300 0 0 0 0 0 0 0 0 1 0 0 0\n"
                                     "0 0 0 0 0 0 0 0 0 0 1 0 0 -inf\n"
                                     "0 0 0 0 0 0 0 0 45 0 1 0 0 0\n"
                                     "2 0 0 0 0 0 0 0 0 0 1 0 0 0\n");
    assert_int_equal(model->count, 2);
    assert_true(*sgs_gaussians_at(model, 0, 0) == 1.0f && *sgs_gaussians_at(model, 1, 0) == 2.0f);
    assert_true(*sgs_gaussians_at(model, 2, SGS_PARAM_OPACITY) == -30.0f); // inert again
    assert_int_equal(warning_count, 1);
    assert_non_null(strstr(warnings, "c.ply: 4 of 6 primitives are not finite and were dropped"));
    sgs_gaussians_destroy(model);
    warnings_end();
    temp_folder_remove(&folder);
}

static void ply_reads_a_zero_quaternion_as_no_rotation(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    warnings_begin(NULL);
    sgs_gaussians *model = read_text(&folder, 3,
                                     "0 0 0 0 0 0 0 0 0 0 0 0 0 0\n"
                                     "0 0 0 0 0 0 0 0 0 0 0 3 0 4\n"
                                     "0 0 0 0 0 0 0 0 0 0 0 3e-20 0 4e-20\n");
    static const float expected[3][4] = {{1, 0, 0, 0}, {0, 3, 0, 4}, {0, 0.6f, 0, 0.8f}};
    for (size_t i = 0; i < 3; ++i) {
        for (int k = 0; k < 4; ++k)
            assert_true(fabsf(*sgs_gaussians_at(model, i, SGS_PARAM_ROTATION + k) -
                              expected[i][k]) <= 1e-7f);
    }
    assert_int_equal(warning_count, 1);
    assert_non_null(strstr(warnings, "1 primitives have rotation 0 0 0 0"));
    sgs_gaussians_destroy(model);
    warnings_end();
    temp_folder_remove(&folder);
}

static void ply_warns_of_trailing_bytes(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = random_model(3, 0), *back;
    assert_int_equal(sgs_ply_write(temp_path(&folder, "a.ply"), model), SGS_STATUS_OK);
    FILE *stream = fopen(temp_path(&folder, "a.ply"), "ab");
    fputs("more", stream);
    fclose(stream);
    warnings_begin(NULL);
    assert_int_equal(sgs_ply_read(temp_path(&folder, "a.ply"), &back), SGS_STATUS_OK);
    assert_non_null(strstr(warnings, "4 bytes after the last vertex were ignored"));
    assert_same_model(model, back);
    warnings_end();
    sgs_gaussians_destroy(model);
    sgs_gaussians_destroy(back);
    temp_folder_remove(&folder);
}

// ---- Failing to write ----

static void ply_write_failure_keeps_the_old_file(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *old = random_model(10, 3), *large = random_model(5000, 3), *back;
    assert_int_equal(sgs_ply_write(temp_path(&folder, "a.ply"), old), SGS_STATUS_OK);
    static const size_t limits[] = {0, 1, 100, 1500, 4096, 65536, 200000, 1240000};
    for (size_t k = 0; k < sizeof limits / sizeof *limits; ++k) {
        files_limited(limits[k]);
        const sgs_status status = sgs_ply_write(temp_path(&folder, "a.ply"), large);
        files_unlimited();
        assert_int_equal(status, SGS_STATUS_IO);
        assert_non_null(strstr(sgs_last_error(), "a.ply: cannot be written: File too large"));
        assert_int_equal(temp_folder_count(&folder), 1);
        assert_int_equal(sgs_ply_read(temp_path(&folder, "a.ply"), &back), SGS_STATUS_OK);
        assert_same_model(old, back);
        sgs_gaussians_destroy(back);
    }
    assert_int_equal(sgs_ply_write("/nonexistent/folder/a.ply", old), SGS_STATUS_IO);
    assert_non_null(
        strstr(sgs_last_error(), "/nonexistent/folder/a.ply: cannot be written: No such file"));
    old->sh_degree = 4;
    assert_int_equal(sgs_ply_write(temp_path(&folder, "a.ply"), old), SGS_STATUS_INVALID_ARGUMENT);
    sgs_gaussians_destroy(old);
    sgs_gaussians_destroy(large);
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ply_survives_a_round_trip_bit_by_bit),
        cmocka_unit_test(ply_has_the_layout_of_3dgs),
        cmocka_unit_test(ply_points_have_the_layout_of_input_ply),
        cmocka_unit_test(ply_reads_any_order_type_format_and_degree),
        cmocka_unit_test(ply_reads_text_in_any_language),
        cmocka_unit_test(ply_reads_infinite_logits_as_opaque_and_transparent),
        cmocka_unit_test(ply_drops_rows_that_are_not_finite),
        cmocka_unit_test(ply_reads_a_zero_quaternion_as_no_rotation),
        cmocka_unit_test(ply_warns_of_trailing_bytes),
        cmocka_unit_test(ply_write_failure_keeps_the_old_file),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
