// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The memory of a viewer does not grow with the number of cameras that its pages show. The files
// that it saves replace no others. The last model of a training is copied also while it draws.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <time.h>

#include <cmocka.h>

#include "support/files_support.h"
#include "support/oracle_support.h"
#include "cli/progress.h"
#include "viewer/view_painter.h"

enum { WIDTH = 1280, HEIGHT = 960, CAMERAS = 8 };
static const double pixel_bytes = 2 * sizeof(float); // at least: the two coordinates of a ray

// Renders with many fields of view; the ray tables of all of them would exceed the limit.
static void look_around(sgs_renderer *renderer)
{
    assert_true(CAMERAS * pixel_bytes * WIDTH * HEIGHT > VIEWER_RAY_BYTES);
    sgs_frame frame;
    sgs_camera camera = oracle_camera(SGS_CAMERA_PINHOLE, WIDTH, HEIGHT);
    const sgs_pose pose = oracle_pose_look_at(1.9, -1.2, -3.3);
    assert_int_equal(sgs_frame_create_with(WIDTH, HEIGHT, 0, &frame), SGS_STATUS_OK);
    for (int i = 0; i < CAMERAS; ++i) {
        camera.params[0] = camera.params[1] = 500 + 10 * i;
        assert_int_equal(sgs_renderer_render(renderer, &camera, &pose, NULL, &frame),
                         SGS_STATUS_OK);
        assert_true((double)sgs_renderer_ray_bytes(renderer) >= pixel_bytes * WIDTH * HEIGHT);
        assert_true(sgs_renderer_ray_bytes(renderer) <= VIEWER_RAY_BYTES);
    }
    sgs_frame_free(&frame);
}

static void ray_tables_of_viewer_and_preview_are_limited(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(5, 40, NULL);
    view_source source = {.name = "model"};
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(scene.count, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_copy(model, scene.model), SGS_STATUS_OK);
    assert_true(view_source_open(&source, model, NULL, 0));
    look_around(source.renderer);
    crop_preview preview = {0};
    const view_crop crop = {.preview = CROP_HIDE, .region = -1, .slack = -INFINITY, .opacity = 0.1};
    assert_true(crop_preview_prepare(&preview, &crop, &source));
    look_around(preview.renderer);
    crop_preview_free(&preview);
    view_source_close(&source);
    oracle_scene_free(&scene);
}

// All numbers of a file are taken.
static void fill_numbers(const temp_folder *folder, const char *stem, const char *ending)
{
    char first[512], path[512];
    for (int n = 1; n <= 9999; ++n) {
        snprintf(path, sizeof path, "%s/%s_%04d.%s", folder->path, stem, n, ending);
        if (n > 1) {
            assert_int_equal(symlink(first, path), 0);
            continue;
        }
        file_put(path, "old", 3);
        snprintf(first, sizeof first, "%s_0001.%s", stem, ending);
    }
}

static void check_old(const temp_folder *folder, const char *name)
{
    size_t size;
    unsigned char *bytes = file_get(temp_path(folder, name), &size);
    assert_string_equal((const char *)bytes, "old");
    free(bytes);
}

static void saved_files_replace_no_other(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    oracle_scene scene = oracle_random_model(5, 40, NULL);
    view_source source = {.name = "model", .drawing = {.compact_box = 1, .white_point = 1}};
    sgs_gaussians *model;
    assert_int_equal(sgs_gaussians_create(scene.count, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_copy(model, scene.model), SGS_STATUS_OK);
    assert_true(view_source_open(&source, model, NULL, 0));
    source.folder = strdup(folder.path);
    view_painter painter = {.source = &source};
    const view_request request = {.camera = oracle_camera(SGS_CAMERA_PINHOLE, 16, 16),
                                  .pose = oracle_pose_look_at(1.9, -1.2, -3.3)};
    const view_crop crop = {.preview = CROP_HIDE, .region = -1, .slack = -INFINITY};
    char *path;
    fill_numbers(&folder, "crop", "ply");
    fill_numbers(&folder, "view", "exr");
    assert_null(crop_save(&crop, &source, NULL, NULL));
    assert_false(view_painter_exr(&painter, &request, NULL, NULL, &path));
    assert_null(path);
    check_old(&folder, "crop_9999.ply");
    check_old(&folder, "view_9999.exr");
    assert_int_equal(unlink(temp_path(&folder, "crop_9999.ply")), 0);
    assert_int_equal(unlink(temp_path(&folder, "view_0002.exr")), 0);
    json_t *reply = crop_save(&crop, &source, NULL, NULL);
    const char *saved = json_string_value(json_object_get(reply, "path"));
    assert_true(saved && strstr(saved, "/crop_9999.ply"));
    if (!view_painter_exr(&painter, &request, NULL, NULL, &path))
        fail_msg("%s", sgs_last_error());
    assert_non_null(strstr(path, "/view_0002.exr"));
    json_decref(reply);
    free(path);
    const view_crop none = {.has_sphere = true, .region = -1, .slack = -INFINITY};
    assert_int_equal(unlink(temp_path(&folder, "crop_9999.ply")), 0);
    assert_null(crop_save(&none, &source, NULL, NULL)); // as convert, which writes no empty file
    assert_true(access(temp_path(&folder, "crop_9999.ply"), F_OK));
    assert_non_null(strstr(last_error_text(), "keeps no primitive"));
    view_painter_free(&painter);
    view_source_close(&source);
    oracle_scene_free(&scene);
    temp_folder_remove(&folder);
}

// What an AOV requires is rendered for it only.
static void planes_that_are_not_shown_are_not_rendered(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(5, 40, NULL);
    view_source source = {.name = "model", .drawing = {.compact_box = 1, .white_point = 1}};
    sgs_gaussians *model;
    painted_picture picture;
    assert_int_equal(sgs_gaussians_create(scene.count, &model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_copy(model, scene.model), SGS_STATUS_OK);
    assert_true(view_source_open(&source, model, NULL, 0));
    view_painter painter = {.source = &source};
    view_request request = {.camera = oracle_camera(SGS_CAMERA_PINHOLE, 16, 16),
                            .pose = oracle_pose_look_at(1.9, -1.2, -3.3),
                            .aov = AOV_INDEX_CANDIDATES};
    assert_true(view_painter_draw(&painter, &request, 16, 16, 1, NULL, NULL, &picture));
    assert_non_null(painter.frame.candidates);
    sgs_image8_free(&picture.image);
    request.aov = AOV_INDEX_RGBA;
    assert_true(view_painter_draw(&painter, &request, 16, 16, 1, NULL, NULL, &picture));
    assert_null(painter.frame.candidates);
    sgs_image8_free(&picture.image);
    // AOVs that refer to rows of the model are not cropped.
    request.crop =
        (view_crop){.preview = CROP_HIDE, .region = -1, .slack = -INFINITY, .opacity = 1};
    for (int cropped = 0; cropped < 2; ++cropped) {
        request.aov = cropped ? AOV_INDEX_DEPTH : AOV_INDEX_PRIMITIVE;
        assert_true(view_painter_draw(&painter, &request, 16, 16, 1, NULL, NULL, &picture));
        assert_int_equal(picture.is_cropped, cropped);
        assert_int_equal(picture.removed, cropped ? scene.count : 0);
        sgs_image8_free(&picture.image);
    }
    view_painter_free(&painter);
    view_source_close(&source);
    oracle_scene_free(&scene);
}

static atomic_bool draws;

static void *draw_for_a_moment(void *argument)
{
    view_source *source = argument;
    pthread_mutex_lock(&source->lock);
    atomic_store(&draws, true);
    nanosleep(&(struct timespec){.tv_nsec = 300000000}, NULL);
    assert_true(atomic_load(&source->replacing)); // the drawing thread abandons its picture
    pthread_mutex_unlock(&source->lock);
    return NULL;
}

static void the_last_model_waits_for_the_drawing_thread(void **state)
{
    (void)state;
    oracle_scene scene = oracle_random_model(5, 40, NULL);
    view_source source = {.name = "model"};
    sgs_gaussians *model;
    pthread_t thread;
    assert_int_equal(sgs_gaussians_create(scene.count, &model), SGS_STATUS_OK);
    assert_true(view_source_open(&source, model, NULL, 3));
    atomic_store(&source.wanted, true);
    assert_int_equal(pthread_create(&thread, NULL, draw_for_a_moment, &source), 0);
    while (!atomic_load(&draws))
        nanosleep(&(struct timespec){.tv_nsec = 1000000}, NULL);
    assert_false(view_source_offer(&source, scene.model, NULL, 6));
    assert_int_equal(atomic_load(&source.iteration), 3);
    assert_true(view_source_replace(&source, scene.model, NULL, 7));
    pthread_join(thread, NULL);
    assert_int_equal(atomic_load(&source.iteration), 7);
    assert_int_equal(source.model->count, scene.count);
    assert_false(atomic_load(&source.replacing));
    view_source_close(&source);
    oracle_scene_free(&scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ray_tables_of_viewer_and_preview_are_limited),
        cmocka_unit_test(saved_files_replace_no_other),
        cmocka_unit_test(planes_that_are_not_shown_are_not_rendered),
        cmocka_unit_test(the_last_model_waits_for_the_drawing_thread),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
