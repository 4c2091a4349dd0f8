// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Scenes from memory: a copy of the bundled scene trains to the same bits; the scene of a folder
// and that of the same pixels in memory agree; pixel types, strides, masks and alpha are as
// documented; errors name the bad input; loading reports progress and can be cancelled.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <pthread.h>

#include "sparegs/image.h"
#include "sparegs/model_file.h"
#include "sparegs/scene.h"
#include "sparegs/trainer.h"
#include "support/scene_support.h"

static const char room[] = SGSI_TEST_DATA "/room";

static sgs_scene *load_room(void)
{
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 8;
    options.test_every = 8;
    sgs_scene *scene;
    assert_int_equal(sgs_scene_load(room, &options, &scene), SGS_STATUS_OK);
    return scene;
}

static void train(const sgs_scene *scene, char hex[17])
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = 1000;
    sgs_trainer *trainer;
    assert_int_equal(sgs_trainer_create(scene, &options, &trainer), SGS_STATUS_OK);
    sgs_step_info info;
    for (int i = 0; i < 30; ++i)
        assert_int_equal(sgs_trainer_step(trainer, &info), SGS_STATUS_OK);
    sgs_gaussians_hash(sgs_trainer_model(trainer), hex);
    sgs_trainer_destroy(trainer);
}

// The views in reverse order; the scene sorts them.
static void a_copied_scene_trains_to_the_same_bits(void **state)
{
    (void)state;
    sgs_scene *loaded = load_room(), *made;
    const size_t count = loaded->view_count;
    sgs_view_source *sources = calloc(count, sizeof *sources);
    assert_non_null(sources);
    for (size_t i = 0; i < count; ++i) {
        const sgs_view *view = &loaded->views[i];
        sources[count - 1 - i] =
            (sgs_view_source){.name = view->name,
                              .camera = view->camera,
                              .pose = view->pose,
                              .split = view->split,
                              .channels = view->image.channels,
                              .pixels = view->image.pixels,
                              .channel_stride = (ptrdiff_t)view->image.width * view->image.height,
                              .pixel_stride = 1};
        sources[count - 1 - i].row_stride = view->image.width;
    }
    assert_int_equal(sgs_scene_create(sources, count, loaded->points, loaded->colors,
                                      loaded->point_count, NULL, &made),
                     SGS_STATUS_OK);
    free(sources);
    assert_int_equal(made->format, SGS_SCENE_MEMORY);
    assert_int_equal(made->view_count, count);
    assert_int_equal(made->photo_bytes, loaded->photo_bytes);
    assert_memory_equal(&made->extent, &loaded->extent, sizeof made->extent);
    for (size_t i = 0; i < count; ++i) {
        assert_string_equal(made->views[i].name, loaded->views[i].name);
        assert_int_equal(made->views[i].split, loaded->views[i].split);
        assert_int_equal(made->views[i].image.kept, loaded->views[i].image.kept);
        assert_ptr_not_equal(made->views[i].image.pixels, loaded->views[i].image.pixels);
    }
    char of_files[17], of_memory[17];
    train(loaded, of_files);
    sgs_scene_destroy(loaded);
    train(made, of_memory);
    sgs_scene_destroy(made);
    assert_string_equal(of_memory, of_files);
}

typedef struct training {
    const sgs_scene *scene;
    char hex[17];
} training;

static void *train_in_thread(void *context)
{
    training *t = context;
    train(t->scene, t->hex);
    return NULL;
}

static void trainers_of_two_threads_do_not_disturb_each_other(void **state)
{
    (void)state;
    sgs_scene *scene = load_room();
    training alone = {.scene = scene}, at_once[2] = {alone, alone};
    pthread_t threads[2];
    train_in_thread(&alone);
    for (int k = 0; k < 2; ++k)
        assert_int_equal(pthread_create(&threads[k], NULL, train_in_thread, &at_once[k]), 0);
    for (int k = 0; k < 2; ++k) {
        assert_int_equal(pthread_join(threads[k], NULL), 0);
        assert_string_equal(at_once[k].hex, alone.hex);
    }
    sgs_scene_destroy(scene);
}

// ---- Small views ----

enum { W = 19, H = 7 };

static sgs_view_source small_source(int channels, sgs_pixel_type type, const void *pixels)
{
    return (sgs_view_source){.camera = {SGS_CAMERA_PINHOLE, W, H, {20, 20, 9.5, 3.5}},
                             .pose = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}},
                             .pixel_type = type,
                             .channels = channels,
                             .pixels = pixels};
}

static sgs_scene *make(const sgs_view_source *source, const sgs_scene_options *options)
{
    sgs_scene *scene;
    assert_int_equal(sgs_scene_create(source, 1, NULL, NULL, 0, options, &scene), SGS_STATUS_OK);
    assert_int_equal(scene->view_count, 1);
    return scene;
}

static bool is_valid(const sgs_photo *photo, int x, int y)
{
    return !photo->valid_mask ||
           (photo->valid_mask[(size_t)y * ((size_t)W + 15) / 16 + (size_t)x / 16] >> x % 16 & 1);
}

// Linear floats, bottom row first in memory, five floats apart: alpha, padding and one NaN.
static void floats_with_strides_become_the_space_of_the_scene(void **state)
{
    (void)state;
    float memory[H][W][5];
    for (int y = 0; y < H; ++y)
        for (int x = 0; x < W; ++x) {
            for (int c = 0; c < 3; ++c)
                memory[H - 1 - y][x][c] = (float)(1 + x + 20 * y + c) / 64.0f;
            memory[H - 1 - y][x][3] = x < 4 ? 0.25f : 1.0f;
            memory[H - 1 - y][x][4] = NAN; // padding
        }
    memory[H - 1 - 2][5][1] = NAN;
    sgs_view_source source = small_source(4, SGS_PIXEL_FLOAT, memory[H - 1]);
    source.pixel_stride = sizeof memory[0][0];
    source.row_stride = -(ptrdiff_t)sizeof memory[0];
    for (int run = 0; run < 3; ++run) { // linear; sRGB; sRGB with alpha as a mask
        sgs_scene_options options = sgs_scene_options_default();
        options.space = run == 0 ? SGS_SPACE_LINEAR : SGS_SPACE_SRGB;
        options.alpha = run == 2 ? SGS_ALPHA_MASK : SGS_ALPHA_OVER;
        options.white_point = 2;
        sgs_scene *scene = make(&source, &options);
        const sgs_photo *photo = &scene->views[0].image;
        assert_true(photo->is_hdr && photo->halves && !photo->pixels);
        assert_int_equal(photo->channels, run == 2 ? 3 : 4);
        assert_true(scene->has_alpha);
        assert_int_equal(scene->pixels_nonfinite, 1);
        assert_int_equal(photo->kept, W * H - 1 - (run == 2 ? 4 * H : 0));
        assert_true(scene->white_point == 2);
        for (int y = 0; y < H; ++y)
            for (int x = 0; x < W; ++x) {
                assert_int_equal(is_valid(photo, x, y),
                                 !(x == 5 && y == 2) && !(run == 2 && x < 4));
                for (int c = 0; c < 3 && is_valid(photo, x, y); ++c) {
                    const float light = (float)(1 + x + 20 * y + c) / 128.0f;
                    const float expected = run ? sgs_srgb_encode(light) : light;
                    const float value =
                        sgs_photo_value(photo, ((size_t)c * H + (size_t)y) * W + (size_t)x);
                    assert_true(fabsf(value - expected) <= expected / 1024);
                }
            }
        sgs_scene_destroy(scene);
    }
    // Without a white point, 99 % of the light is at most 1.
    sgs_scene *scene = make(&source, NULL);
    assert_true(scene->white_point > 2.0 && scene->white_point < 2.4);
    sgs_scene_destroy(scene);
}

static double white_point_of_trained(const sgs_scene *scene, const temp_folder *folder)
{
    const char *path = temp_path(folder, "trained.ply");
    sgs_trainer *trainer;
    sgs_step_info info;
    sgs_model_colors colors;
    assert_int_equal(sgs_trainer_create(scene, NULL, &trainer), SGS_STATUS_OK);
    assert_int_equal(sgs_trainer_step(trainer, &info), SGS_STATUS_OK);
    assert_int_equal(sgs_trainer_write_ply(trainer, path), SGS_STATUS_OK);
    sgs_trainer_destroy(trainer);
    assert_int_equal(sgs_model_read_colors(path, &colors), SGS_STATUS_OK);
    return colors.white_point;
}

static void assert_same_photo(const sgs_photo *a, const sgs_photo *b)
{
    assert_true(a->width == b->width && a->height == b->height && a->channels == b->channels);
    assert_true(a->is_hdr == b->is_hdr && a->kept == b->kept && !a->pixels == !b->pixels);
    const size_t values = (size_t)a->width * (size_t)a->height * (size_t)a->channels;
    for (size_t i = 0; i < values; ++i)
        assert_true(sgs_photo_value(a, i) == sgs_photo_value(b, i));
}

// Two photos in linear light and an 8-bit one, as TIFF files and in memory.
static void a_folder_and_memory_give_the_same_scene(void **state)
{
    (void)state;
    static float light[2][H][W][3];
    static uint8_t bytes[H][W][4];
    static const float points[4][3] = {{0, 0, 2}, {0.5f, 0, 3}, {0, 0.25f, 2}, {-0.5f, 0, 4}};
    for (int i = 0; i < H * W; ++i) {
        for (int c = 0; c < 3; ++c)
            for (int k = 0; k < 2; ++k)
                light[k][i / W][i % W][c] = (float)((i * 37 + c * 11 + k * 5) % 256) / 32.0f;
        for (int c = 0; c < 4; ++c)
            bytes[i / W][i % W][c] = (uint8_t)((i * 53 + c * 29) % 256);
    }
    const temp_folder folder = temp_folder_make();
    const tiff floats = {W, H, 3, 32, 2, 3, 0}, rgba = {W, H, 4, 8, 2, 1, 2};
    tiff_put(&folder, "images/0.tif", &floats, light[0], sizeof light[0]);
    tiff_put(&folder, "images/1.tif", &floats, light[1], sizeof light[1]);
    tiff_put(&folder, "images/2.tif", &rgba, bytes, sizeof bytes);
    tree_put_text(&folder, "points.ply",
                  "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\n"
                  "property float z\nend_header\n0 0 2\n0.5 0 3\n0 0.25 2\n-0.5 0 4\n");
#define FRAME(name, x)                                                                             \
    "{\"file_path\":\"images/" name "\",\"transform_matrix\":[[1,0,0," x                           \
    "],[0,-1,0,0],[0,0,-1,0],[0,0,0,1]]}"
    tree_put_text(&folder, "transforms.json",
                  "{\"fl_x\":20,\"fl_y\":20,\"cx\":9.5,\"cy\":3.5,\"w\":19,\"h\":7,"
                  "\"ply_file_path\":\"points.ply\",\"frames\":[" FRAME("0.tif", "0") "," FRAME(
                      "1.tif", "0.5") "," FRAME("2.tif", "-1") "]}");
#undef FRAME
    sgs_view_source sources[3] = {small_source(3, SGS_PIXEL_FLOAT, light[0]),
                                  small_source(3, SGS_PIXEL_FLOAT, light[1]),
                                  small_source(4, SGS_PIXEL_UINT8, bytes)};
    static const char *const names[3] = {"images/0.tif", "images/1.tif", "images/2.tif"};
    for (int v = 0; v < 3; ++v) {
        sources[v].name = names[v];
        sources[v].pose.translation[0] = v == 0 ? 0 : v == 1 ? -0.5 : 1;
    }
    sgs_scene *loaded, *made;
    assert_int_equal(sgs_scene_load(folder.path, NULL, &loaded), SGS_STATUS_OK);
    assert_int_equal(sgs_scene_create(sources, 3, points[0], NULL, 4, NULL, &made), SGS_STATUS_OK);
    assert_int_equal(loaded->view_count, 3);
    assert_int_equal(made->view_count, 3);
    for (size_t v = 0; v < 3; ++v) {
        assert_string_equal(made->views[v].name, loaded->views[v].name);
        assert_true(sgs_camera_equal(&made->views[v].camera, &loaded->views[v].camera));
        assert_memory_equal(&made->views[v].pose, &loaded->views[v].pose, sizeof(sgs_pose));
        assert_int_equal(made->views[v].split, loaded->views[v].split);
        assert_same_photo(&made->views[v].image, &loaded->views[v].image);
    }
    assert_int_equal(loaded->linear_images, 2);
    assert_int_equal(made->linear_images, 2);
    assert_true(loaded->white_point > 4.0 && made->white_point == loaded->white_point);
    assert_int_equal(made->float_images, loaded->float_images);
    assert_int_equal(made->photo_bytes, loaded->photo_bytes);
    assert_int_equal(made->has_alpha, loaded->has_alpha);
    assert_int_equal(made->pixels_nonfinite, loaded->pixels_nonfinite);
    assert_int_equal(made->masks, loaded->masks);
    assert_int_equal(made->point_count, loaded->point_count);
    assert_memory_equal(made->points, loaded->points, sizeof points);
    assert_memory_equal(made->center, loaded->center, sizeof made->center);
    assert_true(made->extent == loaded->extent);
    const double white_point = white_point_of_trained(loaded, &folder);
    assert_true(fabs(white_point - loaded->white_point) <= 1e-6 * white_point);
    assert_true(white_point_of_trained(made, &folder) == white_point);
    sgs_scene_destroy(loaded);
    sgs_scene_destroy(made);
    tree_remove(&folder);
}

static void halves_keep_their_value(void **state)
{
    (void)state;
    // 1, 0.5, -1 (becomes 0), 65504, the smallest subnormal (becomes 0), infinity.
    static const uint16_t halves[] = {0x3c00, 0x3800, 0xbc00, 0x7bff, 0x0001, 0x7c00};
    static const float values[] = {1, 0.5f, 0, 65504, 0};
    uint16_t pixels[H][W][3] = {{{0}}};
    for (int i = 0; i < 6; ++i)
        pixels[0][i][1] = halves[i];
    const sgs_view_source source = small_source(3, SGS_PIXEL_HALF, pixels);
    sgs_scene_options options = sgs_scene_options_default();
    options.space = SGS_SPACE_LINEAR;
    options.white_point = 1;
    sgs_scene *scene = make(&source, &options);
    const sgs_photo *photo = &scene->views[0].image;
    for (int i = 0; i < 5; ++i)
        assert_true(sgs_photo_value(photo, (size_t)(W * H + i)) == values[i]);
    assert_false(is_valid(photo, 5, 0));
    assert_int_equal(scene->pixels_nonfinite, 1);
    sgs_scene_destroy(scene);
}

static void assert_held_out(const sgs_view_source *sources, size_t count, const char *name,
                            const char *also, const char *expected)
{
    const char *const names[] = {name, also};
    sgs_scene_options options = sgs_scene_options_default();
    options.held_out = names;
    options.held_out_count = also ? 2 : 1;
    sgs_scene *scene;
    assert_int_equal(sgs_scene_create(sources, count, NULL, NULL, 0, &options, &scene),
                     SGS_STATUS_OK);
    for (size_t v = 0; v < count; ++v)
        assert_int_equal(scene->views[v].split == SGS_SPLIT_TEST, expected[v] == '1');
    sgs_scene_destroy(scene);
}

// The names of a run that read the same photos with other folders in front.
static void recorded_names_match_in_other_folders(void **state)
{
    (void)state;
    static const char *const names[] = {"a/1.png", "a/2.png", "b/1.png", "c/d/3.png"};
    static const uint8_t pixels[H][W][3];
    sgs_view_source sources[4];
    for (int v = 0; v < 4; ++v) {
        sources[v] = small_source(3, SGS_PIXEL_UINT8, pixels);
        sources[v].name = names[v];
    }
    assert_held_out(sources, 4, "a/2.png", NULL, "0100");
    assert_held_out(sources, 4, "2.png", NULL, "0100");
    assert_held_out(sources, 4, "images/a/2.png", "d/3.png", "0101");
    assert_held_out(sources, 4, "1.png", NULL, "0000");      // of two views
    assert_held_out(sources, 4, "b/2.png", ".png", "0000");  // another folder, part of a name
    assert_held_out(sources, 4, "a/1.png", "2.png", "1000"); // the folders are the same

    // Three names that denote the same view denote none.
    static const char *const recorded[] = {"x/a/2.png", "y/a/2.png", "3.png", NULL, "z/a/2.png"};
    static const ptrdiff_t expected[] = {-1, -1, 3, -1, -1};
    const sgs_scene_options options = sgs_scene_options_default();
    ptrdiff_t found[5];
    sgs_scene *scene;
    assert_int_equal(sgs_scene_create(sources, 4, NULL, NULL, 0, &options, &scene), SGS_STATUS_OK);
    sgs_scene_find_recorded(scene, recorded, 5, found);
    for (int k = 0; k < 5; ++k)
        assert_int_equal(found[k], expected[k]);
    sgs_scene_destroy(scene);
}

static void masks_define_the_valid_pixels(void **state)
{
    (void)state;
    uint8_t pixels[H][W][3], mask[H][2 * W];
    memset(pixels, 77, sizeof pixels);
    memset(mask, 0, sizeof mask);
    for (int y = 0; y < H; ++y)
        for (int x = 0; x < W; ++x)
            mask[y][2 * x] = x % 3 ? 128 : 127;
    sgs_view_source source = small_source(3, SGS_PIXEL_UINT8, pixels);
    source.mask = mask[0];
    source.mask_pixel_stride = 2;
    source.mask_row_stride = sizeof mask[0];
    for (int invert = 0; invert < 2; ++invert) {
        sgs_scene_options options = sgs_scene_options_default();
        options.invert_masks = invert;
        sgs_scene *scene = make(&source, &options);
        assert_int_equal(scene->masks, 1);
        for (int y = 0; y < H; ++y)
            for (int x = 0; x < W; ++x)
                assert_int_equal(is_valid(&scene->views[0].image, x, y), (x % 3 != 0) != invert);
        sgs_scene_destroy(scene);
    }
    memset(mask, 0, sizeof mask);
    sgs_scene *scene;
    assert_int_equal(sgs_scene_create(&source, 1, NULL, NULL, 0, NULL, &scene),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "view 'view_000000': mask excludes every pixel"));
    assert_null(scene);
}

// ---- Refusals ----

static void refused(const sgs_view_source *views, size_t count, const float *points,
                    size_t point_count, const char *sentence)
{
    sgs_scene *scene = (sgs_scene *)&count;
    assert_int_equal(sgs_scene_create(views, count, points, NULL, point_count, NULL, &scene),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_null(scene);
    if (!strstr(sgs_last_error(), sentence))
        fail_msg("'%s' lacks '%s'", sgs_last_error(), sentence);
}

static void bad_input_is_named(void **state)
{
    (void)state;
    static const uint8_t pixels[H * W * 4];
    const sgs_view_source good = small_source(3, SGS_PIXEL_UINT8, pixels);
    sgs_view_source two[2] = {good, good};
    refused(NULL, 0, NULL, 0, "no views");
    sgs_view_source bad = good;
    bad.name = "a";
    bad.camera.params[0] = NAN;
    refused(&bad, 1, NULL, 0, "view 'a': camera: ");
    bad = good;
    bad.pose.rotation[0] = 2;
    refused(&bad, 1, NULL, 0, "view 'view_000000': pose.rotation");
    bad = good;
    bad.pose.translation[2] = INFINITY;
    refused(&bad, 1, NULL, 0, "pose.translation");
    bad.pose.translation[2] = 1e15;
    refused(&bad, 1, NULL, 0, "view 'view_000000': camera position is out of range");
    bad = good;
    for (int k = 3; k < 6; ++k) // an image with y up
        bad.pose.rotation[k] = -bad.pose.rotation[k];
    refused(&bad, 1, NULL, 0, "pose.rotation is mirrored");
    bad = good;
    bad.camera = (sgs_camera){SGS_CAMERA_OPENCV, W, H, {20, 20, 9, 3, -1e9}};
    refused(&bad, 1, NULL, 0, "view 'view_000000': its lens has no ray for any pixel; check k1");
    bad = good;
    bad.channels = 2;
    refused(&bad, 1, NULL, 0, "channels");
    bad = good;
    bad.pixel_type = (sgs_pixel_type)3;
    refused(&bad, 1, NULL, 0, "pixel_type");
    bad = good;
    bad.pixel_type = SGS_PIXEL_FLOAT;
    bad.pixel_stride = 3;
    refused(&bad, 1, NULL, 0, "stride");
    bad = good;
    bad.split = SGS_SPLIT_ALL;
    refused(&bad, 1, NULL, 0, "split");
    bad = good;
    bad.split = SGS_SPLIT_TEST;
    refused(&bad, 1, NULL, 0, "held out");
    two[0].name = two[1].name = "same";
    refused(two, 2, NULL, 0, "view 'same': name is used twice");
    const float points[6] = {0, 0, 0, 0, NAN, 0};
    refused(&good, 1, points, 2, "point 1 is not finite");
    sgs_scene_options options = sgs_scene_options_default();
    options.struct_size += 1;
    sgs_scene *scene;
    assert_int_equal(sgs_scene_create(&good, 1, NULL, NULL, 0, &options, &scene),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_scene_load(room, &options, &scene), SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "sgs_scene_options.struct_size"));
}

static void options_out_of_range_are_refused(void **state)
{
    (void)state;
    static const uint8_t pixels[H * W * 3];
    const sgs_view_source good = small_source(3, SGS_PIXEL_UINT8, pixels);
    const sgs_scene_options initial = sgs_scene_options_default();
    sgs_scene_options cases[9];
    for (int k = 0; k < 9; ++k)
        cases[k] = initial;
    cases[0].white_point = NAN;
    cases[1].white_point = INFINITY;
    cases[2].white_point = -1;
    cases[3].alpha = (sgs_alpha)3;
    cases[4].alpha = (sgs_alpha)-1;
    cases[5].space = (sgs_space)2;
    cases[6].test_every = -1;
    cases[7].view_height = -1;
    cases[8].cameras_only = true; // with load_images
    for (int k = 0; k < 9; ++k) {
        static const char *const names[] = {"white_point", "white_point", "white_point",
                                            "alpha",       "alpha",       "space",
                                            "test_every",  "view_height", "cameras_only"};
        sgs_scene *scene = NULL;
        if (k < 8) {
            assert_int_equal(sgs_scene_create(&good, 1, NULL, NULL, 0, &cases[k], &scene),
                             SGS_STATUS_INVALID_ARGUMENT);
            assert_non_null(strstr(sgs_last_error(), names[k]));
        }
        assert_int_equal(sgs_scene_load(room, &cases[k], &scene), SGS_STATUS_INVALID_ARGUMENT);
        assert_non_null(strstr(sgs_last_error(), names[k]));
        assert_null(scene);
    }
}

// The view exists, but training requires its photo.
static void views_without_photos_are_not_trained(void **state)
{
    (void)state;
    const sgs_view_source source = small_source(3, SGS_PIXEL_UINT8, NULL);
    sgs_scene *scene = make(&source, NULL);
    sgs_trainer *trainer;
    assert_int_equal(sgs_trainer_create(scene, NULL, &trainer), SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "the training views have no photos"));
    const sgs_photo *photo;
    assert_int_equal(sgs_scene_photo(scene, 0, &photo), SGS_STATUS_OK);
    assert_int_equal(photo->width, 0);
    assert_int_equal(sgs_scene_photo(scene, 1, &photo), SGS_STATUS_INVALID_ARGUMENT);
    assert_null(photo);
    sgs_scene_destroy(scene);
}

// ---- Distance from the origin ----

static void count_far(void *user, const char *message)
{
    *(size_t *)user += strstr(message, "subtract the same offset from all cameras and points") != 0;
}

// Georeferenced cameras, 100 units apart, where the steps of positions are 0.5 or 0.03 units; the
// same cameras around the origin; a panorama, whose cameras are close together and whose points are
// not.
static void single_precision_too_coarse_for_the_scene_is_warned_of(void **state)
{
    (void)state;
    static const struct {
        double origin, spread, focal;
        float distance;
        size_t warnings;
    } scenes[] = {
        {5.4e6, 100, 2000, 50, 1}, {4.6e5, 100, 2000, 50, 1}, {4.6e5, 100, 20, 50, 0},
        {0, 100, 2000, 50, 0},     {1000, 100, 2000, 50, 0},  {100, 1e-3, 2000, 50, 0},
        {100, 1e-3, 2000, 0, 1},   {5e6, 0, 2000, 50, 1},
    };
    static const uint8_t pixels[H * W * 3];
    for (size_t i = 0; i < sizeof scenes / sizeof *scenes; ++i) {
        sgs_view_source sources[2];
        float points[9];
        for (int k = 0; k < 2; ++k) {
            sources[k] = small_source(3, SGS_PIXEL_UINT8, pixels);
            sources[k].camera.params[0] = sources[k].camera.params[1] = scenes[i].focal;
            sources[k].pose.translation[1] = -scenes[i].origin;
            sources[k].pose.translation[0] = k * scenes[i].spread;
        }
        for (int k = 0; k < 9; ++k)
            points[k] = k % 3 == 1 ? (float)scenes[i].origin : k % 3 == 2 ? scenes[i].distance : 0;
        size_t warned = 0;
        sgs_scene *scene;
        sgs_warning_handler_set(count_far, &warned);
        assert_int_equal(sgs_scene_create(sources, 2, points, NULL, 3, NULL, &scene),
                         SGS_STATUS_OK);
        sgs_warning_handler_set(NULL, NULL);
        if (warned != scenes[i].warnings)
            fail_msg("scene %zu: %zu warnings", i, warned);
        sgs_scene_destroy(scene);
    }
}

// ---- Progress ----

typedef struct watcher {
    size_t calls, cancel_at, total;
} watcher;

static bool watch(void *user, size_t done, size_t total)
{
    watcher *w = user;
    assert_int_equal(done, ++w->calls);
    w->total = total;
    return done != w->cancel_at;
}

static void loading_reports_progress_and_can_be_cancelled(void **state)
{
    (void)state;
    for (int images = 0; images < 2; ++images)
        for (int cancels = 0; cancels < 2; ++cancels) {
            watcher w = {.cancel_at = cancels ? 20 : 0};
            sgs_scene_options options = sgs_scene_options_default();
            options.downscale = 8;
            options.load_images = images;
            options.progress = watch;
            options.progress_user = &w;
            sgs_scene *scene = NULL;
            const sgs_status status = sgs_scene_load(room, &options, &scene);
            assert_int_equal(status, cancels ? SGS_STATUS_CANCELLED : SGS_STATUS_OK);
            assert_int_equal(scene == NULL, cancels);
            assert_int_equal(w.total, images ? 70 : 35);
            assert_int_equal(w.calls, cancels ? 20 : w.total);
            sgs_scene_destroy(scene);
        }
    static const uint8_t pixels[H * W * 3];
    sgs_view_source sources[5];
    for (int i = 0; i < 5; ++i)
        sources[i] = small_source(3, SGS_PIXEL_UINT8, pixels);
    watcher w = {.cancel_at = 3};
    sgs_scene_options options = sgs_scene_options_default();
    options.progress = watch;
    options.progress_user = &w;
    sgs_scene *scene;
    assert_int_equal(sgs_scene_create(sources, 5, NULL, NULL, 0, &options, &scene),
                     SGS_STATUS_CANCELLED);
    assert_int_equal(w.calls, 3);
    w = (watcher){0};
    assert_int_equal(sgs_scene_create(sources, 5, NULL, NULL, 0, &options, &scene), SGS_STATUS_OK);
    assert_true(w.calls == 5 && w.total == 5);
    sgs_scene_destroy(scene);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_copied_scene_trains_to_the_same_bits),
        cmocka_unit_test(trainers_of_two_threads_do_not_disturb_each_other),
        cmocka_unit_test(floats_with_strides_become_the_space_of_the_scene),
        cmocka_unit_test(a_folder_and_memory_give_the_same_scene),
        cmocka_unit_test(halves_keep_their_value),
        cmocka_unit_test(recorded_names_match_in_other_folders),
        cmocka_unit_test(masks_define_the_valid_pixels),
        cmocka_unit_test(bad_input_is_named),
        cmocka_unit_test(options_out_of_range_are_refused),
        cmocka_unit_test(views_without_photos_are_not_trained),
        cmocka_unit_test(single_precision_too_coarse_for_the_scene_is_warned_of),
        cmocka_unit_test(loading_reports_progress_and_can_be_cancelled),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
