// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// cameras.json of the code of Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance Field
// Rendering", 2023; viewers use it for their start position. It holds camera-to-world rotations
// (rows), centres and focal lengths in pixels; held-out views come first, and ids follow that
// order. The original has no distortion, principal point or Exif orientation, which are added, and
// which the reader does not require.

#include "sparegs/scene.h"

#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "sparegs/output_file.h"

// ---- Writing ----

static json_t *position_of(const sgs_pose *pose)
{
    double center[3];
    sgs_pose_center(pose, center);
    return json_pack("[f, f, f]", center[0], center[1], center[2]);
}

// Rows of the transposed world-to-camera rotation.
static json_t *rotation_of(const sgs_pose *pose)
{
    const double *r = pose->rotation;
    return json_pack("[[f, f, f], [f, f, f], [f, f, f]]", r[0], r[3], r[6], r[1], r[4], r[7], r[2],
                     r[5], r[8]);
}

// JSON is UTF-8, but file names need not be. json_string rejects other bytes, so they are replaced.
static json_t *text_of(const char *name)
{
    json_t *text = json_string(name);
    char *copy = text ? NULL : sgsi_strdup(name);
    if (!copy)
        return text;
    for (char *at = copy; *at; ++at) {
        if ((unsigned char)*at > 126)
            *at = '?';
    }
    text = json_string(copy);
    sgsi_free(copy);
    return text;
}

static json_t *params_of(const sgs_camera *camera)
{
    json_t *params = json_array();
    for (int k = 0; k < sgs_camera_param_count(camera->model); ++k)
        json_array_append_new(params, json_real(camera->params[k]));
    return params;
}

static json_t *camera_of(const sgs_named_camera *view, size_t id)
{
    double fx, fy, cx, cy;
    sgs_camera_intrinsics(&view->camera, &fx, &fy, &cx, &cy);
    json_t *camera =
        json_pack("{s:I, s:o, s:i, s:i, s:o, s:o, s:f, s:f, s:f, s:f, s:s, s:o}", "id",
                  (json_int_t)id, "img_name", text_of(view->name), "width", view->camera.width,
                  "height", view->camera.height, "position", position_of(&view->pose), "rotation",
                  rotation_of(&view->pose), "fy", fy, "fx", fx, "cx", cx, "cy", cy, "camera_model",
                  sgs_camera_model_name(view->camera.model), "params", params_of(&view->camera));
    if (view->orientation > 1)
        json_object_set_new(camera, "exif_orientation", json_integer(view->orientation));
    return camera;
}

// What JSON cannot hold, such as numbers that are not finite, is an error of the caller.
static sgs_status check_camera(const sgs_named_camera *view, size_t id, const char *path)
{
    if (!view->name)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: camera %zu: name is NULL", path, id);
    if (sgs_camera_validate(&view->camera) || sgs_pose_validate(&view->pose))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: camera %zu, '%s': %s", path, id,
                         view->name, sgs_last_error());
    return SGS_STATUS_OK;
}

sgs_status sgs_cameras_write_json(const sgs_named_camera *cameras, size_t count, const char *path)
{
    for (size_t k = 0; k < count; ++k) {
        const sgs_status status = check_camera(&cameras[k], k, path);
        if (status)
            return status;
    }
    json_t *list = json_array();
    bool made = list;
    for (size_t k = 0; k < count && made; ++k)
        made = !json_array_append_new(list, camera_of(&cameras[k], k));
    char *text = made ? json_dumps(list, JSON_COMPACT | JSON_REAL_PRECISION(17)) : NULL;
    json_decref(list);
    if (!text)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write %zu cameras",
                         path, count);
    sgs_output_file file;
    sgs_status status = sgs_output_file_open(&file, path);
    if (!status) {
        fputs(text, file.stream);
        fputc('\n', file.stream);
        status = sgs_output_file_commit(&file);
    }
    free(text);
    return status;
}

sgs_status sgs_scene_write_cameras_json(const sgs_scene *scene, const char *path)
{
    sgs_named_camera *cameras = sgsi_alloc(scene->view_count + 1, sizeof *cameras);
    if (!cameras)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write %zu cameras",
                         path, scene->view_count);
    size_t count = 0;
    for (int pass = 0; pass < 2; ++pass) {
        for (size_t k = 0; k < scene->view_count; ++k) {
            const sgs_view *view = &scene->views[k];
            if ((view->split == SGS_SPLIT_TEST) == (pass == 0))
                cameras[count++] =
                    (sgs_named_camera){view->name, view->camera, view->pose, view->orientation};
        }
    }
    const sgs_status status = sgs_cameras_write_json(cameras, count, path);
    sgsi_free(cameras);
    return status;
}

// ---- Reading ----

static bool read_number(const json_t *value, double *number)
{
    *number = json_number_value(value);
    return json_is_number(value) && isfinite(*number);
}

// The members camera_model and params, which 3DGS does not write. Without them the camera is a
// pinhole. Returns NULL, or a description of the error.
static const char *read_lens(const json_t *entry, sgs_camera *camera)
{
    const json_t *model = json_object_get(entry, "camera_model"),
                 *params = json_object_get(entry, "params");
    if (!model)
        return NULL;
    const char *name = json_string_value(model);
    sgs_camera_model named = SGS_CAMERA_EQUIRECTANGULAR; // not a model of COLMAP
    if (!name ||
        (strcmp(name, sgs_camera_model_name(named)) && !sgs_camera_model_from_name(name, &named)))
        return "camera_model must be the name of a camera model of COLMAP, or EQUIRECTANGULAR";
    const sgs_camera pinhole = *camera;
    camera->model = named;
    const size_t count = (size_t)sgs_camera_param_count(camera->model);
    memset(camera->params, 0, sizeof camera->params);
    bool complete = json_array_size(params) == count;
    for (size_t k = 0; k < count && complete; ++k)
        complete = read_number(json_array_get(params, k), &camera->params[k]);
    if (!complete)
        return "params must be the parameters of camera_model";
    double fx, fy, cx, cy;
    sgs_camera_intrinsics(camera, &fx, &fy, &cx, &cy);
    if (!(fabs(fx - pinhole.params[0]) <= 1e-6 * fx && fabs(fy - pinhole.params[1]) <= 1e-6 * fy))
        return "fx and fy must be those of params";
    // cx and cy, where given, count, so that they can be changed alone.
    const bool has_cx = json_object_get(entry, "cx"), has_cy = json_object_get(entry, "cy");
    *camera = sgs_camera_shifted(camera, has_cx ? pinhole.params[2] - cx : 0,
                                 has_cy ? pinhole.params[3] - cy : 0);
    return NULL;
}

// Returns NULL, or a description of the error.
static const char *read_pose(const json_t *entry, sgs_pose *pose)
{
    static const double origin[3];
    const json_t *rows = json_object_get(entry, "rotation");
    double position[3], rotation[9];
    for (size_t i = 0; i < 3; ++i) {
        if (!read_number(json_array_get(json_object_get(entry, "position"), i), &position[i]))
            return "position must be three numbers";
        for (size_t j = 0; j < 3; ++j)
            if (!read_number(json_array_get(json_array_get(rows, i), j), &rotation[3 * i + j]))
                return "rotation must be three rows of three numbers";
    }
    if (sgs_pose_from_axes(rotation, origin, pose))
        return "rotation is not a rotation matrix";
    return sgs_pose_from_axes(rotation, position, pose) ? "position is out of range" : NULL;
}

// Returns NULL, or a description of the error.
static const char *read_camera(const json_t *entry, sgs_named_camera *camera)
{
    double width, height, fx, fy, cx, cy;
    if (!read_number(json_object_get(entry, "width"), &width) ||
        !read_number(json_object_get(entry, "height"), &height) ||
        !read_number(json_object_get(entry, "fx"), &fx) ||
        !read_number(json_object_get(entry, "fy"), &fy))
        return "width, height, fx and fy must be numbers";
    if (!(width >= 1 && width <= 65536 && height >= 1 && height <= 65536))
        return "width and height must be from 1 to 65536";
    if (!read_number(json_object_get(entry, "cx"), &cx))
        cx = width / 2;
    if (!read_number(json_object_get(entry, "cy"), &cy))
        cy = height / 2;
    camera->camera = (sgs_camera){SGS_CAMERA_PINHOLE, (int)width, (int)height, {fx, fy, cx, cy}};
    const char *problem = read_pose(entry, &camera->pose);
    if (!problem)
        problem = read_lens(entry, &camera->camera);
    if (problem)
        return problem;
    const json_t *orientation = json_object_get(entry, "exif_orientation");
    const json_int_t held = json_integer_value(orientation); // 0 without one
    if (orientation && !(held >= 1 && held <= 8))
        return "exif_orientation must be an integer from 1 to 8";
    camera->orientation = (int)held;
    return sgs_camera_validate(&camera->camera) ? sgs_last_error() : NULL;
}

static const json_t *entry_of(const json_t *root, size_t i)
{
    return json_is_array(root) ? json_array_get(root, i) : root;
}

// The cameras of a list or an object, with their names in the same block.
static sgs_status read_cameras(const json_t *root, const char *path, sgs_named_camera **cameras,
                               size_t *count)
{
    size_t bytes = 0;
    *count = json_is_array(root) ? json_array_size(root) : 1;
    for (size_t i = 0; i < *count; ++i)
        bytes += json_string_length(json_object_get(entry_of(root, i), "img_name")) + 1;
    sgs_named_camera *read = sgsi_alloc(*count * sizeof *read + bytes + 1, 1);
    if (!read)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read %zu cameras",
                         path, *count);
    char *names = (char *)(read + *count);
    for (size_t i = 0; i < *count; ++i) {
        const json_t *entry = entry_of(root, i);
        const char *name = json_string_value(json_object_get(entry, "img_name")),
                   *problem = read_camera(entry, &read[i]);
        if (problem) {
            const sgs_status status =
                sgsi_fail(SGS_STATUS_FORMAT, "%s: camera %zu: %s", path, i, problem);
            sgsi_free(read);
            return status;
        }
        read[i].name = name ? strcpy(names, name) : NULL;
        names += name ? strlen(name) + 1 : 0;
    }
    *cameras = read;
    return SGS_STATUS_OK;
}

sgs_status sgs_cameras_parse_json(const char *text, size_t size, const char *path,
                                  sgs_named_camera **cameras, size_t *count)
{
    *cameras = NULL;
    *count = 0;
    json_error_t error;
    const size_t mark = size >= 3 ? sgsi_byte_order_mark((const uint8_t *)text) : 0;
    json_t *root = json_loadb(text + mark, size - mark, JSON_REJECT_DUPLICATES, &error);
    if (!root)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: line %d: %s", path, error.line, error.text);
    const sgs_status status = read_cameras(root, path, cameras, count);
    json_decref(root);
    if (status)
        *count = 0;
    return status;
}

sgs_status sgs_cameras_read_json(const char *path, sgs_named_camera **cameras, size_t *count)
{
    uint8_t *text;
    size_t size;
    *cameras = NULL;
    *count = 0;
    sgs_status status = sgsi_file_read(path, 0, &text, &size);
    if (status)
        return status;
    status = sgs_cameras_parse_json((const char *)text, size, path, cameras, count);
    sgsi_free(text);
    return status;
}

void sgs_cameras_free(sgs_named_camera *cameras)
{
    sgsi_free(cameras);
}
