// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Camera paths made from the views of a scene, with the lens of its first view.

#include "cameras/camera_file.h"
#include "sparegs/scene.h"

// A circle of `count` cameras around the point that the views look at, at their mean distance and
// height, names orbit_00000, ... . Fails, with a word on stderr, for views that look away from each
// other.
bool camera_path_orbit(const sgs_scene *scene, int count, camera_list *list);

// Two turns of a spiral around the view in the middle of all, half as wide as the views lie apart
// and at most 0.15 of the distance of what they look at, which it looks at; names spiral_00000, ...
// .
bool camera_path_spiral(const sgs_scene *scene, int count, camera_list *list);
