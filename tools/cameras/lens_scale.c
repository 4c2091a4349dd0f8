// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cameras/lens_scale.h"

#include <math.h>

#include "sparegs/image.h"

void camera_paraxial(const sgs_camera *camera, double *fx, double *fy, double *cx, double *cy)
{
    sgs_camera_intrinsics(camera, fx, fy, cx, cy);
    const double omega = camera->model == SGS_CAMERA_FOV ? camera->params[4] : 0;
    if (fabs(omega) < 1e-6)
        return;
    const double scale = 2 * tan(0.5 * omega) / omega; // of atan(2 r tan(omega / 2)) / omega at 0
    *fx *= scale;
    *fy *= scale;
}

double camera_pixel_aspect(const sgs_camera *camera)
{
    double fx, fy, cx, cy;
    sgs_camera_intrinsics(camera, &fx, &fy, &cx, &cy);
    return camera->model == SGS_CAMERA_EQUIRECTANGULAR
               ? 1
               : sgs_pixel_aspect(fx, fy, camera->width, camera->height);
}
