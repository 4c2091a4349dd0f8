// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Central cameras as in COLMAP: intrinsics with distortion, projection to pixels and its inverse.
// Pure functions in double precision, without images or files. Camera axes: x right, y down, z
// forward. Pixel coordinates: origin at the upper left corner of the image, pixel centres at .5.
//
// Threads: all functions may be called from any thread at any time.

#include <stdbool.h>

#include "sparegs/status.h"

#ifdef __cplusplus
extern "C" {
#endif

// COLMAP's model ids (src/base/camera_models.h of COLMAP 3.8).
typedef enum sgs_camera_model {
    SGS_CAMERA_SIMPLE_PINHOLE = 0,        // f, cx, cy
    SGS_CAMERA_PINHOLE = 1,               // fx, fy, cx, cy
    SGS_CAMERA_SIMPLE_RADIAL = 2,         // f, cx, cy, k
    SGS_CAMERA_RADIAL = 3,                // f, cx, cy, k1, k2
    SGS_CAMERA_OPENCV = 4,                // fx, fy, cx, cy, k1, k2, p1, p2
    SGS_CAMERA_OPENCV_FISHEYE = 5,        // fx, fy, cx, cy, k1, k2, k3, k4
    SGS_CAMERA_FULL_OPENCV = 6,           // fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6
    SGS_CAMERA_FOV = 7,                   // fx, fy, cx, cy, omega
    SGS_CAMERA_SIMPLE_RADIAL_FISHEYE = 8, // f, cx, cy, k
    SGS_CAMERA_RADIAL_FISHEYE = 9,        // f, cx, cy, k1, k2
    SGS_CAMERA_THIN_PRISM_FISHEYE = 10,   // fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, sx1, sy1
    SGS_CAMERA_MODEL_COUNT = 11,
    // fx, fy (pixels per radian of longitude and latitude), cx, cy. COLMAP's model has other
    // parameters.
    SGS_CAMERA_EQUIRECTANGULAR = 100
} sgs_camera_model;

typedef struct sgs_camera {
    sgs_camera_model model;
    int width, height; // pixels
    double params[12]; // in the model's order above; unused entries are 0
} sgs_camera;

// World to camera: p_cam = rotation * p_world + translation. Rotation row-major, orthonormal, not
// mirrored: see sgs_pose_validate.
typedef struct sgs_pose {
    double rotation[9];
    double translation[3];
} sgs_pose;

// Number of parameters of a model, 0 for an unknown id.
SGS_API int sgs_camera_param_count(sgs_camera_model model);

// COLMAP's name of a model ("OPENCV"), or "EQUIRECTANGULAR"; NULL for an unknown id.
SGS_API const char *sgs_camera_model_name(sgs_camera_model model);

// Finds a model by COLMAP's name. Returns false for any other name, also for "EQUIRECTANGULAR";
// *model is then unchanged.
SGS_API bool sgs_camera_model_from_name(const char *name, sgs_camera_model *model);

// True for the models whose distortion acts on the angle from the axis (rays beyond 90 degrees may
// exist).
SGS_API bool sgs_camera_is_fisheye(sgs_camera_model model);

// Checks sizes in [1, 65536], finite parameters, positive focal lengths and |omega| < pi of the FOV
// model. Fails with INVALID_ARGUMENT; sgs_last_error() gives the reason, without a file name.
SGS_API sgs_status sgs_camera_validate(const sgs_camera *camera);

// True if both cameras have the same model, size and parameters.
SGS_API bool sgs_camera_equal(const sgs_camera *a, const sgs_camera *b);

// Focal lengths in pixels (fx, fy) and principal point (cx, cy) in pixels. Cannot fail.
SGS_API void sgs_camera_intrinsics(const sgs_camera *camera, double *fx, double *fy, double *cx,
                                   double *cy);

// The same lens for an image of another size: focal lengths and principal point scale per axis. A
// model with one focal length becomes the one with two if the axes scale differently. Cannot fail.
SGS_API sgs_camera sgs_camera_resized(const sgs_camera *camera, int width, int height);

// The same lens for an image of another size with the same vertical field of view: focal lengths
// and distortion scale by height / camera->height; the image is cropped or extended left and right.
// Keeps the pixel aspect. Cannot fail.
SGS_API sgs_camera sgs_camera_reframed(const sgs_camera *camera, int width, int height);

// The same lens with the principal point, and therefore the image, shifted by (dx, dy) pixels.
// Cannot fail.
SGS_API sgs_camera sgs_camera_shifted(const sgs_camera *camera, double dx, double dy);

// All directions in one image: longitude from -180 to 180 degrees from left to right, latitude from
// top to bottom, the camera axis in the centre.
SGS_API sgs_camera sgs_camera_equirectangular(int width, int height);

// Projects a point in camera axes to pixel coordinates. False if the point has no image: behind a
// perspective camera, outside the domain where the distortion is monotonic, or not finite.
SGS_API bool sgs_camera_project(const sgs_camera *camera, const double point[3], double pixel[2]);

// Unit direction in camera axes of the ray through a pixel coordinate, by Newton inversion of the
// distortion. False if it does not converge or the pixel is outside the lens's valid image, such as
// beyond the poles of an equirectangular camera, or not finite.
SGS_API bool sgs_camera_unproject(const sgs_camera *camera, const double pixel[2],
                                  double direction[3]);

// Camera centre in world space: -Rᵀ t.
SGS_API void sgs_pose_center(const sgs_pose *pose, double center[3]);

// Checks that the rotation is orthonormal to 1e-3 and not mirrored, the translation finite, and the
// sum of the camera centre's absolute coordinates below 1e15. Fails with INVALID_ARGUMENT;
// sgs_last_error() gives the reason.
SGS_API sgs_status sgs_pose_validate(const sgs_pose *pose);

// Replaces the rotation of a valid pose, such as one with few digits, by the nearest exact one. The
// camera stays at -R⁻¹ t. Rotations that are orthonormal to 1e-12 keep their bits. Rendering and
// sgs_scene_create do so with a copy. Cannot fail.
SGS_API void sgs_pose_orthonormalize(sgs_pose *pose);

// Pose from a quaternion (w,x,y,z, any positive norm) and translation, in COLMAP's convention.
// Fails with INVALID_ARGUMENT for zero or non-finite quaternions or non-finite translations.
SGS_API sgs_status sgs_pose_from_quaternion(const double qvec[4], const double tvec[3],
                                            sgs_pose *pose);

// Pose from the camera-to-world rotation (row-major: its columns are the camera axes in the world)
// and the camera centre, as in cameras.json and most 3D programs. Exactly orthonormal, as by
// sgs_pose_orthonormalize. Fails with INVALID_ARGUMENT as sgs_pose_validate; *pose is then
// undefined.
SGS_API sgs_status sgs_pose_from_axes(const double axes[9], const double center[3], sgs_pose *pose);

// Quaternion (w,x,y,z), unit, w >= 0, of a pose's rotation. Cannot fail.
SGS_API void sgs_pose_quaternion(const sgs_pose *pose, double qvec[4]);

#ifdef __cplusplus
}
#endif
