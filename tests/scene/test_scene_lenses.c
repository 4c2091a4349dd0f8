// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Lenses without a ray for some or all pixels: reported as such, and not as masks. Image circles
// and panoramas of transforms.json.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "support/bad_input.h"
#include "support/scene_support.h"

enum { WIDTH = 64, HEIGHT = 48 };
static const double focal = 50, center_x = 32, center_y = 24;

static const uint8_t red[4] = {250, 20, 10, 255};

// A frame per text of lens parameters, with photos images/0.png, images/1.png, ...
static temp_folder scene_make(const char *const lenses[], int count)
{
    const temp_folder folder = temp_folder_make();
    buffer b = {.size = 0};
    put_text(&b, "{\"frames\": [");
    for (int i = 0; i < count; ++i) {
        char name[64];
        snprintf(name, sizeof name, "images/%d.png", i);
        tree_put_picture(&folder, name, WIDTH, HEIGHT, 3, red);
        put_text(&b,
                 "%s{\"file_path\": \"%s\", \"w\": %d, \"h\": %d, \"fl_x\": %g, \"cx\": %g, "
                 "\"cy\": %g, %s, \"transform_matrix\": "
                 "[[1,0,0,%d],[0,1,0,0],[0,0,1,4],[0,0,0,1]]}",
                 i ? ", " : "", name, WIDTH, HEIGHT, focal, center_x, center_y, lenses[i], i);
    }
    put_text(&b, "]}");
    tree_put(&folder, "transforms.json", b.data, b.size);
    return folder;
}

static sgs_status load(const temp_folder *folder, bool images, sgs_scene **scene)
{
    sgs_scene_options options = sgs_scene_options_default();
    options.load_images = images;
    warnings[0] = 0;
    return sgs_scene_load(folder->path, &options, scene);
}

static size_t count_of(const char *text, const char *part)
{
    size_t count = 0;
    for (const char *at = text; (at = strstr(at, part)); at += strlen(part))
        ++count;
    return count;
}

static void lenses_without_any_ray_are_errors(void **state)
{
    (void)state;
    static const char *const lenses[] = {"\"p1\": 1e10", "\"k1\": -1e9"};
    for (int i = 0; i < 2; ++i)
        for (int images = 0; images < 2; ++images) {
            temp_folder folder = scene_make(lenses + i, 1);
            sgs_scene *scene = (sgs_scene *)1;
            assert_int_equal(load(&folder, images, &scene), SGS_STATUS_FORMAT);
            assert_null(scene);
            assert_holds(sgs_last_error(), "/transforms.json: the lens has no ray for any pixel of "
                                           "1 image(s); check k1, k2, p1, p2, cx, cy");
            assert_null(strstr(warnings, "mask"));
            tree_remove(&folder);
            bad_input();
        }
}

static void images_of_a_lens_without_rays_are_skipped(void **state)
{
    (void)state;
    static const char *const lenses[] = {"\"k1\": 0", "\"p1\": 1e10", "\"p1\": 1e10", "\"k1\": 0"};
    temp_folder folder = scene_make(lenses, 4);
    for (int images = 0; images < 2; ++images) {
        sgs_scene *scene;
        assert_int_equal(load(&folder, images, &scene), SGS_STATUS_OK);
        assert_int_equal(scene->view_count, 2);
        assert_string_equal(scene->views[1].name, "images/3.png");
        assert_holds(warnings, "/transforms.json: the lens of the camera of 'images/1.png' has no "
                               "ray for any pixel, and its images are skipped; check k1, k2, p1, "
                               "p2, cx, cy\n");
        assert_int_equal(count_of(warnings, "no ray"), 1);
        assert_int_equal(count_of(warnings, "mask"), 0);
        sgs_scene_destroy(scene);
    }
    tree_remove(&folder);
}

// r (1 + k1 r^2) has its maximum at r^2 = -1 / (3 k1): no ray reaches a pixel beyond 2/3 of that r.
static double lost_percent(double k1)
{
    const double most = focal * 2 / 3 * sqrt(-1 / (3 * k1));
    int lost = 0;
    for (int y = 0; y < HEIGHT; ++y)
        for (int x = 0; x < WIDTH; ++x)
            lost += hypot(x + 0.5 - center_x, y + 0.5 - center_y) > most;
    return 100.0 * lost / (WIDTH * HEIGHT);
}

static void perspective_lenses_with_few_rays_are_reported_once(void **state)
{
    (void)state;
    static const char *const lenses[] = {"\"k1\": -0.5", "\"k1\": -0.5", "\"k1\": -5"};
    temp_folder folder = scene_make(lenses, 3);
    for (int images = 0; images < 2; ++images) {
        sgs_scene *scene;
        char wide[200], narrow[200];
        assert_int_equal(load(&folder, images, &scene), SGS_STATUS_OK);
        assert_int_equal(scene->view_count, 3);
        snprintf(wide, sizeof wide,
                 "the lens of the camera of 'images/0.png' has no ray for %.1f %% of the pixels, "
                 "which are not used; check k1",
                 lost_percent(-0.5));
        snprintf(narrow, sizeof narrow, "'images/2.png' has no ray for %.1f %% of the pixels",
                 lost_percent(-5));
        assert_true(lost_percent(-0.5) > 5 && lost_percent(-5) > 80);
        assert_holds(warnings, wide);
        assert_holds(warnings, narrow);
        assert_int_equal(count_of(warnings, "no ray"), 2);
        sgs_scene_destroy(scene);
    }
    tree_remove(&folder);
}

static void corners_of_few_pixels_and_fisheye_circles_are_usual(void **state)
{
    (void)state;
    // 3 % of the pixels; and an equidistant circle: theta (1 - theta^2 / 3) is at most 2/3.
    static const char *const lenses[] = {
        "\"k1\": -0.28", "\"camera_model\": \"OPENCV_FISHEYE\", \"fl_y\": 30, \"k1\": -0.3333"};
    assert_true(lost_percent(-0.28) > 0 && lost_percent(-0.28) < 5);
    temp_folder folder = scene_make(lenses, 2);
    sgs_scene *scene;
    assert_int_equal(load(&folder, true, &scene), SGS_STATUS_OK);
    assert_int_equal(scene->view_count, 2);
    for (size_t i = 0; i < 2; ++i)
        assert_true(scene->views[i].image.kept < WIDTH * HEIGHT);
    assert_true(scene->views[1].image.kept < 0.9 * WIDTH * HEIGHT);
    assert_int_equal(count_of(warnings, "no ray"), 0);
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

// Valid pixels have all corners within the radius of the image centre.
static void assert_circle(const sgs_photo *photo, double radius)
{
    size_t kept = 0;
    for (int y = 0; y < photo->height; ++y)
        for (int x = 0; x < photo->width; ++x) {
            bool inside = true;
            for (int k = 0; k < 4; ++k)
                inside = inside && hypot(x + k % 2 - 0.5 * photo->width,
                                         y + k / 2 - 0.5 * photo->height) <= radius;
            if (sgs_mask_is_valid(photo->valid_mask, photo->width, x, y) != inside)
                fail_msg("radius %g: pixel %d %d", radius, x, y);
            kept += inside;
        }
    assert_int_equal(photo->kept, kept);
}

// The radius is in pixels of w and h; nerfstudio uses it with fisheye lenses only.
static void pixels_outside_the_circle_of_a_fisheye_lens_are_masked(void **state)
{
    (void)state;
    static const char *const lenses[] = {
        "\"camera_model\": \"OPENCV_FISHEYE\", \"fisheye_crop_radius\": 20.5",
        "\"camera_model\": \"OPENCV_FISHEYE\", \"fisheye_crop_radius\": 30",
        "\"camera_model\": \"OPENCV_FISHEYE\", \"fisheye_crop_radius\": 40", // the corners
        "\"camera_model\": \"OPENCV\", \"k1\": 0.001, \"fisheye_crop_radius\": 20.5",
        "\"camera_model\": \"OPENCV_FISHEYE\", \"fisheye_crop_radius\": null"};
    temp_folder folder = scene_make(lenses, 5);
    tree_put_picture(&folder, "images/1.png", WIDTH / 2, HEIGHT / 2, 3, red); // of half the size
    for (int downscale = 1; downscale <= 2; ++downscale)
        for (int limited = 0; limited < 2; ++limited) {
            sgs_scene_options options = sgs_scene_options_default();
            options.downscale = downscale;
            options.image_cache = (size_t)limited; // the photos are decoded when they are used
            sgs_scene *scene;
            assert_int_equal(sgs_scene_load(folder.path, &options, &scene), SGS_STATUS_OK);
            assert_int_equal(scene->view_count, 5);
            const double radii[] = {20.5 / downscale, 15.0 / downscale};
            for (size_t i = 0; i < 5; ++i) {
                const sgs_photo *photo;
                assert_int_equal(sgs_scene_photo(scene, i, &photo), SGS_STATUS_OK);
                if (i < 2)
                    assert_circle(photo, radii[i]);
                else
                    assert_null(photo->valid_mask);
            }
            assert_int_equal(scene->masks, 0);
            assert_string_equal(warnings, "");
            sgs_scene_destroy(scene);
        }
    tree_remove(&folder);
}

static void masks_of_lenses_with_rays_are_still_reported_as_masks(void **state)
{
    (void)state;
    static const char *const lenses[] = {"\"k1\": -0.28"};
    static const uint8_t black[4] = {0, 0, 0, 255};
    temp_folder folder = scene_make(lenses, 1);
    tree_put_picture(&folder, "masks/0.png", WIDTH, HEIGHT, 1, black);
    sgs_scene *scene;
    assert_int_equal(load(&folder, true, &scene), SGS_STATUS_INVALID_ARGUMENT);
    assert_holds(sgs_last_error(), "masks exclude every pixel of every image, ");
    assert_holds(warnings, "masks/0.png: mask excludes every pixel");
    tree_remove(&folder);
}

// Ray of nerfstudio (cameras.py, EQUIRECTANGULAR) in its camera axes x right, y up, z backward.
static void nerfstudio_ray(const double pixel[2], double ray[3])
{
    const double pi = 3.14159265358979324, a = (pixel[0] - WIDTH / 2.0) / (WIDTH / 2.0),
                 b = -(pixel[1] - HEIGHT / 2.0) / HEIGHT;
    const double theta = -pi * a, phi = pi * (0.5 - b);
    ray[0] = -sin(theta) * sin(phi);
    ray[1] = cos(phi);
    ray[2] = -cos(theta) * sin(phi);
}

// Ray of instant-ngp (latlong_to_dir) in axes x right, y down, z forward, as ray of nerfstudio.
static void latlong_ray(const double pixel[2], double ray[3])
{
    const double pi = 3.14159265358979324, theta = (pixel[1] / HEIGHT - 0.5) * pi,
                 phi = (pixel[0] / WIDTH - 0.5) * 2 * pi;
    ray[0] = sin(phi) * cos(theta);
    ray[1] = -sin(theta);
    ray[2] = -cos(phi) * cos(theta);
}

// Camera-to-world: x along world y, backward along world x, upward along world z.
static const double axes[3][3] = {{0, 0, 1}, {1, 0, 0}, {0, 1, 0}};

static void assert_panorama(const sgs_view *view, void (*reference)(const double *, double *))
{
    static const double pixels[][2] = {{WIDTH / 2.0, HEIGHT / 2.0},
                                       {48, 24},
                                       {32, 6},
                                       {0.5, 0.5},
                                       {63.5, 40},
                                       {10, 30},
                                       {20, 47.5}};
    for (size_t k = 0; k < sizeof pixels / sizeof *pixels; ++k) {
        double ray[3], own[3];
        reference(pixels[k], ray);
        assert_true(sgs_camera_unproject(&view->camera, pixels[k], own));
        for (int i = 0; i < 3; ++i) {
            double expected = 0, got = 0;
            for (int j = 0; j < 3; ++j) {
                expected += axes[i][j] * ray[j];
                got += view->pose.rotation[3 * j + i] * own[j];
            }
            if (!(fabs(expected - got) < 1e-12))
                fail_msg("pixel %zu, axis %d: %g instead of %g", k, i, got, expected);
        }
    }
}

static void panoramas_have_the_rays_of_other_programs(void **state)
{
    static const struct {
        const char *keys, *frame_keys;
        void (*reference)(const double *, double *);
        bool warns;
    } kinds[] = {
        {"\"camera_model\": \"EQUIRECTANGULAR\"", "", nerfstudio_ray, false},
        {"\"camera_model\": \"EQUIRECTANGULAR\", \"w\": 64, \"h\": 48, \"fl_x\": 32, \"fl_y\": 48, "
         "\"cx\": 32, \"cy\": 24",
         "", nerfstudio_ray, false},
        {"\"camera_model\": \"EQUIRECTANGULAR\", \"w\": 128, \"h\": 96", "", nerfstudio_ray, false},
        {"\"camera_model\": \"EQUIRECTANGULAR\", \"w\": 64, \"h\": 48, \"fl_x\": 900", "",
         nerfstudio_ray, true},
        {"\"camera_model\": \"EQUIRECTANGULAR\", \"w\": 64, \"h\": 48, \"k1\": 0.1", "",
         nerfstudio_ray, true},
        {"\"camera_model\": \"EQUIRECTANGULAR\", \"fl_x\": 900", "", nerfstudio_ray, true},
        {"\"camera_model\": \"EQUIRECTANGULAR\", \"cy\": 24", "", nerfstudio_ray, true},
        {"\"latlong\": true, \"camera_angle_x\": 0.7", "", latlong_ray, false},
        {"\"latlong\": true", "\"latlong\": null, ", latlong_ray, false}, // null: absent
        {"\"latlong\": false", "\"latlong\": true, ", latlong_ray, false},
    };
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; ++k) {
        const temp_folder folder = temp_folder_make();
        char text[1024];
        snprintf(text, sizeof text,
                 "{%s, \"frames\": [{%s\"file_path\": \"images/a.png\", \"transform_matrix\": "
                 "[[0,0,1,5],[1,0,0,6],[0,1,0,7],[0,0,0,1]]}]}",
                 kinds[k].keys, kinds[k].frame_keys);
        tree_put_text(&folder, "transforms.json", text);
        tree_put_picture(&folder, "images/a.png", WIDTH, HEIGHT, 3, red);
        sgs_scene *scene;
        warnings_begin(state);
        if (load(&folder, true, &scene))
            fail_msg("case %zu: %s", k, sgs_last_error());
        const sgs_view *view = &scene->views[0];
        assert_int_equal(view->camera.model, SGS_CAMERA_EQUIRECTANGULAR);
        assert_true(view->camera.width == WIDTH && view->camera.height == HEIGHT);
        assert_int_equal(view->image.kept, WIDTH * HEIGHT);
        assert_panorama(view, kinds[k].reference);
        assert_int_equal(count_of(warnings, "shows all directions; focal length, principal point "
                                            "and distortion are ignored"),
                         kinds[k].warns);
        sgs_scene_destroy(scene);
        tree_remove(&folder);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(lenses_without_any_ray_are_errors, warnings_begin),
        cmocka_unit_test_setup(images_of_a_lens_without_rays_are_skipped, warnings_begin),
        cmocka_unit_test_setup(perspective_lenses_with_few_rays_are_reported_once, warnings_begin),
        cmocka_unit_test_setup(corners_of_few_pixels_and_fisheye_circles_are_usual, warnings_begin),
        cmocka_unit_test_setup(pixels_outside_the_circle_of_a_fisheye_lens_are_masked,
                               warnings_begin),
        cmocka_unit_test_setup(masks_of_lenses_with_rays_are_still_reported_as_masks,
                               warnings_begin),
        cmocka_unit_test_setup(panoramas_have_the_rays_of_other_programs, warnings_begin),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
