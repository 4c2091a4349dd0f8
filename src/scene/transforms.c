// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Camera files of the NeRF family: transforms_train.json / transforms_test.json of NeRF synthetic
// (Mildenhall et al. 2020) and transforms.json of nerfstudio and instant-ngp.
//
// transform_matrix is camera-to-world with OpenGL camera axes (x right, y up, z backward). Ours are
// x right, y down, z forward, so its second and third columns change sign; world axes are kept. A
// uniform scale of the matrix does not affect rays and is removed. Rounding errors of its rotation
// are repaired by polar decomposition; larger deviations from a rotation are errors.
//
// Intrinsics are global, per frame (these take precedence), or reduced to camera_angle_x and
// camera_angle_y; without w and h the photo's size completes these (see sgsi_frame). NeRF
// synthetic omits ".png" in file_path and composites its RGBA images over white. Errors count
// frames from 0, as JSON paths do.
//
// A panorama has no focal length: camera_model EQUIRECTANGULAR of nerfstudio, latlong of
// instant-ngp. Its centre is the camera axis, its upper row up. instant-ngp's equirectangular is
// another lens: its rows are spaced by the sine of the latitude.

#include "scene/transforms.h"

#include <ctype.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <jansson.h>

#include "base/core.h"
#include "base/path_sandbox.h"
#include "formats/point_cloud.h"
#include "rays/rotation.h"

enum { MAX_SIZE = 65536 };

#define TEST_FILE "transforms_test.json"
#define FRAME_EXTENSION ".png" // of a file_path without extension

enum key {
    KEY_W,
    KEY_H,
    KEY_FL_X,
    KEY_FL_Y,
    KEY_CX,
    KEY_CY,
    KEY_K1,
    KEY_K2,
    KEY_K3,
    KEY_K4,
    KEY_K5,
    KEY_K6,
    KEY_P1,
    KEY_P2,
    KEY_ANGLE_X,
    KEY_ANGLE_Y,
    KEY_COUNT
};

static const char *const key_names[KEY_COUNT] = {
    "w",  "h",  "fl_x",           "fl_y",          "cx", "cy", "k1", "k2", "k3", "k4", "k5", "k6",
    "p1", "p2", "camera_angle_x", "camera_angle_y"};

typedef struct intrinsics {
    double value[KEY_COUNT]; // NaN if absent
    const char *model;       // camera_model, NULL if absent
    bool fisheye;            // instant-ngp's is_fisheye
    bool panorama;           // instant-ngp's latlong
} intrinsics;

typedef struct reader {
    const char *path;
    char where[48]; // "frame 3" or "the global keys"
    sgsi_dataset *dataset;
    bool ignores_distortion; // warned
    bool ignores_intrinsics; // of a panorama; warned
} reader;

// Fails for keys of instant-ngp that select a lens which is not supported.
static sgs_status check_lens(const reader *r, const json_t *object)
{
    static const char *const keys[] = {"ftheta_p0", "equirectangular"};
    for (size_t i = 0; i < sizeof keys / sizeof *keys; ++i) {
        const json_t *value = json_object_get(object, keys[i]);
        if (value && !json_is_null(value) && !json_is_false(value))
            return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                             "%s: %s: the lens of '%s' is not supported; convert the images to "
                             "PINHOLE, OPENCV, OPENCV_FISHEYE or 'latlong'",
                             r->path, r->where, keys[i]);
    }
    return SGS_STATUS_OK;
}

// Sets the values that are present in `object`.
static sgs_status read_intrinsics(const reader *r, const json_t *object, intrinsics *out)
{
    for (int k = 0; k < KEY_COUNT; ++k) {
        const json_t *value = json_object_get(object, key_names[k]);
        if (!value || json_is_null(value))
            continue;
        if (!json_is_number(value) || !isfinite(json_number_value(value)))
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s: '%s' must be a number", r->path, r->where,
                             key_names[k]);
        out->value[k] = json_number_value(value);
    }
    const json_t *model = json_object_get(object, "camera_model");
    if (model && !json_is_string(model) && !json_is_null(model))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s: 'camera_model' must be a string", r->path,
                         r->where);
    if (json_is_string(model))
        out->model = json_string_value(model);
    out->fisheye = out->fisheye || json_is_true(json_object_get(object, "is_fisheye"));
    const json_t *panorama = json_object_get(object, "latlong");
    if (panorama && !json_is_null(panorama))
        out->panorama = !json_is_false(panorama);
    return check_lens(r, object);
}

static bool has_number(const json_t *object, enum key key)
{
    return json_is_number(json_object_get(object, key_names[key]));
}

// A field of view of a frame replaces global focal lengths, which would take precedence.
static void drop_global_focal(const json_t *object, intrinsics *out)
{
    static const enum key keys[] = {KEY_FL_X, KEY_FL_Y, KEY_ANGLE_X, KEY_ANGLE_Y};
    if (has_number(object, KEY_FL_X) || has_number(object, KEY_FL_Y) ||
        !(has_number(object, KEY_ANGLE_X) || has_number(object, KEY_ANGLE_Y)))
        return;
    for (size_t i = 0; i < sizeof keys / sizeof *keys; ++i)
        out->value[keys[i]] = NAN;
}

static double or_else(double value, double otherwise)
{
    return isnan(value) ? otherwise : value;
}

static sgs_status read_size(const reader *r, const intrinsics *in, sgs_camera *camera)
{
    const double w = in->value[KEY_W], h = in->value[KEY_H];
    if (isnan(w) && isnan(h))
        return SGS_STATUS_OK; // taken from the photo
    if (!(w >= 1 && w <= MAX_SIZE && h >= 1 && h <= MAX_SIZE))
        return sgsi_fail(
            SGS_STATUS_FORMAT,
            "%s: %s: image size w = %g, h = %g is not within 1 to %d pixels; correct or omit both",
            r->path, r->where, w, h, MAX_SIZE);
    camera->width = (int)lround(w);
    camera->height = (int)lround(h);
    return SGS_STATUS_OK;
}

#define PERSPECTIVE_MODELS                                                                         \
    "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, PERSPECTIVE, OPENCV, FULL_OPENCV"
#define FISHEYE_MODELS "SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, OPENCV_FISHEYE"

// True if `name` is one of the names in "A, B, C".
static bool is_listed(const char *name, const char *list)
{
    const size_t length = strlen(name);
    for (const char *at = list; length; at += 2) {
        const size_t end = strcspn(at, ",");
        if (end == length && !strncmp(at, name, length))
            return true;
        at += end;
        if (!*at)
            break;
    }
    return false;
}

// The first of these distortion coefficients that is not 0, or KEY_COUNT.
static enum key first_distortion(const intrinsics *in, enum key from, enum key to)
{
    for (enum key key = from; key <= to; ++key)
        if (or_else(in->value[key], 0) != 0)
            return key;
    return KEY_COUNT;
}

static sgs_status read_model(reader *r, const intrinsics *in, sgs_camera *camera)
{
    const double *v = in->value;
    const double k1 = or_else(v[KEY_K1], 0), k2 = or_else(v[KEY_K2], 0), k3 = or_else(v[KEY_K3], 0);
    const double k4 = or_else(v[KEY_K4], 0), p1 = or_else(v[KEY_P1], 0), p2 = or_else(v[KEY_P2], 0);
    double *p = camera->params;
    const char *model = in->model ? in->model : in->fisheye ? "OPENCV_FISHEYE" : "OPENCV";
    const bool fisheye = is_listed(model, FISHEYE_MODELS);
    const bool known = fisheye || is_listed(model, PERSPECTIVE_MODELS);
    camera->model = SGS_CAMERA_PINHOLE;
    if (!strcmp(model, "PINHOLE")) {
        if (first_distortion(in, KEY_K1, KEY_P2) != KEY_COUNT && !r->ignores_distortion) {
            sgsi_warn("%s: %s: camera model PINHOLE has no distortion; k1 to k6, p1 and p2 are "
                      "ignored; use OPENCV if the images are distorted",
                      r->path, r->where);
            r->ignores_distortion = true;
        }
        return SGS_STATUS_OK;
    }
    // The rational model has k4 to k6 in its denominator.
    const enum key excess = !known || !strcmp(model, "FULL_OPENCV")
                                ? KEY_COUNT
                                : first_distortion(in, fisheye ? KEY_K5 : KEY_K4, KEY_K6);
    if (in->panorama) // of instant-ngp; the model is another one
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s: 'latlong' contradicts camera model '%.64s'; remove one of them",
                         r->path, r->where, model);
    if (!known)
        return sgsi_fail(
            SGS_STATUS_UNSUPPORTED,
            "%s: %s: camera model '%.64s' is not supported; supported: " PERSPECTIVE_MODELS
            ", " FISHEYE_MODELS ", EQUIRECTANGULAR; undistort the images or use one of these",
            r->path, r->where, model);
    if (excess != KEY_COUNT)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED, "%s: %s: camera model '%.64s' has no %s; %s",
                         r->path, r->where, model, key_names[excess],
                         fisheye ? "undistort the images" : "use FULL_OPENCV");
    p[4] = k1;
    p[5] = k2;
    if (fisheye) {
        // As in nerfstudio, p1 and p2 act on the angle, too: a thin prism lens without prism.
        const bool tangential = p1 != 0 || p2 != 0;
        camera->model = tangential ? SGS_CAMERA_THIN_PRISM_FISHEYE : SGS_CAMERA_OPENCV_FISHEYE;
        p[6] = tangential ? p1 : k3;
        p[7] = tangential ? p2 : k4;
        p[8] = tangential ? k3 : 0;
        p[9] = tangential ? k4 : 0;
        return SGS_STATUS_OK;
    }
    p[6] = p1;
    p[7] = p2;
    p[8] = k3; // without k4 to k6 the denominator is 1
    p[9] = k4;
    p[10] = or_else(v[KEY_K5], 0);
    p[11] = or_else(v[KEY_K6], 0);
    camera->model = first_distortion(in, KEY_K3, KEY_K6) != KEY_COUNT   ? SGS_CAMERA_FULL_OPENCV
                    : first_distortion(in, KEY_K1, KEY_P2) != KEY_COUNT ? SGS_CAMERA_OPENCV
                                                                        : SGS_CAMERA_PINHOLE;
    return SGS_STATUS_OK;
}

#define PANORAMA "EQUIRECTANGULAR"

static bool is_panorama(const intrinsics *in)
{
    return in->model ? !strcmp(in->model, PANORAMA) : in->panorama;
}

// nerfstudio writes w/2, h, w/2 and h/2 as fl_x, fl_y, cx and cy of a full panorama. Without a
// size, none is known to be one of these.
static bool is_of_panorama(const intrinsics *in, const sgs_camera *camera)
{
    static const enum key keys[] = {KEY_FL_X, KEY_FL_Y, KEY_CX, KEY_CY};
    const double full[] = {0.5 * camera->width, camera->height, 0.5 * camera->width,
                           0.5 * camera->height};
    bool is = true;
    for (size_t i = 0; i < sizeof keys / sizeof *keys; ++i) {
        const double value = in->value[keys[i]];
        is = is && (isnan(value) || (camera->width && fabs(value - full[i]) <= 1.0));
    }
    return is;
}

// Without a size, the photo completes the camera.
static sgs_status read_panorama(reader *r, const intrinsics *in, sgs_camera *camera)
{
    *camera = sgs_camera_equirectangular(camera->width, camera->height);
    const bool fits =
        is_of_panorama(in, camera) && first_distortion(in, KEY_K1, KEY_P2) == KEY_COUNT;
    if (!fits && !r->ignores_intrinsics)
        sgsi_warn("%s: %s: an image of " PANORAMA " shows all directions; focal length, principal "
                  "point and distortion are ignored; correct the images if they show less",
                  r->path, r->where);
    r->ignores_intrinsics |= !fits;
    return SGS_STATUS_OK;
}

// Focal length from a field of view; NaN if the angle is absent.
static sgs_status focal_of_angle(const reader *r, const intrinsics *in, enum key key, int size,
                                 double *focal)
{
    const double angle = in->value[key];
    *focal = NAN;
    if (isnan(angle))
        return SGS_STATUS_OK;
    if (!(angle > 0 && angle < 3.14159))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s: '%s' is %g, not an angle between 0 and pi radians", r->path,
                         r->where, key_names[key], angle);
    if (size > 0)
        *focal = 0.5 * size / tan(0.5 * angle);
    return SGS_STATUS_OK;
}

static sgs_status read_camera(reader *r, const intrinsics *in, sgsi_frame *frame)
{
    sgs_camera *camera = &frame->camera;
    double from_x, from_y;
    sgs_status status = read_size(r, in, camera);
    if (!status && is_panorama(in))
        return read_panorama(r, in, camera);
    if (!status)
        status = read_model(r, in, camera);
    if (!status)
        status = focal_of_angle(r, in, KEY_ANGLE_X, camera->width, &from_x);
    if (!status)
        status = focal_of_angle(r, in, KEY_ANGLE_Y, camera->height, &from_y);
    if (status)
        return status;
    const double fl_x = in->value[KEY_FL_X], fl_y = in->value[KEY_FL_Y];
    double *p = camera->params;
    if (sgs_camera_is_fisheye(camera->model))
        from_x = from_y = NAN; // distortion of the angle: no simple relation to the focal length
    p[0] = or_else(fl_x, or_else(from_x, or_else(fl_y, from_y)));
    p[1] = or_else(fl_y, isnan(fl_x) ? or_else(from_y, p[0]) : fl_x);
    if (camera->width == 0 && isnan(fl_x) && !sgs_camera_is_fisheye(camera->model)) {
        frame->angle_x = or_else(in->value[KEY_ANGLE_X], 0); // completed by the photo's size
        frame->angle_y = isnan(fl_y) ? or_else(in->value[KEY_ANGLE_Y], 0) : 0;
    }
    if (isnan(p[0]) && sgs_camera_is_fisheye(camera->model))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s: no focal length of the fisheye lens, which 'camera_angle_x' does "
                         "not define; add 'fl_x' (pixels)",
                         r->path, r->where);
    if (isnan(p[0]) && !(frame->angle_x > 0 || frame->angle_y > 0))
        return sgsi_fail(
            SGS_STATUS_FORMAT,
            "%s: %s: no focal length; add 'fl_x' (pixels) or 'camera_angle_x' (radians)", r->path,
            r->where);
    p[2] = or_else(in->value[KEY_CX], camera->width ? 0.5 * camera->width : NAN);
    p[3] = or_else(in->value[KEY_CY], camera->width ? 0.5 * camera->height : NAN);
    if (camera->width && sgs_camera_validate(camera))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s: %s; correct the intrinsics", r->path, r->where,
                         sgs_last_error());
    return SGS_STATUS_OK;
}

// Removes a uniform scale and replaces m by the nearest rotation. Returns false if m differs by
// more than two percent from a scaled rotation.
static bool make_rotation(double m[9])
{
    double cofactors[9];
    const double scale = cbrt(sgsi_determinant(m, cofactors));
    if (!(scale > 0) || !isfinite(scale))
        return false;
    for (int i = 0; i < 9; ++i)
        m[i] /= scale;
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) {
            const double dot = m[i] * m[j] + m[3 + i] * m[3 + j] + m[6 + i] * m[6 + j];
            if (!(fabs(dot - (i == j)) <= 0.02))
                return false;
        }
    }
    sgsi_nearest_rotation(m);
    return true;
}

// The fourth row is (0, 0, 0, 1). Column-major matrices have the position there, and no other
// symptom: all cameras would be at the origin.
static sgs_status check_last_row(const reader *r, const json_t *row)
{
    double value[4] = {0};
    for (size_t j = 0; j < 4; ++j)
        value[j] = json_number_value(json_array_get(row, j));
    if (fabs(value[0]) <= 1e-3 && fabs(value[1]) <= 1e-3 && fabs(value[2]) <= 1e-3)
        return SGS_STATUS_OK;
    return sgsi_fail(
        SGS_STATUS_FORMAT,
        "%s: %s: last row of 'transform_matrix' is (%g, %g, %g, %g), not (0, 0, 0, 1); "
        "transpose column-major matrices",
        r->path, r->where, value[0], value[1], value[2], value[3]);
}

static sgs_status read_pose(const reader *r, const json_t *object, sgs_pose *pose)
{
    const json_t *rows = json_object_get(object, "transform_matrix");
    const size_t row_count = json_array_size(rows); // 0 if not an array
    bool ok = row_count == 3 || row_count == 4;
    double m[3][4] = {{0}};
    for (size_t i = 0; i < 3 && ok; ++i) {
        const json_t *row = json_array_get(rows, i);
        ok = json_array_size(row) == 4;
        for (size_t j = 0; j < 4 && ok; ++j) {
            ok = json_is_number(json_array_get(row, j));
            m[i][j] = json_number_value(json_array_get(row, j));
        }
    }
    if (!ok)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s: 'transform_matrix' must be 4 rows (or 3) of 4 numbers", r->path,
                         r->where);
    const sgs_status status = check_last_row(r, json_array_get(rows, 3));
    if (status)
        return status;
    double rotation[9];
    for (int i = 0; i < 3; ++i) {
        rotation[3 * i] = m[i][0];
        rotation[3 * i + 1] = -m[i][1];
        rotation[3 * i + 2] = -m[i][2];
    }
    double cofactors[9];
    if (sgsi_determinant(rotation, cofactors) < 0)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s: 'transform_matrix' is mirrored; convert left-handed cameras to "
                         "right-handed ones with x right, y up, z backward",
                         r->path, r->where);
    if (!make_rotation(rotation))
        return sgsi_fail(
            SGS_STATUS_FORMAT,
            "%s: %s: 'transform_matrix' contains no rotation; export the cameras again", r->path,
            r->where);
    for (int i = 0; i < 3; ++i) {
        double t = 0;
        for (int j = 0; j < 3; ++j) {
            pose->rotation[3 * i + j] = rotation[3 * j + i];
            t -= rotation[3 * j + i] * m[j][3];
        }
        pose->translation[i] = t;
    }
    return SGS_STATUS_OK;
}

// Replaces the file name of `path` by `name`.
static char *sibling_path(const char *path, const char *name)
{
    const char *slash = strrchr(path, '/');
    return sgsi_format("%.*s%s", slash ? (int)(slash + 1 - path) : 0, path, name);
}

// The name of the photo that the JSON file names, as a new string, or NULL without memory.
// *problem: why it is no name, see sgsi_image_name_clean, or NULL. NeRF synthetic omits the
// extension, so a name without the extension of an image gets one, unless there is a file of this
// name.
static char *image_name(const char *json_path, const char *file, const char **problem)
{
    char *name = sgsi_strdup(file);
    *problem = name ? sgsi_image_name_clean(name) : NULL;
    if (!name || *problem || sgsi_image_name_has_format(name))
        return name;
    char *as_written = sibling_path(json_path, name);
    char *extended = as_written ? sgsi_format("%s" FRAME_EXTENSION, name) : NULL;
    const bool keeps = as_written && sgsi_is_file(as_written);
    sgsi_free(as_written);
    sgsi_free(keeps ? extended : name);
    if (keeps)
        return name;
    *problem = extended ? sgsi_image_name_clean(extended) : NULL; // its length
    return extended;
}

// Reads the path under `key`, relative to the JSON file's folder.
static sgs_status read_path(const reader *r, const json_t *object, const char *key, bool is_photo,
                            char **path)
{
    const char *file = json_string_value(json_object_get(object, key)), *problem = NULL;
    if (!file)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s: '%s' must be a string", r->path, r->where,
                         key);
    *path = is_photo ? image_name(r->path, file, &problem) : sgsi_strdup(file);
    if (!*path)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: %s: not enough memory", r->path, r->where);
    if (!is_photo)
        problem = sgsi_image_name_clean(*path);
    if (problem)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s: '%s' %s; use a path below the folder of this JSON file", r->path,
                         r->where, key, problem);
    return SGS_STATUS_OK;
}

// nerfstudio's mask of a frame: white pixels are valid.
static sgs_status read_mask(const reader *r, const json_t *object, char **path)
{
    const json_t *value = json_object_get(object, "mask_path");
    return !value || json_is_null(value) ? SGS_STATUS_OK
                                         : read_path(r, object, "mask_path", false, path);
}

static sgs_status read_frame(reader *r, const json_t *object, const intrinsics *global,
                             sgsi_frame *frame)
{
    intrinsics own = *global;
    if (!json_is_object(object))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s: must be an object", r->path, r->where);
    sgs_status status = read_path(r, object, "file_path", true, &frame->name);
    if (!status)
        status = read_mask(r, object, &frame->mask);
    if (!status)
        status = read_pose(r, object, &frame->pose);
    drop_global_focal(object, &own);
    if (!status)
        status = read_intrinsics(r, object, &own);
    return status ? status : read_camera(r, &own, frame);
}

static sgs_status read_frames(reader *r, const json_t *root, sgs_split split)
{
    sgsi_dataset *d = r->dataset;
    const json_t *frames = json_object_get(root, "frames");
    const size_t count = json_array_size(frames);
    if (!json_is_array(frames) || count == 0)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: 'frames' must be a list with at least one frame",
                         r->path);
    intrinsics global = {.model = NULL};
    for (int k = 0; k < KEY_COUNT; ++k)
        global.value[k] = NAN;
    snprintf(r->where, sizeof r->where, "the global keys");
    sgs_status status = read_intrinsics(r, root, &global);
    if (status)
        return status;
    if (!sgsi_grow((void **)&d->frames, d->frame_count, d->frame_count + count, sizeof *d->frames))
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for %zu frames", r->path,
                         count);
    for (size_t i = 0; i < count && !status; ++i) {
        snprintf(r->where, sizeof r->where, "frame %zu", i);
        sgsi_frame *frame = &d->frames[d->frame_count++];
        *frame = (sgsi_frame){
            .split = split, .place = i, .file = split == SGS_SPLIT_TEST ? TEST_FILE : NULL};
        status = read_frame(r, json_array_get(frames, i), &global, frame);
    }
    return status;
}

static sgs_status parse_file(const char *path, json_t **root)
{
    uint8_t *content;
    size_t size;
    json_error_t error;
    *root = NULL;
    const sgs_status status = sgsi_file_read(path, (size_t)1 << 30, &content, &size);
    if (status)
        return status;
    const size_t mark = sgsi_byte_order_mark(content);
    // Integers as doubles too: integers of many digits are not an error.
    *root = json_loadb((const char *)content + mark, size - mark, JSON_DECODE_INT_AS_REAL, &error);
    sgsi_free(content);
    if (!*root)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: line %d, column %d: %s; correct it or export the cameras again", path,
                         error.line, error.column, error.text);
    if (!json_is_object(*root)) {
        json_decref(*root);
        *root = NULL;
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: must contain a JSON object with 'frames'", path);
    }
    return SGS_STATUS_OK;
}

static int frame_order(const void *a, const void *b)
{
    const sgsi_frame *const *x = a, *const *y = b;
    return strcmp((*x)->name, (*y)->name);
}

static int name_order(const void *key, const void *element)
{
    const sgsi_frame *const *frame = element;
    return strcmp(key, (*frame)->name);
}

// Name of the frame that an entry of nerfstudio's lists means; NULL if there is none. The caller
// frees it.
static char *listed_name(const char *json_path, const json_t *entry)
{
    const char *file = json_string_value(entry), *problem = NULL;
    char *name = file ? image_name(json_path, file, &problem) : NULL;
    if (problem) {
        sgsi_free(name);
        return NULL;
    }
    return name;
}

// The frames of a file by name, for nerfstudio's lists. Frames with the same name are an error
// later (sgsi_dataset_check_names).
typedef struct frame_index {
    const char *path;
    const json_t *root;
    sgsi_dataset *dataset;
    sgsi_frame **sorted; // [frame_count]
    bool *listed;        // [frame_count], in the order of the frames
} frame_index;

// Marks the frames that a list names. Returns their number.
static size_t mark_listed(const frame_index *index, const char *key, sgs_split split)
{
    const json_t *names = json_object_get(index->root, key), *entry;
    const size_t count = index->dataset->frame_count;
    size_t i, unknown = 0, first = 0;
    json_array_foreach(names, i, entry)
    {
        char *name = listed_name(index->path, entry);
        sgsi_frame **found =
            name ? bsearch(name, index->sorted, count, sizeof *index->sorted, name_order) : NULL;
        sgsi_free(name);
        if (found) {
            (*found)->split = split;
            index->listed[*found - index->dataset->frames] = true;
        } else if (unknown++ == 0) {
            first = i;
        }
    }
    if (unknown)
        sgsi_warn(
            "%s: %zu of %zu entries of '%s' match no frame and are ignored; the first is entry "
            "%zu",
            index->path, unknown, json_array_size(names), key, first);
    return json_array_size(names) - unknown;
}

static void drop_unlisted(const frame_index *index, const char *held_out)
{
    sgsi_dataset *dataset = index->dataset;
    const size_t all = dataset->frame_count;
    char *first = NULL;
    dataset->frame_count = 0;
    for (size_t i = 0; i < all; ++i) {
        sgsi_frame *frame = &dataset->frames[i];
        if (index->listed[i]) {
            dataset->frames[dataset->frame_count++] = *frame;
            continue;
        }
        if (!first)
            first = frame->name;
        else
            sgsi_free(frame->name);
        sgsi_free(frame->mask);
    }
    if (first)
        sgsi_warn("%s: %zu of %zu frames are in neither 'train_filenames' nor '%s' and are not "
                  "used, first '%s'",
                  index->path, all - dataset->frame_count, all, held_out, first);
    sgsi_free(first);
}

// nerfstudio's lists of images: test_filenames, or val_filenames without it, are held out. With
// train_filenames, images in neither list are not used.
static sgs_status apply_lists(const char *path, const json_t *root, sgsi_dataset *dataset)
{
    static const char train[] = "train_filenames";
    const bool tests = json_array_size(json_object_get(root, "test_filenames")) > 0;
    const char *held_out = tests ? "test_filenames" : "val_filenames";
    const size_t count = dataset->frame_count;
    if (!count || (!json_array_size(json_object_get(root, held_out)) &&
                   !json_array_size(json_object_get(root, train))))
        return SGS_STATUS_OK;
    frame_index index = {.path = path,
                         .root = root,
                         .dataset = dataset,
                         .sorted = sgsi_alloc(count, sizeof *index.sorted),
                         .listed = sgsi_calloc(count, sizeof *index.listed)};
    if (index.sorted && index.listed) {
        for (size_t i = 0; i < count; ++i)
            index.sorted[i] = &dataset->frames[i];
        qsort(index.sorted, count, sizeof *index.sorted, frame_order);
        const bool trains = mark_listed(&index, train, SGS_SPLIT_TRAIN) > 0;
        if (mark_listed(&index, held_out, SGS_SPLIT_TEST))
            dataset->has_split = true;
        if (trains)
            drop_unlisted(&index, held_out);
    }
    const bool done = index.sorted && index.listed;
    sgsi_free(index.sorted);
    sgsi_free(index.listed);
    return done ? SGS_STATUS_OK
                : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                            "%s: not enough memory for its lists of images", path);
}

// The point cloud is optional: if it cannot be read, a warning is sent and the scene has no points.
static void read_points(const char *path, const json_t *root, sgsi_dataset *dataset)
{
    const json_t *value = json_object_get(root, "ply_file_path");
    char *name = json_is_string(value) ? sgsi_strdup(json_string_value(value)) : NULL;
    if (!name)
        return;
    const char *problem = sgsi_image_name_clean(name);
    char *cloud = problem ? NULL : sibling_path(path, name);
    char *folder = sibling_path(path, ".");
    sgsi_roots roots = {0};
    if (problem)
        sgsi_warn("%s: 'ply_file_path' %s; the scene has no points", path, problem);
    else if (!cloud || sgsi_roots_add(&roots, folder) || sgsi_roots_check(&roots, cloud) ||
             sgsi_point_cloud_read(cloud, &dataset->point_count, &dataset->points,
                                   &dataset->colors))
        sgsi_warn("%s; the scene has no points",
                  cloud ? sgs_last_error() : "not enough memory for the points");
    sgsi_roots_free(&roots);
    sgsi_free(folder);
    sgsi_free(cloud);
    sgsi_free(name);
}

static sgs_status read_file(const char *path, sgs_split split, sgsi_dataset *dataset)
{
    reader r = {.path = path, .dataset = dataset};
    json_t *root;
    sgs_status status = parse_file(path, &root);
    if (status)
        return status;
    status = read_frames(&r, root, split);
    if (!status && split == SGS_SPLIT_TRAIN)
        status = apply_lists(path, root, dataset);
    if (!status && split == SGS_SPLIT_TRAIN)
        read_points(path, root, dataset);
    json_decref(root);
    return status;
}

sgs_status sgsi_transforms_read(const char *path, sgsi_dataset *dataset)
{
    const char *suffix = "transforms_train.json";
    const size_t length = strlen(path), suffix_length = strlen(suffix);
    *dataset = (sgsi_dataset){.format = SGS_SCENE_TRANSFORMS};
    sgs_status status = read_file(path, SGS_SPLIT_TRAIN, dataset);
    if (!status && length >= suffix_length && !strcmp(path + length - suffix_length, suffix)) {
        dataset->white_background = true;
        char *test = sibling_path(path, TEST_FILE);
        if (!test)
            status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory", path);
        else if (!access(test, F_OK)) {
            status = read_file(test, SGS_SPLIT_TEST, dataset);
            dataset->has_split = true;
        }
        sgsi_free(test);
    }
    if (!status)
        status = sgsi_dataset_check_names(dataset, path, "frame");
    if (status)
        sgsi_dataset_free(dataset);
    return status;
}
