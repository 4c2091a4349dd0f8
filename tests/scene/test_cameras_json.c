// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// cameras.json: keys, their order and their meaning as in 3DGS, then those of the lens.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <jansson.h>
#include <math.h>

#include "base/core.h"
#include "support/files_support.h"
#include "sparegs/scene.h"

static sgs_view make_view(char *name, sgs_split split, double seed)
{
    sgs_view view = {.name = name, .split = split};
    view.camera = (sgs_camera){
        SGS_CAMERA_OPENCV, 480, 270, {400.5, 401.25, 240, 135, 0.1, -0.05, 1e-3, 2e-3}};
    const double qvec[4] = {1.0, 0.3 * seed, -0.2, 0.5}, tvec[3] = {seed, 2.0, -3.0};
    assert_int_equal(sgs_pose_from_quaternion(qvec, tvec, &view.pose), SGS_STATUS_OK);
    return view;
}

static double number_at(json_t *array, size_t k)
{
    assert_true(json_is_number(json_array_get(array, k)));
    return json_number_value(json_array_get(array, k));
}

// p_cam = R p + t; the file's rotation C and position c are its inverse: C p_cam + c = p.
static void assert_inverts(json_t *camera, const sgs_pose *pose)
{
    const double p[3] = {0.7, -1.3, 2.9};
    double q[3];
    for (int row = 0; row < 3; ++row) {
        q[row] = pose->translation[row];
        for (int k = 0; k < 3; ++k)
            q[row] += pose->rotation[3 * row + k] * p[k];
    }
    for (size_t row = 0; row < 3; ++row) {
        json_t *cells = json_array_get(json_object_get(camera, "rotation"), row);
        assert_int_equal(json_array_size(cells), 3);
        double back = number_at(json_object_get(camera, "position"), row);
        for (size_t k = 0; k < 3; ++k)
            back += number_at(cells, k) * q[k];
        assert_true(fabs(back - p[row]) <= 1e-12);
    }
}

static void cameras_json_matches_3dgs(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_view views[4] = {
        make_view("a.jpg", SGS_SPLIT_TEST, 0.1), make_view("b/\xc3\xa9.jpg", SGS_SPLIT_TRAIN, 0.2),
        make_view("c.jpg", SGS_SPLIT_TEST, 0.3), make_view("\xff\"d\\.jpg", SGS_SPLIT_TRAIN, 0.4)};
    views[1].orientation = 1; // upright
    views[3].orientation = 6;
    const sgs_scene scene = {.view_count = 4, .views = views};
    const char *path = temp_path(&folder, "cameras.json");
    assert_int_equal(sgs_scene_write_cameras_json(&scene, path), SGS_STATUS_OK);
    json_error_t error;
    json_t *list = json_load_file(path, 0, &error);
    assert_non_null(list);
    assert_int_equal(json_array_size(list), 4);
    static const int order[4] = {0, 2, 1, 3}; // held-out views first
    static const char *const names[4] = {"a.jpg", "c.jpg", "b/\xc3\xa9.jpg", "?\"d\\.jpg"};
    static const char *const keys[] = {
        "id", "img_name", "width", "height",       "position", "rotation",        "fy",
        "fx", "cx",       "cy",    "camera_model", "params",   "exif_orientation"};
    for (size_t k = 0; k < 4; ++k) {
        json_t *camera = json_array_get(list, k);
        assert_int_equal(json_integer_value(json_object_get(camera, "id")), k);
        assert_string_equal(json_string_value(json_object_get(camera, "img_name")), names[k]);
        assert_int_equal(json_integer_value(json_object_get(camera, "width")), 480);
        assert_int_equal(json_integer_value(json_object_get(camera, "height")), 270);
        assert_true(json_real_value(json_object_get(camera, "fx")) == 400.5);
        assert_true(json_real_value(json_object_get(camera, "fy")) == 401.25);
        assert_inverts(camera, &views[order[k]].pose);
        assert_true(number_at(json_object_get(camera, "params"), 5) == -0.05);
        assert_int_equal(json_array_size(json_object_get(camera, "params")), 8);
        assert_string_equal(json_string_value(json_object_get(camera, "camera_model")), "OPENCV");
        size_t place = 0;
        const char *key;
        json_t *value;
        json_object_foreach(camera, key, value) assert_string_equal(key, keys[place++]);
        assert_int_equal(place, k == 3 ? 13 : 12);
        assert_int_equal(json_integer_value(json_object_get(camera, "exif_orientation")),
                         k == 3 ? 6 : 0);
    }
    json_decref(list);
    temp_folder_remove(&folder);
}

static void cameras_json_write_failure_keeps_the_old_file(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    sgs_view views[1] = {make_view("a.jpg", SGS_SPLIT_TRAIN, 0.1)};
    sgs_scene scene = {.view_count = 0, .views = views};
    const char *path = temp_path(&folder, "cameras.json");
    assert_int_equal(sgs_scene_write_cameras_json(&scene, path), SGS_STATUS_OK);
    scene.view_count = 1;
    files_limited(20);
    assert_int_equal(sgs_scene_write_cameras_json(&scene, path), SGS_STATUS_IO);
    files_unlimited();
    assert_non_null(strstr(sgs_last_error(), "cameras.json: cannot be written: File too large"));
    size_t size;
    unsigned char *bytes = file_get(path, &size);
    assert_string_equal((const char *)bytes, "[]\n");
    assert_int_equal(temp_folder_count(&folder), 1);
    free(bytes);
    temp_folder_remove(&folder);
}

static void expect_refused(const sgs_named_camera *cameras, const char *path, const char *reason)
{
    assert_int_equal(sgs_cameras_write_json(cameras, 2, path), SGS_STATUS_INVALID_ARGUMENT);
    if (!strstr(sgs_last_error(), reason) || !strstr(sgs_last_error(), path))
        fail_msg("'%s' does not contain '%s'", sgs_last_error(), reason);
}

static void invalid_cameras_are_named_with_the_reason(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "cameras.json");
    const sgs_view view = make_view("a.jpg", SGS_SPLIT_TRAIN, 0.1);
    const sgs_named_camera good = {"b.jpg", view.camera, view.pose, 1};
    sgs_named_camera cameras[2] = {good, good};
    cameras[1].camera.params[4] = NAN;
    expect_refused(cameras, path, "camera 1, 'b.jpg': parameter 5 of the OPENCV camera is not");
    cameras[1] = good;
    cameras[1].camera.params[0] = INFINITY;
    expect_refused(cameras, path, "camera 1, 'b.jpg': parameter 1 of the OPENCV camera is not");
    cameras[1] = good;
    cameras[1].camera.model = (sgs_camera_model)99;
    expect_refused(cameras, path, "camera 1, 'b.jpg': unknown camera model 99");
    cameras[1] = good;
    cameras[1].pose.translation[2] = -INFINITY;
    expect_refused(cameras, path, "camera 1, 'b.jpg': pose.translation");
    cameras[1] = good;
    cameras[1].pose.rotation[0] = NAN;
    expect_refused(cameras, path, "camera 1, 'b.jpg': pose.rotation");
    cameras[1] = good;
    cameras[0].name = NULL;
    expect_refused(cameras, path, "camera 0: name is NULL");
    assert_int_equal(temp_folder_count(&folder), 0);
    assert_int_equal(sgs_cameras_write_json(cameras + 1, 1, path), SGS_STATUS_OK);
    temp_folder_remove(&folder);
}

static void the_reader_inverts_the_writer(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "cameras.json");
    const sgs_view view = make_view("b/\xc3\xa9.jpg", SGS_SPLIT_TRAIN, 0.2);
    const sgs_named_camera written[2] = {{view.name, view.camera, view.pose, 6},
                                         {"a", sgs_camera_equirectangular(96, 48), view.pose, 0}};
    sgs_named_camera *cameras;
    size_t count;
    assert_int_equal(sgs_cameras_write_json(written, 2, path), SGS_STATUS_OK);
    assert_int_equal(sgs_cameras_read_json(path, &cameras, &count), SGS_STATUS_OK);
    assert_int_equal(count, 2);
    for (size_t k = 0; k < count; ++k) {
        assert_string_equal(cameras[k].name, written[k].name);
        assert_int_equal(cameras[k].orientation, written[k].orientation);
        assert_int_equal(cameras[k].camera.model, written[k].camera.model);
        assert_int_equal(cameras[k].camera.width, written[k].camera.width);
        assert_int_equal(cameras[k].camera.height, written[k].camera.height);
        for (int i = 0; i < 12; ++i)
            assert_true(cameras[k].camera.params[i] == written[k].camera.params[i]);
        for (int i = 0; i < 9; ++i)
            assert_true(fabs(cameras[k].pose.rotation[i] - written[k].pose.rotation[i]) <= 1e-14);
        for (int i = 0; i < 3; ++i)
            assert_true(fabs(cameras[k].pose.translation[i] - written[k].pose.translation[i]) <=
                        1e-12);
    }
    sgs_cameras_free(cameras);
    sgs_cameras_free(NULL);
    assert_int_equal(sgs_cameras_read_json(temp_path(&folder, "none"), &cameras, &count),
                     SGS_STATUS_IO);
    assert_null(cameras);
    temp_folder_remove(&folder);
}

// As 3DGS writes it. The camera at (1, 2, 3) looks along +x of the world: its axes, the columns of
// the rotation, are -y, -z and x.
static const char original[] =
    "{\"id\": 0, \"img_name\": \"0001\", \"width\": 640, \"height\": 480, "
    "\"position\": [1.0, 2.0, 3.0], "
    "\"rotation\": [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], "
    "\"fy\": 500.5, \"fx\": 500.0}";

static sgs_status parse(const char *text, sgs_named_camera **cameras, size_t *count)
{
    return sgs_cameras_parse_json(text, strlen(text), "x.json", cameras, count);
}

static void cameras_of_3dgs_are_pinholes(void **state)
{
    (void)state;
    char text[1024];
    sgs_named_camera *cameras;
    size_t count;
    assert_int_equal(parse("[]", &cameras, &count), SGS_STATUS_OK);
    assert_int_equal(count, 0);
    sgs_cameras_free(cameras);
    snprintf(text, sizeof text, "[%s,{%s]", original, strstr(original, "\"width"));
    assert_int_equal(parse(text, &cameras, &count), SGS_STATUS_OK);
    assert_int_equal(count, 2);
    assert_string_equal(cameras[0].name, "0001");
    assert_null(cameras[1].name);
    sgs_cameras_free(cameras);
    assert_int_equal(parse(original, &cameras, &count), SGS_STATUS_OK); // without a list
    assert_int_equal(count, 1);
    const sgs_camera *camera = &cameras->camera;
    assert_int_equal(camera->model, SGS_CAMERA_PINHOLE);
    assert_true(camera->width == 640 && camera->height == 480 && camera->params[0] == 500 &&
                camera->params[1] == 500.5 && camera->params[2] == 320 && camera->params[3] == 240);
    // A point 10 ahead, 1 to the right and 2 down is (11, 1, 1).
    const double point[3] = {11, 1, 1}, expected[3] = {1, 2, 10};
    for (int i = 0; i < 3; ++i) {
        double sum = cameras->pose.translation[i];
        for (int j = 0; j < 3; ++j)
            sum += cameras->pose.rotation[3 * i + j] * point[j];
        assert_true(fabs(sum - expected[i]) <= 1e-12);
    }
    sgs_cameras_free(cameras);
}

// Programs on Windows begin UTF-8 files with it.
static void a_byte_order_mark_is_skipped(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const char *path = temp_path(&folder, "cameras.json");
    char text[1024];
    const size_t size = (size_t)snprintf(text, sizeof text, "\xef\xbb\xbf%s", original);
    sgs_named_camera *cameras;
    size_t count;
    assert_int_equal(parse(text, &cameras, &count), SGS_STATUS_OK);
    assert_int_equal(count, 1);
    assert_string_equal(cameras->name, "0001");
    sgs_cameras_free(cameras);
    file_put(path, text, size);
    assert_int_equal(sgs_cameras_read_json(path, &cameras, &count), SGS_STATUS_OK);
    assert_int_equal(count, 1);
    sgs_cameras_free(cameras);
    static const char beginning[2] = {'\xef', '\xbb'}; // without NUL
    assert_int_equal(sgs_cameras_parse_json(beginning, 2, "x.json", &cameras, &count),
                     SGS_STATUS_FORMAT);
    assert_int_equal(parse("\xef\xbb\xbf", &cameras, &count), SGS_STATUS_FORMAT);
    temp_folder_remove(&folder);
}

static void invalid_files_are_refused(void **state)
{
    (void)state;
    static const struct {
        const char *from, *to, *message;
    } cases[] = {
        {"{\"id\"", "[{\"id\"", "x.json: line 1: "},
        {"\"id\": 0", "\"id\": 0, \"id\": 0", "x.json: line 1: duplicate object key"},
        {"640", "\"640\"", "camera 0: width, height, fx and fy must be numbers"},
        {"640", "0", "camera 0: width and height must be from 1 to 65536"},
        {"1.0, 2.0, 3.0", "1.0, 2.0", "camera 0: position must be three numbers"},
        {"1.0, 2.0, 3.0", "1.0, 2.0, 1e300", "camera 0: position is out of range"},
        {"[-1.0, 0.0, 0.0]", "[-1.0, 0.0]", "rotation must be three rows of three numbers"},
        {"[-1.0, 0.0, 0.0]", "[1.0, 0.0, 0.0]", "rotation is not a rotation matrix"},
        {"[-1.0, 0.0, 0.0]", "[-1.01, 0.0, 0.0]", "rotation is not a rotation matrix"},
        {"\"fx\": 500.0", "\"fx\": -500.0", "camera 0: "},
        {"\"id\": 0", "\"camera_model\": \"X\"", "camera_model must be the name of a"},
        {"\"id\": 0", "\"camera_model\": \"PINHOLE\"", "params must be the parameters of"},
        {"\"id\": 0", "\"camera_model\": \"PINHOLE\", \"params\": [1, 1, 1, 1]",
         "fx and fy must be those of params"},
        {"\"id\": 0", "\"exif_orientation\": 9", "exif_orientation must be an integer from 1"},
    };
    sgs_named_camera *cameras;
    size_t count;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        char text[1024];
        const char *at = strstr(original, cases[k].from);
        snprintf(text, sizeof text, "%.*s%s%s", (int)(at - original), original, cases[k].to,
                 at + strlen(cases[k].from));
        assert_int_equal(parse(text, &cameras, &count), SGS_STATUS_FORMAT);
        assert_true(!cameras && !count);
        if (strncmp(sgs_last_error(), "x.json: ", 8) != 0 ||
            !strstr(sgs_last_error(), cases[k].message))
            fail_msg("'%s' is not '%s'", sgs_last_error(), cases[k].message);
    }
    assert_int_equal(parse("[1]", &cameras, &count), SGS_STATUS_FORMAT);
    assert_int_equal(parse("", &cameras, &count), SGS_STATUS_FORMAT);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cameras_json_matches_3dgs),
        cmocka_unit_test(cameras_json_write_failure_keeps_the_old_file),
        cmocka_unit_test(invalid_cameras_are_named_with_the_reason),
        cmocka_unit_test(the_reader_inverts_the_writer),
        cmocka_unit_test(cameras_of_3dgs_are_pinholes),
        cmocka_unit_test(a_byte_order_mark_is_skipped),
        cmocka_unit_test(invalid_files_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
