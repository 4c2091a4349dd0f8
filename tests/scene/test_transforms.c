// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// transforms.json and its variants: axes, intrinsics from all keys, splits, the point cloud, and
// errors with frame and key.

#include <ctype.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "support/bad_input.h"
#include "support/transforms_support.h"

#define IDENTITY "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"

static void opengl_axes_become_colmap_axes(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgsi_dataset d;
    // At (1, 2, 3), rotated by 90 degrees about the world's z: camera x points along world y.
    read_text(
        &folder,
        "{\"fl_x\":50,\"w\":64,\"h\":48,\"frames\":[{\"file_path\":\"a.png\",\"transform_matrix\":"
        "[[0,-1,0,1],[1,0,0,2],[0,0,1,3],[0,0,0,1]]}]}",
        &d);
    double center[3];
    sgs_pose_center(&d.frames[0].pose, center);
    assert_true(center[0] == 1 && center[1] == 2 && center[2] == 3);
    // One unit ahead is -z of OpenGL's camera; up in the image is smaller v.
    const double ahead[3] = {1, 2, 2}, ahead_up[3] = {1 - 0.1, 2, 2},
                 ahead_right[3] = {1, 2 + 0.1, 2};
    const double *const worlds[3] = {ahead, ahead_up, ahead_right};
    const double expected[3][2] = {{32, 24}, {32, 19}, {37, 24}};
    for (int k = 0; k < 3; ++k) {
        const double *r = d.frames[0].pose.rotation, *t = d.frames[0].pose.translation;
        double p[3], pixel[2];
        for (int i = 0; i < 3; ++i)
            p[i] = r[3 * i] * worlds[k][0] + r[3 * i + 1] * worlds[k][1] +
                   r[3 * i + 2] * worlds[k][2] + t[i];
        assert_true(sgs_camera_project(&d.frames[0].camera, p, pixel));
        assert_true(fabs(pixel[0] - expected[k][0]) < 1e-12 &&
                    fabs(pixel[1] - expected[k][1]) < 1e-12);
    }
    sgsi_dataset_free(&d);
    tree_remove(&folder);
}

static void scaled_and_rounded_matrices_become_rotations(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgsi_dataset d;
    read_text(&folder,
              "{\"fl_x\":50,\"w\":64,\"h\":48,\"frames\":["
              "{\"file_path\":\"a\",\"transform_matrix\":[[0.2,0,0,5],[0,0.2,0,6],[0,0,0.2,7]]},"
              "{\"file_path\":\"b\",\"transform_matrix\":"
              "[[0.8,-0.601,0,0],[0.6,0.799,0.001,0],[0.001,0,1.001,0],[0,0,0,1]]}]}",
              &d);
    assert_true(d.frames[0].pose.rotation[0] == 1 && d.frames[0].pose.rotation[4] == -1);
    assert_true(d.frames[0].pose.translation[0] == -5 && d.frames[0].pose.translation[2] == 7);
    const double *m = d.frames[1].pose.rotation;
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            const double dot =
                m[3 * i] * m[3 * j] + m[3 * i + 1] * m[3 * j + 1] + m[3 * i + 2] * m[3 * j + 2];
            assert_true(fabs(dot - (i == j)) < 1e-14);
        }
    }
    assert_true(fabs(m[0] - 0.8) < 2e-3);
    sgsi_dataset_free(&d);
    tree_remove(&folder);
}

// Keys of a frame (overriding the global ones) and the resulting camera.
static const struct {
    const char *global, *own;
    sgs_camera camera; // expected parameters; NaN means NaN
    double angle_x;
} lenses[] = {
    {"\"fl_x\":50,\"w\":64,\"h\":48", "", {SGS_CAMERA_PINHOLE, 64, 48, {50, 50, 32, 24}}, 0},
    {"\"fl_x\":50,\"fl_y\":51,\"cx\":30,\"cy\":25,\"w\":64.0,\"h\":48",
     "",
     {SGS_CAMERA_PINHOLE, 64, 48, {50, 51, 30, 25}},
     0},
    {"\"fl_x\":50,\"w\":64,\"h\":48",
     "\"fl_x\":70,\"cx\":31",
     {SGS_CAMERA_PINHOLE, 64, 48, {70, 70, 31, 24}},
     0},
    {"\"fl_x\":50,\"fl_y\":51,\"camera_angle_y\":0.5,\"w\":64,\"h\":48",
     "\"camera_angle_x\":1.5707963267948966",
     {SGS_CAMERA_PINHOLE, 64, 48, {32, 32, 32, 24}},
     0},
    {"\"fl_x\":50", "\"w\":20,\"h\":10", {SGS_CAMERA_PINHOLE, 20, 10, {50, 50, 10, 5}}, 0},
    {"\"fl_y\":50,\"w\":64,\"h\":48", "", {SGS_CAMERA_PINHOLE, 64, 48, {50, 50, 32, 24}}, 0},
    {"\"camera_angle_x\":1.5707963267948966,\"w\":64,\"h\":48",
     "",
     {SGS_CAMERA_PINHOLE, 64, 48, {32, 32, 32, 24}},
     0},
    {"\"camera_angle_x\":1.5707963267948966,\"camera_angle_y\":0.9272952180016122,\"w\":64,\"h\":"
     "48",
     "",
     {SGS_CAMERA_PINHOLE, 64, 48, {32, 48, 32, 24}},
     0},
    {"\"camera_angle_x\":0.5", "", {SGS_CAMERA_PINHOLE, 0, 0, {NAN, NAN, NAN, NAN}}, 0.5},
    {"\"fl_x\":50", "", {SGS_CAMERA_PINHOLE, 0, 0, {50, 50, NAN, NAN}}, 0},
    {"\"fl_x\":50,\"w\":64,\"h\":48,\"camera_model\":\"OPENCV\",\"k1\":0.1,\"k2\":0.2,\"p1\":0.3,"
     "\"p2\":0.4",
     "",
     {SGS_CAMERA_OPENCV, 64, 48, {50, 50, 32, 24, 0.1, 0.2, 0.3, 0.4}},
     0},
    {"\"fl_x\":50,\"w\":64,\"h\":48,\"k1\":0.1",
     "\"k1\":0.2",
     {SGS_CAMERA_OPENCV, 64, 48, {50, 50, 32, 24, 0.2}},
     0},
    {"\"fl_x\":50,\"w\":64,\"h\":48,\"camera_model\":\"OPENCV\",\"k1\":0.0",
     "",
     {SGS_CAMERA_PINHOLE, 64, 48, {50, 50, 32, 24}},
     0},
    {"\"fl_x\":50,\"w\":64,\"h\":48,\"camera_model\":\"PINHOLE\",\"k1\":0.1",
     "",
     {SGS_CAMERA_PINHOLE, 64, 48, {50, 50, 32, 24}},
     0},
    {"\"fl_x\":50,\"w\":64,\"h\":48,\"k3\":0.01,\"k1\":0.1",
     "",
     {SGS_CAMERA_FULL_OPENCV, 64, 48, {50, 50, 32, 24, 0.1, 0, 0, 0, 0.01}},
     0},
    {"\"fl_x\":50,\"w\":64,\"h\":48,\"camera_model\":\"OPENCV_FISHEYE\",\"k1\":0.1,\"k4\":0.4",
     "",
     {SGS_CAMERA_OPENCV_FISHEYE, 64, 48, {50, 50, 32, 24, 0.1, 0, 0, 0.4}},
     0},
    {"\"fl_x\":50,\"w\":64,\"h\":48,\"camera_model\":\"OPENCV_FISHEYE\",\"k1\":0.1,\"k2\":0.2,"
     "\"k3\":0.3,\"k4\":0.4,\"p1\":0.01,\"p2\":0.02",
     "",
     {SGS_CAMERA_THIN_PRISM_FISHEYE, 64, 48, {50, 50, 32, 24, 0.1, 0.2, 0.01, 0.02, 0.3, 0.4}},
     0},
    {"\"fl_x\":50,\"w\":64,\"h\":48,\"camera_model\":\"FULL_OPENCV\",\"k1\":0.1,\"p2\":0.2,\"k4\":"
     "0.4,\"k6\":0.6",
     "",
     {SGS_CAMERA_FULL_OPENCV, 64, 48, {50, 50, 32, 24, 0.1, 0, 0, 0.2, 0, 0.4, 0, 0.6}},
     0},
    {"\"fl_x\":50,\"w\":64,\"h\":48,\"camera_model\":\"RADIAL_FISHEYE\",\"k1\":0.1,\"k2\":0.2",
     "\"camera_model\":\"SIMPLE_RADIAL_FISHEYE\",\"k2\":0",
     {SGS_CAMERA_OPENCV_FISHEYE, 64, 48, {50, 50, 32, 24, 0.1}},
     0},
    {"\"fl_x\":50,\"w\":64,\"h\":48,\"is_fisheye\":true,\"k1\":0.1",
     "",
     {SGS_CAMERA_OPENCV_FISHEYE, 64, 48, {50, 50, 32, 24, 0.1}},
     0},
    {"\"fl_x\":50,\"w\":64,\"h\":48,\"camera_model\":null,\"cx\":null",
     "",
     {SGS_CAMERA_PINHOLE, 64, 48, {50, 50, 32, 24}},
     0},
};

static void intrinsics_are_read_from_all_keys(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof lenses / sizeof *lenses; ++i) {
        const temp_folder folder = temp_folder_make();
        char text[1024];
        sgsi_dataset d;
        snprintf(text, sizeof text,
                 "{%s,\"frames\":[{\"file_path\":\"a\",\"transform_matrix\":" IDENTITY "%s%s}]}",
                 lenses[i].global, *lenses[i].own ? "," : "", lenses[i].own);
        read_text(&folder, text, &d);
        const sgs_camera *got = &d.frames[0].camera, *expected = &lenses[i].camera;
        if (got->model != expected->model || got->width != expected->width ||
            got->height != expected->height)
            fail_msg("case %zu: %s %d x %d", i, sgs_camera_model_name(got->model), got->width,
                     got->height);
        const bool deferred = lenses[i].angle_x > 0;
        assert_true(d.frames[0].angle_x == lenses[i].angle_x);
        for (int k = deferred ? 2 : 0; k < 12; ++k) {
            const double a = got->params[k], b = expected->params[k];
            if (!(fabs(a - b) < 1e-12 || (isnan(a) && isnan(b))))
                fail_msg("case %zu: parameter %d is %g instead of %g", i, k, a, b);
        }
        sgsi_dataset_free(&d);
        tree_remove(&folder);
    }
}

#define FRAME "{\"file_path\":\"a.png\",\"transform_matrix\":" IDENTITY "}"
#define GLOBAL "\"fl_x\":50,\"w\":64,\"h\":48,"
#define MATRIX(m)                                                                                  \
    "{" GLOBAL "\"frames\":[" FRAME ",{\"file_path\":\"b\",\"transform_matrix\":" m "}]}"
#define NAMED(name)                                                                                \
    "{" GLOBAL "\"frames\":[{\"file_path\":" name ",\"transform_matrix\":" IDENTITY "}]}"
#define MASKED(name)                                                                               \
    "{" GLOBAL "\"frames\":[{\"file_path\":\"a.png\",\"mask_path\":" name                          \
    ",\"transform_matrix\":" IDENTITY "}]}"
#define KEYS(keys) "{" keys ",\"frames\":[" FRAME "]}"

static const struct {
    const char *text;
    sgs_status status;
    const char *message;
} wrong[] = {
    {"", SGS_STATUS_FORMAT, "line 1, column 0: "},
    {"{", SGS_STATUS_FORMAT, "line 1, column 1: "},
    {"{\n\"frames\": [,]}", SGS_STATUS_FORMAT, "line 2, column 12: unexpected token near ','"},
    {"[1, 2]", SGS_STATUS_FORMAT, "must contain a JSON object with 'frames'"},
    {"null", SGS_STATUS_FORMAT, "line 1, column 4: "},
    {"\xff\xfe", SGS_STATUS_FORMAT, "line 1, column 0: "},
    {"{}", SGS_STATUS_FORMAT, "'frames' must be a list with at least one frame"},
    {"{\"frames\":[]}", SGS_STATUS_FORMAT, "'frames' must be a list with at least one frame"},
    {"{\"frames\":{\"a\":1}}", SGS_STATUS_FORMAT,
     "'frames' must be a list with at least one frame"},
    {"{\"frames\":[7]}", SGS_STATUS_FORMAT, "frame 0: must be an object"},
    {"{\"frames\":[{}]}", SGS_STATUS_FORMAT, "frame 0: 'file_path' must be a string"},
    {NAMED("7"), SGS_STATUS_FORMAT, "frame 0: 'file_path' must be a string"},
    {NAMED("\"\""), SGS_STATUS_FORMAT, "frame 0: 'file_path' is empty"},
    {NAMED("\"../a.png\""), SGS_STATUS_FORMAT, "frame 0: 'file_path' leaves the image folder"},
    {NAMED("\"x/../../a\""), SGS_STATUS_FORMAT, "frame 0: 'file_path' leaves the image folder"},
    {NAMED("\"/etc/passwd\""), SGS_STATUS_FORMAT, "frame 0: 'file_path' is an absolute path"},
    {NAMED("\"a\\u0007b\""), SGS_STATUS_FORMAT, "frame 0: 'file_path' contains control characters"},
    {NAMED("\"a\\u0000b\""), SGS_STATUS_FORMAT, "line 1, column "},
    {"{" GLOBAL "\"frames\":[{\"file_path\":\"a\"}]}", SGS_STATUS_FORMAT,
     "frame 0: 'transform_matrix' must be 4 rows"},
    {MATRIX("7"), SGS_STATUS_FORMAT,
     "frame 1: 'transform_matrix' must be 4 rows (or 3) of 4 numbers"},
    {MATRIX("[[1,0,0,0],[0,1,0,0]]"), SGS_STATUS_FORMAT,
     "frame 1: 'transform_matrix' must be 4 rows"},
    {MATRIX("[[1,0,0],[0,1,0],[0,0,1]]"), SGS_STATUS_FORMAT,
     "frame 1: 'transform_matrix' must be 4 rows"},
    {MATRIX("[[1,0,0,\"x\"],[0,1,0,0],[0,0,1,0]]"), SGS_STATUS_FORMAT,
     "frame 1: 'transform_matrix' must be 4 rows"},
    {MATRIX("[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1],[0,0,0,1]]"), SGS_STATUS_FORMAT,
     "frame 1: 'transform_matrix'"},
    {MATRIX("[[1,0,0,0],[0,1,0,0],[0,0,1,0],[4,5,6,1]]"), SGS_STATUS_FORMAT,
     "frame 1: last row of 'transform_matrix' is (4, 5, 6, 1), not (0, 0, 0, 1); transpose"},
    {MATRIX("[[0,0,0,0],[0,0,0,0],[0,0,0,0]]"), SGS_STATUS_FORMAT,
     "frame 1: 'transform_matrix' contains no rotation"},
    {MATRIX("[[-1,0,0,0],[0,1,0,0],[0,0,1,0]]"), SGS_STATUS_FORMAT,
     "frame 1: 'transform_matrix' is mirrored; convert left-handed cameras"},
    {MATRIX("[[1,0.5,0,0],[0,1,0,0],[0,0,1,0]]"), SGS_STATUS_FORMAT,
     "frame 1: 'transform_matrix' contains no rotation"},
    {MATRIX("[[1e200,0,0,0],[0,1,0,0],[0,0,1,0]]"), SGS_STATUS_FORMAT,
     "frame 1: 'transform_matrix' contains no rotation"},
    {MATRIX("[[1e999,0,0,0],[0,1,0,0],[0,0,1,0]]"), SGS_STATUS_FORMAT, "real number overflow"},
    {MATRIX("[[NaN,0,0,0],[0,1,0,0],[0,0,1,0]]"), SGS_STATUS_FORMAT, "invalid token near 'NaN'"},
    {KEYS("\"w\":64,\"h\":48"), SGS_STATUS_FORMAT, "frame 0: no focal length; add 'fl_x' (pixels)"},
    {KEYS("\"w\":64"), SGS_STATUS_FORMAT,
     "frame 0: image size w = 64, h = nan is not within 1 to 65536 pixels"},
    {KEYS("\"fl_x\":\"50px\",\"w\":64,\"h\":48"), SGS_STATUS_FORMAT,
     "the global keys: 'fl_x' must be a number"},
    {KEYS("\"fl_x\":50,\"w\":0,\"h\":48"), SGS_STATUS_FORMAT,
     "image size w = 0, h = 48 is not within"},
    {KEYS("\"fl_x\":50,\"w\":1e30,\"h\":48"), SGS_STATUS_FORMAT,
     "image size w = 1e+30, h = 48 is not within"},
    {KEYS("\"fl_x\":50,\"w\":64,\"h\":99999999999999999999999999999999"), SGS_STATUS_FORMAT,
     "h = 1e+32 is not within"},
    {KEYS("\"fl_x\":-50,\"w\":64,\"h\":48"), SGS_STATUS_FORMAT,
     "frame 0: focal length -50 of the PINHOLE camera"},
    {KEYS("\"fl_x\":0,\"w\":64,\"h\":48"), SGS_STATUS_FORMAT,
     "frame 0: focal length 0 of the PINHOLE camera"},
    {KEYS("\"camera_angle_x\":0"), SGS_STATUS_FORMAT,
     "frame 0: 'camera_angle_x' is 0, not an angle between 0 and pi"},
    {KEYS("\"camera_angle_x\":57"), SGS_STATUS_FORMAT,
     "frame 0: 'camera_angle_x' is 57, not an angle"},
    {KEYS("\"camera_angle_x\":1,\"camera_model\":\"OPENCV_FISHEYE\""), SGS_STATUS_FORMAT,
     "frame 0: no focal length of the fisheye lens, which a field of view does not define"},
    {KEYS("\"fl_x\":5,\"camera_model\":7"), SGS_STATUS_FORMAT,
     "the global keys: 'camera_model' must be a string"},
    {KEYS("\"fl_x\":5,\"camera_model\":\"VR180_L\""), SGS_STATUS_UNSUPPORTED,
     "frame 0: camera model 'VR180_L' is not supported; supported: SIMPLE_PINHOLE, "
     "PINHOLE, "
     "SIMPLE_RADIAL, RADIAL, PERSPECTIVE, OPENCV, FULL_OPENCV, SIMPLE_RADIAL_FISHEYE"},
    {KEYS("\"fl_x\":5,\"k4\":1"), SGS_STATUS_UNSUPPORTED,
     "frame 0: camera model 'OPENCV' has no k4; undistort the images"},
    {KEYS("\"fl_x\":5,\"k4\":1,\"k5\":1,\"k6\":1"), SGS_STATUS_UNSUPPORTED,
     "frame 0: camera model 'OPENCV' has no k4; use FULL_OPENCV"},
    {KEYS("\"fl_x\":5,\"is_fisheye\":true,\"k5\":1"), SGS_STATUS_UNSUPPORTED,
     "frame 0: camera model 'OPENCV_FISHEYE' has no k5; undistort the images"},
    {KEYS("\"fl_x\":5,\"ftheta_p0\":0"), SGS_STATUS_UNSUPPORTED,
     "the global keys: the lens of 'ftheta_p0' is not supported; convert the images"},
    {KEYS("\"fl_x\":5,\"latlong\":true,\"camera_model\":\"OPENCV\""), SGS_STATUS_FORMAT,
     "frame 0: 'latlong' contradicts camera model 'OPENCV'; remove one of them"},
    {KEYS("\"fl_x\":5,\"latlong\":false,\"equirectangular\":true"), SGS_STATUS_UNSUPPORTED,
     "the global keys: the lens of 'equirectangular' is not supported"},
    {MASKED("7"), SGS_STATUS_FORMAT, "frame 0: 'mask_path' must be a string"},
    {MASKED("\"\""), SGS_STATUS_FORMAT, "frame 0: 'mask_path' is empty"},
    {MASKED("\"../m.png\""), SGS_STATUS_FORMAT,
     "frame 0: 'mask_path' leaves the image folder; use a path below"},
    {"{" GLOBAL "\"frames\":[" FRAME "," FRAME "]}", SGS_STATUS_FORMAT,
     "frame 1: duplicate image name 'a.png', first used at frame 0"},
};

static void invalid_files_are_rejected_with_frame_and_key(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; ++i) {
        const temp_folder folder = temp_folder_make();
        sgsi_dataset d;
        tree_put_text(&folder, "transforms.json", wrong[i].text);
        if (sgsi_transforms_read(temp_path(&folder, "transforms.json"), &d) != wrong[i].status)
            fail_msg("case %zu (%s): %s", i, wrong[i].message, sgs_last_error());
        assert_holds(sgs_last_error(), wrong[i].message);
        bad_input();
        const char *path = temp_path(&folder, "transforms.json: ");
        assert_memory_equal(sgs_last_error(), path, strlen(path));
        assert_null(d.frames);
        tree_remove(&folder);
    }
}

static void ignored_distortion_is_warned_of_once(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    for (int distorted = 0; distorted < 2; ++distorted) {
        char text[1024];
        sgsi_dataset d;
        snprintf(text, sizeof text,
                 "{" GLOBAL "\"camera_model\":\"PINHOLE\",\"k1\":%d,\"frames\":[" FRAME
                 ",{\"file_path\":\"b.png\",\"transform_matrix\":" IDENTITY "}]}",
                 distorted);
        read_text(&folder, text, &d);
        assert_int_equal(d.frames[1].camera.model, SGS_CAMERA_PINHOLE);
        sgsi_dataset_free(&d);
        if (!distorted)
            assert_string_equal(warnings, "");
    }
    assert_holds(warnings, "frame 0: camera model PINHOLE has no distortion; k1 to k6");
    assert_null(strstr(warnings, "frame 1"));
    tree_remove(&folder);
}

static void byte_order_marks_are_skipped(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgsi_dataset d;
    read_text(&folder, "\xef\xbb\xbf{" GLOBAL "\"frames\":[" FRAME "]}", &d);
    assert_int_equal(d.frame_count, 1);
    sgsi_dataset_free(&d);
    tree_put_text(&folder, "transforms.json", "\xef\xbb\xbf");
    assert_int_equal(sgsi_transforms_read(temp_path(&folder, "transforms.json"), &d),
                     SGS_STATUS_FORMAT);
    tree_remove(&folder);
}

static void deep_nesting_is_rejected(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    enum { DEPTH = 100000 };
    char *text = malloc(DEPTH + 1);
    assert_non_null(text);
    memset(text, '[', DEPTH);
    text[DEPTH] = 0;
    tree_put_text(&folder, "transforms.json", text);
    free(text);
    sgsi_dataset d;
    assert_int_equal(sgsi_transforms_read(temp_path(&folder, "transforms.json"), &d),
                     SGS_STATUS_FORMAT);
    assert_holds(sgs_last_error(), "maximum parsing depth reached");
    bad_input();
    tree_remove(&folder);
}

static void truncated_files_are_rejected(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *text = "{" GLOBAL "\"frames\":[" FRAME "]}";
    for (size_t length = 0; length < strlen(text); ++length) {
        sgsi_dataset d;
        tree_put(&folder, "transforms.json", text, length);
        assert_int_equal(sgsi_transforms_read(temp_path(&folder, "transforms.json"), &d),
                         SGS_STATUS_FORMAT);
    }
    tree_remove(&folder);
}

static void synthetic_test_split_is_read_from_its_file(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *form =
        "{\"camera_angle_x\":0.69,\"frames\":[{\"file_path\":\"./%s/r_0\",\"rotation\":0.01,"
        "\"transform_matrix\":" IDENTITY "}]}";
    char text[512];
    snprintf(text, sizeof text, form, "train");
    tree_put_text(&folder, "transforms_train.json", text);
    snprintf(text, sizeof text, form, "test");
    tree_put_text(&folder, "transforms_test.json", text);
    sgsi_dataset d;
    assert_int_equal(sgsi_transforms_read(temp_path(&folder, "transforms_train.json"), &d),
                     SGS_STATUS_OK);
    assert_int_equal(d.frame_count, 2);
    assert_true(d.has_split && d.white_background);
    assert_string_equal(d.frames[0].name, "train/r_0.png");
    assert_int_equal(d.frames[0].split, SGS_SPLIT_TRAIN);
    assert_string_equal(d.frames[1].name, "test/r_0.png");
    assert_int_equal(d.frames[1].split, SGS_SPLIT_TEST);
    sgsi_dataset_free(&d);
    snprintf(text, sizeof text, form, "train");
    tree_put_text(&folder, "transforms_test.json", text);
    assert_int_equal(sgsi_transforms_read(temp_path(&folder, "transforms_train.json"), &d),
                     SGS_STATUS_FORMAT);
    assert_holds(sgs_last_error(), "transforms_train.json: frame 0: image 'train/r_0.png' is also "
                                   "frame 0 of transforms_test.json");
    tree_put_text(&folder, "transforms_test.json", "{broken");
    assert_int_equal(sgsi_transforms_read(temp_path(&folder, "transforms_train.json"), &d),
                     SGS_STATUS_FORMAT);
    assert_holds(sgs_last_error(), "transforms_test.json: line 1");
    tree_remove(&folder);
}

static void nerfstudio_test_names_are_held_out(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgsi_dataset d;
    read_text(&folder,
              "{" GLOBAL "\"test_filenames\":[\"./b.png\",7,\"none\"],\"frames\":[" FRAME
              ",{\"file_path\":\"b.png\",\"transform_matrix\":" IDENTITY "}]}",
              &d);
    assert_true(d.has_split && !d.white_background);
    assert_int_equal(d.frames[0].split, SGS_SPLIT_TRAIN);
    assert_int_equal(d.frames[1].split, SGS_SPLIT_TEST);
    assert_holds(warnings, "transforms.json: 2 of 3 entries of 'test_filenames' match no frame and "
                           "are ignored, first entry 1, which is not a string");
    sgsi_dataset_free(&d);
    tree_remove(&folder);
}

static void test_names_may_lack_the_extension(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgsi_dataset d;
    read_text(&folder,
              "{" GLOBAL "\"test_filenames\":[\"images/b\"],\"frames\":[" FRAME
              ",{\"file_path\":\"images/b\",\"transform_matrix\":" IDENTITY "}]}",
              &d);
    assert_true(d.has_split);
    assert_int_equal(d.frames[0].split, SGS_SPLIT_TRAIN);
    assert_int_equal(d.frames[1].split, SGS_SPLIT_TEST);
    assert_string_equal(warnings, "");
    sgsi_dataset_free(&d);
    tree_remove(&folder);
}

static void validation_names_replace_missing_test_names(void **state)
{
    (void)state;
    static const char *const tests[] = {"", "\"test_filenames\":[],",
                                        "\"test_filenames\":[\"a.png\"],"};
    for (size_t k = 0; k < 3; ++k) {
        const temp_folder folder = temp_folder_make();
        char text[1024];
        sgsi_dataset d;
        snprintf(text, sizeof text,
                 "{" GLOBAL "%s\"val_filenames\":[\"b.png\"],\"frames\":[" FRAME
                 ",{\"file_path\":\"b.png\",\"transform_matrix\":" IDENTITY "}]}",
                 tests[k]);
        read_text(&folder, text, &d);
        assert_true(d.has_split);
        assert_int_equal(d.frames[0].split, k == 2 ? SGS_SPLIT_TEST : SGS_SPLIT_TRAIN);
        assert_int_equal(d.frames[1].split, k == 2 ? SGS_SPLIT_TRAIN : SGS_SPLIT_TEST);
        sgsi_dataset_free(&d);
        tree_remove(&folder);
    }
}

// nerfstudio trains on the images of train_filenames only: with test_filenames, those of
// val_filenames are in no list. A list that names no frame is ignored.
static void frames_in_no_list_are_not_used(void **state)
{
    (void)state;
    static const struct {
        const char *lists, *names; // a: trained, A: held out
        const char *warning;
    } cases[] = {
        {"\"train_filenames\":[\"a.png\"],\"val_filenames\":[\"b.png\"],"
         "\"test_filenames\":[\"c.png\"],",
         "aC", "2 of 4 frames are in neither 'train_filenames' nor 'test_filenames'"},
        {"\"train_filenames\":[\"a.png\",\"d.png\",\"c.png\"],\"val_filenames\":[\"b.png\"],",
         "aBcd", NULL},
        {"\"train_filenames\":[\"b\",\"b\",\"d.png\",\"none.png\"],", "bd",
         "nor 'val_filenames' and are not used, first 'a.png'"},
        {"\"train_filenames\":[\"none.png\"],\"test_filenames\":[\"d.png\"],", "abcD",
         "1 of 1 entries of 'train_filenames' match no frame"},
        {"\"train_filenames\":[],\"test_filenames\":[\"d.png\"],", "abcD", NULL}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        const temp_folder folder = temp_folder_make();
        char text[2048], used[8] = "";
        sgsi_dataset d;
        warnings_begin(state);
        snprintf(text, sizeof text,
                 "{" GLOBAL "%s\"frames\":[" FRAME
                 ",{\"file_path\":\"b.png\",\"transform_matrix\":" IDENTITY "}"
                 ",{\"file_path\":\"c.png\",\"transform_matrix\":" IDENTITY "}"
                 ",{\"file_path\":\"d.png\",\"transform_matrix\":" IDENTITY "}]}",
                 cases[k].lists);
        read_text(&folder, text, &d);
        assert_true(d.frame_count <= 4);
        for (size_t i = 0; i < d.frame_count; ++i)
            used[i] = (char)(d.frames[i].split == SGS_SPLIT_TEST ? toupper(d.frames[i].name[0])
                                                                 : d.frames[i].name[0]);
        assert_string_equal(used, cases[k].names);
        if (cases[k].warning)
            assert_non_null(strstr(warnings, cases[k].warning));
        else
            assert_string_equal(warnings, "");
        sgsi_dataset_free(&d);
        tree_remove(&folder);
    }
}

// Every third frame is held out; the list is in another order than the frames and has unknown names
// and repetitions.
static void many_test_names_are_found(void **state)
{
    (void)state;
    enum { FRAMES = 300, NAMES = 20000 };
    const temp_folder folder = temp_folder_make();
    char *text;
    size_t length;
    FILE *stream = open_memstream(&text, &length);
    assert_non_null(stream);
    fputs("{" GLOBAL "\"test_filenames\":[\"none\"", stream);
    for (int k = NAMES; k > 0; --k)
        fprintf(stream, ",\"%d.png\"", 3 * (7 * k % NAMES));
    fputs("],\"frames\":[", stream);
    for (int k = 0; k < FRAMES; ++k)
        fprintf(stream, "%s{\"file_path\":\"%d.png\",\"transform_matrix\":" IDENTITY "}",
                k ? "," : "", 7 * k % FRAMES);
    fputs("]}", stream);
    assert_int_equal(fclose(stream), 0);
    sgsi_dataset d;
    read_text(&folder, text, &d);
    assert_true(d.has_split && d.frame_count == FRAMES);
    for (size_t k = 0; k < d.frame_count; ++k)
        assert_int_equal(d.frames[k].split,
                         atoi(d.frames[k].name) % 3 ? SGS_SPLIT_TRAIN : SGS_SPLIT_TEST);
    sgsi_dataset_free(&d);
    free(text);
    tree_remove(&folder);
}

static const char with_cloud[] =
    "{" GLOBAL "\"ply_file_path\":\"sparse_pc.ply\",\"frames\":[" FRAME "]}";

static void point_cloud_is_read(void **state)
{
    (void)state;
    static const struct {
        const char *text;
        float points[6];
        uint8_t colors[6];
    } clouds[] = {
        {"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty "
         "float z\n"
         "property uint8 red\nproperty uint8 green\nproperty uint8 blue\nend_header\n1 2 3 4 5 "
         "6\n-1 -2.5 0 255 0 9\n",
         {1, 2, 3, -1, -2.5f, 0},
         {4, 5, 6, 255, 0, 9}},
        {"ply\nformat ascii 1.0\nelement vertex 3\nproperty double z\nproperty float red\nproperty "
         "float green\n"
         "property float blue\nproperty int y\nproperty float x\nend_header\n3 0.5 1 0 2 1\nnan 0 "
         "0 0 0 0\n9 2 -1 0 8 "
         "7\n",
         {1, 2, 3, 7, 8, 9},
         {128, 255, 0, 255, 0, 0}},
        {"ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty "
         "float z\nend_header\n"
         "1 2 3 4 5 6\n",
         {1, 2, 3, 4, 5, 6},
         {128, 128, 128, 128, 128, 128}},
    };
    for (size_t i = 0; i < sizeof clouds / sizeof *clouds; ++i) {
        const temp_folder folder = temp_folder_make();
        sgsi_dataset d;
        warnings_begin(state);
        tree_put_text(&folder, "sparse_pc.ply", clouds[i].text);
        read_text(&folder, with_cloud, &d);
        assert_int_equal(d.point_count, 2);
        assert_memory_equal(d.points, clouds[i].points, sizeof clouds[i].points);
        assert_memory_equal(d.colors, clouds[i].colors, sizeof clouds[i].colors);
        if (i == 1)
            assert_holds(warnings,
                         "sparse_pc.ply: vertex 1: dropped 1 non-finite point(s), the first one "
                         "here; export the points again to keep them");
        else
            assert_string_equal(warnings, "");
        sgsi_dataset_free(&d);
        tree_remove(&folder);
    }
}

static void binary_point_cloud_is_read(void **state)
{
    (void)state;
    static const unsigned char big[] = {0x3f, 0x80, 0, 0, 0x40, 0, 0, 0, 0x40, 0x40, 0, 0, 7, 8, 9};
    const temp_folder folder = temp_folder_make();
    static buffer b;
    b.size = 0;
    put_text(
        &b,
        "ply\nformat binary_big_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
        "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar "
        "blue\nend_header\n");
    put_bytes(&b, big, sizeof big);
    tree_put(&folder, "sparse_pc.ply", b.data, b.size);
    sgsi_dataset d;
    read_text(&folder, with_cloud, &d);
    assert_int_equal(d.point_count, 1);
    assert_true(d.points[0] == 1 && d.points[1] == 2 && d.points[2] == 3 && d.colors[2] == 9);
    sgsi_dataset_free(&d);
    tree_remove(&folder);
}

static void scene_with_a_broken_point_cloud_has_no_points(void **state)
{
    (void)state;
    static const struct {
        const char *name, *text, *message;
    } clouds[] = {
        {"other.ply", "", "sparse_pc.ply: "},
        {"sparse_pc.ply", "not a ply", "sparse_pc.ply: "},
        {"sparse_pc.ply",
         "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n",
         "lack x, y, z"},
        {"sparse_pc.ply", "ply\nformat ascii 1.0\nelement face 0\nproperty float x\nend_header\n",
         "has no vertices"},
        {"sparse_pc.ply",
         "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\nproperty "
         "float z\n"
         "end_header\n1 2 3 4 5 z\n",
         "vertex 1 of 2 is truncated or not a number"},
        {"sparse_pc.ply",
         "ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\n"
         "property float y\nproperty float z\nend_header\n",
         "sparse_pc.ply: "},
        {"sparse_pc.ply",
         "ply\nformat ascii 1.0\nelement vertex 1\nproperty list uchar int x\nend_header\n0\n",
         "property 'x' is a list"},
    };
    for (size_t i = 0; i < sizeof clouds / sizeof *clouds; ++i) {
        const temp_folder folder = temp_folder_make();
        sgsi_dataset d;
        warnings_begin(state);
        tree_put_text(&folder, clouds[i].name, clouds[i].text);
        read_text(&folder, with_cloud, &d);
        assert_int_equal(d.point_count, 0);
        assert_null(d.points);
        assert_holds(warnings, clouds[i].message);
        bad_input();
        assert_holds(warnings, "; the scene has no points, and training starts from random ones\n");
        sgsi_dataset_free(&d);
        tree_remove(&folder);
    }
}

static void any_failing_allocation_is_reported(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    tree_put_text(&folder, "transforms.json", "{" GLOBAL "\"frames\":[" FRAME "]}");
    sgs_status status = SGS_STATUS_OUT_OF_MEMORY;
    for (size_t n = 1; n < 50 && status; ++n) {
        sgsi_dataset d;
        sgsi_fail_allocation(n);
        status = sgsi_transforms_read(temp_path(&folder, "transforms.json"), &d);
        sgsi_fail_allocation(0);
        assert_true(status == SGS_STATUS_OK || status == SGS_STATUS_OUT_OF_MEMORY);
        sgsi_dataset_free(&d);
    }
    assert_int_equal(status, SGS_STATUS_OK);
    tree_remove(&folder);
}

// The option replaces the folder that all names share, whatever it is called, and masks are found
// without it.
static void transforms_image_folder_may_have_any_name(void **state)
{
    (void)state;
    static const uint8_t white[3] = {255, 255, 255};
    static const char *const names[] = {"rgb/a/1.png", "rgb/b/2.png", "1.png", "2.png"};
    for (int bare = 0; bare < 2; ++bare) {
        const temp_folder folder = temp_folder_make();
        char text[512];
        snprintf(text, sizeof text,
                 "{\"fl_x\":40,\"w\":32,\"h\":24,\"frames\":["
                 "{\"file_path\":\"%s\",\"transform_matrix\":"
                 "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]},"
                 "{\"file_path\":\"%s\",\"transform_matrix\":"
                 "[[1,0,0,1],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}]}",
                 names[2 * bare], names[2 * bare + 1]);
        tree_put_text(&folder, "transforms.json", text);
        for (int k = 0; k < 2; ++k) {
            char place[64];
            const char *below = names[2 * bare + k] + (bare ? 0 : 4);
            tree_put_picture(&folder, names[2 * bare + k], 32, 24, 3, white);
            snprintf(place, sizeof place, "half/%s", below);
            tree_put_picture(&folder, place, 16, 12, 3, white);
            snprintf(place, sizeof place, "masks/%s", below);
            tree_put_picture(&folder, place, 32, 24, 3, white);
        }
        sgs_scene_options options = sgs_scene_options_default();
        options.images_dir = "half";
        options.load_images = false;
        for (int absolute = 0; absolute < 2; ++absolute) {
            sgs_scene *scene;
            assert_int_equal(sgs_scene_load(folder.path, &options, &scene), SGS_STATUS_OK);
            assert_int_equal(scene->view_count, 2);
            for (size_t v = 0; v < 2; ++v) {
                assert_int_equal(scene->views[v].camera.width, 16);
                assert_string_equal(scene->views[v].name, names[2 * bare + (int)v]);
            }
            assert_int_equal(scene->masks, 2);
            sgs_scene_destroy(scene);
            options.images_dir = temp_path(&folder, "half");
        }
        options.images_dir = "images_2";
        sgs_scene *scene;
        assert_int_equal(sgs_scene_load(folder.path, &options, &scene), SGS_STATUS_IO);
        bad_input();
        assert_holds(sgs_last_error(), ": no image folder 'images_2'; create it or choose another "
                                       "with option images_dir");
        tree_remove(&folder);
    }
}

// Names keep the extension of every image format; the file may have another one, also in capitals.
static void extensions_are_those_of_image_files(void **state)
{
    (void)state;
    static const uint8_t white[3] = {255, 255, 255};
    static const char *const formats[] = {"JPG", "heic", "DNG", "tga", "jp2", "CR2", "avif"};
    const temp_folder folder = temp_folder_make();
    for (size_t i = 0; i < sizeof formats / sizeof *formats; ++i) {
        char text[512], name[32];
        sgsi_dataset d;
        snprintf(name, sizeof name, "a.%s", formats[i]);
        snprintf(text, sizeof text,
                 "{" GLOBAL "\"frames\":[{\"file_path\":\"%s\",\"transform_matrix\":" IDENTITY
                 "}]}",
                 name);
        read_text(&folder, text, &d);
        assert_string_equal(d.frames[0].name, name);
        sgsi_dataset_free(&d);
    }
    tree_put_picture(&folder, "a.TIF", 64, 48, 3, white); // read by its contents
    sgs_scene *scene;
    assert_int_equal(sgs_scene_load(folder.path, NULL, &scene), SGS_STATUS_OK);
    assert_holds(scene->views[0].image_path, "/a.TIF");
    assert_int_equal(scene->views[0].image.pixels[0], 255);
    sgs_scene_destroy(scene);
    tree_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(opengl_axes_become_colmap_axes, warnings_begin),
        cmocka_unit_test_setup(scaled_and_rounded_matrices_become_rotations, warnings_begin),
        cmocka_unit_test_setup(intrinsics_are_read_from_all_keys, warnings_begin),
        cmocka_unit_test_setup(invalid_files_are_rejected_with_frame_and_key, warnings_begin),
        cmocka_unit_test_setup(ignored_distortion_is_warned_of_once, warnings_begin),
        cmocka_unit_test_setup(byte_order_marks_are_skipped, warnings_begin),
        cmocka_unit_test_setup(deep_nesting_is_rejected, warnings_begin),
        cmocka_unit_test_setup(truncated_files_are_rejected, warnings_begin),
        cmocka_unit_test_setup(synthetic_test_split_is_read_from_its_file, warnings_begin),
        cmocka_unit_test_setup(nerfstudio_test_names_are_held_out, warnings_begin),
        cmocka_unit_test_setup(test_names_may_lack_the_extension, warnings_begin),
        cmocka_unit_test_setup(validation_names_replace_missing_test_names, warnings_begin),
        cmocka_unit_test_setup(frames_in_no_list_are_not_used, warnings_begin),
        cmocka_unit_test(many_test_names_are_found),
        cmocka_unit_test_setup(point_cloud_is_read, warnings_begin),
        cmocka_unit_test_setup(binary_point_cloud_is_read, warnings_begin),
        cmocka_unit_test_setup(scene_with_a_broken_point_cloud_has_no_points, warnings_begin),
        cmocka_unit_test_setup(any_failing_allocation_is_reported, warnings_begin),
        cmocka_unit_test_setup(transforms_image_folder_may_have_any_name, warnings_begin),
        cmocka_unit_test_setup(extensions_are_those_of_image_files, warnings_begin),
    };
    return cmocka_run_group_tests_name("transforms", tests, NULL, NULL);
}
