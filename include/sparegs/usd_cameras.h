// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The cameras of an OpenUSD stage, as pinholes for the renderer. Reads text (.usda, or .usd with
// text) and the root layer of a package (.usdz) if it is text; no binary files, references,
// sublayers or variants. Writes nothing: models are written with their cameras by sgs_model_write.
//
// The world is that of the models that sgs_model_read reads from the same stage: x right, y down, z
// forward, whatever upAxis says; metersPerUnit has no effect on either. Both fit without changes.
//
// Threads: the functions may be called from any thread at any time.

#include "sparegs/camera.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct sgs_usd_view {
    double time;       // time code at which the stage was evaluated
    int frame;         // the nearest integer; 0 without time samples
    sgs_camera camera; // SGS_CAMERA_PINHOLE
    sgs_pose pose;
} sgs_usd_view;

typedef struct sgs_usd_camera {
    char *path;          // of the prim, without the first slash: "World/shot"
    bool has_samples;    // of the camera or a prim above it, at time codes that are frame numbers
    bool is_animated;    // there is more than one sample of some attribute
    size_t view_count;   // 1, or one per frame if it is animated
    sgs_usd_view *views; // [view_count], by increasing time
} sgs_usd_camera;

typedef struct sgs_usd_cameras {
    size_t count;            // >= 1
    sgs_usd_camera *cameras; // [count], in the order of the file
    double fps;              // views per second of the animated cameras; 0 without such
} sgs_usd_cameras;

// Reads all active prims of type Camera that are perspective, for images of width x height pixels
// (1 to 65536); orthographic ones are omitted with a warning. Release with sgs_usd_cameras_destroy.
//
// The transforms of a camera and of the prims above it are evaluated as UsdGeomXformable does;
// between time samples, numbers change linearly and quaternions by slerp. An animated camera has
// one view for each integer time code from startTimeCode to endTimeCode, or from its first to its
// last sample where the layer does not give them; fps is timeCodesPerSecond, else framesPerSecond,
// else 24.
//
// The vertical field of view is that of focalLength and verticalAperture. The horizontal one
// follows from horizontalAperture if the pixels are then square to 1 %, or to one pixel of the
// shorter side; else from square pixels, with a warning. Anamorphic cameras of sparegs have the
// attribute sparegs:pixelAspectRatio in place of 1. The aperture offsets move the principal point.
//
// Fails with INVALID_ARGUMENT (size), IO, FORMAT (also for values that are out of range),
// UNSUPPORTED (binary files, variants, splines, orthographic cameras only, shears, mirrors and
// scales that are not uniform), LIMIT (frame numbers beyond -1000000 to 1000000, more than 100000
// cameras or views) or OUT_OF_MEMORY; the error names the file and the camera. On failure *cameras
// is NULL.
SGS_API sgs_status sgs_usd_cameras_read(const char *path, int width, int height,
                                        sgs_usd_cameras **cameras);

// Accepts NULL.
SGS_API void sgs_usd_cameras_destroy(sgs_usd_cameras *cameras);

#ifdef __cplusplus
}
#endif
