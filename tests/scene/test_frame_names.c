// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Names of photos in transforms.json: with and without the extension of an image format, and the
// same in lists of names. Names that denote a view.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "support/bad_input.h"
#include "support/transforms_support.h"

#define FRAME(name)                                                                                \
    "{\"file_path\":\"" name "\",\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,0]]}"
#define GLOBAL "{\"camera_angle_x\":1,"

static void files_keep_the_name_as_written(void **state)
{
    (void)state;
    static const uint8_t white[3] = {255, 255, 255};
    static const struct {
        const char *written, *name;
    } cases[] = {{"photos/one.sgi", "photos/one.sgi"},     // files in formats that are not listed
                 {"./photos//two", "photos/two"},          // and without an extension
                 {"photos/three.5", "photos/three.5.png"}, // no file
                 {"photos/four", "photos/four.png"},       // a folder
                 {"photos/five.jfif", "photos/five.jfif"}, // listed formats
                 {"photos/six.JPE", "photos/six.JPE"},
                 {"seven.dpx", "seven.dpx"},
                 {"eight.jxl", "eight.jxl"},
                 {"nine.gif", "nine.gif"},
                 {"ten.psd", "ten.psd"},
                 {"eleven.hdr", "eleven.hdr"}};
    const temp_folder folder = temp_folder_make();
    tree_put_picture(&folder, "photos/one.sgi", 8, 8, 3, white); // read by its contents
    tree_put_picture(&folder, "photos/two", 8, 8, 3, white);
    tree_put_picture(&folder, "photos/four/one.png", 8, 8, 3, white);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        char text[512];
        sgsi_dataset d;
        snprintf(text, sizeof text,
                 GLOBAL "\"test_filenames\":[\"%s\"],\"frames\":[" FRAME("%s") "]}",
                 cases[i].written, cases[i].written);
        warnings[0] = 0;
        read_text(&folder, text, &d);
        assert_string_equal(d.frames[0].name, cases[i].name);
        assert_int_equal(d.frames[0].split, SGS_SPLIT_TEST); // found in the list
        assert_string_equal(warnings, "");
        sgsi_dataset_free(&d);
    }
    tree_remove(&folder);
}

// drop_unlisted compares names that were read from frames with names from lists.
static void listed_names_are_those_of_frames(void **state)
{
    (void)state;
    static const uint8_t white[3] = {255, 255, 255};
    const temp_folder folder = temp_folder_make();
    sgs_scene *scene;
    tree_put_picture(&folder, "a.sgi", 8, 8, 3, white);
    tree_put_picture(&folder, "b", 8, 8, 3, white);
    tree_put_picture(&folder, "c.png", 8, 8, 3, white);
    tree_put_picture(&folder, "d.sgi", 8, 8, 3, white);
    tree_put_text(&folder, "transforms.json",
                  GLOBAL "\"train_filenames\":[\"./a.sgi\",\"b\",\"typo.png\",\"../x\"],"
                         "\"val_filenames\":[\"c\"],\"frames\":[" FRAME("a.sgi") "," FRAME(
                             "b") "," FRAME("c.png") "," FRAME("d.sgi") "]}");
    if (sgs_scene_load(folder.path, NULL, &scene))
        fail_msg("%s", sgs_last_error());
    assert_int_equal(scene->view_count, 3);
    assert_string_equal(scene->views[0].name, "a.sgi");
    assert_string_equal(scene->views[1].name, "b");
    assert_string_equal(scene->views[2].name, "c.png");
    assert_int_equal(scene->views[1].image.pixels[0], 255);
    assert_holds(warnings, "2 of 4 entries of 'train_filenames' match no frame and are ignored, "
                           "first 'typo.png'\n");
    assert_holds(warnings, "and are not used, first 'd.sgi'");
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

static void extended_names_have_the_limit_of_names(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    char name[1100], text[1400];
    for (int length = 1019; length <= 1026; ++length) {
        sgsi_dataset d;
        memset(name, 'a', (size_t)length);
        name[length] = 0;
        snprintf(text, sizeof text, GLOBAL "\"frames\":[" FRAME("%s") "]}", name);
        tree_put_text(&folder, "transforms.json", text);
        const sgs_status status = sgsi_transforms_read(temp_path(&folder, "transforms.json"), &d);
        assert_int_equal(status, length <= 1020 ? SGS_STATUS_OK : SGS_STATUS_FORMAT);
        if (status) {
            assert_holds(sgs_last_error(), "frame 0: 'file_path' is longer than 1024 bytes");
            bad_input();
        } else {
            assert_int_equal(strlen(d.frames[0].name), length + 4);
        }
        sgsi_dataset_free(&d);
    }
    tree_remove(&folder);
}

static void any_failing_allocation_is_reported(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    tree_put_text(&folder, "b", "a file");
    tree_put_text(&folder, "transforms.json",
                  GLOBAL
                  "\"test_filenames\":[\"a\",\"b\"],\"frames\":[" FRAME("a") "," FRAME("b") "]}");
    sgs_status status = SGS_STATUS_OUT_OF_MEMORY;
    for (size_t n = 1; n < 60; ++n) {
        sgsi_dataset d;
        sgsi_fail_allocation(n);
        status = sgsi_transforms_read(temp_path(&folder, "transforms.json"), &d);
        sgsi_fail_allocation(0);
        assert_true(status == SGS_STATUS_OK || status == SGS_STATUS_OUT_OF_MEMORY);
        sgsi_dataset_free(&d);
    }
    assert_int_equal(status, SGS_STATUS_OK);
    tree_remove(&folder);
}

static void names_match_exactly_without_folder_or_without_extension(void **state)
{
    (void)state;
    static const struct {
        const char *view, *name;
        int match;
    } cases[] = {{"a/b.c.png", "a/b.c.png", 0}, {"a/b.c.png", "b.c.png", 1},
                 {"a/b.c.png", "a/b.c", 2},     {"a/b.c.png", "b.c", 2},
                 {"a/b.c.png", "b", -1},        {"a/b.c.png", "a/b", -1},
                 {"a/b.c.png", "c.png", -1},    {"a/b.c.png", "", -1},
                 {"b.png", "b.png", 0},         {"b.png", "b", 2},
                 {"b.png", "B.png", -1},        {"b.png", "b.pn", -1},
                 {"a/none", "none", 1},         {"a/none", "a/none", 0},
                 {"a.b/none", "a", -1},         {"a.b/none", "none", 1},
                 {"x/a/b.png", "a/b", -1}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i)
        if (sgs_view_name_match(cases[i].view, cases[i].name) != cases[i].match)
            fail_msg("'%s' and '%s'", cases[i].view, cases[i].name);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(files_keep_the_name_as_written, warnings_begin),
        cmocka_unit_test_setup(listed_names_are_those_of_frames, warnings_begin),
        cmocka_unit_test_setup(extended_names_have_the_limit_of_names, warnings_begin),
        cmocka_unit_test_setup(any_failing_allocation_is_reported, warnings_begin),
        cmocka_unit_test(names_match_exactly_without_folder_or_without_extension),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
