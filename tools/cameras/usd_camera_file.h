// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Cameras of OpenUSD stages for `render --camera`: those of 3D programs, of models that were
// written with their cameras, and cameras.usda.

#include "cameras/camera_file.h"

// True for OpenUSD, text or binary, by name or content.
bool usd_camera_file_is(const char *path);

// Pinholes of width x height pixels. The frames of a stage with one camera are named frame_01001
// etc. by their time codes; with several cameras, SHOT_01001 etc. by the name of the prim, or by
// its path if another camera has the same name. A camera without animation has the name of its
// prim alone. `first` is the number of the first camera if the file gives none. False after
// printing the error; else release the list with camera_list_free.
bool usd_camera_file_read(const char *path, int first, int width, int height, camera_list *list);

// Keeps the frames of the prim that `view` names. False, without a change, if it names none.
bool usd_camera_file_keep(const char *view, camera_list *list);

// The cameras have the frame numbers of the file if all are frames of one prim.
void usd_camera_file_number(camera_list *list);
