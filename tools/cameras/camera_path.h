// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Camera paths made from the views of a scene.

#include "cameras/camera_file.h"
#include "sparegs/scene.h"

typedef struct path_options {
    int count;      // cameras, >= 1
    int first;      // number of the first one, in its name
    double arc;     // of an orbit, degrees up to 360; 0 = the arc that was photographed
    bool keep_lens; // the lens of the first view with its distortion, instead of a pinhole of the
                    // same focal length and pixel aspect ratio
} path_options;

// An orbit around the point that the views look at, with the distance and height of the views near
// each angle, perpendicular to the up direction of the capture; names orbit_NNNNN, numbered
// from `first`. Fails, with a message, if the views look at no common point.
bool camera_path_orbit(const sgs_scene *scene, const path_options *options, camera_list *list);

// Two turns of a spiral around the central view. Its width is half the spread of the views, at most
// 0.15 of the distance of the subject, which it looks at; names spiral_NNNNN.
bool camera_path_spiral(const sgs_scene *scene, const path_options *options, camera_list *list);

// Unit up direction of a capture: the one most perpendicular to the horizontal axes of the images,
// which are turned by their Exif orientation. Of the scene if it is not NULL, else of the list, in
// which images without an orientation count as upright; -y without views.
void camera_path_up(const sgs_scene *scene, const camera_list *list, double up[3]);

// The point that the cameras look at: the one with the least squared distance to all optical axes.
// Returns false, with the target unchanged, if the axes are parallel or the point is behind the
// cameras.
bool camera_path_target(const camera_list *list, double target[3]);
