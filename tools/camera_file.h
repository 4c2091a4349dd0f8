// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Cameras for `render --camera`, read from the cameras.json of a 3DGS run (ours or another program's).

#include <stdbool.h>
#include <stddef.h>

#include "sparegs/camera.h"

typedef struct named_camera {
    char *name;
    sgs_camera camera;
    sgs_pose pose;
} named_camera;

// Reads one object or a list of them: width, height, fx, fy, position [3], rotation [3][3] (camera to world, rows),
// and where present img_name, cx, cy (else the image's middle). False after printing the error; else release *cameras
// with camera_file_free.
bool camera_file_read(const char *path, named_camera **cameras, size_t *count);
void camera_file_free(named_camera *cameras, size_t count);
