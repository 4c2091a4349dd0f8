// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Intrinsics of transforms.json.
//
// They are global, per frame (these take precedence), or reduced to camera_angle_x and
// camera_angle_y, or x_fov and y_fov of instant-ngp (degrees); without w and h the photo's size
// completes these (see sgsi_frame).
//
// A panorama has no focal length: camera_model EQUIRECTANGULAR of nerfstudio, latlong of
// instant-ngp. Its centre is the camera axis, its upper row up. instant-ngp's equirectangular is
// another lens: its rows are spaced by the sine of the latitude.

#include "scene/transforms_lens.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"

enum { MAX_SIZE = 65536 };

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
    KEY_FOV_X,
    KEY_FOV_Y,
    KEY_CIRCLE,
    KEY_COUNT
};

static const char *const key_names[KEY_COUNT] = {[KEY_W] = "w",
                                                 [KEY_H] = "h",
                                                 [KEY_FL_X] = "fl_x",
                                                 [KEY_FL_Y] = "fl_y",
                                                 [KEY_CX] = "cx",
                                                 [KEY_CY] = "cy",
                                                 [KEY_K1] = "k1",
                                                 [KEY_K2] = "k2",
                                                 [KEY_K3] = "k3",
                                                 [KEY_K4] = "k4",
                                                 [KEY_K5] = "k5",
                                                 [KEY_K6] = "k6",
                                                 [KEY_P1] = "p1",
                                                 [KEY_P2] = "p2",
                                                 [KEY_ANGLE_X] = "camera_angle_x",
                                                 [KEY_ANGLE_Y] = "camera_angle_y",
                                                 [KEY_FOV_X] = "x_fov",
                                                 [KEY_FOV_Y] = "y_fov",
                                                 [KEY_CIRCLE] = "fisheye_crop_radius"};

_Static_assert((int)KEY_COUNT == (int)SGSI_LENS_NUMBERS, "sgsi_lens_keys.value");

#define PERSPECTIVE_MODELS                                                                         \
    "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, PERSPECTIVE, OPENCV, FULL_OPENCV"
#define FISHEYE_MODELS "SIMPLE_RADIAL_FISHEYE, RADIAL_FISHEYE, OPENCV_FISHEYE"
#define PANORAMA "EQUIRECTANGULAR"

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

static bool is_set(const json_t *object, const char *key)
{
    const json_t *value = json_object_get(object, key);
    return value && !json_is_null(value) && !json_is_false(value);
}

// Fails for keys of instant-ngp that select a lens or camera axes which are not supported.
// "from_mitsuba": false overrides normal_mts_args.
static sgs_status check_lens(const sgsi_transforms_reader *r, const json_t *object)
{
    static const char *const keys[] = {"ftheta_p0", "equirectangular", "orthographic"};
    for (size_t i = 0; i < sizeof keys / sizeof *keys; ++i)
        if (is_set(object, keys[i]))
            return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                             "%s: %s: the lens of '%s' is not supported; convert the images to "
                             "PINHOLE, OPENCV, OPENCV_FISHEYE or 'latlong'",
                             r->path, r->where, keys[i]);
    const bool from_mitsuba = is_set(object, "from_mitsuba");
    if (from_mitsuba || (is_set(object, "normal_mts_args") &&
                         !json_is_false(json_object_get(object, "from_mitsuba"))))
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: %s: the camera axes of Mitsuba ('%s') are not supported; convert "
                         "'transform_matrix' to x right, y up, z backward and remove the key",
                         r->path, r->where, from_mitsuba ? "from_mitsuba" : "normal_mts_args");
    return SGS_STATUS_OK;
}

// A finite number, also as a string: older versions of nerfstudio wrote the numbers of
// RealityCapture so. Blanks, hexadecimal numbers and words such as "inf" are none.
static bool read_number(const json_t *value, double *number)
{
    const char *text = json_string_value(value);
    char *end = NULL;
    *number = text ? strtod(text, &end) : json_number_value(value);
    const bool is_whole =
        text ? *text && !*end && !text[strspn(text, "+-.0123456789eE")] : json_is_number(value);
    return is_whole && isfinite(*number);
}

static bool has_number(const json_t *object, enum key key)
{
    double number;
    return read_number(json_object_get(object, key_names[key]), &number);
}

// A field of view of a frame replaces global focal lengths, which would take precedence; a focal
// length replaces a global field of view in degrees, which would contradict it.
static void drop_global_focal(const json_t *object, sgsi_lens_keys *out)
{
    static const enum key focal[] = {KEY_FL_X, KEY_FL_Y},
                          fields[] = {KEY_ANGLE_X, KEY_ANGLE_Y, KEY_FOV_X, KEY_FOV_Y};
    bool has_focal = false, has_field = false;
    for (size_t i = 0; i < sizeof focal / sizeof *focal; ++i)
        has_focal |= has_number(object, focal[i]);
    for (size_t i = 0; i < sizeof fields / sizeof *fields; ++i)
        has_field |= has_number(object, fields[i]);
    if (has_focal || has_field)
        out->value[KEY_FOV_X] = out->value[KEY_FOV_Y] = NAN;
    if (has_focal || !has_field)
        return;
    out->value[KEY_FL_X] = out->value[KEY_FL_Y] = NAN;
    out->value[KEY_ANGLE_X] = out->value[KEY_ANGLE_Y] = NAN;
}

sgsi_lens_keys sgsi_lens_keys_none(void)
{
    sgsi_lens_keys none = {.model = NULL};
    for (int k = 0; k < KEY_COUNT; ++k)
        none.value[k] = NAN;
    return none;
}

static bool is_known(const char *model)
{
    return is_listed(model, PERSPECTIVE_MODELS) || is_listed(model, FISHEYE_MODELS) ||
           !strcmp(model, PANORAMA);
}

// nerfstudio's list of all coefficients, which takes precedence over the keys k1 to p2 beside it.
// Lists of models that are refused have other lengths.
static sgs_status read_distortion(const sgsi_transforms_reader *r, const json_t *object,
                                  sgsi_lens_keys *out)
{
    static const enum key keys[] = {KEY_K1, KEY_K2, KEY_K3, KEY_K4, KEY_P1, KEY_P2};
    const size_t count = sizeof keys / sizeof *keys;
    const json_t *list = json_object_get(object, "distortion_params");
    if (!list || json_is_null(list) || (out->model && !is_known(out->model)))
        return SGS_STATUS_OK;
    bool good = json_array_size(list) == count; // 0 if not an array
    for (size_t i = 0; i < count && good; ++i)
        good = read_number(json_array_get(list, i), &out->value[keys[i]]);
    return good ? SGS_STATUS_OK
                : sgsi_fail(SGS_STATUS_FORMAT,
                            "%s: %s: 'distortion_params' must be a list of 6 numbers, k1, k2, k3, "
                            "k4, p1 and p2",
                            r->path, r->where);
}

sgs_status sgsi_lens_keys_read(const sgsi_transforms_reader *r, const json_t *object,
                               sgsi_lens_keys *out)
{
    drop_global_focal(object, out);
    for (int k = 0; k < KEY_COUNT; ++k) {
        const json_t *value = json_object_get(object, key_names[k]);
        if (!value || json_is_null(value))
            continue;
        if (!read_number(value, &out->value[k]))
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s: '%s' must be a number", r->path, r->where,
                             key_names[k]);
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
    const sgs_status status = check_lens(r, object);
    return status ? status : read_distortion(r, object, out);
}

static double or_else(double value, double otherwise)
{
    return isnan(value) ? otherwise : value;
}

static sgs_status read_size(const sgsi_transforms_reader *r, const sgsi_lens_keys *in,
                            sgs_camera *camera)
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

// The first of these distortion coefficients that is not 0, or KEY_COUNT.
static enum key first_distortion(const sgsi_lens_keys *in, enum key from, enum key to)
{
    for (enum key key = from; key <= to; ++key)
        if (or_else(in->value[key], 0) != 0)
            return key;
    return KEY_COUNT;
}

static sgs_status read_model(sgsi_transforms_reader *r, const sgsi_lens_keys *in,
                             sgs_camera *camera)
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
    // k4 alone is nerfstudio's next coefficient of the polynomial, and not that of FULL_OPENCV.
    const bool rational = !fisheye && first_distortion(in, KEY_K5, KEY_K6) != KEY_COUNT;
    if (excess != KEY_COUNT)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED, "%s: %s: camera model '%.64s' has no %s; %s",
                         r->path, r->where, model, key_names[excess],
                         rational ? "use FULL_OPENCV" : "undistort the images");
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

static bool is_panorama(const sgsi_lens_keys *in)
{
    return in->model ? !strcmp(in->model, PANORAMA) : in->panorama;
}

// nerfstudio writes w/2, h, w/2 and h/2 as fl_x, fl_y, cx and cy of a full panorama. Without a
// size, none is known to be one of these.
static bool is_of_panorama(const sgsi_lens_keys *in, const sgs_camera *camera)
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
static sgs_status read_panorama(sgsi_transforms_reader *r, const sgsi_lens_keys *in,
                                sgs_camera *camera)
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

// Along an axis: its keys, the extent of the image (0 = that of the photo), and what the keys say.
typedef struct lens_axis {
    enum key focal_key, angle_key, degrees_key;
    int size;
    double focal, angle, from_angle; // pixels, radians, pixels; NaN if absent
} lens_axis;

// instant-ngp prefers x_fov to fl_x, nerfstudio fl_x, so both must be equal but for rounding.
static sgs_status check_degrees(const sgsi_transforms_reader *r, const sgsi_lens_keys *in,
                                const lens_axis *axis)
{
    const double degrees = in->value[axis->degrees_key];
    const char *name = key_names[axis->degrees_key];
    if (!(degrees > 0 && degrees < 180))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s: '%s' is %g, not an angle between 0 and 180 degrees", r->path,
                         r->where, name, degrees);
    if (!axis->size && (!isnan(in->value[KEY_FL_X]) || !isnan(in->value[KEY_FL_Y])))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s: '%s' beside a focal length in pixels requires 'w' and 'h'; add "
                         "them, or remove it",
                         r->path, r->where, name);
    if (fabs(axis->from_angle - axis->focal) > 0.005 * axis->focal)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s: '%s' is %g degrees, a focal length of %g pixels, but '%s' is "
                         "%g; remove one of them",
                         r->path, r->where, name, degrees, axis->from_angle,
                         key_names[axis->focal_key], axis->focal);
    return SGS_STATUS_OK;
}

static sgs_status read_axis(const sgsi_transforms_reader *r, const sgsi_lens_keys *in,
                            lens_axis *axis)
{
    const double degrees = in->value[axis->degrees_key];
    axis->focal = in->value[axis->focal_key];
    axis->angle = in->value[axis->angle_key];
    if (!isnan(axis->angle) && !(axis->angle > 0 && axis->angle < 3.14159))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s: '%s' is %g, not an angle between 0 and pi radians", r->path,
                         r->where, key_names[axis->angle_key], axis->angle);
    if (!isnan(degrees))
        axis->angle = degrees * (3.14159265358979324 / 180);
    axis->from_angle = axis->size > 0 ? 0.5 * axis->size / tan(0.5 * axis->angle) : NAN;
    return isnan(degrees) ? SGS_STATUS_OK : check_degrees(r, in, axis);
}

// Focal lengths, or the angles by which the photo's size completes them.
static sgs_status read_focal(const sgsi_transforms_reader *r, const sgsi_lens_keys *in,
                             sgsi_frame *frame)
{
    const sgs_camera *camera = &frame->camera;
    double *p = frame->camera.params;
    lens_axis x = {KEY_FL_X, KEY_ANGLE_X, KEY_FOV_X, camera->width, NAN, NAN, NAN};
    lens_axis y = {KEY_FL_Y, KEY_ANGLE_Y, KEY_FOV_Y, camera->height, NAN, NAN, NAN};
    sgs_status status = read_axis(r, in, &x);
    if (!status)
        status = read_axis(r, in, &y);
    if (status)
        return status;
    const bool fisheye = sgs_camera_is_fisheye(camera->model);
    if (fisheye) // distortion of the angle: no simple relation to the focal length
        x.from_angle = y.from_angle = NAN;
    const bool is_square = !isnan(x.focal) && isnan(in->value[KEY_FOV_Y]);
    p[0] = or_else(x.focal, or_else(x.from_angle, or_else(y.focal, y.from_angle)));
    p[1] = or_else(y.focal, is_square ? x.focal : or_else(y.from_angle, p[0]));
    if (camera->width == 0 && isnan(x.focal) && !fisheye) {
        frame->angle_x = or_else(x.angle, 0); // completed by the photo's size
        frame->angle_y = isnan(y.focal) ? or_else(y.angle, 0) : 0;
    }
    if (isnan(p[0]) && fisheye)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s: no focal length of the fisheye lens, which a field of view does "
                         "not define; add 'fl_x' (pixels)",
                         r->path, r->where);
    if (isnan(p[0]) && !(frame->angle_x > 0 || frame->angle_y > 0))
        return sgsi_fail(
            SGS_STATUS_FORMAT,
            "%s: %s: no focal length; add 'fl_x' (pixels) or 'camera_angle_x' (radians)", r->path,
            r->where);
    return SGS_STATUS_OK;
}

// nerfstudio ignores the pixels outside the image circle of a fisheye lens, and the key with other
// lenses. The radius is in pixels before downscaling; its script for EyefulTower writes fractions.
static sgs_status read_circle(const sgsi_transforms_reader *r, const sgsi_lens_keys *in,
                              sgsi_frame *frame)
{
    const double radius = in->value[KEY_CIRCLE];
    if (isnan(radius) || !sgs_camera_is_fisheye(frame->camera.model))
        return SGS_STATUS_OK;
    if (!(radius >= 1))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s: '%s' is %g, not a radius of at least 1 pixel; convert it to "
                         "pixels, or remove it",
                         r->path, r->where, key_names[KEY_CIRCLE], radius);
    frame->circle = radius;
    return SGS_STATUS_OK;
}

sgs_status sgsi_lens_keys_apply(sgsi_transforms_reader *r, const sgsi_lens_keys *in,
                                sgsi_frame *frame)
{
    sgs_camera *camera = &frame->camera;
    sgs_status status = read_size(r, in, camera);
    if (!status && is_panorama(in))
        return read_panorama(r, in, camera);
    if (!status)
        status = read_model(r, in, camera);
    if (!status)
        status = read_focal(r, in, frame);
    if (!status)
        status = read_circle(r, in, frame);
    if (status)
        return status;
    camera->params[2] = or_else(in->value[KEY_CX], camera->width ? 0.5 * camera->width : NAN);
    camera->params[3] = or_else(in->value[KEY_CY], camera->width ? 0.5 * camera->height : NAN);
    if (camera->width && sgs_camera_validate(camera))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s: %s; correct the intrinsics", r->path, r->where,
                         sgs_last_error());
    return SGS_STATUS_OK;
}
