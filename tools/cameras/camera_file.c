// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// cameras.json as sgs_cameras_read_json reads it.
//
// A nerfstudio camera path stores camera_to_world per frame (row-major, OpenGL camera axes), the
// vertical field of view in degrees, and the size and projection of all frames.

#include "cameras/camera_file.h"

#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli/input_file.h"
#include "cli/json_file.h"
#include "cli/output.h"
#include "cli/progress.h"

sgs_camera camera_pinhole(int width, int height, double fov)
{
    const double focal = 0.5 * height / tan(fov * 3.141592653589793 / 360);
    return (sgs_camera){
        SGS_CAMERA_PINHOLE, width, height, {focal, focal, 0.5 * width, 0.5 * height}};
}

static bool read_number(const json_t *value, double *number)
{
    *number = json_number_value(value);
    return json_is_number(value) && isfinite(*number);
}

// Reads the cameras of a cameras.json.
static bool read_all(const char *path, const json_t *root, camera_list *list)
{
    char *text = json_dumps(root, JSON_REAL_PRECISION(17));
    sgs_named_camera *read = NULL;
    size_t count = 0;
    const bool done = text && !sgs_cameras_parse_json(text, strlen(text), path, &read, &count);
    if (!done)
        fail_run("%s", text ? sgs_last_error() : "out of memory");
    for (size_t i = 0; i < count && i < list->count; ++i) {
        const char *name = read[i].name;
        list->cameras[i] =
            (named_camera){.name = name ? format_text("%s", name)
                                        : format_text("camera_%zu", (size_t)list->first + i),
                           .camera = read[i].camera,
                           .file_camera = read[i].camera,
                           .pose = read[i].pose,
                           .orientation = read[i].orientation};
        list->is_numbered = list->is_numbered || !name;
    }
    sgs_cameras_free(read);
    free(text);
    return done;
}

// ---- nerfstudio's camera paths ----

static bool read_numbers(const json_t *array, double *numbers, size_t count)
{
    for (size_t i = 0; i < count; ++i)
        if (!read_number(json_array_get(array, i), &numbers[i]))
            return false;
    return json_array_size(array) == count;
}

// Creates a lens with the vertical field of view `fov` in degrees. Returns NULL, or a description
// of the error.
static const char *path_lens(const char *type, int width, int height, double fov,
                             sgs_camera *camera)
{
    if (!strcmp(type, "equirectangular") || !strcmp(type, "spherical")) {
        *camera = sgs_camera_equirectangular(width, height);
        return NULL;
    }
    const bool fisheye = !strcmp(type, "fisheye");
    if (!fisheye && strcmp(type, "perspective"))
        return "camera_type must be perspective, fisheye or equirectangular";
    if (!(fov > 0 && fov < 179))
        return "fov must be an angle between 0 and 179 degrees";
    *camera = camera_pinhole(width, height, fov);
    if (fisheye)
        camera->model = SGS_CAMERA_OPENCV_FISHEYE;
    return NULL;
}

// camera_to_world has OpenGL's camera axes (y up, z backward), so its second and third columns
// change sign. Returns NULL, or a description of the error.
static const char *path_pose(const json_t *matrix, sgs_pose *pose)
{
    double m[16], rotation[9];
    if (!read_numbers(matrix, m, 16))
        return "camera_to_world must be sixteen numbers";
    const double scale = sqrt(m[0] * m[0] + m[4] * m[4] + m[8] * m[8]);
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            rotation[3 * i + j] = m[4 * i + j] / scale * (j ? -1 : 1);
    if (!(scale > 0) || sgs_pose_from_axes(rotation, (double[]){0, 0, 0}, pose))
        return "camera_to_world is not a rotation and a translation";
    return sgs_pose_from_axes(rotation, (double[]){m[3], m[7], m[11]}, pose)
               ? "camera_to_world is out of range"
               : NULL;
}

const char *camera_path_frame(const json_t *frame, const char *type, int width, int height,
                              sgs_camera *camera, sgs_pose *pose)
{
    double fov = 0;
    read_number(json_object_get(frame, "fov"), &fov);
    const char *problem = path_pose(json_object_get(frame, "camera_to_world"), pose);
    if (!problem)
        problem = path_lens(type, width, height, fov, camera);
    return !problem && sgs_camera_validate(camera) ? sgs_last_error() : problem;
}

static bool read_path(const char *path, const json_t *root, camera_list *list)
{
    double width, height;
    if (!read_number(json_object_get(root, "render_width"), &width) ||
        !read_number(json_object_get(root, "render_height"), &height) ||
        !(width >= 1 && width <= 65536) || !(height >= 1 && height <= 65536)) {
        fail_run("%s: render_width and render_height must be numbers from 1 to 65536", path);
        return false;
    }
    const char *type = json_string_value(json_object_get(root, "camera_type"));
    if (read_number(json_object_get(root, "fps"), &list->fps) && list->fps > 0 &&
        !(list->fps >= 0.01 && list->fps <= 1000)) { // the range of --fps
        fail_run("%s: fps must be a number from 0.01 to 1000", path);
        return false;
    }
    const json_t *frames = json_object_get(root, "camera_path");
    for (size_t i = 0; i < list->count; ++i) {
        const char *problem =
            camera_path_frame(json_array_get(frames, i), type ? type : "perspective", (int)width,
                              (int)height, &list->cameras[i].camera, &list->cameras[i].pose);
        if (problem) {
            fail_run("%s: camera_path: frame %zu: %s", path, i, problem);
            return false;
        }
        list->cameras[i].name = format_text("frame_%05zu", (size_t)list->first + i);
    }
    list->is_numbered = true;
    return true;
}

// True if `root` has no camera at all, as the camera paths of other programs.
static bool is_foreign(const json_t *root)
{
    return !json_is_array(root) && !json_object_get(root, "width") &&
           !json_object_get(root, "fx") && !json_object_get(root, "position");
}

bool camera_file_is_scene(const char *path)
{
    json_t *root = load_json(path, 0, NULL);
    const bool is_scene = json_is_array(json_object_get(root, "frames"));
    json_decref(root);
    return is_scene;
}

// True if the file begins like JSON; also if it is named so or cannot be read, which read_json
// reports with the place.
static bool may_be_json(const char *path)
{
    FILE *stream = name_has_ending(path, ".json") ? NULL : open_input(path, NULL);
    if (!stream)
        return true;
    int first;
    do
        first = getc(stream);
    while (first > 0 && strchr(" \t\r\n\xef\xbb\xbf", first)); // and a byte order mark
    fclose(stream);
    return first == '{' || first == '[';
}

static bool is_colmap(const char *path)
{
    static const char *const names[] = {"cameras", "images", "points3D", "frames", "rigs"};
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k) {
        const size_t length = strlen(names[k]);
        if (!strncmp(name, names[k], length) &&
            (!strcmp(name + length, ".bin") || !strcmp(name + length, ".txt")))
            return true;
    }
    return false;
}

// True for files of 3D programs, which can also export .chan and OpenUSD.
static bool is_of_3d_program(const char *path)
{
    return name_has_ending(path, ".abc|.fbx");
}

// Returns false.
static bool fail_format(const char *path)
{
    if (is_colmap(path))
        fail_run("%s: is a file of a COLMAP model; give the folder of the model", path);
    else
        fail_run("%s: contains no cameras of a known format; cameras are read from cameras.json, "
                 "transforms.json, .chan, .usda, the camera path of nerfstudio's viewer and the "
                 "folder of a COLMAP model%s",
                 path,
                 is_of_3d_program(path) ? "; export the camera as a .usda or .chan file" : "");
    return false;
}

// The viewer of nerfstudio saves the frames between key frames only once the path is made.
static bool has_only_key_frames(const json_t *root)
{
    return json_array_size(json_object_get(root, "keyframes")) &&
           !json_array_size(json_object_get(root, "camera_path"));
}

bool camera_file_read(const char *path, int first, camera_list *list)
{
    *list = (camera_list){.first = first};
    if (is_colmap(path) || !may_be_json(path))
        return fail_format(path);
    json_t *root = read_json(path);
    if (!root)
        return false;
    const json_t *frames = json_object_get(root, "camera_path");
    if (has_only_key_frames(root)) {
        json_decref(root);
        fail_run("%s: has key frames, but no camera_path; generate the camera path in the viewer "
                 "of nerfstudio and export it again",
                 path);
        return false;
    }
    if (!frames && is_foreign(root)) {
        json_decref(root);
        return fail_format(path);
    }
    list->count = frames                ? json_array_size(frames)
                  : json_is_array(root) ? json_array_size(root)
                                        : 1;
    list->cameras = calloc(list->count + 1, sizeof *list->cameras);
    bool done = list->cameras && list->count;
    if (!done)
        fail_run("%s: contains no cameras", path);
    done = done && (frames ? read_path(path, root, list) : read_all(path, root, list));
    json_decref(root);
    if (!done)
        camera_list_free(list);
    return done;
}

void named_camera_free(named_camera *camera)
{
    free(camera->name);
    free(camera->stem);
    free(camera->prim);
}

size_t evenly_spaced(size_t k, size_t most, size_t count)
{
    return (k * count + most - 1) / most;
}

void camera_list_thin(camera_list *list, size_t most)
{
    size_t kept = 0;
    for (size_t i = 0; i < list->count; ++i) {
        if (kept < most && (list->count <= most || i == evenly_spaced(kept, most, list->count)))
            list->cameras[kept++] = list->cameras[i];
        else
            named_camera_free(&list->cameras[i]);
    }
    list->count = kept;
}

void camera_list_free(camera_list *list)
{
    sgs_scene_destroy(list->scene);
    for (size_t i = 0; list->cameras && i < list->count; ++i)
        named_camera_free(&list->cameras[i]);
    free(list->cameras);
    *list = (camera_list){0};
}
