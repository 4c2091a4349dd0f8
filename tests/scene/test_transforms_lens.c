// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Intrinsics that programs write into transforms.json in other ways than as one number per key.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "support/bad_input.h"
#include "support/locale_support.h"
#include "support/transforms_support.h"

// Reads a file with these global keys and keys of its only frame.
static sgs_status read_keys(const char *global, const char *own, sgsi_dataset *d)
{
    const temp_folder folder = temp_folder_make();
    char text[1024];
    snprintf(text, sizeof text,
             "{%s%s\"frames\":[{%s%s\"file_path\":\"a.png\",\"transform_matrix\":"
             "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}",
             global, *global ? "," : "", own, *own ? "," : "");
    tree_put_text(&folder, "transforms.json", text);
    const sgs_status status = sgsi_transforms_read(temp_path(&folder, "transforms.json"), d);
    tree_remove(&folder);
    return status;
}

// Global keys, keys of the frame, and the resulting camera.
typedef struct lens_case {
    const char *global, *own;
    sgs_camera camera;
} lens_case;

static void assert_cameras(const lens_case *cases, size_t count)
{
    for (size_t i = 0; i < count; ++i) {
        sgsi_dataset d;
        if (read_keys(cases[i].global, cases[i].own, &d))
            fail_msg("case %zu: %s", i, sgs_last_error());
        const sgs_camera *got = &d.frames[0].camera, *expected = &cases[i].camera;
        if (got->model != expected->model || got->width != expected->width ||
            got->height != expected->height)
            fail_msg("case %zu: %s %d x %d", i, sgs_camera_model_name(got->model), got->width,
                     got->height);
        for (int k = 0; k < 12; ++k)
            if (!(fabs(got->params[k] - expected->params[k]) < 1e-12))
                fail_msg("case %zu: parameter %d is %g instead of %g", i, k, got->params[k],
                         expected->params[k]);
        sgsi_dataset_free(&d);
    }
}

typedef struct wrong_case {
    const char *global, *own;
    sgs_status status;
    const char *message;
} wrong_case;

static void assert_refused(const wrong_case *cases, size_t count)
{
    for (size_t i = 0; i < count; ++i) {
        sgsi_dataset d;
        if (read_keys(cases[i].global, cases[i].own, &d) != cases[i].status)
            fail_msg("case %zu (%s): %s", i, cases[i].message, sgs_last_error());
        assert_holds(sgs_last_error(), cases[i].message);
        bad_input();
    }
}

#define COUNT(array) (sizeof(array) / sizeof *(array))

static void numbers_may_be_strings(void **state)
{
    (void)state;
    static const lens_case cases[] = {
        {"\"fl_x\":\"50\",\"fl_y\":\"5.1e+1\",\"w\":\"64\",\"h\":48",
         "\"k1\":\"-0.0721\",\"p2\":\"+.25\",\"k2\":\"0\"",
         {SGS_CAMERA_OPENCV, 64, 48, {50, 51, 32, 24, -0.0721, 0, 0, 0.25}}},
        // A field of view of the frame replaces the global focal length.
        {"\"fl_x\":50,\"w\":64,\"h\":48",
         "\"camera_angle_x\":\"1.5707963267948966\"",
         {SGS_CAMERA_PINHOLE, 64, 48, {32, 32, 32, 24}}},
    };
    assert_cameras(cases, COUNT(cases));
    if (decimal_comma_set()) {
        assert_cameras(cases, COUNT(cases));
        decimal_comma_unset();
    }
}

static void other_strings_are_no_numbers(void **state)
{
    (void)state;
    static const char *const words[] = {"",    "five", "50mm", " 50", "50 ",   "5,0", "0x32",
                                        "inf", "nan",  "1.2.", "--5", "1e999", "e",   "1e"};
    for (size_t i = 0; i < COUNT(words); ++i) {
        char keys[64];
        snprintf(keys, sizeof keys, "\"fl_x\":50,\"k1\":\"%s\"", words[i]);
        assert_refused(&(wrong_case){keys, "", SGS_STATUS_FORMAT,
                                     "transforms.json: the global keys: 'k1' must be a number"},
                       1);
    }
    assert_refused(&(wrong_case){"\"fl_x\":50", "\"k1\":true", SGS_STATUS_FORMAT,
                                 "transforms.json: frame 0: 'k1' must be a number"},
                   1);
}

#define SIZED "\"fl_x\":50,\"w\":64,\"h\":48"
#define LIST "\"distortion_params\":"

// nerfstudio: [k1, k2, k3, k4, p1, p2], preferred to k1, ..., p2 (nerfstudio_dataparser.py).
static void distortion_may_be_a_list(void **state)
{
    (void)state;
    static const lens_case cases[] = {
        {SIZED "," LIST "[0.1,0.2,0,0,0.3,0.4]",
         "",
         {SGS_CAMERA_OPENCV, 64, 48, {50, 50, 32, 24, 0.1, 0.2, 0.3, 0.4}}},
        {SIZED "," LIST "[0.1,0.2,0.5,0,0.3,0.4]",
         "",
         {SGS_CAMERA_FULL_OPENCV, 64, 48, {50, 50, 32, 24, 0.1, 0.2, 0.3, 0.4, 0.5}}},
        {SIZED ",\"k1\":9,\"k2\":9,\"p1\":9," LIST "[0.1,0,0,0,0,0]",
         "",
         {SGS_CAMERA_OPENCV, 64, 48, {50, 50, 32, 24, 0.1}}},
        {SIZED ",\"camera_model\":\"OPENCV_FISHEYE\",\"k1\":9",
         LIST "[0.1,0.2,0.3,0.4,0,0],\"k2\":9",
         {SGS_CAMERA_OPENCV_FISHEYE, 64, 48, {50, 50, 32, 24, 0.1, 0.2, 0.3, 0.4}}},
        {SIZED "," LIST "[0.1,0.2,0,0,0,0]",
         LIST "[0.5,0,0,0,0,\"0.6\"]",
         {SGS_CAMERA_OPENCV, 64, 48, {50, 50, 32, 24, 0.5, 0, 0, 0.6}}},
        {SIZED "," LIST "[0.1,0.2,0,0,0,0]",
         "\"k1\":0.7",
         {SGS_CAMERA_OPENCV, 64, 48, {50, 50, 32, 24, 0.7, 0.2}}},
        {SIZED "," LIST "null", "", {SGS_CAMERA_PINHOLE, 64, 48, {50, 50, 32, 24}}},
    };
    assert_cameras(cases, COUNT(cases));
}

static void lists_of_other_lengths_are_refused(void **state)
{
    (void)state;
    static const char *const lists[] = {"[]",
                                        "0.1",
                                        "[0.1,0.2,0.3,0.4]",
                                        "[0.1,0.2,0,0,0,0,0]",
                                        "{\"k1\":0.1}",
                                        "[0.1,0.2,null,0,0,0]",
                                        "[0.1,0.2,0,0,0,\"x\"]",
                                        "[[0.1,0.2,0,0,0,0]]"};
    for (size_t i = 0; i < COUNT(lists); ++i) {
        char keys[128];
        snprintf(keys, sizeof keys, SIZED "," LIST "%s", lists[i]);
        assert_refused(&(wrong_case){keys, "", SGS_STATUS_FORMAT,
                                     "transforms.json: the global keys: 'distortion_params' must "
                                     "be a list of 6 numbers, k1, k2, k3, k4, p1 and p2"},
                       1);
    }
    static const wrong_case refused[] = {
        {SIZED, LIST "[1]", SGS_STATUS_FORMAT, "frame 0: 'distortion_params' must be a list"},
        {SIZED "," LIST "[0.1,0.2,0,0.4,0,0]", "", SGS_STATUS_UNSUPPORTED,
         "frame 0: camera model 'OPENCV' has no k4; undistort the images"},
        // Project Aria: 12 coefficients.
        {SIZED ",\"camera_model\":\"FISHEYE624\"", LIST "[1,2,3,4,5,6,7,8,9,10,11,12]",
         SGS_STATUS_UNSUPPORTED, "frame 0: camera model 'FISHEYE624' is not supported"},
        {SIZED ",\"camera_model\":\"FISHEYE624\"," LIST "[1,2,3,4,5,6,7,8,9,10,11,12]", "",
         SGS_STATUS_UNSUPPORTED, "frame 0: camera model 'FISHEYE624' is not supported"},
    };
    assert_refused(refused, COUNT(refused));
}

// Degrees. 90 of 64 pixels are a focal length of 32, 2 atan(1/2) of 48 pixels one of 48.
#define FOV_X "\"x_fov\":90"
#define FOV_Y "\"y_fov\":53.13010235415598"
#define SIZE "\"w\":64,\"h\":48"

static void fields_of_view_may_be_in_degrees(void **state)
{
    (void)state;
    static const lens_case cases[] = {
        {SIZE "," FOV_X, "", {SGS_CAMERA_PINHOLE, 64, 48, {32, 32, 32, 24}}},
        {SIZE "," FOV_Y, "", {SGS_CAMERA_PINHOLE, 64, 48, {48, 48, 32, 24}}},
        {SIZE "," FOV_X "," FOV_Y, "", {SGS_CAMERA_PINHOLE, 64, 48, {32, 48, 32, 24}}},
        // instant-ngp: x_fov, else fl_x, else camera_angle_x, for each axis (nerf_loader.cu).
        {SIZE "," FOV_X ",\"camera_angle_x\":1",
         "",
         {SGS_CAMERA_PINHOLE, 64, 48, {32, 32, 32, 24}}},
        {SIZE "," FOV_X ",\"fl_y\":50", "", {SGS_CAMERA_PINHOLE, 64, 48, {32, 50, 32, 24}}},
        {SIZE "," FOV_Y ",\"fl_x\":50", "", {SGS_CAMERA_PINHOLE, 64, 48, {50, 48, 32, 24}}},
        // Equal but for rounding: the focal length.
        {SIZE "," FOV_X ",\"fl_x\":32.1", "", {SGS_CAMERA_PINHOLE, 64, 48, {32.1, 32.1, 32, 24}}},
        // Those of a frame replace the global ones.
        {SIZE ",\"fl_x\":70,\"fl_y\":71", FOV_X, {SGS_CAMERA_PINHOLE, 64, 48, {32, 32, 32, 24}}},
        {SIZE "," FOV_X "," FOV_Y, "\"fl_x\":70", {SGS_CAMERA_PINHOLE, 64, 48, {70, 70, 32, 24}}},
        {SIZE ",\"x_fov\":20,\"y_fov\":20",
         "\"camera_angle_x\":1.5707963267948966",
         {SGS_CAMERA_PINHOLE, 64, 48, {32, 32, 32, 24}}},
    };
    assert_cameras(cases, COUNT(cases));
    sgsi_dataset d;
    assert_int_equal(read_keys(FOV_X ",\"camera_angle_y\":0.5", "", &d), SGS_STATUS_OK);
    assert_int_equal(d.frames[0].camera.width, 0); // the photo's size completes it
    assert_true(fabs(d.frames[0].angle_x - 1.5707963267948966) < 1e-15);
    assert_true(d.frames[0].angle_y == 0.5);
    sgsi_dataset_free(&d);
}

static void contradicting_fields_of_view_are_refused(void **state)
{
    (void)state;
    static const wrong_case cases[] = {
        {SIZE "," FOV_X ",\"fl_x\":50", "", SGS_STATUS_FORMAT,
         "transforms.json: frame 0: 'x_fov' is 90 degrees, a focal length of 32 pixels, but "
         "'fl_x' is 50; remove one of them"},
        {SIZE, "\"fl_y\":40," FOV_Y, SGS_STATUS_FORMAT,
         "frame 0: 'y_fov' is 53.1301 degrees, a focal length of 48 pixels, but 'fl_y' is 40"},
        {SIZE ",\"x_fov\":180", "", SGS_STATUS_FORMAT,
         "frame 0: 'x_fov' is 180, not an angle between 0 and 180 degrees"},
        {SIZE, "\"y_fov\":0", SGS_STATUS_FORMAT, "frame 0: 'y_fov' is 0, not an angle"},
        {FOV_X ",\"fl_x\":32", "", SGS_STATUS_FORMAT,
         "frame 0: 'x_fov' beside a focal length in pixels requires 'w' and 'h'; add them"},
        {FOV_Y ",\"fl_x\":32", "", SGS_STATUS_FORMAT, "frame 0: 'y_fov' beside a focal length"},
        {SIZE ",\"is_fisheye\":true," FOV_X, "", SGS_STATUS_FORMAT,
         "frame 0: no focal length of the fisheye lens, which a field of view does not define"},
        {SIZE ",\"x_fov\":\"wide\"", "", SGS_STATUS_FORMAT,
         "the global keys: 'x_fov' must be a number"},
    };
    assert_refused(cases, COUNT(cases));
}

static void lenses_and_axes_of_instant_ngp_are_refused(void **state)
{
    (void)state;
    static const wrong_case cases[] = {
        {SIZED ",\"orthographic\":true", "", SGS_STATUS_UNSUPPORTED,
         "transforms.json: the global keys: the lens of 'orthographic' is not supported; convert"},
        {SIZED, "\"orthographic\":1", SGS_STATUS_UNSUPPORTED,
         "frame 0: the lens of 'orthographic'"},
        {SIZED ",\"from_mitsuba\":true", "", SGS_STATUS_UNSUPPORTED,
         "transforms.json: the global keys: the camera axes of Mitsuba ('from_mitsuba') are not "
         "supported; convert 'transform_matrix' to x right, y up, z backward and remove the key"},
        {SIZED ",\"normal_mts_args\":[]", "", SGS_STATUS_UNSUPPORTED,
         "the camera axes of Mitsuba ('normal_mts_args') are not supported"},
    };
    assert_refused(cases, COUNT(cases));
    static const lens_case accepted[] = {
        {SIZED ",\"orthographic\":false,\"from_mitsuba\":null",
         "",
         {SGS_CAMERA_PINHOLE, 64, 48, {50, 50, 32, 24}}},
        // As in instant-ngp, false overrides the arguments of the Mitsuba renderer.
        {SIZED ",\"normal_mts_args\":[\"-o\"],\"from_mitsuba\":false",
         "",
         {SGS_CAMERA_PINHOLE, 64, 48, {50, 50, 32, 24}}},
    };
    assert_cameras(accepted, COUNT(accepted));
}

// Its effect on pixels is tested in test_scene_lenses.c.
static void image_circles_have_a_radius_in_pixels(void **state)
{
    (void)state;
    static const wrong_case cases[] = {
        // nerfstudio's script for EyefulTower
        {SIZED ",\"camera_model\":\"OPENCV_FISHEYE\",\"fisheye_crop_radius\":0.43", "",
         SGS_STATUS_FORMAT,
         "transforms.json: frame 0: 'fisheye_crop_radius' is 0.43, not a radius of at least 1 "
         "pixel; convert it to pixels, or remove it"},
        {SIZED ",\"is_fisheye\":true", "\"fisheye_crop_radius\":-20", SGS_STATUS_FORMAT,
         "frame 0: 'fisheye_crop_radius' is -20, not a radius"},
        {SIZED ",\"fisheye_crop_radius\":[20]", "", SGS_STATUS_FORMAT,
         "the global keys: 'fisheye_crop_radius' must be a number"},
    };
    assert_refused(cases, COUNT(cases));
    static const struct {
        const char *keys;
        double circle;
    } accepted[] = {{SIZED ",\"fisheye_crop_radius\":0.43", 0},
                    {SIZED ",\"camera_model\":\"EQUIRECTANGULAR\",\"fisheye_crop_radius\":20", 0},
                    {SIZED ",\"is_fisheye\":true,\"fisheye_crop_radius\":707.5", 707.5},
                    {SIZED ",\"is_fisheye\":true", 0}};
    for (size_t i = 0; i < COUNT(accepted); ++i) {
        sgsi_dataset d;
        assert_int_equal(read_keys(accepted[i].keys, "", &d), SGS_STATUS_OK);
        assert_true(d.frames[0].circle == accepted[i].circle);
        sgsi_dataset_free(&d);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(numbers_may_be_strings, warnings_begin),
        cmocka_unit_test_setup(other_strings_are_no_numbers, warnings_begin),
        cmocka_unit_test_setup(distortion_may_be_a_list, warnings_begin),
        cmocka_unit_test_setup(lists_of_other_lengths_are_refused, warnings_begin),
        cmocka_unit_test_setup(fields_of_view_may_be_in_degrees, warnings_begin),
        cmocka_unit_test_setup(contradicting_fields_of_view_are_refused, warnings_begin),
        cmocka_unit_test_setup(lenses_and_axes_of_instant_ngp_are_refused, warnings_begin),
        cmocka_unit_test_setup(image_circles_have_a_radius_in_pixels, warnings_begin),
    };
    return cmocka_run_group_tests_name("transforms_lens", tests, NULL, NULL);
}
