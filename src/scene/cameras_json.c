// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Writes cameras.json like the code of Kerbl et al., "3D Gaussian Splatting for Real-Time Radiance
// Field Rendering", 2023; viewers use it for their start position. It holds camera-to-world
// rotations (rows), centres and focal lengths in pixels; held-out views come first, and ids follow
// that order. The format has no distortion or principal point.

#include "sparegs/scene.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"

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

static json_t *camera_of(const sgs_view *view, size_t id)
{
    double fx, fy, cx, cy;
    sgs_camera_intrinsics(&view->camera, &fx, &fy, &cx, &cy);
    // JSON is UTF-8, but file names need not be. json_string rejects other bytes, so they are
    // replaced.
    char *name = sgsi_strdup(view->name);
    if (!name)
        return NULL;
    json_t *text = json_string(name);
    if (!text) {
        for (char *at = name; *at; ++at) {
            if ((unsigned char)*at > 126)
                *at = '?';
        }
        text = json_string(name);
    }
    sgsi_free(name);
    return json_pack("{s:I, s:o, s:i, s:i, s:o, s:o, s:f, s:f}", "id", (json_int_t)id, "img_name",
                     text, "width", view->camera.width, "height", view->camera.height, "position",
                     position_of(&view->pose), "rotation", rotation_of(&view->pose), "fy", fy, "fx",
                     fx);
}

static json_t *list_cameras(const sgs_scene *scene)
{
    json_t *list = json_array();
    size_t id = 0;
    for (int pass = 0; pass < 2; ++pass) {
        for (size_t k = 0; k < scene->view_count; ++k) {
            const bool is_test = scene->views[k].split == SGS_SPLIT_TEST;
            if (is_test != (pass == 0))
                continue;
            if (json_array_append_new(list, camera_of(&scene->views[k], id++))) {
                json_decref(list);
                return NULL;
            }
        }
    }
    return list;
}

sgs_status sgs_scene_write_cameras_json(const sgs_scene *scene, const char *path)
{
    json_t *list = list_cameras(scene);
    char *text = list ? json_dumps(list, JSON_COMPACT | JSON_REAL_PRECISION(17)) : NULL;
    json_decref(list);
    if (!text)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: no memory to write %zu cameras", path,
                         scene->view_count);
    sgsi_atomic_file file;
    sgs_status status = sgsi_atomic_open(&file, path);
    if (!status) {
        fputs(text, file.stream);
        fputc('\n', file.stream);
        status = sgsi_atomic_commit(&file);
    }
    free(text);
    return status;
}
