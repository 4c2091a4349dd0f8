// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Camera animations of Nuke (.chan), also written by Blender, Houdini and camera trackers.

#include "cameras/camera_file.h"

// True if the name of the file ends in .chan.
bool chan_file_is(const char *path);

// One camera per line: frame number, translation, rotation in degrees (order ZXY), vertical field
// of view in degrees; empty lines and lines that begin with '#' are skipped. The cameras are
// pinholes of width x height pixels with the principal point in the image centre, sorted by frame,
// and named by their frame numbers: frame_01001, or frame_-0010 for a negative one. False after
// printing the error; else release the list with camera_list_free.
bool chan_file_read(const char *path, int width, int height, camera_list *list);
