// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// cameras.json as 3DGS writes it: position is the camera's centre in world space, rotation its axes in world space
// (camera to world), so the pose is rotation transposed and -rotation^T position. A rotation that is not orthonormal
// to 1e-3 is refused: drawing through it would shear the picture without a word.

#include "camera_file.h"

#include <jansson.h>
#include <math.h>
#include <stdlib.h>

#include "output.h"
#include "progress.h"

static bool read_number(const json_t *value, double *number)
{
    *number = json_number_value(value);
    return json_is_number(value) && isfinite(*number);
}

static bool is_rotation(const double r[9])
{
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            const double dot = r[i] * r[j] + r[3 + i] * r[3 + j] + r[6 + i] * r[6 + j];
            if (!(fabs(dot - (i == j)) < 1e-3))
                return false;
        }
    return r[0] * (r[4] * r[8] - r[5] * r[7]) - r[1] * (r[3] * r[8] - r[5] * r[6]) +
               r[2] * (r[3] * r[7] - r[4] * r[6]) >
           0;
}

// NULL, or what is wrong with the entry.
static const char *read_camera(const json_t *entry, named_camera *camera)
{
    double width, height, fx, fy, cx, cy, position[3], rotation[9];
    if (!read_number(json_object_get(entry, "width"), &width) ||
        !read_number(json_object_get(entry, "height"), &height) || !read_number(json_object_get(entry, "fx"), &fx) ||
        !read_number(json_object_get(entry, "fy"), &fy))
        return "width, height, fx and fy must be numbers";
    if (!(width >= 1 && width <= 65536 && height >= 1 && height <= 65536))
        return "width and height must be from 1 to 65536";
    if (!read_number(json_object_get(entry, "cx"), &cx))
        cx = width / 2;
    if (!read_number(json_object_get(entry, "cy"), &cy))
        cy = height / 2;
    for (size_t i = 0; i < 3; ++i) {
        if (!read_number(json_array_get(json_object_get(entry, "position"), i), &position[i]))
            return "position must be three numbers";
        for (size_t j = 0; j < 3; ++j)
            if (!read_number(json_array_get(json_array_get(json_object_get(entry, "rotation"), i), j),
                             &rotation[3 * i + j]))
                return "rotation must be three rows of three numbers";
    }
    if (!is_rotation(rotation))
        return "rotation is not a rotation matrix";
    camera->camera = (sgs_camera){SGS_CAMERA_PINHOLE, (int)width, (int)height, {fx, fy, cx, cy}};
    for (int i = 0; i < 3; ++i) {
        camera->pose.translation[i] = 0;
        for (int j = 0; j < 3; ++j) {
            camera->pose.rotation[3 * i + j] = rotation[3 * j + i];
            camera->pose.translation[i] -= rotation[3 * j + i] * position[j];
        }
    }
    return sgs_camera_validate(&camera->camera) ? sgs_last_error() : NULL;
}

static bool read_all(const char *path, const json_t *root, named_camera *cameras, size_t count)
{
    for (size_t i = 0; i < count; ++i) {
        const json_t *entry = json_is_array(root) ? json_array_get(root, i) : root;
        const char *problem = read_camera(entry, &cameras[i]);
        if (problem) {
            fail_run("%s: camera %zu: %s", path, i, problem);
            return false;
        }
        const char *name = json_string_value(json_object_get(entry, "img_name"));
        cameras[i].name = name ? format_text("%s", name) : format_text("camera_%zu", i);
    }
    return true;
}

bool camera_file_read(const char *path, named_camera **cameras, size_t *count)
{
    *cameras = NULL;
    *count = 0;
    json_error_t error;
    json_t *root = json_load_file(path, 0, &error);
    if (!root) {
        fail_run("%s: line %d: %s", path, error.line, error.text);
        return false;
    }
    *count = json_is_array(root) ? json_array_size(root) : 1;
    *cameras = calloc(*count + 1, sizeof **cameras);
    bool done = *cameras && *count;
    if (!done)
        fail_run("%s: holds no camera", path);
    done = done && read_all(path, root, *cameras, *count);
    json_decref(root);
    if (!done) {
        camera_file_free(*cameras, *count);
        *cameras = NULL;
        *count = 0;
    }
    return done;
}

void camera_file_free(named_camera *cameras, size_t count)
{
    for (size_t i = 0; cameras && i < count; ++i)
        free(cameras[i].name);
    free(cameras);
}
