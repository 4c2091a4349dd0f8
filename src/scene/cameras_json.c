// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Writes cameras.json like the code of Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance
// Field Rendering", 2023; viewers use it for their start position. It holds camera-to-world
// rotations (rows), centres and focal lengths in pixels; held-out views come first, and ids follow
// that order. The original has no distortion, principal point or Exif orientation, which are added.

#include "sparegs/scene.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "sparegs/output_file.h"

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
