// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// COLMAP models: both formats give the same scene, and every kind of invalid model is rejected with
// file, position and reason.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "support/locale_support.h"
#include "support/bad_input.h"
#include "scene/colmap.h"
#include "scene/scene_find.h"
#include "support/scene_support.h"
#include "support/skip_support.h"

static const char *const kinds[2] = {"txt", "bin"};

// Statuses of an orderly failure.
static bool orderly(sgs_status status)
{
    return status == SGS_STATUS_OK || status == SGS_STATUS_FORMAT ||
           status == SGS_STATUS_UNSUPPORTED || status == SGS_STATUS_OUT_OF_MEMORY;
}

static temp_folder whole_model(bool binary)
{
    const model m = model_make();
    const temp_folder folder = temp_folder_make();
    model_put(&folder, "", &m, binary);
    return folder;
}

// Asserts that the model is rejected with this status and message. Removes it.
static void assert_refused(const temp_folder *folder, size_t number, sgs_status status,
                           const char *message)
{
    sgsi_dataset d;
    if (sgsi_colmap_read(folder->path, &d) != status)
        fail_msg("case %zu (%s): %s", number, message, sgs_last_error());
    assert_holds(sgs_last_error(), message);
    bad_input();
    tree_remove(folder);
}

static void assert_equals_model(const sgsi_dataset *d, const model *m)
{
    assert_int_equal(d->frame_count, m->image_count);
    assert_int_equal(d->point_count, m->point_count);
    for (int i = 0; i < m->image_count; ++i) {
        const sgsi_frame *frame = &d->frames[i];
        sgs_pose pose;
        assert_string_equal(frame->name, m->images[i].name);
        assert_int_equal(sgs_pose_from_quaternion(m->images[i].pose, m->images[i].pose + 4, &pose),
                         SGS_STATUS_OK);
        assert_memory_equal(&frame->pose, &pose, sizeof pose);
        for (int k = 0; k < m->camera_count; ++k) {
            const model_camera *camera = &m->cameras[k];
            if (camera->id != m->images[i].camera)
                continue;
            assert_int_equal(frame->camera.model, camera->model);
            assert_int_equal(frame->camera.width, camera->width);
            assert_int_equal(frame->camera.height, camera->height);
            assert_memory_equal(frame->camera.params, camera->params, sizeof camera->params);
        }
    }
    for (int i = 0; i < m->point_count; ++i) {
        for (int k = 0; k < 3; ++k) {
            assert_true(d->points[3 * i + k] == (float)m->points[i].xyz[k]);
            assert_int_equal(d->colors[3 * i + k], m->points[i].rgb[k]);
        }
    }
}

static void both_formats_hold_the_model_exactly(void **state)
{
    (void)state;
    const model m = model_make();
    for (int binary = 0; binary < 2; ++binary) {
        const temp_folder folder = temp_folder_make();
        model_put(&folder, "", &m, binary);
        sgsi_dataset d;
        assert_true(sgsi_colmap_present(folder.path));
        assert_int_equal(sgsi_colmap_image_count(folder.path), MODEL_IMAGES);
        assert_int_equal(sgsi_colmap_read(folder.path, &d), SGS_STATUS_OK);
        assert_int_equal(d.format, binary ? SGS_SCENE_COLMAP_BINARY : SGS_SCENE_COLMAP_TEXT);
        assert_equals_model(&d, &m);
        assert_string_equal(warnings, "");
        sgsi_dataset_free(&d);
        tree_remove(&folder);
    }
}

static void binary_is_preferred_over_text(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    model m = model_make();
    model_put(&folder, "", &m, true);
    m.image_count = 1;
    model_put(&folder, "", &m, false);
    sgsi_dataset d;
    assert_int_equal(sgsi_colmap_read(folder.path, &d), SGS_STATUS_OK);
    assert_int_equal(d.frame_count, MODEL_IMAGES);
    sgsi_dataset_free(&d);
    tree_remove(&folder);
}

static void points_in_the_other_format_are_read(void **state)
{
    (void)state;
    const model m = model_make();
    for (int binary = 0; binary < 2; ++binary) {
        const temp_folder folder = temp_folder_make(), other = temp_folder_make();
        const char *kind = binary ? "points3D.txt" : "points3D.bin";
        char target[4096];
        model_put(&folder, "", &m, binary);
        model_put(&other, "", &m, !binary);
        unlink(temp_path(&folder, binary ? "points3D.bin" : "points3D.txt"));
        snprintf(target, sizeof target, "%s", temp_path(&folder, kind));
        assert_int_equal(rename(temp_path(&other, kind), target), 0);
        sgsi_dataset d;
        assert_int_equal(sgsi_colmap_read(folder.path, &d), SGS_STATUS_OK);
        assert_equals_model(&d, &m);
        assert_string_equal(warnings, "");
        sgsi_dataset_free(&d);
        tree_remove(&folder);
        tree_remove(&other);
    }
}

// ---- Contents invalid in both formats
// ------------------------------------------------------------

static char long_name[1200];

static void no_cameras(model *m)
{
    m->camera_count = 0;
}
static void no_images(model *m)
{
    m->image_count = 0;
}
static void no_width(model *m)
{
    m->cameras[0].width = 0;
}
static void no_height(model *m)
{
    m->cameras[1].height = 0;
}
static void wide(model *m)
{
    m->cameras[0].width = 65537;
}
static void huge(model *m)
{
    m->cameras[0].height = UINT64_MAX;
}
static void no_focal(model *m)
{
    m->cameras[1].params[0] = 0;
}
static void backward_focal(model *m)
{
    m->cameras[0].params[1] = -50;
}
static void nan_focal(model *m)
{
    m->cameras[0].params[0] = NAN;
}
static void infinite_focal(model *m)
{
    m->cameras[0].params[0] = INFINITY;
}
static void nan_distortion(model *m)
{
    m->cameras[2].params[11] = NAN;
}
static void wide_fov(model *m)
{
    m->cameras[0].model = SGS_CAMERA_FOV, m->cameras[0].params[4] = 4;
}
static void camera_twice(model *m)
{
    m->cameras[2].id = 7;
}
static void lost_camera(model *m)
{
    m->images[1].camera = 55;
}
static void zero_quaternion(model *m)
{
    memset(m->images[1].pose, 0, 4 * sizeof(double));
}
static void nan_quaternion(model *m)
{
    m->images[0].pose[2] = NAN;
}
static void infinite_quaternion(model *m)
{
    m->images[0].pose[0] = -INFINITY;
}
static void nan_translation(model *m)
{
    m->images[2].pose[5] = NAN;
}
static void infinite_translation(model *m)
{
    m->images[2].pose[6] = INFINITY;
}
static void image_twice(model *m)
{
    m->images[3].name = "b.png";
}
static void image_twice_spelled(model *m)
{
    m->images[3].name = "./sub//c.png";
}
static void parent_name(model *m)
{
    m->images[1].name = "../a.png";
}
static void hidden_parent_name(model *m)
{
    m->images[1].name = "x/../../a.png";
}
static void windows_parent_name(model *m)
{
    m->images[1].name = "x\\..\\a.png";
}
static void absolute_name(model *m)
{
    m->images[1].name = "/etc/passwd";
}
static void drive_name(model *m)
{
    m->images[1].name = "C:\\a.png";
}
static void bare_dot_name(model *m)
{
    m->images[1].name = "./";
}
static void control_name(model *m)
{
    m->images[1].name = "a\033[31m.png";
}
static void endless_name(model *m)
{
    m->images[1].name = memset(long_name, 'x', sizeof long_name - 1);
}

// `binary` and `text`: expected positions, NULL if the message has none.
static const struct {
    void (*edit)(model *);
    const char *file, *binary, *text, *message;
} wrong_contents[] = {
    {no_cameras, "cameras", NULL, NULL, "contains no cameras; rerun COLMAP's mapper"},
    {no_images, "images", NULL, NULL, "contains no registered images; rerun COLMAP's mapper"},
    {no_width, "cameras", "byte 8", "line 4",
     "camera 7 has size 0 x 48, not within 1 to 65536 pixels"},
    {no_height, "cameras", "byte 96", "line 5", "camera 2 has size 64 x 0"},
    {wide, "cameras", "byte 8", "line 4", "camera 7 has size 65537 x 48"},
    {huge, "cameras", "byte 8", "line 4", "camera 7 has size 64 x 18446744073709551615"},
    {no_focal, "cameras", "byte 96", "line 5",
     "camera 2: focal length 0 of the SIMPLE_PINHOLE camera is not positive"},
    {backward_focal, "cameras", "byte 8", "line 4",
     "camera 7: focal length -50 of the OPENCV camera"},
    {nan_focal, "cameras", "byte 8", "line 4",
     "camera 7: parameter 1 of the OPENCV camera is not finite; recalibrate"},
    {infinite_focal, "cameras", "byte 8", "line 4",
     "camera 7: parameter 1 of the OPENCV camera is not finite"},
    {nan_distortion, "cameras", "byte 144", "line 6",
     "camera 9: parameter 12 of the FULL_OPENCV camera is not finite"},
    {wide_fov, "cameras", "byte 8", "line 4",
     "camera 7: field-of-view parameter 4 of the FOV camera"},
    {camera_twice, "cameras", "byte 144", "line 6", "duplicate camera id 7, first used at"},
    {lost_camera, "images", "byte 134", "line 5",
     "image 1 'a.png' refers to camera 55, which is missing in the cameras file"},
    {zero_quaternion, "images", "byte 134", "line 5",
     "image 1 'a.png': the rotation quaternion has norm 0; remove"},
    {nan_quaternion, "images", "byte 8", "line 3",
     "image 4 'b.png': the rotation quaternion is not finite"},
    {infinite_quaternion, "images", "byte 8", "line 3",
     "image 4 'b.png': the rotation quaternion is not finite"},
    {nan_translation, "images", "byte 212", "line 7",
     "image 3 'sub/c.png': the translation is not finite"},
    {infinite_translation, "images", "byte 212", "line 7",
     "image 3 'sub/c.png': the translation is not finite"},
    {image_twice, "images", "byte 318", "line 9", "duplicate image name 'b.png', first used at"},
    {image_twice_spelled, "images", "byte 318", "line 9",
     "duplicate image name 'sub/c.png', first used at"},
    {parent_name, "images", "byte 134", "line 5",
     "the name of image 1 leaves the image folder ('../a.png')"},
    {hidden_parent_name, "images", "byte 134", "line 5",
     "leaves the image folder ('x/../../a.png')"},
    {windows_parent_name, "images", "byte 134", "line 5", "leaves the image folder"},
    {absolute_name, "images", "byte 134", "line 5", "is an absolute path ('/etc/passwd')"},
    {drive_name, "images", "byte 134", "line 5", "is an absolute path"},
    {bare_dot_name, "images", "byte 134", "line 5", "the name of image 1 is empty"},
    {control_name, "images", "byte 134", "line 5", "contains control characters ('not shown')"},
    {endless_name, "images", "byte 134", "line 5", "is longer than 1024 bytes"},
};

static void invalid_content_is_rejected_in_both_formats(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof wrong_contents / sizeof *wrong_contents; ++i) {
        for (int binary = 0; binary < 2; ++binary) {
            const temp_folder folder = temp_folder_make();
            model m = model_make();
            wrong_contents[i].edit(&m);
            model_put(&folder, "", &m, binary);
            sgsi_dataset d;
            if (sgsi_colmap_read(folder.path, &d) != SGS_STATUS_FORMAT)
                fail_msg("case %zu (%s) is not refused", i, wrong_contents[i].message);
            const char *place = binary ? wrong_contents[i].binary : wrong_contents[i].text;
            char start[512];
            snprintf(start, sizeof start, "%s/%s.%s: %s%s", folder.path, wrong_contents[i].file,
                     kinds[binary], place ? place : "", place ? ": " : "");
            assert_memory_equal(sgs_last_error(), start, strlen(start));
            assert_holds(sgs_last_error(), wrong_contents[i].message);
            bad_input();
            assert_null(d.frames);
            tree_remove(&folder);
        }
    }
}

static void nonfinite_points_are_dropped_and_counted(void **state)
{
    (void)state;
    for (int binary = 0; binary < 2; ++binary) {
        const temp_folder folder = temp_folder_make();
        model m = model_make();
        warnings_begin(state);
        m.points[1].xyz[0] = NAN;
        m.points[2].xyz[2] = -INFINITY;
        m.points[4].xyz[1] = 1e300; // out of range for float
        model_put(&folder, "", &m, binary);
        sgsi_dataset d;
        assert_int_equal(sgsi_colmap_read(folder.path, &d), SGS_STATUS_OK);
        assert_int_equal(d.point_count, 2);
        assert_true(d.points[3] == 1 && d.points[4] == 2 && d.points[5] == 3 && d.colors[3] == 9);
        assert_holds(warnings, binary ? "points3D.bin: byte 75: dropped 3 non-finite point(s)"
                                      : "points3D.txt: line 4: dropped 3 non-finite point(s)");
        sgsi_dataset_free(&d);
        tree_remove(&folder);
    }
}

static void models_without_points_are_read(void **state)
{
    (void)state;
    for (int binary = 0; binary < 2; ++binary) {
        const temp_folder folder = temp_folder_make();
        model m = model_make();
        warnings_begin(state);
        m.point_count = 0;
        model_put(&folder, "", &m, binary);
        sgsi_dataset d;
        assert_int_equal(sgsi_colmap_read(folder.path, &d), SGS_STATUS_OK);
        assert_int_equal(d.point_count, 0);
        assert_string_equal(warnings, "");
        sgsi_dataset_free(&d);
        unlink(temp_path(&folder, binary ? "points3D.bin" : "points3D.txt"));
        assert_int_equal(sgsi_colmap_read(folder.path, &d), SGS_STATUS_OK);
        assert_holds(warnings, binary ? "no points3D.bin" : "no points3D.txt");
        sgsi_dataset_free(&d);
        tree_remove(&folder);
    }
}

// ---- Damaged bytes ------------------------------------------------------------------------------

// Overwrites `size` bytes at `offset` of a valid model's file with `value`.
static const struct {
    const char *file;
    size_t offset;
    int size;
    uint64_t value;
    sgs_status status;
    const char *message;
} damages[] = {
    {"cameras.bin", 0, 8, 4, SGS_STATUS_FORMAT,
     "cameras.bin: byte 264: unexpected end of file in a camera"},
    {"cameras.bin", 0, 8, 7, SGS_STATUS_FORMAT,
     "byte 0: declares 7 cameras, but the remaining 256 bytes can hold at most 6"},
    {"cameras.bin", 0, 8, UINT64_MAX, SGS_STATUS_FORMAT,
     "byte 0: declares 18446744073709551615 cameras"},
    {"cameras.bin", 12, 4, 18, SGS_STATUS_UNSUPPORTED,
     "cameras.bin: byte 12: unknown camera model '18'; supported: COLMAP's models 0 to 10, "
     "SIMPLE_FISHEYE (14), FISHEYE (15) and EQUIRECTANGULAR (17)"},
    {"cameras.bin", 100, 4, 11, SGS_STATUS_UNSUPPORTED,
     "byte 100: camera model RAD_TAN_THIN_PRISM_FISHEYE (11) is not supported; supported:"},
    {"cameras.bin", 12, 4, 12, SGS_STATUS_UNSUPPORTED, "camera model SIMPLE_DIVISION (12) is"},
    {"cameras.bin", 12, 4, 13, SGS_STATUS_UNSUPPORTED, "camera model DIVISION (13) is not"},
    {"cameras.bin", 12, 4, 16, SGS_STATUS_UNSUPPORTED, "camera model EUCM (16) is not supported"},
    {"cameras.bin", 12, 4, 17, SGS_STATUS_FORMAT,
     "the parameters 50.5 x 51.25 of EQUIRECTANGULAR are not the size 64 x 48 of the image"},
    {"cameras.bin", 12, 4, UINT32_MAX, SGS_STATUS_UNSUPPORTED,
     "byte 12: unknown camera model '-1'"},
    {"cameras.bin", 12, 4, SGS_CAMERA_EQUIRECTANGULAR, SGS_STATUS_UNSUPPORTED,
     "byte 12: unknown camera model '100'"},
    {"images.bin", 0, 8, 100, SGS_STATUS_FORMAT, "images.bin: byte 0: declares 100 images"},
    {"images.bin", 0, 8, (uint64_t)1 << 60, SGS_STATUS_FORMAT,
     "byte 0: declares 1152921504606846976 images"},
    {"images.bin", 0, 8, 5, SGS_STATUS_FORMAT, "unexpected end of file in an image"},
    {"images.bin", 78, 8, 1000, SGS_STATUS_FORMAT,
     "byte 78: image 4 declares 1000 2-D points, but only"},
    {"images.bin", 78, 8, UINT64_MAX / 24 + 2, SGS_STATUS_FORMAT,
     "byte 78: image 4 declares 768614336404564652 2-D"},
    {"images.bin", 72, 1, 0, SGS_STATUS_FORMAT,
     "byte 73: image 4 declares"}, // an empty name shifts the following fields
    {"images.bin", 73, 1, '\n', SGS_STATUS_FORMAT,
     "byte 8: the name of image 4 contains control characters"},
    {"points3D.bin", 0, 8, 1000000, SGS_STATUS_FORMAT,
     "points3D.bin: byte 0: declares 1000000 points"},
    {"points3D.bin", 0, 8, 6, SGS_STATUS_FORMAT,
     "declares 6 points, but the remaining 303 bytes can hold at most 5"},
    {"points3D.bin", 51, 8, 1 << 20, SGS_STATUS_FORMAT,
     "byte 51: point 10 declares a track of 1048576 images"},
    {"points3D.bin", 51, 8, (uint64_t)1 << 61, SGS_STATUS_FORMAT,
     "byte 51: point 10 declares a track of 2305843009"},
};

static void damaged_counts_and_models_are_rejected(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof damages / sizeof *damages; ++i) {
        const temp_folder folder = whole_model(true);
        size_t size;
        unsigned char *bytes = file_get(temp_path(&folder, damages[i].file), &size);
        for (int k = 0; k < damages[i].size; ++k)
            bytes[damages[i].offset + (size_t)k] = (unsigned char)(damages[i].value >> (8 * k));
        file_put(temp_path(&folder, damages[i].file), bytes, size);
        free(bytes);
        assert_refused(&folder, i, damages[i].status, damages[i].message);
    }
}

static void too_small_counts_are_reported(void **state)
{
    (void)state;
    const temp_folder folder = whole_model(true);
    size_t size;
    unsigned char *bytes = file_get(temp_path(&folder, "images.bin"), &size);
    bytes[0] = 3;
    file_put(temp_path(&folder, "images.bin"), bytes, size);
    free(bytes);
    sgsi_dataset d;
    assert_int_equal(sgsi_colmap_read(folder.path, &d), SGS_STATUS_OK);
    assert_int_equal(d.frame_count, 3);
    assert_holds(warnings, "images.bin: byte 318: ignored 162 bytes after the last record");
    sgsi_dataset_free(&d);
    tree_remove(&folder);
}

static const char *const files[2][3] = {{"cameras.txt", "images.txt", "points3D.txt"},
                                        {"cameras.bin", "images.bin", "points3D.bin"}};

static void truncated_binary_files_are_rejected(void **state)
{
    (void)state;
    const temp_folder folder = whole_model(true);
    for (int f = 0; f < 3; ++f) {
        size_t size;
        unsigned char *bytes = file_get(temp_path(&folder, files[1][f]), &size);
        for (size_t length = 0; length < size; ++length) {
            sgsi_dataset d;
            file_put(temp_path(&folder, files[1][f]), bytes, length);
            if (sgsi_colmap_read(folder.path, &d) != SGS_STATUS_FORMAT)
                fail_msg("%s cut at byte %zu is not refused: %s", files[1][f], length,
                         sgs_last_error());
            assert_holds(sgs_last_error(), files[1][f]);
            assert_holds(sgs_last_error(), ": byte ");
        }
        file_put(temp_path(&folder, files[1][f]), bytes, size);
        free(bytes);
    }
    tree_remove(&folder);
}

static void truncated_text_files_are_handled(void **state)
{
    (void)state;
    const temp_folder folder = whole_model(false);
    for (int f = 0; f < 3; ++f) {
        size_t size;
        unsigned char *bytes = file_get(temp_path(&folder, files[0][f]), &size);
        for (size_t length = 0; length < size; ++length) {
            sgsi_dataset d;
            file_put(temp_path(&folder, files[0][f]), bytes, length);
            const sgs_status status = sgsi_colmap_read(folder.path, &d);
            assert_true(status == SGS_STATUS_OK || status == SGS_STATUS_FORMAT ||
                        status == SGS_STATUS_UNSUPPORTED);
            assert_true(d.frame_count <= MODEL_IMAGES && d.point_count <= MODEL_POINTS);
            if (status)
                assert_holds(sgs_last_error(), f == 0 && length > 120 ? "s.txt: " : files[0][f]);
            sgsi_dataset_free(&d);
        }
        file_put(temp_path(&folder, files[0][f]), bytes, size);
        free(bytes);
    }
    tree_remove(&folder);
}

static void any_damaged_byte_is_handled(void **state)
{
    (void)state;
    static const unsigned char values[] = {0x00, 0xff, 0x7f, '\n', '-'};
    const temp_folder folder = whole_model(true);
    for (int f = 0; f < 3; ++f) {
        size_t size;
        unsigned char *bytes = file_get(temp_path(&folder, files[1][f]), &size);
        for (size_t at = 0; at < size * sizeof values; ++at) {
            const unsigned char kept = bytes[at / sizeof values];
            bytes[at / sizeof values] = values[at % sizeof values];
            file_put(temp_path(&folder, files[1][f]), bytes, size);
            bytes[at / sizeof values] = kept;
            sgsi_dataset d;
            assert_true(orderly(sgsi_colmap_read(folder.path, &d)));
            sgsi_dataset_free(&d);
        }
        file_put(temp_path(&folder, files[1][f]), bytes, size);
        free(bytes);
    }
    tree_remove(&folder);
}

static void any_failing_allocation_is_reported(void **state)
{
    (void)state;
    const model m = model_make();
    for (int binary = 0; binary < 2; ++binary) {
        const temp_folder folder = temp_folder_make();
        model_put(&folder, "", &m, binary);
        sgs_status status = SGS_STATUS_OUT_OF_MEMORY;
        for (size_t n = 1; n < 200 && status; ++n) {
            sgsi_dataset d;
            sgsi_fail_allocation(n);
            status = sgsi_colmap_read(folder.path, &d);
            sgsi_fail_allocation(0);
            assert_true(status == SGS_STATUS_OK || status == SGS_STATUS_OUT_OF_MEMORY);
            sgsi_dataset_free(&d);
        }
        assert_int_equal(status, SGS_STATUS_OK);
        tree_remove(&folder);
    }
}

// ---- Text ---------------------------------------------------------------------------------------

static const struct {
    const char *file, *content;
    sgs_status status;
    const char *message;
} wrong_texts[] = {
    {"cameras.txt", "", SGS_STATUS_FORMAT, "cameras.txt: contains no cameras"},
    {"cameras.txt", "# only\n\n   # comments\n", SGS_STATUS_FORMAT,
     "cameras.txt: contains no cameras"},
    {"cameras.txt", "7\n", SGS_STATUS_FORMAT,
     "line 1: expected CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]"},
    {"cameras.txt", "x PINHOLE 64 48 1 1 1 1\n", SGS_STATUS_FORMAT, "line 1: expected CAMERA_ID"},
    {"cameras.txt", "-7 PINHOLE 64 48 1 1 1 1\n", SGS_STATUS_FORMAT, "line 1: expected CAMERA_ID"},
    {"cameras.txt", "4294967296 PINHOLE 64 48 1 1 1 1\n", SGS_STATUS_FORMAT,
     "line 1: expected CAMERA_ID"},
    {"cameras.txt", "\n7 MAGIC 64 48 1 1 1 1\n", SGS_STATUS_UNSUPPORTED,
     "line 2: unknown camera model 'MAGIC'"},
    {"cameras.txt", "7 pinhole 64 48 1 1 1 1\n", SGS_STATUS_UNSUPPORTED,
     "unknown camera model 'pinhole'"},
    {"cameras.txt", "7 EUCM 64 48 1 1 1 1 1 1\n", SGS_STATUS_UNSUPPORTED,
     "line 1: camera model EUCM (16) is not supported; supported: COLMAP's models 0 to 10"},
    {"cameras.txt", "7 FISHEYE 64 48 1 1 1\n", SGS_STATUS_FORMAT,
     "FISHEYE requires exactly 4 parameters"},
    {"cameras.txt", "7 EQUIRECTANGULAR 64 48 64 nan\n", SGS_STATUS_FORMAT,
     "line 1: camera 7: the parameters 64 x nan of EQUIRECTANGULAR are not the size 64 x 48"},
    {"cameras.txt", "7 PINHOLE 64.5 48 1 1 1 1\n", SGS_STATUS_FORMAT, "line 1: expected CAMERA_ID"},
    {"cameras.txt", "7 PINHOLE 99999999999999999999 48 1 1 1 1\n", SGS_STATUS_FORMAT,
     "line 1: expected"},
    {"cameras.txt", "7 PINHOLE 64 48 1 1 1\n", SGS_STATUS_FORMAT,
     "PINHOLE requires exactly 4 parameters"},
    {"cameras.txt", "7 PINHOLE 64 48 1 1 1 1 1\n", SGS_STATUS_FORMAT,
     "PINHOLE requires exactly 4 parameters"},
    {"cameras.txt", "7 PINHOLE 64 48 1 1 1 1x\n", SGS_STATUS_FORMAT,
     "PINHOLE requires exactly 4 parameters"},
    {"images.txt", "# nothing\n", SGS_STATUS_FORMAT, "images.txt: contains no registered images"},
    {"images.txt", "1 1 0 0 0 0 0 0 7 a.png\n\n2 1 0 0 0 0 0 0 7\n", SGS_STATUS_FORMAT,
     "line 3: expected IMAGE_ID"},
    {"images.txt", "1 1 0 0 zero 0 0 0 7 a.png\n", SGS_STATUS_FORMAT,
     "line 1: expected IMAGE_ID QW QX QY QZ"},
    {"images.txt", "1 1 0 0 0 0 0 0 seven a.png\n", SGS_STATUS_FORMAT, "line 1: expected IMAGE_ID"},
    {"images.txt", "1 1 0 0 0 0 0 0 7 a.png\n2 1 0 0 0 0 0 0 7 b.png\n", SGS_STATUS_FORMAT,
     "line 2: expected X Y POINT3D_ID ... (the second line of every image"},
    {"images.txt", "1 1 0 0 0 0 0 0 7 a.png\n2 1 0 0 0 0 0 0 7 two blanks in.png\n",
     SGS_STATUS_FORMAT, "line 2: expected X Y POINT3D_ID"},
    {"images.txt", "1 1 0 0 0 0 0 0 7 a.png\n1 2 3 4\n", SGS_STATUS_FORMAT,
     "line 2: expected X Y POINT3D_ID"},
    {"images.txt", "1 nan 0 0 0 0 0 0 7 a.png\n\n", SGS_STATUS_FORMAT,
     "line 1: image 1 'a.png': the rotation"},
    {"points3D.txt", "1 0 0\n", SGS_STATUS_FORMAT,
     "points3D.txt: line 1: expected POINT3D_ID X Y Z R G B"},
    {"points3D.txt", "1 0 0 0 1 2 256 0.1\n", SGS_STATUS_FORMAT, "line 1: expected POINT3D_ID"},
    {"points3D.txt", "1 0 0 0 1 2 -3 0.1\n", SGS_STATUS_FORMAT, "line 1: expected POINT3D_ID"},
    {"points3D.txt", "1 0 0 0 1 2 3\n", SGS_STATUS_FORMAT, "line 1: expected POINT3D_ID"},
    {"points3D.txt", "1 0 0,5 0 1 2 3 0.1\n", SGS_STATUS_FORMAT, "line 1: expected POINT3D_ID"},
};

static void invalid_lines_are_reported_with_their_number(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof wrong_texts / sizeof *wrong_texts; ++i) {
        const temp_folder folder = whole_model(false);
        tree_put_text(&folder, wrong_texts[i].file, wrong_texts[i].content);
        assert_refused(&folder, i, wrong_texts[i].status, wrong_texts[i].message);
    }
}

static void text_files_with_zero_bytes_are_rejected(void **state)
{
    (void)state;
    const temp_folder folder = whole_model(false);
    tree_put(&folder, "points3D.txt", "1 0 0 0\0 1 2 3", 15);
    sgsi_dataset d;
    assert_int_equal(sgsi_colmap_read(folder.path, &d), SGS_STATUS_FORMAT);
    assert_holds(sgs_last_error(), "points3D.txt: byte 7: zero byte in a text file");
    bad_input();
    tree_remove(&folder);
}

static void text_with_bom_crlf_and_tabs_is_read(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    tree_put_text(&folder, "cameras.txt", "\xEF\xBB\xBF\t1\tPINHOLE 64  48 50 50 32 24 \r\n");
    tree_put_text(&folder, "images.txt",
                  "\xEF\xBB\xBF# two images\r\n1 1 0 0 0 0 0 0 1 a b.png\r\n\r\n2 1 0 0 0 0 0 0 1 "
                  "c.png\r\n1.5 2 -1 3 4 5\r\n");
    tree_put_text(&folder, "points3D.txt", "1 1 2 3 4 5 6 0.5\r\n");
    assert_int_equal(sgsi_colmap_image_count(folder.path), 2);
    sgsi_dataset d;
    assert_int_equal(sgsi_colmap_read(folder.path, &d), SGS_STATUS_OK);
    assert_int_equal(d.frame_count, 2);
    assert_string_equal(d.frames[0].name, "a b.png");
    assert_string_equal(d.frames[1].name, "c.png");
    assert_int_equal(d.point_count, 1);
    sgsi_dataset_free(&d);
    tree_remove(&folder);
}

static void wrong_record_count_in_text_header_is_reported(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    model m = model_make();
    model_put(&folder, "", &m, false);
    tree_put_text(&folder, "points3D.txt",
                  "# Number of points: 900, mean track length: 2\n1 1 2 3 4 5 6 0.5\n");
    sgsi_dataset d;
    assert_int_equal(sgsi_colmap_read(folder.path, &d), SGS_STATUS_OK);
    assert_holds(warnings, "points3D.txt: the header declares 900 points, but the file contains 1; "
                           "is the file complete?");
    sgsi_dataset_free(&d);
    tree_remove(&folder);
}

static void decimal_points_do_not_depend_on_the_locale(void **state)
{
    (void)state;
    const model m = model_make();
    const temp_folder folder = whole_model(false);
    if (!decimal_comma_set()) {
        tree_remove(&folder);
        skip_because("the system cannot make a locale");
    }
    sgsi_dataset d;
    const sgs_status status = sgsi_colmap_read(folder.path, &d);
    decimal_comma_unset();
    assert_int_equal(status, SGS_STATUS_OK);
    assert_equals_model(&d, &m);
    sgsi_dataset_free(&d);
    tree_remove(&folder);
}

static void names_find_photos_with_another_extension_or_without_one(void **state)
{
    (void)state;
    static const char *const names[][2] = {{"0001", "0001.jpg"},
                                           {"sub/0001", "sub/0001.PNG"},
                                           {"frame.7", "frame.7.jpg"}, // not frame.exr
                                           {"frame.jpg", "frame.exr"},
                                           {"frame.8", "frame.exr"},
                                           {"v.1/0001", "v.1/0001"}, // none
                                           {"0002", "0002"}};
    const temp_folder folder = temp_folder_make();
    static const char *const files[] = {"0001.jpg", "sub/0001.PNG", "frame.7.jpg", "frame.exr",
                                        "v.exr"};
    for (size_t k = 0; k < sizeof files / sizeof *files; ++k)
        tree_put_text(&folder, files[k], "");
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k) {
        char *path = sgsi_scene_image_path(folder.path, names[k][0]);
        assert_non_null(path);
        assert_string_equal(path + strlen(folder.path) + 1, names[k][1]);
        sgsi_free(path);
    }
    tree_remove(&folder);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup(both_formats_hold_the_model_exactly, warnings_begin),
        cmocka_unit_test_setup(binary_is_preferred_over_text, warnings_begin),
        cmocka_unit_test_setup(points_in_the_other_format_are_read, warnings_begin),
        cmocka_unit_test_setup(invalid_content_is_rejected_in_both_formats, warnings_begin),
        cmocka_unit_test_setup(nonfinite_points_are_dropped_and_counted, warnings_begin),
        cmocka_unit_test_setup(models_without_points_are_read, warnings_begin),
        cmocka_unit_test_setup(damaged_counts_and_models_are_rejected, warnings_begin),
        cmocka_unit_test_setup(too_small_counts_are_reported, warnings_begin),
        cmocka_unit_test_setup(truncated_binary_files_are_rejected, warnings_begin),
        cmocka_unit_test_setup(truncated_text_files_are_handled, warnings_begin),
        cmocka_unit_test_setup(any_damaged_byte_is_handled, warnings_begin),
        cmocka_unit_test_setup(any_failing_allocation_is_reported, warnings_begin),
        cmocka_unit_test_setup(invalid_lines_are_reported_with_their_number, warnings_begin),
        cmocka_unit_test_setup(text_files_with_zero_bytes_are_rejected, warnings_begin),
        cmocka_unit_test_setup(text_with_bom_crlf_and_tabs_is_read, warnings_begin),
        cmocka_unit_test_setup(wrong_record_count_in_text_header_is_reported, warnings_begin),
        cmocka_unit_test_setup(decimal_points_do_not_depend_on_the_locale, warnings_begin),
        cmocka_unit_test(names_find_photos_with_another_extension_or_without_one),
    };
    return cmocka_run_group_tests_name("colmap", tests, NULL, NULL);
}
