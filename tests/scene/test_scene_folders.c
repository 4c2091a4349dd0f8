// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Folders, masks and links that exist but cannot be used are errors, not missing ones: a scene is
// never trained without its masks because of a permission. Root reads every folder, so the tests of
// permissions become another user.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "support/bad_input.h"
#include "support/scene_support.h"

enum { NOBODY = 65534 };

static const uint8_t red[4] = {250, 20, 10, 255};

static temp_folder scene_make(void)
{
    const temp_folder folder = temp_folder_make();
    const model m = model_make();
    model_put(&folder, "sparse/0/", &m, true);
    model_put_pictures(&folder, "images", &m, (picture){32, 24, 3, red});
    assert_int_equal(chmod(folder.path, 0755), 0);
    return folder;
}

// The error ends with `message`, after the path of the scene's folder.
static void assert_refused(const char *path, const char *masks, const char *message)
{
    sgs_scene_options options = sgs_scene_options_default();
    options.load_images = false;
    options.masks_dir = masks;
    sgs_scene *scene = (sgs_scene *)1;
    const sgs_status status = sgs_scene_load(path, &options, &scene);
    assert_null(scene);
    assert_holds(sgs_last_error(), message);
    assert_int_equal(status, SGS_STATUS_IO);
    bad_input();
}

static size_t count_views(const char *path, const char *masks)
{
    sgs_scene_options options = sgs_scene_options_default();
    options.load_images = false;
    options.masks_dir = masks;
    sgs_scene *scene;
    if (sgs_scene_load(path, &options, &scene))
        fail_msg("%s", sgs_last_error());
    const size_t count = scene->view_count;
    sgs_scene_destroy(scene);
    return count;
}

static void masks_that_are_no_files_are_refused(void **state)
{
    (void)state;
    static const char *const names[] = {"masks/a.png",       "masks/a.png.png",
                                        "mask/sub/c.png",    "masks/a_mask.png",
                                        "images/b_mask.png", "images/dynamic_mask_b.png"};
    for (size_t i = 0; i < sizeof names / sizeof *names; ++i) {
        temp_folder folder = scene_make();
        char text[256];
        tree_put_text(&folder, names[i], "");
        assert_int_equal(unlink(temp_path(&folder, names[i])), 0);
        assert_int_equal(symlink("nowhere.png", temp_path(&folder, names[i])), 0);
        snprintf(text, sizeof text, "/%s: symbolic link to a missing file; use option masks_dir",
                 names[i]);
        assert_refused(folder.path, NULL, text);
        assert_int_equal(count_views(folder.path, "none"), MODEL_IMAGES);
        assert_int_equal(unlink(temp_path(&folder, names[i])), 0);
        assert_int_equal(symlink(strrchr(names[i], '/') + 1, temp_path(&folder, names[i])), 0);
        snprintf(text, sizeof text, "/%s: Too many levels of symbolic links", names[i]);
        assert_refused(folder.path, NULL, text);
        assert_int_equal(unlink(temp_path(&folder, names[i])), 0);
        assert_int_equal(mkdir(temp_path(&folder, names[i]), 0755), 0);
        snprintf(text, sizeof text, "/%s: is not a regular file", names[i]);
        assert_refused(folder.path, NULL, text);
        assert_int_equal(rmdir(temp_path(&folder, names[i])), 0);
        assert_int_equal(count_views(folder.path, NULL), MODEL_IMAGES);
        tree_remove(&folder);
    }
}

static void mask_folders_that_are_no_folders_are_refused(void **state)
{
    (void)state;
    temp_folder folder = scene_make();
    assert_refused(folder.path, "people",
                   "/people: no such mask folder; use option masks_dir none");
    tree_put_text(&folder, "masks", "");
    assert_refused(folder.path, NULL, "/masks: is not a folder; use option masks_dir none");
    assert_refused(folder.path, "masks", "/masks: is not a folder");
    assert_refused(folder.path, "masks/of/people", "/masks: Not a directory");
    assert_int_equal(unlink(temp_path(&folder, "masks")), 0);
    assert_int_equal(symlink("nowhere", temp_path(&folder, "masks")), 0);
    assert_refused(folder.path, NULL, "/masks: symbolic link to a missing file");
    assert_int_equal(unlink(temp_path(&folder, "masks")), 0);
    tree_put_text(&folder, "masks/sub", ""); // the mask of sub/c.png would be in a folder
    assert_refused(folder.path, NULL, "/masks/sub: Not a directory");
    static char longest[5000];
    memset(longest, 'x', sizeof longest - 1);
    for (size_t i = 0; i < sizeof longest - 1; i += 100)
        longest[i] = '/';
    assert_refused(folder.path, longest, "...: File name too long");
    assert_refused(longest, NULL, "...: File name too long");
    tree_remove(&folder);
}

// A name of 251 bytes is allowed; the names of its masks, which are longer, cannot exist.
static void long_names_of_photos_have_no_masks(void **state)
{
    (void)state;
    temp_folder folder = temp_folder_make();
    char name[252], path[600];
    memset(name, 'n', 247);
    memcpy(name + 247, ".png", 5);
    model m = model_make();
    m.image_count = 1;
    m.images[0].name = name;
    model_put(&folder, "sparse/0/", &m, true);
    tree_put_picture(&folder, "images/short.png", 32, 24, 3, red);
    snprintf(path, sizeof path, "%s/images/%s", folder.path, name);
    assert_int_equal(rename(temp_path(&folder, "images/short.png"), path), 0);
    assert_int_equal(count_views(folder.path, NULL), 1);
    tree_remove(&folder);
}

static void models_behind_broken_links_are_reported(void **state)
{
    (void)state;
    temp_folder folder = scene_make();
    assert_int_equal(rename(temp_path(&folder, "sparse"), temp_path(&folder, "model")), 0);
    assert_int_equal(symlink("nowhere", temp_path(&folder, "sparse")), 0);
    assert_refused(folder.path, NULL, "/sparse: symbolic link to a missing file");
    assert_int_equal(unlink(temp_path(&folder, "sparse")), 0);
    tree_put_text(&folder, "sparse", "");
    assert_refused(folder.path, NULL, "/sparse: is not a folder");
    assert_int_equal(unlink(temp_path(&folder, "sparse")), 0);
    tree_put_text(&folder, "colmap", "");
    assert_refused(folder.path, NULL, "/colmap: Not a directory");
    assert_int_equal(symlink("nowhere", temp_path(&folder, "transforms.json")), 0);
    assert_refused(folder.path, NULL, "/transforms.json: symbolic link to a missing file");
    assert_int_equal(unlink(temp_path(&folder, "transforms.json")), 0);
    // A file named like a folder of models hides none.
    tree_put_text(
        &folder, "transforms.json",
        "{\"w\": 32, \"h\": 24, \"fl_x\": 30, \"frames\": [{\"file_path\": \"images/a.png\","
        " \"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,1],[0,0,0,1]]}]}");
    assert_int_equal(count_views(folder.path, NULL), 1);
    tree_remove(&folder);
}

static void image_folders_behind_broken_links_are_reported(void **state)
{
    (void)state;
    temp_folder folder = scene_make();
    assert_int_equal(rename(temp_path(&folder, "images"), temp_path(&folder, "photos")), 0);
    assert_int_equal(symlink("nowhere", temp_path(&folder, "images")), 0);
    assert_refused(folder.path, NULL, "/images: symbolic link to a missing file");
    assert_int_equal(unlink(temp_path(&folder, "images")), 0);
    assert_int_equal(symlink("photos", temp_path(&folder, "images")), 0);
    assert_int_equal(count_views(folder.path, NULL), MODEL_IMAGES);
    tree_remove(&folder);
}

// The scene cannot be loaded while `name` has these permissions, and the error names `name`.
static void assert_locked(const temp_folder *folder, const char *name, mode_t mode)
{
    char text[128];
    snprintf(text, sizeof text, "/%s: Permission denied", name);
    assert_int_equal(chmod(temp_path(folder, name), mode), 0);
    const bool root = geteuid() == 0;
    if (root)
        assert_int_equal(seteuid(NOBODY), 0);
    assert_refused(folder->path, NULL, text);
    if (root)
        assert_int_equal(seteuid(0), 0);
    assert_int_equal(chmod(temp_path(folder, name), 0755), 0);
}

static void locked_folders_are_named(void **state)
{
    (void)state;
    static const char *const names[] = {"sparse", "sparse/0", "images", "masks"};
    static const mode_t modes[] = {0, 0444, 0311}; // none, no search, no list
    temp_folder folder = scene_make();
    tree_put_text(&folder, "masks/x.png", "");
    for (size_t i = 0; i < sizeof names / sizeof *names; ++i)
        for (size_t k = 0; k < sizeof modes / sizeof *modes; ++k)
            assert_locked(&folder, names[i], modes[k]);
    assert_locked(&folder, "images/sub", 0);
    tree_remove(&folder);
}

static void locked_photos_of_transforms_are_named(void **state)
{
    (void)state;
    temp_folder folder = scene_make();
    assert_int_equal(rename(temp_path(&folder, "sparse"), temp_path(&folder, "model")), 0);
    tree_put_text(
        &folder, "transforms.json",
        "{\"w\": 32, \"h\": 24, \"fl_x\": 30, \"frames\": [{\"file_path\": \"images/a.png\","
        " \"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,1],[0,0,0,1]]}]}");
    assert_locked(&folder, "images", 0);
    assert_locked(&folder, "images", 0444);
    assert_int_equal(count_views(folder.path, NULL), 1);
    tree_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(masks_that_are_no_files_are_refused, warnings_begin),
        cmocka_unit_test_setup(mask_folders_that_are_no_folders_are_refused, warnings_begin),
        cmocka_unit_test_setup(long_names_of_photos_have_no_masks, warnings_begin),
        cmocka_unit_test_setup(models_behind_broken_links_are_reported, warnings_begin),
        cmocka_unit_test_setup(image_folders_behind_broken_links_are_reported, warnings_begin),
        cmocka_unit_test_setup(locked_folders_are_named, warnings_begin),
        cmocka_unit_test_setup(locked_photos_of_transforms_are_named, warnings_begin),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
