// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Renders never replace the photos that they are compared with, nor the video of the same command.
// Functions print their error before they return false.

#include <stdbool.h>

#include "cameras/camera_file.h"
#include "sparegs/scene.h"

// What `render` writes for each camera.
typedef struct frame_outputs {
    const char *folder; // NULL: no frames
    unsigned aovs;
    bool png, deep;
    const char *film; // file of the video, or NULL
} frame_outputs;

// False if a PNG or EXR file FOLDER/STEM.* or FOLDER/STEM_* is a photo or a mask of the scene, or
// if a frame would replace one through a link, or the video; likewise if the video would replace
// one. scene may be NULL: then it is the data set that the cameras come from, if any.
bool photo_guard_admits_frames(const sgs_scene *scene, const frame_outputs *outputs,
                               const camera_list *cameras);
// The same for the images that `eval` saves for each view of the scene: FOLDER/STEM.png,
// FOLDER/STEM_photo.png and FOLDER/STEM_flip.png.
bool photo_guard_admits_saved(const sgs_scene *scene, const char *folder, char *const *stems);
