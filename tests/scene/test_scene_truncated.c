// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Truncated image files of a scene, with and without loading its images.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "support/scene_support.h"

static temp_folder scene_make(void)
{
    static const uint8_t grey[3] = {90, 100, 110};
    const temp_folder folder = temp_folder_make();
    const model m = model_make();
    model_put(&folder, "sparse/0/", &m, true);
    model_put_pictures(&folder, "images", &m, (picture){64, 48, 3, grey});
    return folder;
}

// The missing part of a JPEG or PNG file is found in advance, unless only headers are read.
static void truncated_images_are_skipped(void **state)
{
    (void)state;
    const temp_folder folder = scene_make();
    size_t size;
    unsigned char *bytes = file_get(temp_path(&folder, "images/b.png"), &size);
    file_put(temp_path(&folder, "images/b.png"), bytes, size - 12); // without the chunk IEND
    free(bytes);
    for (int k = 0; k < 3; ++k) {
        sgs_scene_options options = sgs_scene_options_default();
        options.load_images = k == 0;
        options.headers_only = k == 2;
        warnings_begin(state);
        sgs_scene *scene;
        assert_int_equal(sgs_scene_load(folder.path, &options, &scene), SGS_STATUS_OK);
        assert_int_equal(scene->view_count, k == 2 ? 4 : 3);
        assert_int_equal(scene->images_missing, k == 2 ? 0 : 1);
        if (k < 2)
            assert_holds(warnings, "images/b.png: the image file is truncated; copy it again; the "
                                   "view is skipped");
        sgs_scene_destroy(scene);
    }
    tree_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(truncated_images_are_skipped, warnings_begin),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
