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

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cameras_json_matches_3dgs),
        cmocka_unit_test(cameras_json_write_failure_keeps_the_old_file),
        cmocka_unit_test(invalid_cameras_are_named_with_the_reason),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
