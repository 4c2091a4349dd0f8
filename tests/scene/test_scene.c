// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Whole scenes: location of their parts, cameras fitted to photos, the split, the extent, and
// missing photos, poses or both.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "support/bad_input.h"
#include "support/scene_support.h"
#include "base/threads.h"

#define ROOM SGSI_TEST_DATA "/room"

static const uint8_t red[4] = {250, 20, 10, 255}, glass[4] = {100, 150, 200, 128};

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

static void assert_refused(const char *path, const sgs_scene_options *options, sgs_status status,
                           const char *message)
{
    sgs_scene *scene = (sgs_scene *)1;
    const sgs_status got = sgs_scene_load(path, options, &scene);
    assert_null(scene);
    assert_holds(sgs_last_error(), message);
    assert_int_equal(got, status);
    bad_input();
}

static void models_are_found_in_all_usual_places(void **state)
{
    (void)state;
    static const struct {
        const char *model, *images, *scene;
    } places[] = {
        {"sparse/0/", "images", ""},
        {"sparse/", "images", ""},
        {"colmap/sparse/0/", "images", ""},
        {"colmap/sparse/0/", "colmap/images", ""},
        {"", "images", ""},
        {"model/", "images", "model"},
        {"sparse/0/", "images", "sparse/0"},
        {"sparse/0/", "images", "sparse"},
    };
    for (size_t i = 0; i < sizeof places / sizeof *places; ++i) {
        for (int binary = 0; binary < 2; ++binary) {
            const temp_folder folder = scene_make(places[i].model, binary, places[i].images);
            sgs_scene *scene = load(temp_path(&folder, places[i].scene), NULL);
            assert_int_equal(scene->format,
                             binary ? SGS_SCENE_COLMAP_BINARY : SGS_SCENE_COLMAP_TEXT);
            assert_int_equal(scene->view_count, MODEL_IMAGES);
            assert_int_equal(scene->point_count, MODEL_POINTS);
            assert_int_equal(scene->images_missing + scene->images_unposed, 0);
            assert_string_equal(warnings, "");
            sgs_scene_destroy(scene);
            tree_remove(&folder);
        }
    }
}

static void largest_of_several_models_is_used(void **state)
{
    (void)state;
    const temp_folder folder = scene_make("sparse/2/", true, "images");
    model small = model_make();
    small.image_count = 2;
    model_put(&folder, "sparse/0/", &small, true);
    model_put(&folder, "sparse/10/", &small, false);
    tree_put_text(&folder, "sparse/1/images.bin", "only half of a model");
    sgs_scene *scene = load(folder.path, NULL);
    assert_int_equal(scene->view_count, MODEL_IMAGES);
    assert_holds(scene->model_path, "sparse/2");
    assert_holds(warnings, "contains 3 models; using the largest, 2 with 4 images");
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

static void missing_scenes_are_reported_with_a_hint(void **state)
{
    (void)state;
    temp_folder folder = temp_folder_make();
    assert_refused("/nowhere/at/all", NULL, SGS_STATUS_IO,
                   "/nowhere/at/all: no such folder; specify a data set of COLMAP or with a "
                   "transforms.json");
    assert_refused("", NULL, SGS_STATUS_INVALID_ARGUMENT, "scene path is missing");
    assert_refused(folder.path, NULL, SGS_STATUS_IO, "no scene found: neither a COLMAP model");
    tree_put_text(&folder, "photo.jpg", "");
    assert_refused(temp_path(&folder, "photo.jpg"), NULL, SGS_STATUS_INVALID_ARGUMENT,
                   "is a file, not a scene; specify a scene folder");
    tree_put_text(&folder, "sparse/0/cameras.bin", "");
    assert_refused(folder.path, NULL, SGS_STATUS_IO, "sparse/0/images.bin: missing, although ");
    tree_remove(&folder);
    folder = temp_folder_make();
    tree_put_text(&folder, "sparse/images.txt", "");
    assert_refused(folder.path, NULL, SGS_STATUS_IO, "sparse/cameras.txt: missing, although ");
    tree_remove(&folder);
}

static void missing_image_folder_error_lists_the_others(void **state)
{
    (void)state;
    temp_folder folder = scene_make("sparse/0/", true, "images_8");
    tree_put_text(&folder, "images_4/x.txt", "");
    assert_refused(
        folder.path, NULL, SGS_STATUS_IO,
        ": no image folder 'images'; choose one of images_4, images_8 with option images_dir");
    sgs_scene_options options = sgs_scene_options_default();
    options.images_dir = "images_8";
    sgs_scene *scene = load(folder.path, &options);
    assert_int_equal(scene->view_count, MODEL_IMAGES);
    sgs_scene_destroy(scene);
    char absolute[512];
    snprintf(absolute, sizeof absolute, "%s/images_8", folder.path);
    options.images_dir = absolute;
    sgs_scene_destroy(load(folder.path, &options));
    tree_remove(&folder);
    folder = scene_make("", true, "photos"); // images.bin is not a folder
    assert_refused(folder.path, NULL, SGS_STATUS_IO, ": no image folder 'images'; create it");
    tree_remove(&folder);
}

static void cameras_are_fitted_to_their_photos(void **state)
{
    (void)state;
    const temp_folder folder = scene_make("sparse/0/", true, "images");
    // 64 x 48 in the model: the scale differs per axis.
    tree_put_picture(&folder, "images/b.png", 16, 24, 3, red);
    sgs_scene *scene = load(folder.path, NULL);
    const char *const names[] = {"a.png", "b.png", "d with blanks.png", "sub/c.png"};
    for (int i = 0; i < 4; ++i) {
        assert_string_equal(scene->views[i].name, names[i]);
        assert_holds(scene->views[i].image_path, names[i]);
        assert_int_equal(scene->views[i].camera.width, i == 1 ? 16 : 32);
        assert_int_equal(scene->views[i].camera.height, 24);
        assert_int_equal(scene->views[i].image.width, scene->views[i].camera.width);
        assert_int_equal(scene->views[i].image.pixels[0], 250);
    }
    assert_true(scene->views[0].camera.params[0] == 25 && scene->views[0].camera.params[1] == 16);
    assert_true(scene->views[1].camera.params[0] == 50.5 / 4 &&
                scene->views[1].camera.params[1] == 51.25 / 2);
    assert_int_equal(scene->views[3].camera.model, SGS_CAMERA_FULL_OPENCV);
    assert_true(scene->views[3].camera.params[0] == 22.5);
    assert_holds(warnings, "aspect ratio of 1 image(s), first 'b.png', differs from their camera");
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

static void downscaling_divides_images_and_cameras(void **state)
{
    (void)state;
    const temp_folder folder = scene_make("sparse/0/", true, "images");
    sgs_scene_options options = sgs_scene_options_default();
    for (int load_images = 0; load_images < 2; ++load_images) {
        options.downscale = 5;
        options.load_images = load_images;
        sgs_scene *scene = load(folder.path, &options);
        const sgs_view *view = &scene->views[0];
        assert_true(view->camera.width == 6 && view->camera.height == 4);
        assert_int_equal(view->camera.model, SGS_CAMERA_PINHOLE); // 6/64 is not 4/48
        assert_true(fabs(view->camera.params[0] - 50 * 6.0 / 64) < 1e-12);
        assert_true(fabs(view->camera.params[1] - 50 * 4.0 / 48) < 1e-12);
        assert_int_equal(view->image.pixels != NULL, load_images);
        if (view->image.pixels)
            assert_true(view->image.width == 6 && view->image.height == 4 &&
                        view->image.pixels[0] == 250);
        sgs_scene_destroy(scene);
        options.downscale = 100;
        scene = load(folder.path, &options);
        assert_true(scene->views[0].camera.width == 1 && scene->views[0].camera.height == 1);
        sgs_scene_destroy(scene);
    }
    options.downscale = -1;
    assert_refused(folder.path, &options, SGS_STATUS_INVALID_ARGUMENT, " is negative");
    options.downscale = 0;
    options.test_every = -1;
    assert_refused(folder.path, &options, SGS_STATUS_INVALID_ARGUMENT, " is negative");
    tree_remove(&folder);
}

static void wide_images_are_downscaled_to_1600_pixels_with_a_warning(void **state)
{
    (void)state;
    const temp_folder folder = scene_make("sparse/0/", true, "images");
    tree_put_picture(&folder, "images/a.png", 2001, 2, 3, red);
    sgs_scene *scene = load(folder.path, NULL);
    assert_true(scene->views[0].camera.width == 1600 && scene->views[0].camera.height == 1);
    assert_true(scene->views[0].image.width == 1600 && scene->views[1].camera.width == 32);
    const sgs_camera *file = &scene->views[0].file_camera;
    assert_true(file->width == 2001 && file->height == 2 &&
                scene->views[1].file_camera.width == 32);
    assert_true(scene->reduction == 2001.0 / 1600);
    assert_holds(warnings, "images wider than 1600 px are reduced to 1600 px; use option downscale "
                           "1 to keep their size");
    sgs_scene_destroy(scene);
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 1;
    warnings_begin(state);
    scene = load(folder.path, &options);
    assert_int_equal(scene->views[0].camera.width, 2001);
    assert_true(scene->reduction == 1);
    assert_null(strstr(warnings, "1600"));
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

static void missing_and_broken_images_are_skipped_and_counted(void **state)
{
    (void)state;
    const temp_folder folder = scene_make("sparse/0/", true, "images");
    unlink(temp_path(&folder, "images/a.png"));
    tree_put_text(&folder, "images/b.png", "broken");
    for (int load_images = 0; load_images < 2; ++load_images) {
        sgs_scene_options options = sgs_scene_options_default();
        options.load_images = load_images;
        warnings_begin(state);
        sgs_scene *scene = load(folder.path, &options);
        assert_int_equal(scene->view_count, 2);
        assert_int_equal(scene->images_missing, 2);
        assert_int_equal(scene->images_unposed, 0); // the broken one has a pose
        assert_string_equal(scene->views[0].name, "d with blanks.png");
        assert_holds(warnings, "images/a.png: no such file; the view is skipped");
        assert_holds(warnings, "images/b.png: cannot read the image: ");
        sgs_scene_destroy(scene);
    }
    unlink(temp_path(&folder, "images/d with blanks.png"));
    unlink(temp_path(&folder, "images/sub/c.png"));
    assert_refused(folder.path, NULL, SGS_STATUS_IO,
                   "images: none of the 4 registered images can be read; first error: ");
    tree_remove(&folder);
}

static void images_without_a_pose_are_counted(void **state)
{
    (void)state;
    const temp_folder folder = scene_make("sparse/0/", true, "images");
    tree_put_picture(&folder, "images/z.png", 4, 4, 3, red);
    tree_put_text(&folder, "images/sub/y.JPG", "");
    tree_put_text(&folder, "images/sub/c.DNG", ""); // the raw file of sub/c.png
    tree_put_text(&folder, "images/notes.txt", "");
    tree_put_text(&folder, "images/.hidden.png", "");
    sgs_scene *scene = load(folder.path, NULL);
    assert_int_equal(scene->view_count, MODEL_IMAGES);
    assert_int_equal(scene->images_unposed, 2);
    assert_holds(warnings,
                 "images: ignored 2 image(s) without a pose in the model: sub/y.JPG, z.png\n");
    sgs_scene_destroy(scene);
    for (int i = 0; i < 3; ++i) {
        char name[32];
        snprintf(name, sizeof name, "images/%d.png", i);
        tree_put_text(&folder, name, "");
    }
    scene = load(folder.path, NULL);
    assert_int_equal(scene->images_unposed, 5);
    assert_holds(warnings, "without a pose in the model: 0.png, 1.png, 2.png, ...\n");
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

// Other paths of a folder by links, also cyclic ones, count nothing twice, and links out of the
// data set are not followed.
static void images_behind_links_are_counted_once(void **state)
{
    (void)state;
    const temp_folder folder = scene_make("sparse/0/", true, "images"),
                      outside = temp_folder_make();
    tree_put_picture(&folder, "images/z.png", 4, 4, 3, red);
    tree_put_picture(&folder, "other/w.png", 4, 4, 3, red);
    tree_put_picture(&outside, "v.png", 4, 4, 3, red);
    const struct {
        const char *target, *name;
    } links[] = {{".", "images/0"},         {".", "images/1"},        {"sub", "images/2"},
                 {"..", "images/up"},       {"../other", "images/a"}, {"../images", "other/back"},
                 {outside.path, "images/v"}};
    for (size_t k = 0; k < sizeof links / sizeof *links; ++k)
        assert_int_equal(symlink(links[k].target, temp_path(&folder, links[k].name)), 0);
    sgs_scene *scene = load(folder.path, NULL);
    assert_int_equal(scene->view_count, MODEL_IMAGES);
    assert_int_equal(scene->images_unposed, 2);
    assert_holds(warnings, "without a pose in the model: a/w.png, z.png\n");
    sgs_scene_destroy(scene);
    tree_remove(&folder);
    tree_remove(&outside);
}

static void named_pipes_are_refused(void **state)
{
    (void)state;
    const temp_folder folder = scene_make("sparse/0/", true, "images");
    const model m = model_make();
    char name[256];
    snprintf(name, sizeof name, "images/%s", m.images[0].name);
    assert_int_equal(unlink(temp_path(&folder, name)), 0);
    assert_int_equal(mkfifo(temp_path(&folder, name), 0600), 0);
    sgs_scene *scene = load(folder.path, NULL);
    assert_int_equal(scene->view_count, MODEL_IMAGES - 1);
    assert_holds(warnings, "is not a regular file");
    sgs_scene_destroy(scene);
    assert_int_equal(unlink(temp_path(&folder, "sparse/0/points3D.bin")), 0);
    assert_int_equal(mkfifo(temp_path(&folder, "sparse/0/points3D.bin"), 0600), 0);
    assert_refused(folder.path, NULL, SGS_STATUS_IO, "points3D.bin: is not a regular file");
    tree_remove(&folder);
}

static void other_extension_in_a_downscaled_folder_is_found(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    model m = model_make();
    m.image_count = 1;
    m.images[0].name = "photo.JPEG";
    model_put(&folder, "sparse/0/", &m, true);
    tree_put_picture(&folder, "images/photo.png", 32, 24, 3, red);
    sgs_scene *scene = load(folder.path, NULL);
    assert_string_equal(scene->views[0].name, "photo.JPEG");
    assert_holds(scene->views[0].image_path, "images/photo.png");
    assert_int_equal(scene->images_unposed, 0);
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

// "1" for test views, in order.
static void assert_split(const char *path, const sgs_scene_options *options, const char *expected)
{
    sgs_scene *scene = load(path, options);
    for (size_t i = 0; i < scene->view_count; ++i)
        assert_int_equal(scene->views[i].split,
                         expected[i] == '1' ? SGS_SPLIT_TEST : SGS_SPLIT_TRAIN);
    assert_int_equal(scene->view_count, strlen(expected));
    sgs_scene_destroy(scene);
}

static void views_are_held_out_by_index_or_by_name(void **state)
{
    (void)state;
    const temp_folder folder = scene_make("sparse/0/", true, "images");
    sgs_scene_options options = sgs_scene_options_default();
    assert_split(folder.path, &options, "0000");
    options.test_every = 2;
    assert_split(folder.path, &options, "1010");
    options.test_every = 8;
    assert_split(folder.path, &options, "1000");
    options.test_images = "b.png"; // instead of every eighth
    assert_split(folder.path, &options, "0100");
    options.test_images = " c.png , a,,";
    assert_split(folder.path, &options, "1001");
    options.test_images = "sub/c";
    assert_split(folder.path, &options, "0001");
    options.test_images = "";
    assert_split(folder.path, &options, "0000");
    options.test_images = "a.png,bb.png";
    assert_refused(folder.path, &options, SGS_STATUS_INVALID_ARGUMENT,
                   "no view named 'bb.png' to hold out; the nearest names "
                   "are 'b.png', 'a.png', 'sub/c.png'");
    options.test_images = NULL;
    options.test_every = 1;
    assert_refused(folder.path, &options, SGS_STATUS_INVALID_ARGUMENT, "all 4 views are held out");
    unlink(temp_path(&folder, "images/a.png"));
    options.test_every = 2;
    assert_split(folder.path, &options, "101"); // counted over the loaded views
    tree_remove(&folder);
}

// A missing photo does not change the recorded split of the others.
static void recorded_names_stay_held_out(void **state)
{
    (void)state;
    static const char *const names[] = {"a.png", "sub/c.png", "gone.png"};
    const temp_folder folder = scene_make("sparse/0/", true, "images");
    sgs_scene_options options = sgs_scene_options_default();
    options.test_every = 2;
    options.test_images = "b.png";
    options.held_out = names;
    options.held_out_count = 3;
    assert_split(folder.path, &options, "1001");
    unlink(temp_path(&folder, "images/a.png"));
    assert_split(folder.path, &options, "001");
    options.held_out_count = 0;
    assert_split(folder.path, &options, "000");
    tree_remove(&folder);
}

static void short_name_holds_out_all_matching_views(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    model m = model_make();
    m.image_count = 3;
    m.images[0].name = "left/1.png";
    m.images[1].name = "right/1.png";
    m.images[2].name = "right/2.png";
    model_put(&folder, "sparse/0/", &m, true);
    model_put_pictures(&folder, "images", &m, (picture){32, 24, 3, red});
    sgs_scene_options options = sgs_scene_options_default();
    options.test_images = "1.png";
    assert_split(folder.path, &options, "110");
    options.test_images = "right/1.png";
    assert_split(folder.path, &options, "010");
    tree_remove(&folder);
}

static void views_are_found_by_name(void **state)
{
    (void)state;
    const temp_folder folder = scene_make("sparse/0/", true, "images");
    sgs_scene *scene = load(folder.path, NULL);
    assert_int_equal(sgs_scene_find_view(scene, "b.png"), 1);
    assert_int_equal(sgs_scene_find_view(scene, "b"), 1);
    assert_int_equal(sgs_scene_find_view(scene, "sub/c.png"), 3);
    assert_int_equal(sgs_scene_find_view(scene, "c.png"), 3);
    assert_int_equal(sgs_scene_find_view(scene, "sub/c"), 3);
    assert_int_equal(sgs_scene_find_view(scene, "c"), 3);
    assert_int_equal(sgs_scene_find_view(scene, "b.jpg"), -1);
    assert_int_equal(sgs_scene_find_view(scene, ""), -1);
    sgs_scene_destroy(scene);
    sgs_scene_destroy(NULL);
    tree_remove(&folder);
}

static void extent_is_measured_from_the_training_cameras(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    model m = model_make();
    m.image_count = 3;
    static const char *const names[] = {"1.png", "2.png", "3.png"};
    static const double centers[3][3] = {{100, 0, 0}, {1, 2, 3}, {5, 2, 0}};
    for (int i = 0; i < 3; ++i) {
        char name[64];
        m.images[i].name = names[i];
        for (int k = 0; k < 7; ++k)
            m.images[i].pose[k] = k < 4 ? k == 0 : -centers[i][k - 4];
        snprintf(name, sizeof name, "images/%s", names[i]);
        tree_put_picture(&folder, name, 32, 24, 3, red);
    }
    model_put(&folder, "sparse/0/", &m, true);
    sgs_scene_options options = sgs_scene_options_default();
    options.test_images = "1";
    sgs_scene *scene = load(folder.path, &options);
    assert_true(scene->center[0] == 3 && scene->center[1] == 2 && scene->center[2] == 1.5);
    assert_true(fabs(scene->extent - 1.1 * 2.5) < 1e-12);
    sgs_scene_destroy(scene);
    // One camera: half the median distance of the points; no points: 1.
    options.test_images = "1,2";
    scene = load(folder.path, &options);
    const double *p = m.points[1].xyz; // the third nearest of five
    const double median = sqrt(pow(p[0] - 5, 2) + pow(p[1] - 2, 2) + pow(p[2], 2));
    assert_true(fabs(scene->extent - 0.5 * median) < 1e-6);
    sgs_scene_destroy(scene);
    m.point_count = 0;
    model_put(&folder, "sparse/0/", &m, true);
    scene = load(folder.path, &options);
    assert_true(scene->extent == 1 && scene->point_count == 0);
    sgs_scene_destroy(scene);
    m.images[0].pose[4] = 1e300;
    model_put(&folder, "sparse/0/", &m, true);
    assert_refused(folder.path, NULL, SGS_STATUS_FORMAT,
                   "is out of range; the model may be damaged");
    tree_remove(&folder);
}

static const char synthetic[] =
    "{\"camera_angle_x\":1.5707963267948966,\"frames\":[{\"file_path\":\"./%s/r_0\","
    "\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,4],[0,0,0,1]]},{\"file_path\":"
    "\"./%s/r_1\",\"transform_matrix\":[[1,0,0,0],[0,1,0,0],[0,0,1,2],[0,0,0,1]]}]}";

static void nerf_synthetic_scenes_have_a_white_background(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    char text[1024];
    snprintf(text, sizeof text, synthetic, "train", "train");
    tree_put_text(&folder, "transforms_train.json", text);
    snprintf(text, sizeof text, synthetic, "test", "test");
    tree_put_text(&folder, "transforms_test.json", text);
    static const char *const names[] = {"test/r_0.png", "test/r_1.png", "train/r_0.png",
                                        "train/r_1.png"};
    for (int i = 0; i < 4; ++i)
        tree_put_picture(&folder, names[i], 20, 10, 4, glass);
    sgs_scene_options options = sgs_scene_options_default();
    assert_split(folder.path, &options, "0000"); // nothing is held out by default
    options.use_dataset_split = true;
    assert_split(folder.path, &options, "1100");
    options.test_every = 8;
    for (int images = 0; images < 2; ++images) {
        options.load_images = images != 0;
        sgs_scene *scene = load(folder.path, &options);
        assert_int_equal(scene->format, SGS_SCENE_TRANSFORMS);
        assert_int_equal(scene->view_count, 4);
        assert_true(scene->has_alpha && scene->white_background);
        for (int i = 0; i < 4; ++i) {
            assert_string_equal(scene->views[i].name, names[i]);
            assert_int_equal(scene->views[i].split, i < 2 ? SGS_SPLIT_TEST : SGS_SPLIT_TRAIN);
            const sgs_camera *camera = &scene->views[i].camera;
            assert_true(camera->width == 20 && camera->height == 10 &&
                        fabs(camera->params[0] - 10) < 1e-12);
            assert_true(fabs(camera->params[1] - 10) < 1e-12 && camera->params[2] == 10 &&
                        camera->params[3] == 5);
        }
        assert_true(fabs(scene->extent - 1.1) < 1e-12 && scene->center[2] == 3);
        sgs_scene_destroy(scene);
    }
    assert_string_equal(warnings, "");
    options.use_dataset_split = false; // test_every is a number of the caller, 8 too
    assert_split(folder.path, &options, "1100");
    assert_holds(warnings, "test_every 8 is ignored");
    options.test_every = 2;
    assert_split(folder.path, &options, "1100");
    assert_holds(warnings, "using the scene's own test views; test_every 2 is ignored");
    options.test_images = "train/r_1.png";
    assert_split(folder.path, &options, "0001");
    tree_remove(&folder);
}

// NeRF synthetic files hold an angle only: the focal length follows from the width that is given.
static void cameras_without_a_size_take_the_given_one(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    char text[1024];
    snprintf(text, sizeof text, synthetic, "train", "train");
    tree_put_text(&folder, "transforms.json", text);
    sgs_scene_options options = sgs_scene_options_default();
    options.load_images = false;
    options.cameras_only = true;
    sgs_scene *scene;
    assert_int_equal(sgs_scene_load(folder.path, &options, &scene), SGS_STATUS_IO);
    assert_holds(sgs_last_error(), "transforms.json: no image size");
    assert_holds(sgs_last_error(), "add 'w' and 'h'");
    assert_string_equal(warnings, "");
    options.view_width = 60;
    options.view_height = 40;
    for (int photos = 0; photos < 2; ++photos) { // the first view's photo has a size
        scene = load(folder.path, &options);
        assert_int_equal(scene->view_count, 2);
        for (int i = 0; i < 2; ++i) {
            const sgs_camera *camera = &scene->views[i].camera;
            const int width = photos && !i ? 20 : 60, height = photos && !i ? 10 : 40;
            assert_true(camera->width == width && camera->height == height);
            assert_true(fabs(camera->params[0] - 0.5 * width) < 1e-12 && // 90 degrees
                        fabs(camera->params[1] - 0.5 * width) < 1e-12);
            assert_true(camera->params[2] == 0.5 * width && camera->params[3] == 0.5 * height);
        }
        sgs_scene_destroy(scene);
        tree_put_picture(&folder, "train/r_0.png", 20, 10, 4, glass);
    }
    tree_remove(&folder);
}

// Pixels need not be square: each angle gives the focal length of its axis.
static void angles_complete_cameras_without_a_size(void **state)
{
    (void)state;
    static const struct {
        const char *keys;
        double fx, fy;
    } angles[] = {
        {"\"camera_angle_x\":1.5707963267948966,\"camera_angle_y\":0.9272952180016122", 10, 10},
        {"\"camera_angle_x\":0.9272952180016122,\"camera_angle_y\":1.5707963267948966", 20, 5},
        {"\"camera_angle_y\":0.9272952180016122", 10, 10},
        {"\"camera_angle_x\":1.5707963267948966,\"fl_y\":7", 10, 7}};
    for (size_t i = 0; i < sizeof angles / sizeof *angles; ++i) {
        const temp_folder folder = temp_folder_make();
        char text[512];
        snprintf(text, sizeof text,
                 "{%s,\"frames\":[{\"file_path\":\"a.png\",\"transform_matrix\":"
                 "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}",
                 angles[i].keys);
        tree_put_text(&folder, "transforms.json", text);
        tree_put_picture(&folder, "a.png", 20, 10, 3, glass);
        sgs_scene *scene = load(folder.path, NULL);
        const double *params = scene->views[0].camera.params;
        if (!(fabs(params[0] - angles[i].fx) < 1e-9 && fabs(params[1] - angles[i].fy) < 1e-9))
            fail_msg("%s: focal lengths %g and %g", angles[i].keys, params[0], params[1]);
        sgs_scene_destroy(scene);
        tree_remove(&folder);
    }
}

static void nerfstudio_scenes_take_other_image_folders(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
#define ONE_FRAME                                                                                  \
    "\"frames\":[{\"file_path\":\"images/a.png\",\"transform_matrix\":"                            \
    "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}"
    tree_put_text(&folder, "transforms.json", "{\"fl_x\":40,\"w\":32,\"h\":24," ONE_FRAME);
    tree_put_picture(&folder, "images/a.png", 32, 24, 4, glass);
    tree_put_picture(&folder, "images_2/a.png", 16, 12, 4, glass);
    sgs_scene *scene = load(folder.path, NULL);
    assert_true(scene->views[0].camera.width == 32 && scene->views[0].camera.params[0] == 40);
    assert_true(scene->has_alpha && !scene->white_background);
    sgs_scene_destroy(scene);
    sgs_scene_options options = sgs_scene_options_default();
    options.images_dir = "images_2";
    scene = load(temp_path(&folder, "transforms.json"),
                 &options); // the file itself is a scene path too
    assert_true(scene->views[0].camera.width == 16 && scene->views[0].camera.params[0] == 20);
    assert_string_equal(scene->views[0].name, "images/a.png");
    sgs_scene_destroy(scene);
    assert_string_equal(warnings, "");
    // Without w and h, the intrinsics are taken for those of the smaller image.
    tree_put_text(&folder, "transforms.json", "{\"fl_x\":40,\"cx\":17,\"cy\":11," ONE_FRAME);
    sgs_scene_destroy(load(folder.path, &options));
    assert_holds(warnings, "principal point of 1 image(s), first 'images/a.png', is outside");
    tree_remove(&folder);
}

static void result_does_not_depend_on_threads(void **state)
{
    (void)state;
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 3;
    const int threads = sgsi_threads();
    sgs_scene *scenes[2];
    for (int k = 0; k < 2; ++k) {
        sgsi_threads_set(k == 0 ? 1 : 3);
        scenes[k] = load(ROOM, &options);
    }
    sgsi_threads_set(threads);
    for (size_t i = 0; i < scenes[0]->view_count; ++i) {
        const sgs_view *a = &scenes[0]->views[i], *b = &scenes[1]->views[i];
        assert_string_equal(a->name, b->name);
        assert_memory_equal(a->image.pixels, b->image.pixels, 3u * 160 * 90);
    }
    sgs_scene_destroy(scenes[0]);
    sgs_scene_destroy(scenes[1]);
}

// The bundled scene, rewritten as text with full precision.
static void bundled_scene_is_equal_in_both_formats(void **state)
{
    (void)state;
    sgs_scene_options options = sgs_scene_options_default();
    options.load_images = 0;
    options.test_every = 8;
    sgs_scene *scene = load(ROOM, &options);
    assert_int_equal(scene->view_count, 35);
    assert_int_equal(scene->point_count, 5740);
    assert_int_equal(scene->images_missing + scene->images_unposed, 0);
    assert_string_equal(warnings, "");
    assert_int_equal(scene->views[0].camera.model, SGS_CAMERA_OPENCV);
    assert_true(scene->views[0].camera.width == 480 && scene->views[0].camera.height == 270);
    assert_true(fabs(scene->views[0].camera.params[0] - 903.30969148199449 / 4) < 1e-12);
    assert_true(scene->extent > 5.4 && scene->extent < 5.6);

    const temp_folder folder = temp_folder_make();
    assert_int_equal(sgsi_make_folder(temp_path(&folder, "sparse")), SGS_STATUS_OK);
    FILE *cameras = fopen(temp_path(&folder, "sparse/cameras.txt"), "w");
    FILE *images = fopen(temp_path(&folder, "sparse/images.txt"), "w");
    FILE *points = fopen(temp_path(&folder, "sparse/points3D.txt"), "w");
    const sgs_camera *camera = &scene->views[0].camera;
    fprintf(cameras, "1 OPENCV 480 270");
    for (int k = 0; k < 8; ++k)
        fprintf(cameras, " %.17g", camera->params[k]);
    for (size_t i = scene->view_count; i-- > 0;) { // in another order
        double q[4];
        const double *t = scene->views[i].pose.translation;
        sgs_pose_quaternion(&scene->views[i].pose, q);
        fprintf(images, "%zu %.17g %.17g %.17g %.17g %.17g %.17g %.17g 1 %s\n\n", i, q[0], q[1],
                q[2], q[3], t[0], t[1], t[2], scene->views[i].name);
    }
    for (size_t i = 0; i < scene->point_count; ++i) {
        const float *p = scene->points + 3 * i;
        const uint8_t *c = scene->colors + 3 * i;
        fprintf(points, "%zu %.9g %.9g %.9g %d %d %d 0\n", i, p[0], p[1], p[2], c[0], c[1], c[2]);
    }
    assert_int_equal(fclose(cameras) + fclose(images) + fclose(points), 0);
    options.images_dir = ROOM "/images";
    sgs_scene *text = load(folder.path, &options);
    assert_int_equal(text->format, SGS_SCENE_COLMAP_TEXT);
    assert_int_equal(text->view_count, scene->view_count);
    for (size_t i = 0; i < scene->view_count; ++i) {
        const sgs_view *a = &scene->views[i], *b = &text->views[i];
        assert_string_equal(a->name, b->name);
        assert_int_equal(a->split, b->split);
        assert_memory_equal(&a->camera, &b->camera, sizeof a->camera);
        for (int k = 0; k < 9; ++k)
            assert_true(fabs(a->pose.rotation[k] - b->pose.rotation[k]) < 1e-14);
        assert_memory_equal(a->pose.translation, b->pose.translation, sizeof a->pose.translation);
    }
    assert_memory_equal(scene->points, text->points, scene->point_count * 3 * sizeof *text->points);
    assert_memory_equal(scene->colors, text->colors, scene->point_count * 3);
    sgs_scene_destroy(scene);
    sgs_scene_destroy(text);
    tree_remove(&folder);
}

// Lens and poses are consistent: COLMAP's points project into the photos that observe them.
static void bundled_points_project_into_the_photos(void **state)
{
    (void)state;
    sgs_scene_options options = sgs_scene_options_default();
    options.load_images = 0;
    sgs_scene *scene = load(ROOM, &options);
    for (size_t i = 0; i < scene->point_count; ++i) {
        size_t seen = 0;
        for (size_t v = 0; v < scene->view_count; ++v) {
            const double *r = scene->views[v].pose.rotation, *t = scene->views[v].pose.translation;
            const float *p = scene->points + 3 * i;
            double c[3], pixel[2];
            for (int k = 0; k < 3; ++k)
                c[k] = r[3 * k] * p[0] + r[3 * k + 1] * p[1] + r[3 * k + 2] * p[2] + t[k];
            seen += sgs_camera_project(&scene->views[v].camera, c, pixel) && pixel[0] > -2 &&
                    pixel[0] < 482 && pixel[1] > -2 && pixel[1] < 272;
        }
        assert_true(seen >= 2);
    }
    sgs_scene_destroy(scene);
}

static void any_failing_allocation_is_reported(void **state)
{
    (void)state;
    const temp_folder folder = scene_make("sparse/0/", true, "images");
    const int threads = sgsi_threads();
    sgsi_threads_set(1);
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 2;
    options.test_images = "a.png";
    const size_t before = sgsi_allocation_count();
    sgs_scene_destroy(load(folder.path, &options));
    const size_t allocations = sgsi_allocation_count() - before;
    size_t refused = 0;
    for (size_t n = 1; n <= allocations; ++n) {
        sgs_scene *scene;
        sgsi_fail_allocation(n);
        const sgs_status status = sgs_scene_load(folder.path, &options, &scene);
        sgsi_fail_allocation(0);
        // Searching for photos without a pose and formatting warnings tolerate failed
        // allocations.
        assert_true(status == SGS_STATUS_OK || status == SGS_STATUS_OUT_OF_MEMORY);
        assert_int_equal(scene == NULL, status != SGS_STATUS_OK);
        refused += status != SGS_STATUS_OK;
        sgs_scene_destroy(scene);
    }
    assert_true(refused > allocations / 2);
    sgsi_threads_set(threads);
    tree_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(models_are_found_in_all_usual_places, warnings_begin),
        cmocka_unit_test_setup(largest_of_several_models_is_used, warnings_begin),
        cmocka_unit_test_setup(missing_scenes_are_reported_with_a_hint, warnings_begin),
        cmocka_unit_test_setup(missing_image_folder_error_lists_the_others, warnings_begin),
        cmocka_unit_test_setup(cameras_are_fitted_to_their_photos, warnings_begin),
        cmocka_unit_test_setup(downscaling_divides_images_and_cameras, warnings_begin),
        cmocka_unit_test_setup(wide_images_are_downscaled_to_1600_pixels_with_a_warning,
                               warnings_begin),
        cmocka_unit_test_setup(missing_and_broken_images_are_skipped_and_counted, warnings_begin),
        cmocka_unit_test_setup(images_without_a_pose_are_counted, warnings_begin),
        cmocka_unit_test_setup(images_behind_links_are_counted_once, warnings_begin),
        cmocka_unit_test_setup(named_pipes_are_refused, warnings_begin),
        cmocka_unit_test_setup(other_extension_in_a_downscaled_folder_is_found, warnings_begin),
        cmocka_unit_test_setup(views_are_held_out_by_index_or_by_name, warnings_begin),
        cmocka_unit_test_setup(recorded_names_stay_held_out, warnings_begin),
        cmocka_unit_test_setup(short_name_holds_out_all_matching_views, warnings_begin),
        cmocka_unit_test_setup(views_are_found_by_name, warnings_begin),
        cmocka_unit_test_setup(extent_is_measured_from_the_training_cameras, warnings_begin),
        cmocka_unit_test_setup(nerf_synthetic_scenes_have_a_white_background, warnings_begin),
        cmocka_unit_test_setup(angles_complete_cameras_without_a_size, warnings_begin),
        cmocka_unit_test_setup(cameras_without_a_size_take_the_given_one, warnings_begin),
        cmocka_unit_test_setup(nerfstudio_scenes_take_other_image_folders, warnings_begin),
        cmocka_unit_test_setup(result_does_not_depend_on_threads, warnings_begin),
        cmocka_unit_test_setup(bundled_scene_is_equal_in_both_formats, warnings_begin),
        cmocka_unit_test_setup(bundled_points_project_into_the_photos, warnings_begin),
        cmocka_unit_test_setup(any_failing_allocation_is_reported, warnings_begin),
    };
    return cmocka_run_group_tests_name("scene", tests, NULL, NULL);
}
