// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Short runs on high-resolution images begin with images of half the size: the bundled scene with
// each pixel repeated, 960 x 540.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "sparegs/runtime.h"
#include "sparegs/trainer.h"
#include "support/files_support.h"
#include "support/trainer_support.h"
#include "train/small_images.h"
#include "train/trainer_state.h"

// With 60 photos 0.3 of the run has half the size; the scene has 35, 20 of 45 above the least
// number, 15.
enum { ITERATIONS = 15, HALF = ITERATIONS * 3 * 20 / (10 * 45) };

static sgs_scene *scene;

enum { WIDTH = 960, HEIGHT = 540, RAY_LIMIT = 1 << 30 };

static uint8_t *enlarge(const sgs_photo *photo)
{
    const size_t plane = (size_t)WIDTH * HEIGHT;
    uint8_t *pixels = malloc(3 * plane);
    for (size_t c = 0; c < 3; ++c)
        for (size_t y = 0; y < HEIGHT; ++y)
            for (size_t x = 0; x < WIDTH; ++x)
                pixels[c * plane + y * WIDTH + x] =
                    photo->pixels[c * plane / 4 + y / 2 * (WIDTH / 2) + x / 2];
    return pixels;
}

static int load(void **state)
{
    (void)state;
    sgs_scene *room;
    if (sgs_scene_load(SGSI_TEST_DATA "/room", NULL, &room))
        fail_msg("%s", sgs_last_error());
    sgs_view_source *views = calloc(room->view_count, sizeof *views);
    for (size_t i = 0; i < room->view_count; ++i) {
        const sgs_view *view = &room->views[i];
        assert_int_equal(view->image.width, WIDTH / 2);
        views[i] = (sgs_view_source){.name = view->name,
                                     .camera = sgs_camera_resized(&view->camera, WIDTH, HEIGHT),
                                     .pose = view->pose,
                                     .channels = 3,
                                     .pixels = enlarge(&view->image),
                                     .channel_stride = WIDTH * HEIGHT,
                                     .pixel_stride = 1};
    }
    if (sgs_scene_create(views, room->view_count, room->points, room->colors, room->point_count,
                         NULL, &scene))
        fail_msg("%s", sgs_last_error());
    for (size_t i = 0; i < room->view_count; ++i)
        free((void *)views[i].pixels);
    free(views);
    sgs_scene_destroy(room);
    return 0;
}

static int unload(void **state)
{
    (void)state;
    sgs_scene_destroy(scene);
    return 0;
}

static sgs_train_options short_run(void)
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = ITERATIONS;
    return options;
}

// With one structural update, after the last iteration of half the size.
static sgs_trainer *create_updating(const sgs_train_options *options)
{
    sgs_trainer *trainer = trainer_create(scene, options);
    trainer->schedule.densify_from = 0;
    trainer->schedule.densify_interval = HALF;
    trainer->schedule.densify_until = HALF + 1;
    trainer->schedule.thin_until = trainer->schedule.prune_interval = 0;
    assert_int_equal(sgsi_schedule_first_update(&trainer->schedule), HALF);
    return trainer;
}

static void a_run_begins_with_half_the_size(void **state)
{
    (void)state;
    const sgs_train_options options = short_run();
    sgs_trainer *trainer = trainer_create(scene, &options);
    assert_int_equal(sgs_trainer_milestones(trainer).half_size_until, HALF);
    for (int t = 1; t <= ITERATIONS; ++t) {
        // Images change after an iteration; the change belongs to the next one.
        const bool small = t <= HALF;
        trainer_run(trainer, 1);
        const sgsi_small_images *images = &trainer->views.small_images;
        assert_int_equal(images->scale, small ? 2 : 1);
        assert_int_equal(images->photos != NULL, small);
        if (small) {
            assert_int_equal(images->photos[0].width, 480);
            assert_int_equal(images->photos[0].height, 270);
        }
    }
    sgs_trainer_destroy(trainer);
}

// The memory of a run is estimated before the photos are loaded.
static void the_schedule_is_known_before_the_photos(void **state)
{
    (void)state;
    const sgs_train_options options = short_run();
    sgs_view *views = malloc(scene->view_count * sizeof *views);
    sgs_scene unloaded = *scene;
    memcpy(views, scene->views, scene->view_count * sizeof *views);
    unloaded.views = views;
    for (size_t i = 0; i < scene->view_count; ++i)
        views[i].image = (sgs_photo){0};
    assert_int_equal(sgsi_train_schedule(scene, &options, false).half_size_until, HALF);
    assert_int_equal(sgsi_train_schedule(&unloaded, &options, false).half_size_until, HALF);
    assert_true(sgs_train_memory(&unloaded, &options, 0, 1000) ==
                sgs_train_memory(scene, &options, 0, 1000));
    free(views);
}

// With so many primitives, the training has the peak for any number of threads, not the evaluation.
enum { FEW = 1000000, MANY = 2000000 };

// 44 bytes per voxel of the grid, unless no part of SPARE-GS uses it.
static void the_memory_of_the_grid_is_estimated(void **state)
{
    (void)state;
    sgs_train_options options = short_run();
    size_t bytes[2][2];
    for (int fine = 0; fine < 2; ++fine)
        for (int spare = 0; spare < 2; ++spare) {
            options.spare_grid = fine ? 256 : 32;
            options.spare = spare ? SGS_SPARE_RAP : SGS_SPARE_EDT;
            bytes[fine][spare] = sgs_train_memory(scene, &options, 0, FEW);
        }
    assert_true(bytes[1][0] == bytes[0][0]);
    assert_true(bytes[1][1] - bytes[0][1] == 44 * ((size_t)(256 * 256 * 256) - 32 * 32 * 32));
}

// 4 bytes per tile and view, 8 with ranks, and the columns of the scores of Taming.
static void the_memory_of_tiles_and_scores_is_estimated(void **state)
{
    (void)state;
    sgs_train_options options = short_run();
    const size_t n = scene->view_count, tiles = n * 60 * 34; // 960 x 540 pixels
    sgs_view *views = malloc(2 * n * sizeof *views);
    sgs_scene twice = *scene;
    memcpy(views, scene->views, n * sizeof *views);
    memcpy(views + n, scene->views, n * sizeof *views);
    twice.views = views;
    twice.view_count = 2 * n;
    for (int ranks = 1; ranks <= 2; ++ranks) {
        const size_t once = sgs_train_memory_per_rank(scene, &options, 0, FEW, ranks, RAY_LIMIT);
        assert_int_equal(sgs_train_memory_per_rank(&twice, &options, 0, FEW, ranks, RAY_LIMIT) -
                             once,
                         tiles * (size_t)(4 * ranks));
        options.pipeline = SGS_PIPELINE_TAMING;
        const size_t few = sgs_train_memory_per_rank(scene, &options, 0, FEW, ranks, RAY_LIMIT),
                     many = sgs_train_memory_per_rank(scene, &options, 0, MANY, ranks, RAY_LIMIT);
        options.pipeline = SGS_PIPELINE_MIP;
        const size_t few_mip = sgs_train_memory_per_rank(scene, &options, 0, FEW, ranks, RAY_LIMIT),
                     many_mip =
                         sgs_train_memory_per_rank(scene, &options, 0, MANY, ranks, RAY_LIMIT);
        assert_int_equal((many - few) - (many_mip - few_mip), ranks > 1 ? 93 * (MANY - FEW) : 0);
        options.pipeline = SGS_PIPELINE_3DGS;
    }
    free(views);
}

// Per pixel, 14 bytes and the table for the rays and 120 for the images, also if one table exceeds
// the limit of 1 GiB. Without primitives, the evaluation has the peak: 1080 per thread and column.
static void the_rays_of_a_camera_beyond_the_limit_are_estimated(void **state)
{
    (void)state;
    const sgs_train_options options = short_run();
    sgs_view view = scene->views[0];
    sgs_scene one = *scene;
    size_t bytes[2];
    one.views = &view;
    one.view_count = 1;
    view.camera.height = 16384;
    for (int wide = 0; wide < 2; ++wide) {
        view.camera.width = 8192 << wide;
        bytes[wide] = sgs_train_memory_per_rank(&one, &options, 0, 0, 1, RAY_LIMIT);
    }
    const size_t tiles = 512 * 1024;
    assert_int_equal(bytes[1] - bytes[0], (size_t)8192 * 16384 * (14 + 120) +
                                              tiles * sizeof(sgsi_tile_rays) +
                                              1080 * 8192 * (size_t)sgs_threads_get());
}

// With a camera per image, the tables take what the limit allows, and equal cameras share one.
static void the_ray_tables_of_all_cameras_are_estimated(void **state)
{
    (void)state;
    enum { VIEWS = 6 };
    const sgs_train_options options = short_run();
    const size_t table = 60 * 34 * sizeof(sgsi_tile_rays); // 960 x 540 pixels
    sgs_view views[VIEWS];
    sgs_scene few = *scene;
    few.views = views;
    few.view_count = VIEWS;
    few.float_images = 1; // of one size
    size_t bytes[2][4];
    for (int shared = 0; shared < 2; ++shared)
        for (size_t limit = 0; limit < 4; ++limit) {
            for (int v = 0; v < VIEWS; ++v) {
                views[v] = scene->views[0];
                views[v].camera.params[0] += shared ? 0 : 0.01 * v;
            }
            bytes[shared][limit] =
                sgs_train_memory_per_rank(&few, &options, 0, 0, 1, 3 * limit * table);
        }
    assert_int_equal(bytes[0][1] - bytes[0][0], 2 * table); // at least one
    assert_int_equal(bytes[0][2] - bytes[0][1], 3 * table);
    assert_int_equal(bytes[0][3], bytes[0][2]);
    assert_int_equal(bytes[1][3], bytes[0][0]);
    assert_int_equal(bytes[1][0], bytes[0][0]);
    assert_int_equal(sgs_train_ray_limit(UINT64_C(1) << 38), UINT64_C(1) << 34);
    assert_int_equal(sgs_train_ray_limit(1), 1 << 30);
}

// A camera per image: every table is built once, unless the limit holds fewer.
static void an_iteration_finds_the_table_of_its_camera(void **state)
{
    (void)state;
    const sgs_train_options options = short_run();
    const sgs_camera camera = scene->views[0].camera;
    scene->float_images = 1; // of one size
    for (size_t v = 0; v < scene->view_count; ++v)
        scene->views[v].camera.params[0] += 0.001 * (double)v;
    const size_t table = 60 * 34 * sizeof(sgsi_tile_rays);
    sgs_trainer *trainer = trainer_create(scene, &options);
    assert_true(sgsi_ray_cache_limit(trainer->views.rays) == sgs_train_ray_limit(0));
    trainer_run(trainer, 3);
    assert_int_equal(sgsi_ray_cache_bytes(trainer->views.rays), 3 * table);
    sgs_trainer_ray_limit_set(trainer, 2 * table);
    trainer_run(trainer, 3);
    assert_int_equal(sgsi_ray_cache_bytes(trainer->views.rays), 2 * table);
    sgs_trainer_ray_limit_set(trainer, SIZE_MAX);
    sgs_trainer_memory_limit_set(trainer, (size_t)1 << 36, 0);
    assert_int_equal(sgsi_ray_cache_limit(trainer->views.rays), (size_t)1 << 32);
    sgs_trainer_destroy(trainer);
    for (size_t v = 0; v < scene->view_count; ++v)
        scene->views[v].camera = camera;
    scene->float_images = 0;
}

// Photos in half floats are not reduced.
static void float_photos_keep_their_size(void **state)
{
    (void)state;
    const sgs_train_options options = short_run();
    assert_int_equal(scene->float_images, 0);
    scene->float_images = 1;
    sgs_trainer *trainer = trainer_create(scene, &options);
    trainer_run(trainer, 1);
    assert_null(trainer->views.small_images.photos);
    assert_int_equal(sgs_trainer_milestones(trainer).half_size_until, 0);
    sgs_trainer_destroy(trainer);
    scene->float_images = 0;
}

// Resumed right before and after the change of the size: the same model.
static void a_resumed_run_has_the_same_sizes(void **state)
{
    (void)state;
    const sgs_pipeline pipelines[] = {SGS_PIPELINE_3DGS, SGS_PIPELINE_FASTGS};
    const int after = 3;
    const temp_folder folder = temp_folder_make();
    const char *paths[] = {temp_path(&folder, "before"), temp_path(&folder, "after")};
    for (int p = 0; p < 2; ++p) {
        sgs_train_options options = short_run();
        options.pipeline = pipelines[p];
        char whole[17], resumed[17];
        sgs_trainer *trainer = create_updating(&options);
        const size_t initial = sgs_trainer_model(trainer)->count;
        // The update after an iteration is made at the begin of the next one.
        trainer_run(trainer, HALF);
        assert_int_equal(sgs_trainer_save_checkpoint(trainer, paths[0]), SGS_STATUS_OK);
        assert_true(trainer_run(trainer, 1).structural);
        assert_int_equal(sgs_trainer_save_checkpoint(trainer, paths[1]), SGS_STATUS_OK);
        assert_true(sgs_trainer_model(trainer)->count > initial);
        trainer_run(trainer, after);
        sgs_gaussians_hash(sgs_trainer_model(trainer), whole);
        sgs_trainer_destroy(trainer);
        const int around = options.pipeline == SGS_PIPELINE_FASTGS ? 0 : 1; // its scores take time
        for (int at = HALF; at <= HALF + around; ++at) {
            trainer = create_updating(&options);
            assert_int_equal(sgs_trainer_load_checkpoint(trainer, paths[at - HALF]), SGS_STATUS_OK);
            assert_int_equal(trainer->views.small_images.scale, at <= HALF ? 2 : 1);
            trainer_run(trainer, HALF + 1 + after - at);
            sgs_gaussians_hash(sgs_trainer_model(trainer), resumed);
            sgs_trainer_destroy(trainer);
            assert_string_equal(resumed, whole);
        }
    }
    tree_remove(&folder);
}

// Runs with a model to start from have the full size throughout, also when they are resumed without
// it. The checkpoint says so, as one of a version without small images does.
static void runs_with_a_model_have_the_full_size(void **state)
{
    (void)state;
    sgs_train_options options = short_run();
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "checkpoint");
    sgs_trainer *first = trainer_create(scene, &options);
    options.init = sgs_trainer_model(first);
    sgs_trainer *trainer = trainer_create(scene, &options);
    sgs_trainer_destroy(first);
    trainer_run(trainer, 1);
    assert_null(trainer->views.small_images.photos);
    assert_int_equal(sgs_trainer_save_checkpoint(trainer, path), SGS_STATUS_OK);
    sgs_trainer_destroy(trainer);
    options.init = NULL;
    trainer = trainer_create(scene, &options);
    assert_non_null(trainer->views.small_images.photos);
    assert_int_equal(sgs_trainer_load_checkpoint(trainer, path), SGS_STATUS_OK);
    for (int t = 2; t <= HALF + 1; ++t) {
        trainer_run(trainer, 1);
        assert_null(trainer->views.small_images.photos);
    }
    sgs_trainer_destroy(trainer);
    tree_remove(&folder);
}

// The largest side of a photo: products of sides exceed an int.
static void the_mask_of_a_long_photo_is_reduced(void **state)
{
    (void)state;
    enum { LONG = 65536, SHORT = 4, MASKED = 10 };
    for (int tall = 0; tall < 2; ++tall) {
        const int width = tall ? SHORT : LONG, height = tall ? LONG : SHORT;
        uint8_t *pixels = calloc((size_t)LONG * SHORT, 3), *mask = malloc((size_t)LONG * SHORT);
        memset(mask, 255, (size_t)LONG * SHORT);
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x)
                if ((tall ? y : x) >= LONG - MASKED)
                    mask[(size_t)y * (size_t)width + (size_t)x] = 0;
        const sgs_view_source source = {.camera = {.model = SGS_CAMERA_PINHOLE,
                                                   .width = width,
                                                   .height = height,
                                                   .params = {LONG, LONG, width / 2, height / 2}},
                                        .pose = {.rotation = {1, 0, 0, 0, 1, 0, 0, 0, 1}},
                                        .channels = 3,
                                        .pixels = pixels,
                                        .mask = mask};
        sgs_scene *long_scene;
        if (sgs_scene_create(&source, 1, NULL, NULL, 0, NULL, &long_scene))
            fail_msg("%s", sgs_last_error());
        size_t index = 0;
        const sgsi_train_views views = {.scene = long_scene, .scene_views = &index, .count = 1};
        sgsi_small_images images;
        if (sgsi_small_images_make(&views, 2, &images))
            fail_msg("%s", sgs_last_error());
        assert_int_equal(images.photos[0].kept, (LONG - MASKED) / 2 * (SHORT / 2));
        sgsi_small_images_free(&images);
        sgs_scene_destroy(long_scene);
        free(pixels);
        free(mask);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_run_begins_with_half_the_size),
        cmocka_unit_test(the_schedule_is_known_before_the_photos),
        cmocka_unit_test(the_memory_of_the_grid_is_estimated),
        cmocka_unit_test(the_memory_of_tiles_and_scores_is_estimated),
        cmocka_unit_test(the_rays_of_a_camera_beyond_the_limit_are_estimated),
        cmocka_unit_test(the_ray_tables_of_all_cameras_are_estimated),
        cmocka_unit_test(an_iteration_finds_the_table_of_its_camera),
        cmocka_unit_test(float_photos_keep_their_size),
        cmocka_unit_test(a_resumed_run_has_the_same_sizes),
        cmocka_unit_test(runs_with_a_model_have_the_full_size),
        cmocka_unit_test(the_mask_of_a_long_photo_is_reduced),
    };
    return cmocka_run_group_tests(tests, load, unload);
}
