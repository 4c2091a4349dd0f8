// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Masks: found under all names, read with the right polarity, downscaled conservatively, combined
// with the pixels without a ray, rejected if the size differs. Masked content does not enter the
// model.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "image/mask.h"
#include "support/bad_input.h"
#include "support/png_bytes.h"
#include "support/scene_support.h"
#include "sparegs/trainer.h"

enum { WIDTH = 64, HEIGHT = 48 };

static const uint8_t grey[4] = {90, 100, 110, 255};

// The scene of scene_support with four photos of 64 x 48, and their channels.
static temp_folder make_scene(int channels)
{
    const temp_folder folder = temp_folder_make();
    const model m = model_make();
    model_put(&folder, "sparse/0/", &m, true);
    model_put_pictures(&folder, "images", &m, (picture){WIDTH, HEIGHT, channels, grey});
    return folder;
}

// A mask of the photos' size, black in [x0, x1) x [y0, y1).
static void put_mask(const temp_folder *folder, const char *name, int scale, int x0, int y0, int x1,
                     int y1)
{
    static uint8_t pixels[9 * WIDTH * HEIGHT];
    sgs_image8 image = {
        .width = scale * WIDTH, .height = scale * HEIGHT, .channels = 1, .pixels = pixels};
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x)
            pixels[y * image.width + x] = x >= x0 && x < x1 && y >= y0 && y < y1 ? 0 : 255;
    tree_put(folder, name, "", 0);
    assert_int_equal(sgs_png_write(temp_path(folder, name), &image), SGS_STATUS_OK);
}

static sgs_scene *load(const temp_folder *folder, const sgs_scene_options *options)
{
    sgs_scene *scene;
    if (sgs_scene_load(folder->path, options, &scene))
        fail_msg("%s", sgs_last_error());
    return scene;
}

static const sgs_photo *photo_of(const sgs_scene *scene, const char *name)
{
    const ptrdiff_t found = sgs_scene_find_view(scene, name);
    assert_true(found >= 0);
    return &scene->views[found].image;
}

static void assert_hole(const sgs_photo *photo, int x0, int y0, int x1, int y1, bool inverted)
{
    size_t kept = 0;
    for (int y = 0; y < photo->height; ++y)
        for (int x = 0; x < photo->width; ++x) {
            const bool inside = x >= x0 && x < x1 && y >= y0 && y < y1;
            assert_int_equal(sgs_mask_is_valid(photo->valid_mask, photo->width, x, y),
                             inside == inverted);
            kept += inside == inverted;
        }
    assert_int_equal(photo->kept, kept);
}

static void masks_are_found_under_all_names(void **state)
{
    (void)state;
    temp_folder folder = make_scene(3);
    put_mask(&folder, "masks/a.png", 1, 3, 4, 20, 30);
    put_mask(&folder, "masks/b.png.png", 1, 1, 1, 17, 2);
    put_mask(&folder, "mask/sub/c.png", 1, 0, 0, 64, 5);
    put_mask(&folder, "images/d with blanks_mask.png", 1, 60, 40, 64, 48);
    put_mask(&folder, "other/a_mask.png", 1, 5, 4, 20, 30);
    sgs_scene *scene = load(&folder, NULL);
    assert_hole(photo_of(scene, "a.png"), 3, 4, 20, 30, false);
    assert_hole(photo_of(scene, "b.png"), 1, 1, 17, 2, false);
    assert_hole(photo_of(scene, "sub/c.png"), 0, 0, 64, 5, false);
    assert_hole(photo_of(scene, "d with blanks"), 60, 40, 64, 48, false);
    assert_int_equal(scene->masks, 4);
    assert_int_equal(scene->images_unposed, 0); // a mask next to a photo is not a photo
    assert_string_equal(warnings, "");
    sgs_scene_destroy(scene);
    sgs_scene_options options = sgs_scene_options_default();
    options.masks_dir = "other";
    scene = load(&folder, &options);
    assert_hole(photo_of(scene, "a.png"), 5, 4, 20, 30, false);
    assert_int_equal(scene->masks, 1);
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

// Exports from Windows and from programs for JPEG. PNG precedes; a photo is not its own mask.
static void masks_are_found_in_other_formats_and_cases(void **state)
{
    (void)state;
    static const char *const names[] = {"masks/a.PNG",  "Masks/a.png",      "MASK/a.png.png",
                                        "masks/a.jpg",  "masks/a.JPG",      "masks/a.png.jpeg",
                                        "mask/a.JPEG",  "masks/a_mask.tif", "masks/a.TIF",
                                        "masks/a.tiff", "Mask/a_mask.TIFF", "masks/a_mask.PNG"};
    for (size_t i = 0; i < sizeof names / sizeof *names; ++i) {
        temp_folder folder = make_scene(3);
        put_mask(&folder, names[i], 1, 3, 4, 20, 30);
        sgs_scene *scene = load(&folder, NULL);
        assert_hole(photo_of(scene, "a.png"), 3, 4, 20, 30, false);
        assert_int_equal(scene->masks, 1);
        sgs_scene_destroy(scene);
        tree_remove(&folder);
    }
    temp_folder folder = make_scene(3);
    put_mask(&folder, "masks/a.jpg", 1, 3, 4, 20, 30);
    put_mask(&folder, "masks/a_mask.png", 1, 5, 4, 20, 30);
    put_mask(&folder, "Masks/a.png", 1, 6, 4, 20, 30);
    put_mask(&folder, "MASKS/b.png", 1, 7, 4, 20, 30);
    sgs_scene *scene = load(&folder, NULL);
    assert_hole(photo_of(scene, "a.png"), 5, 4, 20, 30, false);
    assert_int_equal(scene->masks, 1);
    sgs_scene_destroy(scene);
    sgs_scene_options options = sgs_scene_options_default();
    options.masks_dir = "images"; // beside the photos
    put_mask(&folder, "images/b_mask.png", 1, 7, 4, 20, 30);
    scene = load(&folder, &options);
    assert_int_equal(scene->masks, 1);
    assert_null(photo_of(scene, "a.png")->valid_mask);
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

static void masks_that_match_no_image_are_refused(void **state)
{
    (void)state;
    temp_folder folder = make_scene(3);
    sgs_scene *scene;
    put_mask(&folder, "masks/sub/frame_7_mask.png", 1, 3, 4, 20, 30);
    put_mask(&folder, "masks/sub/frame_8.png", 1, 3, 4, 20, 30);
    assert_int_equal(sgs_scene_load(folder.path, NULL, &scene), SGS_STATUS_IO);
    assert_holds(sgs_last_error(), "/masks: none of its 2 images is named after an image of the "
                                   "scene; it contains sub/frame_7_mask.png, sub/frame_8.png; a "
                                   "mask must be named after its image, for example a.png; use "
                                   "option masks_dir none to ignore masks");
    bad_input();
    sgs_scene_options options = sgs_scene_options_default();
    options.masks_dir = "none";
    scene = load(&folder, &options);
    assert_int_equal(scene->masks, 0);
    sgs_scene_destroy(scene);
    put_mask(&folder, "images/b_mask.png", 1, 3, 4, 20, 30); // the masks are elsewhere
    scene = load(&folder, NULL);
    assert_int_equal(scene->masks, 1);
    sgs_scene_destroy(scene);
    tree_remove(&folder);
    folder = make_scene(3);
    tree_put_text(&folder, "masks/notes.txt", "to do");
    scene = load(&folder, NULL);
    assert_holds(warnings, "the mask folder contains no mask named after an image");
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

static void options_select_invert_and_disable_masks(void **state)
{
    (void)state;
    temp_folder folder = make_scene(3);
    put_mask(&folder, "masks/a.png", 1, 3, 4, 20, 30);
    put_mask(&folder, "people/b.png", 1, 1, 1, 17, 2);
    sgs_scene_options options = sgs_scene_options_default();
    options.masks_dir = "people";
    options.invert_masks = 1;
    sgs_scene *scene = load(&folder, &options);
    assert_null(photo_of(scene, "a.png")->valid_mask);
    assert_hole(photo_of(scene, "b.png"), 1, 1, 17, 2, true);
    assert_holds(warnings, "3 of 4 images have no mask");
    sgs_scene_destroy(scene);
    options.masks_dir = "none";
    scene = load(&folder, &options);
    assert_true(scene->masks == 0 && !photo_of(scene, "a.png")->valid_mask &&
                !photo_of(scene, "b.png")->valid_mask);
    sgs_scene_destroy(scene);
    options.masks_dir = "peple";
    assert_int_equal(sgs_scene_load(folder.path, &options, &scene), SGS_STATUS_IO);
    assert_holds(sgs_last_error(), "peple: no such mask folder");
    tree_remove(&folder);
}

// Sets both regions of put_mask: a mask of the photos' size, `inside` in the rectangle.
static void put_values(const temp_folder *folder, const char *name, int inside, int outside)
{
    static uint8_t pixels[WIDTH * HEIGHT];
    sgs_image8 image = {.width = WIDTH, .height = HEIGHT, .channels = 1, .pixels = pixels};
    for (int y = 0; y < HEIGHT; ++y)
        for (int x = 0; x < WIDTH; ++x)
            pixels[y * WIDTH + x] =
                (uint8_t)(x >= 8 && x < 24 && y >= 8 && y < 16 ? inside : outside);
    tree_put(folder, name, "", 0);
    assert_int_equal(sgs_png_write(temp_path(folder, name), &image), SGS_STATUS_OK);
}

// Without a value of at least 128, all but 0 is valid, at any resolution; with one, less is not.
static void masks_of_small_values_exclude_zeros(void **state)
{
    (void)state;
    temp_folder folder = make_scene(3);
    put_values(&folder, "masks/a.png", 0, 1);
    put_values(&folder, "masks/b.png", 0, 127);
    put_values(&folder, "masks/sub/c.png", 127, 128);
    put_values(&folder, "masks/d with blanks.png", 3, 7);
    for (int k = 0; k < 4; ++k) {
        sgs_scene_options options = sgs_scene_options_default();
        options.downscale = k % 2 ? 4 : 1;
        options.invert_masks = k / 2;
        if (k / 2)
            put_values(&folder, "masks/d with blanks.png", 0, 9);
        const int s = options.downscale;
        sgs_scene *scene = load(&folder, &options);
        assert_hole(photo_of(scene, "a.png"), 8 / s, 8 / s, 24 / s, 16 / s, k / 2);
        assert_hole(photo_of(scene, "b.png"), 8 / s, 8 / s, 24 / s, 16 / s, k / 2);
        assert_hole(photo_of(scene, "sub/c.png"), 8 / s, 8 / s, 24 / s, 16 / s, k / 2);
        if (!k)
            assert_null(photo_of(scene, "d with blanks")->valid_mask);
        assert_string_equal(warnings, "");
        sgs_scene_destroy(scene);
    }
    tree_remove(&folder);
}

// Labels of 16 bits, of which 128 is still rounded to 0 of 255, and labels of one channel.
static void labels_of_any_depth_are_valid(void **state)
{
    (void)state;
    temp_folder folder = make_scene(3);
    static uint16_t labels[WIDTH * HEIGHT], colors[3 * WIDTH * HEIGHT];
    for (int y = 0; y < HEIGHT; ++y)
        for (int x = 0; x < WIDTH; ++x) {
            const bool inside = x >= 8 && x < 24 && y >= 8 && y < 16;
            labels[y * WIDTH + x] = inside ? 0 : (uint16_t)(1 + x * 2);
            colors[3 * (y * WIDTH + x) + 2] = !inside;
        }
    png_put(&folder, "masks/a.png", &(png_file){WIDTH, HEIGHT, 1, 16, 0, labels});
    png_put(&folder, "masks/b.png", &(png_file){WIDTH, HEIGHT, 3, 8, 0, colors});
    uint32_t words[WIDTH * HEIGHT];
    for (int i = 0; i < WIDTH * HEIGHT; ++i)
        words[i] = labels[i];
    tiff_put(&folder, "masks/sub/c.png", &(tiff){WIDTH, HEIGHT, 1, 32, 1, 1, 0}, words,
             sizeof words);
    const sgs_scene_options options = sgs_scene_options_default();
    sgs_scene *scene = load(&folder, &options);
    assert_hole(photo_of(scene, "a.png"), 8, 8, 24, 16, false);
    assert_hole(photo_of(scene, "b.png"), 8, 8, 24, 16, false);
    assert_hole(photo_of(scene, "sub/c.png"), 8, 8, 24, 16, false);
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

// instant-ngp excludes pixels with any colour but black (nerf_loader.cu).
static void masks_of_instant_ngp_exclude_all_but_black(void **state)
{
    (void)state;
    temp_folder folder = make_scene(3);
    static const uint8_t blue[3] = {0, 0, 1};
    put_values(&folder, "images/dynamic_mask_a.png", 1, 0);
    put_values(&folder, "images/dynamic_mask_b.png", 255, 0);
    tree_put_picture(&folder, "images/sub/dynamic_mask_c.png", WIDTH, HEIGHT, 3, blue);
    put_values(&folder, "images/dynamic_mask_d with blanks.png", 128, 0);
    put_mask(&folder, "images/b_mask.png", 1, 1, 1, 17, 2); // precedes, as does a mask folder
    put_mask(&folder, "other/a.png", 1, 3, 4, 20, 30);
    sgs_scene_options options = sgs_scene_options_default();
    sgs_scene *scene = load(&folder, &options);
    assert_int_equal(scene->view_count, 3);
    assert_hole(photo_of(scene, "a.png"), 8, 8, 24, 16, false);
    assert_hole(photo_of(scene, "b.png"), 1, 1, 17, 2, false);
    assert_hole(photo_of(scene, "d with blanks"), 8, 8, 24, 16, false);
    assert_holds(warnings, "sub/dynamic_mask_c.png: mask excludes every pixel; the view is ");
    assert_null(strstr(warnings, "without a pose")); // masks are not photos
    sgs_scene_destroy(scene);
    options.invert_masks = true;
    options.image_cache = 1; // the photos are decoded when they are used
    scene = load(&folder, &options);
    assert_int_equal(scene->view_count, 4);
    for (size_t i = 0; i < 4; ++i) {
        const sgs_photo *photo;
        assert_int_equal(sgs_scene_photo(scene, i, &photo), SGS_STATUS_OK);
        if (!strcmp(scene->views[i].name, "sub/c.png"))
            assert_null(photo->valid_mask);
        else if (!strcmp(scene->views[i].name, "b.png"))
            assert_hole(photo, 1, 1, 17, 2, true);
        else
            assert_hole(photo, 8, 8, 24, 16, true);
    }
    sgs_scene_destroy(scene);
    options = sgs_scene_options_default();
    options.masks_dir = "other";
    scene = load(&folder, &options);
    assert_hole(photo_of(scene, "a.png"), 3, 4, 20, 30, false);
    assert_int_equal(scene->masks, 1);
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

static void inversion_that_excludes_nothing_is_reported(void **state)
{
    (void)state;
    temp_folder folder = make_scene(3);
    put_values(&folder, "masks/a.png", 0, 0);
    put_values(&folder, "masks/b.png", 0, 0);
    sgs_scene_options options = sgs_scene_options_default();
    options.masks_dir = "masks";
    options.invert_masks = true;
    sgs_scene *scene = load(&folder, &options);
    assert_holds(warnings, "with option invert_masks, no mask excludes a pixel; are the masks ");
    sgs_scene_destroy(scene);
    warnings[0] = 0;
    options.image_cache = 1; // the photos are decoded again when they are used
    scene = load(&folder, &options);
    assert_holds(warnings, "with option invert_masks, no mask excludes a pixel");
    sgs_scene_destroy(scene);
    warnings[0] = 0;
    put_values(&folder, "masks/b.png", 1, 0);
    scene = load(&folder, &options);
    assert_null(strstr(warnings, "excludes a pixel"));
    sgs_scene_destroy(scene);
    put_values(&folder, "images/dynamic_mask_a.png", 255, 255);
    options.masks_dir = NULL;
    assert_int_equal(rename(temp_path(&folder, "masks"), temp_path(&folder, "unused")), 0);
    scene = load(&folder, &options);
    assert_holds(warnings, "are the masks empty? Black is valid without this option, white with");
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

// nerfstudio names the mask of each frame; mask folders are used for frames that name none.
static void camera_files_name_masks(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    static const char *const frames[] = {
        "\"file_path\":\"images/a.png\",\"mask_path\":\"holes/of a.png\"",
        "\"file_path\":\"images/b.png\",\"mask_path\":null", "\"file_path\":\"images/c.png\""};
    char text[1024] = "{\"fl_x\":50,\"w\":64,\"h\":48,\"frames\":[";
    for (size_t i = 0; i < 3; ++i)
        snprintf(text + strlen(text), sizeof text - strlen(text),
                 "{%s,\"transform_matrix\":[[1,0,0,%zu],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}%s",
                 frames[i], i, i < 2 ? "," : "]}");
    tree_put_text(&folder, "transforms.json", text);
    for (const char *name = "abc"; *name; ++name) {
        char path[] = "images/?.png";
        path[7] = *name;
        tree_put_picture(&folder, path, WIDTH, HEIGHT, 3, grey);
    }
    put_mask(&folder, "holes/of a.png", 1, 3, 4, 20, 30);
    put_mask(&folder, "masks/a.png", 1, 0, 0, 5, 5);
    put_mask(&folder, "masks/c.png", 1, 1, 1, 17, 2);
    sgs_scene_options options = sgs_scene_options_default();
    sgs_scene *scene = load(&folder, &options);
    assert_int_equal(scene->masks, 2);
    assert_hole(photo_of(scene, "images/a.png"), 3, 4, 20, 30, false);
    assert_null(photo_of(scene, "images/b.png")->valid_mask);
    assert_hole(photo_of(scene, "images/c.png"), 1, 1, 17, 2, false);
    sgs_scene_destroy(scene);
    options.masks_dir = "masks"; // overrides masks named in the file
    scene = load(&folder, &options);
    assert_hole(photo_of(scene, "images/a.png"), 0, 0, 5, 5, false);
    sgs_scene_destroy(scene);
    assert_int_equal(remove(temp_path(&folder, "holes/of a.png")), 0);
    options.masks_dir = NULL;
    assert_int_equal(sgs_scene_load(folder.path, &options, &scene), SGS_STATUS_IO);
    assert_holds(sgs_last_error(), "holes/of a.png: no such mask, named by ");
    options.masks_dir = "none";
    scene = load(&folder, &options);
    assert_int_equal(scene->masks, 0);
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

// A downscaled pixel is valid only if its whole area is, also if the mask is three times as large
// as the photo.
static void downscaled_pixels_are_valid_if_entirely_valid(void **state)
{
    (void)state;
    temp_folder folder = make_scene(3);
    put_mask(&folder, "masks/a.png", 1, 9, 9, 16, 16);
    put_mask(&folder, "masks/b.png", 3, 3 * 10 + 1, 3 * 20, 3 * 10 + 2, 3 * 20 + 1);
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 4;
    sgs_scene *scene = load(&folder, &options);
    assert_hole(photo_of(scene, "a.png"), 2, 2, 4, 4, false);
    assert_hole(photo_of(scene, "b.png"), 2, 5, 3, 6, false);
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

static void masks_of_other_sizes_are_rejected(void **state)
{
    (void)state;
    temp_folder folder = make_scene(3);
    static const int sizes[][2] = {{32, 24}, {64, 40}, {128, 90}};
    for (size_t i = 0; i < sizeof sizes / sizeof *sizes; ++i) {
        sgs_scene *scene;
        tree_put_picture(&folder, "masks/b.png", sizes[i][0], sizes[i][1], 1, grey);
        assert_int_equal(sgs_scene_load(folder.path, NULL, &scene), SGS_STATUS_FORMAT);
        assert_holds(sgs_last_error(), "masks/b.png: the mask has ");
        assert_holds(sgs_last_error(), "images/b.png has 64 x 48; use the same size");
        bad_input();
    }
    sgs_scene *scene;
    tree_put_text(&folder, "masks/b.png", "no picture");
    assert_int_equal(sgs_scene_load(folder.path, NULL, &scene), SGS_STATUS_FORMAT);
    assert_holds(sgs_last_error(), "masks/b.png: ");
    bad_input();
    tree_remove(&folder);
}

static void views_without_valid_pixels_are_skipped(void **state)
{
    (void)state;
    temp_folder folder = make_scene(3);
    put_mask(&folder, "masks/a.png", 1, 0, 0, WIDTH, HEIGHT);
    sgs_scene *scene = load(&folder, NULL);
    assert_int_equal(scene->view_count, 3);
    assert_holds(warnings, "masks/a.png: mask excludes every pixel; the view is skipped");
    assert_null(strstr(warnings, "contains no mask")); // it has that one
    assert_holds(warnings, "3 of 3 images have no mask");
    assert_int_equal(scene->masks, 1);
    sgs_scene_destroy(scene);
    put_mask(&folder, "masks/b.png", 1, 0, 0, WIDTH, HEIGHT);
    put_mask(&folder, "masks/sub/c.png", 1, 0, 0, WIDTH, HEIGHT);
    put_mask(&folder, "masks/d with blanks.png", 1, 0, 0, WIDTH, HEIGHT);
    assert_int_equal(sgs_scene_load(folder.path, NULL, &scene), SGS_STATUS_INVALID_ARGUMENT);
    assert_holds(sgs_last_error(), "masks exclude every pixel of every image, ");
    assert_holds(sgs_last_error(), "masks/a.png for example; correct them, or ignore masks with");
    assert_null(strstr(sgs_last_error(), "invert_masks")); // everything would be valid then
    tree_remove(&folder);
}

// A downscaled pixel that a mask excludes partly is invalid: here all are, of any polarity.
static void masks_that_are_not_black_may_be_inverted(void **state)
{
    (void)state;
    temp_folder folder = make_scene(3);
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 64;
    put_mask(&folder, "masks/a.png", 1, 1, 1, 60, 40);
    put_mask(&folder, "masks/b.png", 1, 1, 1, 60, 40);
    put_mask(&folder, "masks/sub/c.png", 1, 1, 1, 60, 40);
    put_mask(&folder, "masks/d with blanks.png", 1, 1, 1, 60, 40);
    sgs_scene *scene;
    assert_int_equal(sgs_scene_load(folder.path, &options, &scene), SGS_STATUS_INVALID_ARGUMENT);
    assert_holds(sgs_last_error(), "every image; masks inverted? (option invert_masks)");
    bad_input();
    tree_remove(&folder);
}

enum { CUTOUT_PHOTO, CUTOUT_BLACK, CUTOUT_WHITE, CUTOUT_MASK };

// An RGBA file whose alpha is 255 outside of [8, 24) x [8, 16) and `inside` in it. Its colours are
// noise between dark and bright, black, white, or black in [40, 50) x [30, 40) and else white.
static void put_cutout(const temp_folder *folder, const char *name, int colors, int inside)
{
    static uint8_t pixels[4 * WIDTH * HEIGHT];
    const int plane = WIDTH * HEIGHT;
    sgs_image8 image = {.width = WIDTH, .height = HEIGHT, .channels = 4, .pixels = pixels};
    for (int at = 0; at < plane; ++at) {
        const int x = at % WIDTH, y = at / WIDTH;
        const bool hole = x >= 40 && x < 50 && y >= 30 && y < 40;
        const int noise[3] = {(7 * x + 31 * y) % 200, (11 * x + 3 * y) % 90, (5 * x + y) % 256};
        for (int c = 0; c < 3; ++c)
            pixels[c * plane + at] =
                (uint8_t)(colors == CUTOUT_PHOTO  ? noise[c]
                          : colors == CUTOUT_MASK ? (hole ? 0 : 255)
                                                  : 255 * (colors == CUTOUT_WHITE));
        pixels[3 * plane + at] = (uint8_t)(x >= 8 && x < 24 && y >= 8 && y < 16 ? inside : 255);
    }
    tree_put(folder, name, "", 0);
    assert_int_equal(sgs_png_write(temp_path(folder, name), &image), SGS_STATUS_OK);
}

// Cut-outs of programs for matting have the photo, or black, in their colours.
static void cutouts_mask_by_their_alpha_channel(void **state)
{
    (void)state;
    temp_folder folder = make_scene(3);
    put_cutout(&folder, "masks/a.png", CUTOUT_PHOTO, 0);
    put_cutout(&folder, "masks/b.png", CUTOUT_BLACK, 0);
    put_cutout(&folder, "masks/sub/c.png", CUTOUT_PHOTO, 100);
    put_cutout(&folder, "masks/d with blanks.png", CUTOUT_WHITE, 0);
    sgs_scene_options options = sgs_scene_options_default();
    for (int invert = 0; invert < 2; ++invert) {
        options.invert_masks = invert;
        options.image_cache = invert; // the photos are decoded again when they are used
        warnings[0] = 0;
        sgs_scene *scene = load(&folder, &options);
        for (size_t i = 0; i < 4; ++i) {
            const sgs_photo *photo;
            assert_int_equal(sgs_scene_photo(scene, i, &photo), SGS_STATUS_OK);
            assert_hole(photo, 8, 8, 24, 16, invert);
        }
        assert_holds(warnings,
                     "/masks/a.png: alpha is used as the mask (also in 2 other masks), because "
                     "the colours are not those of a mask\n");
        assert_int_equal(strlen(strchr(warnings, '\n')), 1); // once
        sgs_scene_destroy(scene);
    }
    tree_remove(&folder);
}

static void colours_of_masks_are_multiplied_by_alpha(void **state)
{
    (void)state;
    temp_folder folder = make_scene(3);
    put_cutout(&folder, "masks/a.png", CUTOUT_MASK, 255);
    sgs_scene *scene = load(&folder, NULL);
    assert_hole(photo_of(scene, "a.png"), 40, 30, 50, 40, false);
    sgs_scene_destroy(scene);
    put_cutout(&folder, "masks/a.png", CUTOUT_MASK, 0);
    scene = load(&folder, NULL);
    const sgs_photo *photo = photo_of(scene, "a.png");
    assert_int_equal(photo->kept, WIDTH * HEIGHT - 16 * 8 - 10 * 10);
    assert_false(sgs_mask_is_valid(photo->valid_mask, WIDTH, 8, 8));
    assert_false(sgs_mask_is_valid(photo->valid_mask, WIDTH, 40, 30));
    assert_null(strstr(warnings, "alpha channel"));
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

static void alpha_channels_mask_on_request(void **state)
{
    (void)state;
    temp_folder folder = make_scene(4);
    static uint8_t pixels[4 * WIDTH * HEIGHT];
    const sgs_image8 image = {WIDTH, HEIGHT, 4, pixels};
    for (int i = 0; i < WIDTH * HEIGHT; ++i)
        pixels[3 * WIDTH * HEIGHT + i] = i % WIDTH < 20 ? 100 : 140;
    assert_int_equal(sgs_png_write(temp_path(&folder, "images/a.png"), &image), SGS_STATUS_OK);
    sgs_scene_options options = sgs_scene_options_default();
    for (int use = SGS_ALPHA_OVER; use <= SGS_ALPHA_IGNORE; ++use) {
        options.alpha = (sgs_alpha)use;
        sgs_scene *scene = load(&folder, &options);
        const sgs_photo *photo = photo_of(scene, "a.png");
        assert_int_equal(photo->channels, use == SGS_ALPHA_OVER ? 4 : 3);
        assert_true(scene->has_alpha);
        assert_hole(photo, 0, 0, use == SGS_ALPHA_MASK ? 20 : 0, HEIGHT, false);
        sgs_scene_destroy(scene);
    }
    tree_remove(&folder);
}

// Corners of a fisheye image and pixels beyond the fold of a lens are invalid, with or without a
// mask.
static void pixels_without_a_ray_are_invalid(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    model m = model_make();
    m.cameras[0] = (model_camera){7, SGS_CAMERA_OPENCV_FISHEYE, 64, 48, {9, 9, 32, 24}};
    model_put(&folder, "sparse/0/", &m, false);
    tree_put_picture(&folder, "images/b.png", WIDTH, HEIGHT, 3, grey);
    put_mask(&folder, "masks/b.png", 1, 30, 20, 34, 25);
    sgs_scene *scene = load(&folder, NULL);
    const sgs_photo *photo = photo_of(scene, "b.png");
    size_t kept = 0;
    for (int y = 0; y < HEIGHT; ++y)
        for (int x = 0; x < WIDTH; ++x) {
            const bool masked = x >= 30 && x < 34 && y >= 20 && y < 25;
            const bool seen =
                hypot(x + 0.5 - 32, y + 0.5 - 24) < 9 * 3.14159265358979323846 && !masked;
            assert_int_equal(sgs_mask_is_valid(photo->valid_mask, WIDTH, x, y), seen);
            kept += seen;
        }
    assert_true(kept < WIDTH * HEIGHT && photo->kept == kept);
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

// ---- Training ----

// Paints a magenta square at the same place of each photo, and masks it if requested.
static void paint(sgs_scene *scene, bool cover)
{
    for (size_t v = 0; v < scene->view_count; ++v) {
        sgs_photo *photo = &scene->views[v].image;
        const int w = photo->width, h = photo->height;
        const size_t plane = (size_t)w * (size_t)h;
        assert_int_equal(sgsi_mask_begin(photo), SGS_STATUS_OK);
        for (int y = h / 4; y < h / 2; ++y)
            for (int x = w / 3; x < w / 3 + h / 4; ++x) {
                const size_t at = (size_t)y * (size_t)w + (size_t)x;
                photo->pixels[at] = photo->pixels[2 * plane + at] = 255;
                photo->pixels[plane + at] = 0;
                if (cover)
                    sgsi_mask_drop(photo, w, h, x, y);
            }
        sgsi_mask_finish(photo);
    }
}

// Number of magenta primitives in a trained model: min(red, blue) - green > 0.08, from band 0.
static int count_magenta(bool painted, bool cover)
{
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 8;
    sgs_scene *scene;
    assert_int_equal(sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene), SGS_STATUS_OK);
    if (painted)
        paint(scene, cover);
    sgs_train_options train = sgs_train_options_default();
    train.iterations = 120;
    train.sh_degree = 0;
    sgs_trainer *trainer;
    assert_int_equal(sgs_trainer_create(scene, &train, &trainer), SGS_STATUS_OK);
    sgs_step_info info = {0};
    while (!info.stop)
        assert_int_equal(sgs_trainer_step(trainer, &info), SGS_STATUS_OK);
    const sgs_gaussians *model = sgs_trainer_model(trainer);
    int magenta = 0;
    for (size_t i = 0; i < model->count; ++i) {
        double rgb[3];
        for (int c = 0; c < 3; ++c)
            rgb[c] = 0.5 + 0.28209479177387814 * *sgs_gaussians_at(model, i, SGS_PARAM_SH_DC + c);
        magenta += fmin(rgb[0], rgb[2]) - rgb[1] > 0.08;
    }
    sgs_trainer_destroy(trainer);
    sgs_scene_destroy(scene);
    return magenta;
}

static void a_masked_square_leaves_no_colour_in_the_model(void **state)
{
    (void)state;
    const int clean = count_magenta(false, false), shown = count_magenta(true, false),
              masked = count_magenta(true, true);
    print_message("magenta primitives: %d without the square, %d with it, %d under a mask\n", clean,
                  shown, masked);
    assert_true(shown > 4 * clean + 50);
    assert_true(masked < 2 * clean + 10);
}

// Trains on the scene and renders its first view; release with sgs_frame_free.
static sgs_frame train_and_render(const sgs_scene *scene, const sgs_train_options *train)
{
    sgs_trainer *trainer;
    sgs_renderer *renderer;
    sgs_frame frame;
    sgs_step_info info = {0};
    const sgs_view *view = &scene->views[0];
    assert_int_equal(sgs_trainer_create(scene, train, &trainer), SGS_STATUS_OK);
    while (!info.stop)
        assert_int_equal(sgs_trainer_step(trainer, &info), SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_create(sgs_trainer_model(trainer), &renderer), SGS_STATUS_OK);
    assert_int_equal(sgs_frame_create(view->camera.width, view->camera.height, &frame),
                     SGS_STATUS_OK);
    assert_int_equal(sgs_renderer_render(renderer, &view->camera, &view->pose, NULL, &frame),
                     SGS_STATUS_OK);
    sgs_renderer_destroy(renderer);
    sgs_trainer_destroy(trainer);
    return frame;
}

// Photos of a disc with alpha over black. Without the alpha loss, black and empty look the
// same.
static double mean_opacity_outside(double weight)
{
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 8;
    sgs_scene *scene;
    assert_int_equal(sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene), SGS_STATUS_OK);
    for (size_t v = 0; v < scene->view_count; ++v) {
        sgs_photo *photo = &scene->views[v].image;
        const size_t plane = (size_t)photo->width * (size_t)photo->height;
        uint8_t *pixels = sgsi_calloc(plane, 4);
        assert_non_null(pixels);
        memset(pixels + 3 * plane, 255, plane); // black and opaque, transparent on the left
        for (size_t i = 0; i < plane; ++i)
            if (i % (size_t)photo->width < (size_t)photo->width / 2)
                pixels[3 * plane + i] = 0;
        sgsi_free(photo->pixels);
        photo->pixels = pixels;
        photo->channels = 4;
    }
    sgs_train_options train = sgs_train_options_default();
    train.iterations = 60;
    train.alpha_loss = weight;
    sgs_frame frame = train_and_render(scene, &train);
    double sides[2] = {0};
    for (int y = 0; y < frame.height; ++y)
        for (int x = 0; x < frame.width; ++x)
            sides[x >= frame.width / 2] += 1 - (double)frame.transmittance[y * frame.width + x];
    const double half = 0.5 * frame.width * frame.height;
    sgs_frame_free(&frame);
    sgs_scene_destroy(scene);
    return (sides[1] - sides[0]) / half;
}

static void alpha_loss_pulls_opacity_to_the_alpha_channel(void **state)
{
    (void)state;
    const double without = mean_opacity_outside(0), with = mean_opacity_outside(1);
    print_message("opacity right minus left: %.3f, with the alpha loss %.3f\n", without, with);
    assert_true(with > without + 0.1);
}

// The mean opacity of a view after training on dark photos without an alpha channel, from
// white points: over black, transparent and dark look the same.
static double mean_opacity(bool opaque)
{
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = 8;
    sgs_scene *scene;
    assert_int_equal(sgs_scene_load(SGSI_TEST_DATA "/room", &options, &scene), SGS_STATUS_OK);
    for (size_t v = 0; v < scene->view_count; ++v) { // a tenth of the light
        sgs_photo *photo = &scene->views[v].image;
        for (size_t i = 0; i < 3 * (size_t)photo->width * (size_t)photo->height; ++i)
            photo->pixels[i] /= 10;
    }
    for (size_t i = 0; i < 3 * scene->point_count; ++i)
        scene->colors[i] /= 10;
    sgs_train_options train = sgs_train_options_default();
    train.iterations = 300;
    train.opaque = train.background_random = opaque;
    train.alpha_loss = opaque ? SGS_TRAIN_OPAQUE_WEIGHT : 0;
    sgs_frame frame = train_and_render(scene, &train);
    double sum = 0;
    for (int i = 0; i < frame.width * frame.height; ++i)
        sum += 1 - (double)frame.transmittance[i];
    const double mean = sum / (frame.width * frame.height);
    sgs_frame_free(&frame);
    sgs_scene_destroy(scene);
    return mean;
}

static void opaque_photos_leave_no_holes(void **state)
{
    (void)state;
    const double without = mean_opacity(false), with = mean_opacity(true);
    print_message("mean opacity of dark photos: %.4f, opaque %.4f\n", without, with);
    assert_true(1 - with < 0.25 * (1 - without));
    assert_true(with > 0.995);
}

static void names_of_masks_have_a_stem(void **state)
{
    (void)state;
    static const char *const masks[] = {"a_mask.png", "images/a_mask.png", "dynamic_mask_a.png",
                                        "b/dynamic_mask_a.b.png"};
    static const char *const photos[] = {"a.png",
                                         "_mask.png",
                                         "images/_mask.png",
                                         "dynamic_mask_.png",
                                         "dynamic_mask_a.jpg",
                                         "b/a_mask.jpg",
                                         "dynamic_mask_a/b.png",
                                         "a_dynamic_mask_b.png"};
    for (size_t i = 0; i < sizeof masks / sizeof *masks; ++i)
        assert_true(sgs_mask_is_name(masks[i]));
    for (size_t i = 0; i < sizeof photos / sizeof *photos; ++i)
        assert_false(sgs_mask_is_name(photos[i]));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(masks_are_found_under_all_names, warnings_begin),
        cmocka_unit_test_setup(masks_are_found_in_other_formats_and_cases, warnings_begin),
        cmocka_unit_test_setup(masks_that_match_no_image_are_refused, warnings_begin),
        cmocka_unit_test_setup(options_select_invert_and_disable_masks, warnings_begin),
        cmocka_unit_test_setup(masks_of_small_values_exclude_zeros, warnings_begin),
        cmocka_unit_test_setup(labels_of_any_depth_are_valid, warnings_begin),
        cmocka_unit_test_setup(masks_of_instant_ngp_exclude_all_but_black, warnings_begin),
        cmocka_unit_test_setup(inversion_that_excludes_nothing_is_reported, warnings_begin),
        cmocka_unit_test_setup(camera_files_name_masks, warnings_begin),
        cmocka_unit_test_setup(downscaled_pixels_are_valid_if_entirely_valid, warnings_begin),
        cmocka_unit_test_setup(masks_of_other_sizes_are_rejected, warnings_begin),
        cmocka_unit_test_setup(views_without_valid_pixels_are_skipped, warnings_begin),
        cmocka_unit_test_setup(masks_that_are_not_black_may_be_inverted, warnings_begin),
        cmocka_unit_test_setup(cutouts_mask_by_their_alpha_channel, warnings_begin),
        cmocka_unit_test_setup(colours_of_masks_are_multiplied_by_alpha, warnings_begin),
        cmocka_unit_test_setup(alpha_channels_mask_on_request, warnings_begin),
        cmocka_unit_test_setup(pixels_without_a_ray_are_invalid, warnings_begin),
        cmocka_unit_test(names_of_masks_have_a_stem),
        cmocka_unit_test(a_masked_square_leaves_no_colour_in_the_model),
        cmocka_unit_test(alpha_loss_pulls_opacity_to_the_alpha_channel),
        cmocka_unit_test(opaque_photos_leave_no_holes),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
