// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Invalid, truncated and hostile PLY files: each gives one error that names the file and the place.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "support/bad_input.h"
#include "base/core.h"
#include "support/files_support.h"
#include "sparegs/gaussians.h"

#define XYZ "property float x\nproperty float y\nproperty float z\n"
#define COLOR "property float f_dc_0\nproperty float f_dc_1\nproperty float f_dc_2\n"
#define OPACITY "property float opacity\n"
#define SCALE "property float scale_0\nproperty float scale_1\nproperty float scale_2\n"
#define ROT3 "property float rot_0\nproperty float rot_1\nproperty float rot_2\n"
#define ROT ROT3 "property float rot_3\n"
#define MODEL XYZ COLOR OPACITY SCALE ROT
#define ASCII "ply\nformat ascii 1.0\n"
#define LITTLE "ply\nformat binary_little_endian 1.0\n"
#define ROW "0 0 0 0 0 0 0 0 0 0 1 0 0 0\n"
#define NAME64 "abcdefghijklmnopqrstuvwxyzabcdefghijklmnopqrstuvwxyzabcdefghijkl"

typedef struct bad_file {
    const char *text;
    sgs_status status;
    const char *message; // text after "FILE: "
} bad_file;

#define NO_PLY                                                                                     \
    "not a PLY file: it does not begin with 'ply'; specify another file, or rename this one with " \
    "the extension of its format"

static const bad_file bad_files[] = {
    {"", SGS_STATUS_FORMAT, NO_PLY},
    {"pl", SGS_STATUS_FORMAT, NO_PLY},
    {"\x89PNG\r\n", SGS_STATUS_FORMAT, NO_PLY},
    {"plyx\n", SGS_STATUS_FORMAT, NO_PLY},
    {"ply\rformat ascii 1.0\r", SGS_STATUS_FORMAT, "line 1: missing line feed"},
    {"ply\n", SGS_STATUS_FORMAT, "line 2: file ends inside the header"},
    {"ply\nelement vertex 1\n", SGS_STATUS_FORMAT, "line 2: expected 'format' after 'ply'"},
    {"ply\nformat ascii\n", SGS_STATUS_FORMAT, "line 2: expected 'format' after 'ply'"},
    {"ply\nformat ascii 2.0\n", SGS_STATUS_UNSUPPORTED,
     "line 2: unknown PLY version 2.0; only 1.0 is supported"},
    {"ply\nformat zip 1.0\n", SGS_STATUS_UNSUPPORTED,
     "line 2: unknown format 'zip'; supported: ascii, binary_little_endian and "
     "binary_big_endian"},
    {ASCII "end_header\n", SGS_STATUS_FORMAT, "has no element 'vertex'; this is not a 3DGS model"},
    {ASCII "element face 3\nend_header\n", SGS_STATUS_FORMAT,
     "has no element 'vertex'; this is not a 3DGS model"},
    {ASCII "element vertex 1\n", SGS_STATUS_FORMAT, "line 4: file ends inside the header"},
    {ASCII "element vertex\n", SGS_STATUS_FORMAT, "line 3: expected 'element NAME COUNT'"},
    {ASCII "element vertex 1 2\n", SGS_STATUS_FORMAT, "line 3: expected 'element NAME COUNT'"},
    {ASCII "element vertex many\n", SGS_STATUS_FORMAT,
     "line 3: count 'many' of element 'vertex' is not a number"},
    {ASCII "element vertex -1\n", SGS_STATUS_FORMAT,
     "line 3: count '-1' of element 'vertex' is not a number"},
    {ASCII "element vertex 18446744073709551616\n", SGS_STATUS_FORMAT,
     "line 3: count '18446744073709551616' of element 'vertex' is not a number"},
    {ASCII "element vertex 1\nelement vertex 1\n", SGS_STATUS_FORMAT,
     "line 4: duplicate element 'vertex'"},
    {ASCII "property float x\n", SGS_STATUS_FORMAT, "line 3: property before the first element"},
    {ASCII "element vertex 1\nproperty float\n", SGS_STATUS_FORMAT,
     "line 4: expected 'property TYPE NAME' or 'property list COUNT-TYPE TYPE NAME'"},
    {ASCII "element vertex 1\nproperty list uchar x\n", SGS_STATUS_FORMAT,
     "line 4: expected 'property TYPE NAME' or 'property list COUNT-TYPE TYPE NAME'"},
    {ASCII "element vertex 1\nproperty half x\n", SGS_STATUS_FORMAT,
     "line 4: property 'x' has unknown type 'half'"},
    {ASCII "element vertex 1\nproperty list float int x\n", SGS_STATUS_FORMAT,
     "line 4: list 'x' has count type 'float', which is not an integer type"},
    {ASCII "element vertex 1\nproperty float x\nproperty int x\n", SGS_STATUS_FORMAT,
     "line 5: duplicate property 'x'"},
    {ASCII "element vertex 1\nproperty float " NAME64 "\n", SGS_STATUS_LIMIT,
     "line 4: name longer than 63 characters"},
    {ASCII "elements vertex 1\n", SGS_STATUS_FORMAT, "line 3: 'elements' is not a PLY keyword"},
    {ASCII "element ver\x1b[2Jtex 1\n", SGS_STATUS_FORMAT,
     "line 3: byte 0x1b is not text; the header is corrupt"},
    {ASCII "element ver\xfftex 1\n", SGS_STATUS_FORMAT,
     "line 3: byte 0xff is not text; the header is corrupt"},
    {ASCII "element vertex 1\nproperty list uchar float x\nend_header\n", SGS_STATUS_UNSUPPORTED,
     "property 'x' of a vertex is a list; a 3DGS model has none"},
    {ASCII "element vertex 1\nend_header\n", SGS_STATUS_FORMAT,
     "property 'x' is missing; this is not a 3DGS model"},
    {ASCII "element vertex 1\n" XYZ COLOR OPACITY SCALE ROT3 "end_header\n", SGS_STATUS_FORMAT,
     "property 'rot_3' is missing; this is not a 3DGS model"},
    {ASCII "element vertex 1\n" XYZ COLOR SCALE ROT "end_header\n", SGS_STATUS_FORMAT,
     "property 'opacity' is missing; this is not a 3DGS model"},
    {ASCII "element vertex 1\n" XYZ "property uchar red\nend_header\n", SGS_STATUS_FORMAT,
     "property 'f_dc_0' is missing; this is a point cloud and not a 3DGS model"},
    {ASCII "element vertex 1\nproperty uint packed_position\nend_header\n", SGS_STATUS_FORMAT,
     "property 'x' is missing; this is a compressed model; export it as an uncompressed PLY"},
    {ASCII "element vertex 1\n" MODEL "property float f_rest_0\nend_header\n" ROW,
     SGS_STATUS_UNSUPPORTED,
     "has 1 f_rest properties; supported: 0, 9, 24, 45 or 72 (SH degree 0 to 4)"},
    {ASCII "element vertex 1\n" MODEL "property float f_rest_0\nproperty float f_rest_1\nproperty "
           "float f_rest_2\nproperty float f_rest_3\n"
           "property float f_rest_4\nproperty float f_rest_5\nproperty float f_rest_6\nproperty "
           "float f_rest_8\n"
           "property float f_rest_9\nend_header\n" ROW,
     SGS_STATUS_FORMAT, "property 'f_rest_7' is missing; this is not a 3DGS model"},
    {ASCII "element vertex 2\n" MODEL "end_header\n" ROW, SGS_STATUS_FORMAT,
     "byte 342: 2 rows of element 'vertex' take at least 28 bytes each, but only 28 bytes are "
     "left; the file is "
     "truncated or its count is wrong"},
    {ASCII "element vertex 18446744073709551615\n" MODEL "end_header\n" ROW, SGS_STATUS_FORMAT,
     "byte 361: 18446744073709551615 rows of element 'vertex' take at least 28 bytes each, but "
     "only 28 bytes are "
     "left; the file is truncated or its count is wrong"},
    {LITTLE "element vertex 1000000000\n" MODEL "end_header\n1234", SGS_STATUS_FORMAT,
     "byte 366: 1000000000 rows of element 'vertex' take at least 56 bytes each, but only 4 bytes "
     "are left; the file "
     "is truncated or its count is wrong"},
    {ASCII "element vertex 1\n" MODEL "end_header\n0 0 zero 0 0 0 0 0 0 0 1 0 0 0\n",
     SGS_STATUS_FORMAT, "byte 346: vertex 0: property 'z': 'zero' is not a number"},
    {ASCII "element vertex 1\n" MODEL "end_header\n0 0 1\x1b[2J 0 0 0 0 0 0 0 1 0 0 0\n",
     SGS_STATUS_FORMAT, "byte 346: vertex 0: property 'z': '1?[2J' is not a number"},
    {ASCII "element vertex 1\n" MODEL "end_header\n0 0 0 0 0 0 0 0 0 0 1.00000 0 0\n",
     SGS_STATUS_FORMAT,
     "byte 374: vertex 0: property 'rot_3' is missing; the file is truncated or corrupt"},
    {ASCII "element cell 99\nproperty int a\nelement vertex 1\n" MODEL "end_header\n" ROW,
     SGS_STATUS_FORMAT,
     "byte 373: 99 rows of element 'cell' take at least 2 bytes each, but only 28 bytes are left; "
     "the file is "
     "truncated or its count is wrong"},
    {ASCII "element cell 1\nproperty list int int a\nelement vertex 1\n" MODEL
           "end_header\n99999999999999999999 " ROW,
     SGS_STATUS_FORMAT, "byte 381: row 0 of element 'cell' is corrupt or truncated"},
    {LITTLE "element cell 1\nproperty list uint double a\nelement vertex 0\n" MODEL
            "end_header\n\xff\xff\xff\xff...",
     SGS_STATUS_FORMAT, "byte 400: row 0 of element 'cell' is corrupt or truncated"},
    {LITTLE "element cell 2\nproperty list char uchar a\nelement vertex 0\n" MODEL
            "end_header\n\xff...",
     SGS_STATUS_FORMAT, "byte 399: row 0 of element 'cell' is corrupt or truncated"},
};

static void ply_names_what_is_wrong(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    for (size_t k = 0; k < sizeof bad_files / sizeof *bad_files; ++k) {
        const char *path = temp_path(&folder, "point_cloud.ply");
        file_put(path, bad_files[k].text, strlen(bad_files[k].text));
        sgs_gaussians *model = (sgs_gaussians *)state;
        const sgs_status status = sgs_ply_read(path, &model);
        char expected[1024];
        snprintf(expected, sizeof expected, "%s: %s", path, bad_files[k].message);
        if (status != bad_files[k].status || strcmp(sgs_last_error(), expected))
            fail_msg("case %zu: status %d with '%s', expected %d with '%s'", k, status,
                     sgs_last_error(), bad_files[k].status, expected);
        assert_null(model);
        bad_input();
    }
    temp_folder_remove(&folder);
}

static void read_generated(const temp_folder *folder, sgs_status expected, const char *message)
{
    sgs_gaussians *model = NULL;
    assert_int_equal(sgs_ply_read(temp_path(folder, "g.ply"), &model), expected);
    assert_null(model);
    if (!strstr(sgs_last_error(), message))
        fail_msg("'%s' does not contain '%s'", sgs_last_error(), message);
    bad_input();
}

static void ply_limits_the_header(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    static char text[1 << 18];
    int length = sprintf(text, ASCII);
    for (int k = 0; k < 17; ++k)
        length += sprintf(text + length, "element e%d 1\n", k);
    file_put(temp_path(&folder, "g.ply"), text, (size_t)length);
    read_generated(&folder, SGS_STATUS_LIMIT, "line 19: more than 16 elements");

    length = sprintf(text, ASCII "element vertex 1\n");
    for (int k = 0; k < 513; ++k)
        length += sprintf(text + length, "property float p%d\n", k);
    file_put(temp_path(&folder, "g.ply"), text, (size_t)length);
    read_generated(&folder, SGS_STATUS_LIMIT, "line 516: more than 512 properties");

    length = sprintf(text, ASCII "property ");
    memset(text + length, 'x', 2000);
    file_put(temp_path(&folder, "g.ply"), text, (size_t)length + 2000);
    read_generated(&folder, SGS_STATUS_LIMIT, "line 3: longer than 1024 characters");

    // Comments may be longer; the lines after them are read.
    length = sprintf(text, ASCII "comment ");
    memset(text + length, 'x', 2000);
    length += 2000;
    length += sprintf(text + length, "\nobj_info ");
    memset(text + length, 'y', 60000);
    length += 60000;
    length += sprintf(text + length, "\nelement vertex 1\nend_header\n");
    file_put(temp_path(&folder, "g.ply"), text, (size_t)length);
    read_generated(&folder, SGS_STATUS_FORMAT, "property 'x'");

    length = sprintf(text, ASCII);
    memset(text + length, '\n', sizeof text - (size_t)length);
    file_put(temp_path(&folder, "g.ply"), text, sizeof text);
    read_generated(&folder, SGS_STATUS_LIMIT, "the header has no end_header within 131072 bytes");
    temp_folder_remove(&folder);
}

static void ply_refuses_what_is_not_a_file(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model;
    assert_int_equal(sgs_ply_read(temp_path(&folder, "none.ply"), &model), SGS_STATUS_IO);
    assert_non_null(strstr(sgs_last_error(), "none.ply: cannot be opened: No such file"));
    bad_input();
    assert_int_equal(sgs_ply_read(folder.path, &model), SGS_STATUS_IO);
    assert_non_null(strstr(sgs_last_error(), ": is not a regular file"));
    bad_input();
    assert_int_equal(mkfifo(temp_path(&folder, "pipe.ply"), 0600), 0);
    assert_int_equal(sgs_ply_read(temp_path(&folder, "pipe.ply"), &model), SGS_STATUS_IO);
    assert_non_null(strstr(sgs_last_error(), "pipe.ply: is not a regular file"));
    bad_input();
    temp_folder_remove(&folder);
}

static sgs_gaussians *small_model(void)
{
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(3, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(model, 3), SGS_STATUS_OK);
    for (size_t i = 0; i < 3; ++i) {
        for (int k = 0; k < SGS_PARAM_COUNT; ++k)
            *sgs_gaussians_at(model, i, k) = (float)sgsi_random_normal(i, (uint64_t)k);
    }
    return model;
}

static void ply_survives_truncation_at_every_byte(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = small_model(), *back;
    assert_int_equal(sgs_ply_write(temp_path(&folder, "a.ply"), model), SGS_STATUS_OK);
    size_t size;
    unsigned char *bytes = file_get(temp_path(&folder, "a.ply"), &size);
    for (size_t length = 0; length < size; ++length) {
        file_put(temp_path(&folder, "b.ply"), bytes, length);
        assert_int_equal(sgs_ply_read(temp_path(&folder, "b.ply"), &back), SGS_STATUS_FORMAT);
        assert_null(back);
    }
    free(bytes);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

// Ascii with a list element before the vertices, truncated after every byte: reading fails, or
// succeeds if only the last number is shortened.
static void ply_survives_truncated_text(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    static const char text[] =
        ASCII "element cell 2\nproperty list uchar int a\nproperty float b\n"
              "element vertex 2\n" MODEL "end_header\n2 1 1 0.5\n0 1.5\n" ROW ROW;
    const size_t whole = strlen(text);
    for (size_t length = 0; length <= whole; ++length) {
        sgs_gaussians *back;
        file_put(temp_path(&folder, "b.ply"), text, length);
        const sgs_status status = sgs_ply_read(temp_path(&folder, "b.ply"), &back);
        assert_int_equal(status, length >= whole - 1 ? SGS_STATUS_OK : SGS_STATUS_FORMAT);
        sgs_gaussians_destroy(back);
    }
    temp_folder_remove(&folder);
}

// Random changes may give any status, but no memory error (checked by the sanitizers), and a model
// that is returned is finite.
static void ply_survives_random_damage(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = small_model(), *back;
    assert_int_equal(sgs_ply_write(temp_path(&folder, "a.ply"), model), SGS_STATUS_OK);
    size_t size;
    unsigned char *bytes = file_get(temp_path(&folder, "a.ply"), &size), *copy = malloc(size);
    for (uint64_t round = 0; round < 1500; ++round) {
        memcpy(copy, bytes, size);
        for (uint64_t hit = 0; hit <= round % 3; ++hit) {
            const uint64_t bits = sgsi_random_bits(77 + hit, round);
            const size_t reach = round % 2 ? size : 120; // half of them at the beginning
            copy[(bits >> 8) % reach] =
                round % 5 ? (unsigned char)bits : (unsigned char)"0123456789 \n"[bits % 12];
        }
        file_put(temp_path(&folder, "b.ply"), copy, size);
        if (sgs_ply_read(temp_path(&folder, "b.ply"), &back)) {
            assert_null(back);
            continue;
        }
        assert_true(back->count <= 3);
        for (size_t i = 0; i < back->count; ++i) {
            for (int k = 0; k < SGS_PARAM_COUNT; ++k)
                assert_true(*sgs_gaussians_at(back, i, k) - *sgs_gaussians_at(back, i, k) == 0.0f);
        }
        sgs_gaussians_destroy(back);
    }
    free(bytes);
    free(copy);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

static void ply_survives_lack_of_memory(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_gaussians *model = small_model(), *back;
    char path[300];
    snprintf(path, sizeof path, "%s", temp_path(&folder, "a.ply"));
    assert_int_equal(sgs_ply_write(path, model), SGS_STATUS_OK);
    sgs_status status = SGS_STATUS_OUT_OF_MEMORY;
    size_t n = 0;
    while (status) {
        sgsi_fail_allocation(++n);
        status = sgs_ply_read(path, &back);
        assert_true(status ? !back : back->count == 3);
        assert_true(!status || status == SGS_STATUS_OUT_OF_MEMORY);
    }
    sgsi_fail_allocation(0);
    assert_int_equal(n, 5); // reader, buffer, model, its data
    sgs_gaussians_destroy(back);
    for (n = 1; n <= 2; ++n) {
        sgsi_fail_allocation(n);
        assert_int_equal(sgs_ply_write(path, model), SGS_STATUS_OUT_OF_MEMORY);
    }
    sgsi_fail_allocation(0);
    assert_int_equal(temp_folder_count(&folder), 1);
    sgs_gaussians_destroy(model);
    temp_folder_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ply_names_what_is_wrong),
        cmocka_unit_test(ply_limits_the_header),
        cmocka_unit_test(ply_refuses_what_is_not_a_file),
        cmocka_unit_test(ply_survives_truncation_at_every_byte),
        cmocka_unit_test(ply_survives_truncated_text),
        cmocka_unit_test(ply_survives_random_damage),
        cmocka_unit_test(ply_survives_lack_of_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
