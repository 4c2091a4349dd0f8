// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Folders as other programs write them: which of several camera files is used, and what a user
// learns about the others and about names that do not match.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "support/bad_input.h"
#include "scene/similar_name.h"
#include "support/scene_support.h"

static const uint8_t red[4] = {250, 20, 10, 255};

// A COLMAP scene of four views of 32 x 24 px (the model's cameras have 64 x 48 and 128 x 96).
static temp_folder scene_make(const char *place, bool binary, const char *images)
{
    const temp_folder folder = temp_folder_make();
    const model m = model_make();
    model_put(&folder, place, &m, binary);
    model_put_pictures(&folder, images, &m, (picture){32, 24, 3, red});
    return folder;
}

static sgs_scene *load(const char *path, const sgs_scene_options *options)
{
    sgs_scene *scene;
    if (sgs_scene_load(path, options, &scene))
        fail_msg("%s", sgs_last_error());
    return scene;
}

// ns-process-data writes transforms.json and leaves COLMAP's model in colmap/sparse/0; nerfstudio
// reads the former. Elsewhere the model precedes, as in 3DGS.
static void transforms_precede_only_the_model_of_nerfstudio(void **state)
{
    (void)state;
    static const struct {
        const char *model, *json, *warning;
        sgs_scene_format format;
    } cases[] = {
        {"colmap/sparse/0/", "transforms.json", NULL, SGS_SCENE_TRANSFORMS},
        {"colmap/sparse/", "transforms.json", NULL, SGS_SCENE_TRANSFORMS},
        {"colmap/sparse/0/", "transforms_train.json", NULL, SGS_SCENE_TRANSFORMS},
        {"sparse/0/", "transforms.json", "/sparse/0", SGS_SCENE_COLMAP_BINARY},
        {"sparse/", "transforms_train.json", "/sparse", SGS_SCENE_COLMAP_BINARY},
        {"", "transforms.json", "", SGS_SCENE_COLMAP_BINARY},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        const temp_folder folder = scene_make(cases[i].model, true, "images");
        char text[1024] = "";
        tree_put_text(&folder, cases[i].json,
                      "{\"w\": 64, \"h\": 48, \"fl_x\": 50, \"test_filenames\": [\"images/b.png\"],"
                      " \"frames\": [{\"file_path\": \"images/a.png\", \"transform_matrix\":"
                      " [[1,0,0,0],[0,1,0,0],[0,0,1,1],[0,0,0,1]]}, {\"file_path\":"
                      " \"images/b.png\", \"transform_matrix\":"
                      " [[1,0,0,2],[0,1,0,0],[0,0,1,1],[0,0,0,1]]}]}");
        warnings[0] = 0;
        sgs_scene_options options = sgs_scene_options_default();
        options.use_dataset_split = true;
        sgs_scene *scene = load(folder.path, &options);
        assert_int_equal(scene->format, cases[i].format);
        if (cases[i].warning)
            snprintf(
                text, sizeof text,
                "%s/%s: ignored, because the COLMAP model %s%s is used; to use this file, with "
                "its split and masks, specify its path\n",
                folder.path, cases[i].json, folder.path, cases[i].warning);
        assert_string_equal(warnings, text);
        assert_int_equal(scene->view_count, cases[i].warning ? MODEL_IMAGES : 2);
        if (!cases[i].warning)
            assert_int_equal(scene->views[1].split, SGS_SPLIT_TEST);
        sgs_scene_destroy(scene);
        tree_remove(&folder);
    }
}

// Names by the Unicode standard: NFC and NFD of the same letters, and their bytes in Latin-1.
static void names_are_compared_as_systems_change_them(void **state)
{
    (void)state;
    static const struct {
        const char *a, *b;
        sgsi_name_difference difference;
    } cases[] = {
        {"a.jpg", "a.jpg", SGSI_NAME_DIFFERS},
        {"a.jpg", "b.jpg", SGSI_NAME_DIFFERS},
        {"", "a", SGSI_NAME_DIFFERS},
        {"a0.jpg", "A0.JPG", SGSI_NAME_CASE},
        {"sub/a.jpg", "Sub/a.jpg", SGSI_NAME_CASE},
        {"images/a.jpg", "a.jpg", SGSI_NAME_FOLDER},
        {"a.jpg", "x/y/a.jpg", SGSI_NAME_FOLDER},
        {"a.jpg", "ba.jpg", SGSI_NAME_DIFFERS},
        {"x/a.jpg", "y/a.jpg", SGSI_NAME_DIFFERS},
        {"K\xc3\xbc"
         "che",
         "Ku\xcc\x88"
         "che",
         SGSI_NAME_FORM},
        {"\xc5\x81\xc3\xb3", "\xc5\x81o\xcc\x81", SGSI_NAME_FORM}, // the first letter has no base
        {"\xc5\xa1", "s\xcc\x8c", SGSI_NAME_FORM},
        {"K\xc3\xbc"
         "che",
         "K\xfc"
         "che",
         SGSI_NAME_ENCODING},
        {"Stra\xc3\x9f"
         "e",
         "Stra\xdf"
         "e",
         SGSI_NAME_ENCODING},
        {"\xf0", "\xc3\xb0", SGSI_NAME_ENCODING}, // the end of the name, not four bytes
        {"K\xc3\xbc"
         "che",
         "Kuche", SGSI_NAME_ACCENTS},
        {"K\xc3\x9c"
         "CHE",
         "ku\xcc\x88"
         "che",
         SGSI_NAME_CASE},
        {"\xc3\xa9.jpg", "\xc3\xa8.jpg", SGSI_NAME_ACCENTS},
        {"\xc3\x89.jpg", "e.jpg", SGSI_NAME_ACCENTS},
        {"\xf0\x9f\x98\x80.jpg", "\xf0\x9f\x98\x81.jpg", SGSI_NAME_DIFFERS},
        {"\xe3\x81\x82", "\xe3\x81\x84", SGSI_NAME_DIFFERS},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i)
        if (sgsi_name_compare(cases[i].a, cases[i].b) != cases[i].difference ||
            sgsi_name_compare(cases[i].b, cases[i].a) != cases[i].difference)
            fail_msg("'%s' and '%s'", cases[i].a, cases[i].b);
    static char longest[1025], other[1025];
    memset(longest, 0xfc, sizeof longest - 1);
    memset(other, 0xdc, sizeof other - 1);
    assert_int_equal(sgsi_name_compare(longest, other), SGSI_NAME_CASE);
    other[0] = 'x';
    assert_int_equal(sgsi_name_compare(longest, other), SGSI_NAME_DIFFERS);
}

// Moves two photos of a scene.
static void rename_photos(const temp_folder *folder, const char *a, const char *b)
{
    assert_int_equal(rename(temp_path(folder, "images/a.png"), temp_path(folder, a)), 0);
    assert_int_equal(rename(temp_path(folder, "images/b.png"), temp_path(folder, b)), 0);
}

static void missing_photos_with_similar_names_are_explained_once(void **state)
{
    (void)state;
    static const struct {
        const char *a, *b, *hint;
    } cases[] = {
        {"images/A.png", "images/B.PNG",
         "/images: image 'a.png' of the model and the file 'A.png' differ only in upper and lower "
         "case; rename the files\n"},
        {"images/sub/a.png", "images/sub/b.png",
         "/images: image 'a.png' of the model is the file 'sub/a.png'; use option images_dir "
         "images/sub\n"},
        {"images/x.png", "images/B.png",
         "/images: image 'b.png' of the model and the file 'B.png' differ only in upper and lower "
         "case; rename the files\n"},
        {"images/x.png", "images/y.png", NULL},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        const temp_folder folder = scene_make("sparse/0/", true, "images");
        rename_photos(&folder, cases[i].a, cases[i].b);
        warnings[0] = 0;
        sgs_scene *scene = load(folder.path, NULL);
        assert_int_equal(scene->images_missing, 2);
        assert_int_equal(scene->images_unposed, 2);
        const char *first = strstr(warnings, " of the model ");
        if (cases[i].hint) {
            assert_holds(warnings, cases[i].hint);
            assert_null(strstr(first + 1, " of the model "));
        } else {
            assert_null(first);
        }
        sgs_scene_destroy(scene);
        tree_remove(&folder);
    }
}

static void the_error_without_photos_names_the_folder_to_use(void **state)
{
    (void)state;
    static const struct {
        const char *names[2], *images, *option, *hint;
    } cases[] = {
        {{"images/a.png", "images/b.png"}, "images", NULL, "; use option images_dir ."},
        {{"photos/a.png", "photos/b.png"}, "photos", "photos", "; use option images_dir ."},
        {{"photos/a.png", "photos/b.png"},
         "images",
         NULL,
         "; with option images_dir, use the folder that contains 'photos'"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        const temp_folder folder = temp_folder_make();
        model m = model_make();
        m.image_count = 2;
        m.images[0].name = "a.png";
        m.images[1].name = "b.png";
        model_put_pictures(&folder, cases[i].images, &m, (picture){32, 24, 3, red});
        m.images[0].name = cases[i].names[0];
        m.images[1].name = cases[i].names[1];
        model_put(&folder, "sparse/0/", &m, true);
        sgs_scene_options options = sgs_scene_options_default();
        options.images_dir = cases[i].option;
        sgs_scene *scene;
        assert_int_equal(sgs_scene_load(folder.path, &options, &scene), SGS_STATUS_IO);
        assert_holds(sgs_last_error(), "none of the 2 registered images can be read; image '");
        assert_holds(sgs_last_error(), "/a.png' of the model is the file 'a.png' of the folder");
        assert_holds(sgs_last_error(), cases[i].hint);
        bad_input();
        if (i < 2) {
            options.images_dir = ".";
            scene = load(folder.path, &options);
            assert_int_equal(scene->view_count, 2);
            sgs_scene_destroy(scene);
        }
        tree_remove(&folder);
    }
}

// HDR files and JPEG files in one scene: the white level applies to the former only.
static void photos_of_both_kinds_are_reported(void **state)
{
    (void)state;
    const temp_folder folder = scene_make("sparse/0/", true, "images");
    static float light[32 * 24 * 3];
    for (size_t i = 0; i < sizeof light / sizeof *light; ++i)
        light[i] = 0.5f;
    assert_int_equal(unlink(temp_path(&folder, "images/b.png")), 0);
    tiff_put(&folder, "images/b.tif", &(tiff){32, 24, 3, 32, 2, 3, 0}, light, sizeof light);
    char text[1024];
    for (int photos = 0; photos < 2; ++photos) {
        sgs_scene_options options = sgs_scene_options_default();
        options.load_images = photos;
        warnings[0] = 0;
        sgs_scene *scene = load(folder.path, &options);
        assert_int_equal(scene->linear_images, 1);
        assert_string_equal(scene->color_spaces, "sRGB, linear");
        snprintf(text, sizeof text,
                 "%s: 1 of 4 images are scene-linear (first %s/images/b.tif) and use the white "
                 "level; the "
                 "others are display-encoded",
                 folder.path, folder.path);
        assert_holds(warnings, text);
        sgs_scene_destroy(scene);
    }
    sgs_scene_options options = sgs_scene_options_default();
    options.colorspace = "lin_rec709";
    warnings[0] = 0;
    sgs_scene *scene = load(folder.path, &options);
    assert_int_equal(scene->linear_images, 4);
    assert_string_equal(scene->color_spaces, "lin_rec709");
    assert_string_equal(warnings, "");
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

static void names_of_test_images_may_contain_commas(void **state)
{
    (void)state;
    static const struct {
        const char *list, *held_out; // of a, b, c, d
    } cases[] = {{"a, 1.png", "1000"},       {"a, 1", "1000"},
                 {"a, 1.png,c.png", "1010"}, {" c.png , a, 1.png ,", "1010"},
                 {"b,,x,,,y.png", "0100"},   {"b,,x,,,y.png,a, 1.png", "1100"},
                 {"a, 1.png, b,,x", NULL},   {"d.png,c.png,a, 1.png", "1011"}};
    const temp_folder folder = temp_folder_make();
    model m = model_make();
    m.images[0].name = "a, 1.png";
    m.images[1].name = "b,,x,,,y.png";
    m.images[2].name = "c.png";
    m.images[3].name = "d.png";
    model_put(&folder, "sparse/0/", &m, true);
    model_put_pictures(&folder, "images", &m, (picture){32, 24, 3, red});
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        sgs_scene_options options = sgs_scene_options_default();
        options.test_images = cases[i].list;
        sgs_scene *scene;
        const sgs_status status = sgs_scene_load(folder.path, &options, &scene);
        if (!cases[i].held_out) {
            assert_int_equal(status, SGS_STATUS_INVALID_ARGUMENT);
            assert_holds(sgs_last_error(),
                         "no view named 'b' to hold out; the nearest names are '");
            continue;
        }
        assert_int_equal(status, SGS_STATUS_OK);
        for (size_t v = 0; v < 4; ++v)
            assert_int_equal(scene->views[v].split,
                             cases[i].held_out[v] == '1' ? SGS_SPLIT_TEST : SGS_SPLIT_TRAIN);
        sgs_scene_destroy(scene);
    }
    tree_remove(&folder);
}

// A JPEG file that asks viewers to turn it: Exif tag 274 in the segment APP1 (Exif 2.3, 4.5.4 and
// 4.6.4).
static void put_turned(const temp_folder *folder, const char *name, int orientation)
{
    const unsigned char segment[] = {
        0xff, 0xe1, 0,   34, 'E', 'x', 'i', 'f', 0,
        0, // TIFF header:
        'I',  'I',  '*', 0,  8,   0,   0,   0,   1,
        0, // one entry
        0x12, 1,    3,   0,  1,   0,   0,   0,   (unsigned char)orientation,
        0,    0,    0,   0,  0,   0,   0};
    size_t size;
    unsigned char *photo = file_get(SGSI_TEST_DATA "/room/images/0001.jpg", &size);
    unsigned char *turned = malloc(size + sizeof segment);
    assert_non_null(turned);
    memcpy(turned, photo, 2);
    memcpy(turned + 2, segment, sizeof segment);
    memcpy(turned + 2 + sizeof segment, photo + 2, size - 2);
    tree_put(folder, name, turned, size + sizeof segment);
    free(photo);
    free(turned);
}

static void turned_photos_are_explained_by_their_orientation(void **state)
{
    (void)state;
    for (int k = 0; k < 3; ++k) {
        const temp_folder folder = temp_folder_make();
        static const int orientations[] = {1, 6, 8};
        put_turned(&folder, "a.jpg", orientations[k]);
        tree_put_text(
            &folder, "transforms.json",
            "{\"w\": 270, \"h\": 480, \"fl_x\": 230, \"frames\": [{\"file_path\": \"a.jpg\","
            " \"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}");
        warnings[0] = 0;
        sgs_scene *scene = load(folder.path, NULL);
        assert_int_equal(scene->views[0].orientation, orientations[k]);
        assert_holds(warnings,
                     "aspect ratio of 1 image(s), first 'a.jpg', differs from their camera");
        assert_holds(warnings, k == 0 ? "; were they rotated or cropped?"
                               : k == 1
                                   ? "; its EXIF orientation 6 is not applied: rotate the pixels"
                                   : "; its EXIF orientation 8 is not applied: rotate the pixels");
        sgs_scene_destroy(scene);
        tree_remove(&folder);
    }
}

// COLMAP's automatic_reconstructor writes dense/0, image_undistorter dense.
static void scenes_below_the_folder_are_named(void **state)
{
    (void)state;
    static const char *const places[][2] = {{"dense/0/sparse/", "dense/0"},
                                            {"dense/sparse/", "dense"},
                                            {"dense/sparse/0/", "dense"},
                                            {"model/", "model"}};
    sgs_scene *scene;
    char text[600];
    for (size_t i = 0; i < sizeof places / sizeof *places; ++i) {
        const temp_folder folder = scene_make(places[i][0], true, "dense/0/images");
        tree_put_text(&folder, "more/a.txt", "");
        assert_int_equal(sgs_scene_load(folder.path, NULL, &scene), SGS_STATUS_IO);
        snprintf(text, sizeof text, "%s: no scene found, but there is one in %s/%s; specify this ",
                 folder.path, folder.path, places[i][1]);
        assert_holds(sgs_last_error(), text);
        bad_input();
        tree_remove(&folder);
    }
    const temp_folder folder = temp_folder_make();
    tree_put_text(&folder, "nerf/transforms.json", "{}");
    assert_int_equal(sgs_scene_load(folder.path, NULL, &scene), SGS_STATUS_IO);
    assert_holds(sgs_last_error(), "/nerf; specify this folder");
    bad_input();
    tree_remove(&folder);
}

static void text_files_beside_binary_ones_are_reported(void **state)
{
    (void)state;
    const temp_folder folder = scene_make("sparse/0/", true, "images");
    model m = model_make();
    sgs_scene *scene = load(folder.path, NULL);
    assert_string_equal(warnings, "");
    sgs_scene_destroy(scene);
    m.image_count = 2;
    model_put(&folder, "sparse/0/", &m, false);
    scene = load(folder.path, NULL);
    assert_int_equal(scene->view_count, MODEL_IMAGES);
    assert_holds(warnings, "/sparse/0: contains the model as .bin and as .txt; the .txt files are "
                           "ignored\n");
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(transforms_precede_only_the_model_of_nerfstudio, warnings_begin),
        cmocka_unit_test(names_are_compared_as_systems_change_them),
        cmocka_unit_test_setup(missing_photos_with_similar_names_are_explained_once,
                               warnings_begin),
        cmocka_unit_test_setup(the_error_without_photos_names_the_folder_to_use, warnings_begin),
        cmocka_unit_test_setup(photos_of_both_kinds_are_reported, warnings_begin),
        cmocka_unit_test_setup(names_of_test_images_may_contain_commas, warnings_begin),
        cmocka_unit_test_setup(turned_photos_are_explained_by_their_orientation, warnings_begin),
        cmocka_unit_test_setup(scenes_below_the_folder_are_named, warnings_begin),
        cmocka_unit_test_setup(text_files_beside_binary_ones_are_reported, warnings_begin),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
