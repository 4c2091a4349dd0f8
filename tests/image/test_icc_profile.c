// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Embedded ICC profiles, which are not applied, are reported by name unless they are sRGB. The
// bytes follow ICC.1:2022 (7.2 header, 7.3 tag table, multiLocalizedUnicodeType) and ICC.1:2001-04
// (textDescriptionType).

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "image/icc_profile.h"
#include "support/scene_support.h"

enum { WIDTH = 64, HEIGHT = 48, HEADER = 128 };

static void put_big(buffer *b, uint32_t value, int size)
{
    for (int i = size - 1; i >= 0; --i)
        put_integer(b, value >> (8 * i) & 0xff, 1);
}

// Header and a table of two tags, of which the second has the description that follows.
static void begin_profile(buffer *b, uint32_t element_size)
{
    b->size = 0;
    while (b->size < HEADER)
        put_integer(b, 0, 1);
    memcpy(b->data + 36, "acsp", 4);
    put_big(b, 2, 4);
    put_bytes(b, "wtpt", 4);
    put_big(b, 0, 4);
    put_big(b, 20, 4);
    put_bytes(b, "desc", 4);
    put_big(b, HEADER + 4 + 24, 4);
    put_big(b, element_size, 4);
}

static void make_version_2(buffer *b, const char *name)
{
    const uint32_t count = (uint32_t)strlen(name) + 1;
    begin_profile(b, 12 + count + 78);
    put_bytes(b, "desc\0\0\0", 8);
    put_big(b, count, 4);
    put_bytes(b, name, count);
    for (int i = 0; i < 78; ++i) // no Unicode, no ScriptCode
        put_integer(b, 0, 1);
}

// A name in a language, as UTF-16 code units; `before`: in German, in front of it, if not NULL.
static void make_version_4(buffer *b, const char *language, const uint16_t *name, uint32_t length,
                           const char *before)
{
    const uint32_t records = before ? 2 : 1, first = 16 + 12 * records,
                   other = before ? 2 * (uint32_t)strlen(before) : 0;
    begin_profile(b, first + other + 2 * length);
    put_bytes(b, "mluc\0\0\0", 8);
    put_big(b, records, 4);
    put_big(b, 12, 4);
    if (before) {
        put_bytes(b, "deDE", 4);
        put_big(b, other, 4);
        put_big(b, first, 4);
    }
    put_bytes(b, language, 4);
    put_big(b, 2 * length, 4);
    put_big(b, first + other, 4);
    for (const char *at = before ? before : ""; *at; ++at)
        put_big(b, (uint8_t)*at, 2);
    for (uint32_t i = 0; i < length; ++i)
        put_big(b, name[i], 2);
}

static void assert_named(const buffer *b, const char *expected)
{
    char name[32];
    uint8_t *exact = malloc(b->size ? b->size : 1); // for the address sanitizer
    assert_non_null(exact);
    memcpy(exact, b->data, b->size);
    sgsi_icc_name(exact, b->size, name, sizeof name);
    assert_string_equal(name, expected);
    free(exact);
}

static void names_of_profiles_are_read(void **state)
{
    (void)state;
    static buffer b;
    static const uint16_t p3[] = {'P', '3'}, odd[] = {0xe9, 0x20ac, 0xd83d, 7};
    make_version_2(&b, "Adobe RGB (1998)");
    assert_named(&b, "Adobe RGB (1998)");
    make_version_2(&b, "a name that is longer than the 31 bytes");
    assert_named(&b, "a name that is longer than the ");
    make_version_2(&b, "two\nlines");
    assert_named(&b, "two?lines");
    make_version_4(&b, "frFR", p3, 2, NULL);
    assert_named(&b, "P3");
    make_version_4(&b, "enUS", p3, 2, "Farben");
    assert_named(&b, "P3");
    make_version_4(&b, "frFR", p3, 2, "Farben");
    assert_named(&b, "Farben");
    make_version_4(&b, "enUS", odd, 4, NULL);
    assert_named(&b, "\xc3\xa9\xe2\x82\xac??");
}

static void damaged_profiles_have_no_name(void **state)
{
    (void)state;
    static buffer b, cut;
    static const uint16_t p3[] = {'P', '3'};
    make_version_4(&b, "enUS", p3, 2, NULL);
    for (size_t size = 0; size < b.size; ++size) {
        cut = b;
        cut.size = size;
        assert_named(&cut, "");
    }
    for (size_t at = HEADER; at < b.size - 4; ++at) { // counts, offsets and sizes out of range
        cut = b;
        memset(cut.data + at, 0xff, 4);
        char name[32];
        sgsi_icc_name(cut.data, cut.size, name, sizeof name);
        assert_true(strlen(name) < sizeof name);
    }
}

// Grey pixels in a TIFF with tag 34675, the ICC profile.
static void put_photo(const temp_folder *folder, const char *name, const buffer *profile)
{
    static buffer b;
    const uint32_t plane = WIDTH * HEIGHT * 3, data = 8 + 2 + 12 * 12 + 4, bits = data + plane;
    const uint32_t tags[12][4] = {
        {256, 4, 1, WIDTH}, {257, 4, 1, HEIGHT}, {258, 3, 3, bits},
        {259, 3, 1, 1},     {262, 3, 1, 2},      {273, 4, 1, data},
        {277, 3, 1, 3},     {278, 4, 1, HEIGHT}, {279, 4, 1, plane},
        {284, 3, 1, 1},     {339, 3, 1, 1},      {34675, 7, (uint32_t)profile->size, bits + 6}};
    const int count = profile->size ? 12 : 11;
    b.size = 0;
    put_bytes(&b, "II*\0\10\0\0\0", 8);
    put_integer(&b, (uint64_t)count, 2);
    for (int i = 0; i < count; ++i)
        for (int k = 0; k < 4; ++k)
            put_integer(&b, tags[i][k], k < 2 ? 2 : 4);
    put_integer(&b, 0, 4);
    while (b.size < bits)
        put_integer(&b, b.size < data ? 0 : 120, 1);
    for (int i = 0; i < 3; ++i)
        put_integer(&b, 8, 2);
    put_bytes(&b, profile->data, profile->size);
    tree_put(folder, name, b.data, b.size);
}

static void profiles_other_than_srgb_are_reported_once(void **state)
{
    (void)state;
    static buffer p3, adobe, srgb, none;
    static const uint16_t name[] = {'D', 'i', 's', 'p', 'l', 'a', 'y', ' ', 'P', '3'};
    make_version_4(&p3, "enUS", name, 10, NULL);
    make_version_2(&adobe, "Adobe RGB (1998)");
    make_version_2(&srgb, "sRGB IEC61966-2.1");
    const temp_folder folder = temp_folder_make();
    char text[1024] = "{\"fl_x\":50,\"w\":64,\"h\":48,\"frames\":[";
    for (int i = 0; i < 4; ++i)
        snprintf(
            text + strlen(text), sizeof text - strlen(text),
            "{\"file_path\":\"%c.tif\",\"transform_matrix\":[[1,0,0,%d],[0,1,0,0],[0,0,1,0]]}%s",
            'a' + i, i, i < 3 ? "," : "]}");
    tree_put_text(&folder, "transforms.json", text);
    put_photo(&folder, "a.tif", &srgb);
    put_photo(&folder, "b.tif", &p3);
    put_photo(&folder, "c.tif", &adobe);
    put_photo(&folder, "d.tif", &none);
    sgs_scene_options options = sgs_scene_options_default();
    for (int load = 0; load < 2; ++load) {
        sgs_scene *scene;
        warnings[0] = 0;
        options.load_images = load;
        assert_int_equal(sgs_scene_load(folder.path, &options, &scene), SGS_STATUS_OK);
        snprintf(
            text, sizeof text,
            "%s/b.tif: its ICC profile 'Display P3' is not applied; convert the image to sRGB, "
            "or name its colour space with option colorspace (and 1 other image)\n",
            folder.path);
        assert_string_equal(warnings, text);
        sgs_scene_destroy(scene);
    }
    sgs_scene *scene;
    warnings[0] = 0;
    options.colorspace = "srgb_p3d65_scene"; // the user knows
    assert_int_equal(sgs_scene_load(folder.path, &options, &scene), SGS_STATUS_OK);
    assert_string_equal(warnings, "");
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(names_of_profiles_are_read),
        cmocka_unit_test(damaged_profiles_have_no_name),
        cmocka_unit_test_setup(profiles_other_than_srgb_are_reported_once, warnings_begin),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
