// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Renders never replace the photos that they are compared with.

#include <stdbool.h>

#include "sparegs/scene.h"

// False after printing the error if a PNG or EXR file FOLDER/STEM.* or FOLDER/STEM_* is a
// photo or a mask of the scene: renders, their AOVs and error maps have such names. scene may
// be NULL.
bool photo_guard_admits(const sgs_scene *scene, const char *folder, const char *stem);
