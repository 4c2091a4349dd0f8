// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The scale of a lens at its principal point, for pinholes in place of it.

#include "sparegs/camera.h"

// The pinhole with the scale of the lens at the principal point: focal lengths and principal point
// in pixels. They are those of the lens, except for COLMAP's FOV, whose scale there is not 1.
void camera_paraxial(const sgs_camera *camera, double *fx, double *fy, double *cx, double *cy);

// Width of a pixel over its height, fy / fx (anamorphic lenses). 1 for panoramas, and if they
// differ by at most 1 %, as in calibrations of square pixels, or a pixel of the shorter side, which
// sizes of downscaled images are rounded by.
double camera_pixel_aspect(const sgs_camera *camera);
