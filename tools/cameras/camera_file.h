// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Cameras for `render --camera`, read from the cameras.json of a 3DGS run (of any program) or from
// a camera path of nerfstudio's viewer. Other files: chan_file.h, usd_camera_file.h.

#include <stdbool.h>
#include <stddef.h>

#include <jansson.h>

#include "sparegs/camera.h"
#include "sparegs/scene.h"

typedef struct named_camera {
    char *name, *stem; // stem: see file_stems.h; NULL until assigned
    sgs_camera camera;
    sgs_camera file_camera; // at the size of the image file; of paths: width 0
    sgs_pose pose;
    int orientation; // Exif, of the image file, 1 to 8; 0: unknown
    int frame;       // its number in --frames, .chan and .usda
    char *prim;      // OpenUSD: the camera that this is a frame of; NULL if it has no frames
} named_camera;

typedef struct camera_list {
    named_camera *cameras; // [count]
    size_t count;
    double fps;       // of a path, 0 = unspecified
    double arc;       // of an orbit that is not a full circle, degrees; else 0
    int first;        // number of the first camera as a frame
    bool is_numbered; // some names contain such a number
    bool has_frames;  // the cameras have the frame numbers of their file, and are sorted by them
    sgs_scene *scene; // owned: the data set of --camera, without images; or NULL
} camera_list;

// True for a transforms.json, which sgs_scene_load reads: it has "frames".
bool camera_file_is_scene(const char *path);

// cameras.json: one object or a list of them: width, height, fx, fy, position [3], rotation [3][3]
// (camera to world, rows), and optionally img_name, cx, cy (default: the image centre),
// exif_orientation. A camera path: an object with render_width, render_height, camera_type and
// camera_path, frames of camera_to_world [16] and fov. The frames of a path are called frame_00000,
// ..., cameras without a name camera_0, ..., numbered from `first`. False after printing the error;
// else release the list with camera_list_free.
bool camera_file_read(const char *path, int first, camera_list *list);
void camera_list_free(camera_list *list);
// One frame of a camera path for images of width x height pixels: camera_to_world and fov. type:
// perspective, fisheye or equirectangular. Returns NULL, or a description of the error.
const char *camera_path_frame(const json_t *frame, const char *type, int width, int height,
                              sgs_camera *camera, sgs_pose *pose);
// A pinhole with the vertical field of view `fov` in degrees, 0 to 179, and the principal point in
// the image centre.
sgs_camera camera_pinhole(int width, int height, double fov);
// Index of the k-th of `most` <= count evenly spaced elements of a list.
size_t evenly_spaced(size_t k, size_t most, size_t count);
// Keeps at most `most` cameras, evenly spaced.
void camera_list_thin(camera_list *list, size_t most);
// Releases the members of a camera.
void named_camera_free(named_camera *camera);
