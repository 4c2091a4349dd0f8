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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(transforms_precede_only_the_model_of_nerfstudio, warnings_begin),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
