// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The scale of a lens at its principal point, for pinholes in place of it.

#include "sparegs/camera.h"

// The pinhole with the scale of the lens at the principal point: focal lengths and principal point
// in pixels. They are those of the lens, except for COLMAP's FOV, whose scale there is not 1.
void camera_paraxial(const sgs_camera *camera, double *fx, double *fy, double *cx, double *cy);

// sgs_pixel_aspect of the camera (anamorphic lenses); 1 for panoramas.
double camera_pixel_aspect(const sgs_camera *camera);
