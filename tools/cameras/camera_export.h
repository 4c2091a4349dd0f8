// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Cameras as files for other programs: cameras.json (3DGS), .chan (Nuke, Blender, Houdini) and
// OpenUSD text (.usda). The last two cannot store lens distortion. The world axes are those of the
// scene, but y-up in .usda, as in models written as .usda.

#include "cameras/camera_file.h"
#include "sparegs/model_file.h"

enum { CAMERAS_JSON = 1, CAMERAS_CHAN = 2, CAMERAS_USDA = 4 };

// Writes FOLDER/cameras.json, .chan, .usda for the bits of `formats`. Ids are positions in the
// list, whose cameras must be sorted by frame. fps, frames per second (> 0), is that of .usda.
// False after printing the error, also for cameras that are not perspective where .chan or .usda is
// wanted. Warns about what a format omits.
bool cameras_export(const char *folder, unsigned formats, const camera_list *list, double fps);

// False for fisheye lenses and panoramas.
bool camera_is_perspective(const sgs_camera *camera);

// The cameras of a model file, which holds pinholes only.
typedef struct model_cameras {
    sgs_model_camera *cameras; // the caller's memory for all cameras that are added
    size_t count;
    size_t distorted; // of them, those whose distortion is omitted
    size_t omitted;   // not perspective
    bool first_omitted;
} model_cameras;

// Adds the pinhole part of a camera, unless it is not perspective. name is borrowed.
void model_cameras_add(model_cameras *list, const char *name, const sgs_camera *camera,
                       const sgs_pose *pose);
// Warns about what a file of this format omits.
void model_cameras_warn(const model_cameras *list, sgs_model_format format);
