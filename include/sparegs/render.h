// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Rendering a model from a camera and differentiating the image: the Embree tracer, and the slow
// double-precision reference that defines its results. No training, no files.
//
// Threads: a renderer takes one call at a time. Different renderers may run at the same time on
// different threads, also over the same model; nothing may change the model meanwhile. The
// reference is a set of pure functions.
//
// Response of a Gaussian to a ray x(t) = c + t d, |d| = 1 (M = S^-1 R^T, p = M (c - mean), g = M
// d): rho^2 = |p x g|^2 / |g|^2 at t = -(p.g) / |g|^2; alpha = min(0.99, o exp(-rho^2 / 2)). A hit
// counts when alpha >= 1/255 and t > near. Hits blend in the order (t, id) - where two t round to
// the same float, the tracer takes the nearer mean first, then the smaller id -; the first one that
// would take the transmittance below 1e-4 and all behind it do not count.
//
// Filter `3dgs`: scales become s'^2 = s^2 + 0.3 (z / f)^2 with z the camera depth of the mean (its
// distance, for fisheye lenses) and f = sqrt(fx fy): the 0.3 px^2 dilation of 3DGS. Filter `none`:
// the bare Gaussian. Filter `mip`: s'^2 = s^2 + f3^2 with the model's 3D filter f3, then + 0.1 (z /
// f)^2 with Mip-Splatting's opacity factors.

#include <stdbool.h>
#include <stdint.h>

#include "sparegs/camera.h"
#include "sparegs/gaussians.h"
#include "sparegs/image.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum sgs_filter { SGS_FILTER_3DGS = 0, SGS_FILTER_NONE = 1, SGS_FILTER_MIP = 2 } sgs_filter;

typedef struct sgs_render_options {
    size_t struct_size; // set by sgs_render_options_default()
    sgs_filter filter;
    double near_distance; // hits at t <= near do not count, world units; default 0.2 (3DGS's cull),
                          // see sgs_near_distance
    int sh_degree;        // highest band used, 0..3; default 3
    const float *filter_3d; // [count] Mip-Splatting's f3 in world units, or NULL (0); used by
                            // SGS_FILTER_MIP only
    bool axis_depth; // distances of the frame are along the camera's axis (z) instead of the ray;
                     // default false
    double compact_box;  // in (0, 1]: a tile of 16x16 pixels leaves a primitive out when rho^2 of
                         // its rays is beyond this share of the support, 2 ln(255 o), as FastGS's
                         // rasteriser does at 0.5; default 1, exact
    bool differentiable; // keep what sgs_renderer_backward needs: the list of every tile's hits
    sgs_progress_fn progress; // called between bands of rows, or NULL; not with `differentiable`
    void *progress_user;
} sgs_render_options;

// The near distance for cameras of this extent (scene.h): 0.2, and in scenes smaller than 1 as much
// less: their cameras would look through what is to be seen.
SGS_API double sgs_near_distance(double extent);

SGS_API sgs_render_options sgs_render_options_default(void);

// What a frame can hold besides colour and transmittance.
enum {
    SGS_AOV_DEPTH_MEAN = 1,
    SGS_AOV_DEPTH_MEDIAN = 2,
    SGS_AOV_DEPTH_FIRST = 4,
    SGS_AOV_HITS = 8,
    SGS_AOV_NORMAL = 16,
    SGS_AOV_POSITION = 32,
    SGS_AOV_PRIMITIVE = 64,
    SGS_AOVS_BASIC = 15,
    SGS_AOVS_ALL = 127
};

#define SGS_NO_PRIMITIVE UINT32_MAX

// Planes of a rendered view, [height][width] row-major, top row first, each NULL when not wanted.
// Owned by the caller. Distances are along the unit ray (or along the axis:
// sgs_render_options.axis_depth), in world units.
typedef struct sgs_frame {
    int width, height;    // must equal the camera's
    float *color[3];      // linear blend of the SH colours, premultiplied, WITHOUT background
    float *transmittance; // T left after the last counted hit; alpha = 1 - T
    float *depth_mean;    // sum(w t) / sum(w); 0 where nothing was hit
    float *depth_median;  // t of the hit that takes T to 0.5 or below; 0 if none does
    float *depth_first;   // smallest t of a counted hit; 0 where nothing was hit
    float *hits;          // number of counted hits
    float *normal[3]; // world, unit: direction of sum(w n), n the primitive's shortest axis (the
                      // first of equal ones)
    // turned towards the camera's centre; 0 where nothing was hit or the sum vanishes
    float *position[3];  // world: sum(w x) / sum(w), x the point of a hit; 0 where nothing was hit
    uint32_t *primitive; // row of the primitive with the largest w; SGS_NO_PRIMITIVE where nothing
                         // was hit
} sgs_frame;

// Allocates colour, transmittance and the planes of SGS_AOVS_BASIC (64-byte aligned, zeroed); on
// failure everything is NULL.
SGS_API sgs_status sgs_frame_create(int width, int height, sgs_frame *frame);
// The same with a choice: `planes` is a sum of SGS_AOV_ bits.
SGS_API sgs_status sgs_frame_create_with(int width, int height, unsigned planes, sgs_frame *frame);
// Frees the planes of a frame made by these functions and zeroes the struct; accepts an empty one.
SGS_API void sgs_frame_free(sgs_frame *frame);

typedef struct sgs_renderer sgs_renderer;

// A renderer of a model, which must outlive it and must not change without sgs_renderer_update. The
// BVH is built at the first rendering. Release it with sgs_renderer_destroy, which accepts NULL.
// Fails with OUT_OF_MEMORY or INTERNAL (Embree); *renderer is then NULL.
SGS_API sgs_status sgs_renderer_create(const sgs_gaussians *model, sgs_renderer **renderer);
SGS_API void sgs_renderer_destroy(sgs_renderer *renderer);
// To be called after every change of the model, its values or its count: the next rendering
// rebuilds the BVH. Cannot fail.
SGS_API sgs_status sgs_renderer_update(sgs_renderer *renderer);
// Renders one view: the planes of `frame` that are not NULL. Bits do not depend on the number of
// threads. options: NULL = the defaults. Fails with INVALID_ARGUMENT for options out of range or a
// frame of another size than the camera's, UNSUPPORTED for a lens without rays, OUT_OF_MEMORY or
// CANCELLED; the planes then hold anything.
SGS_API sgs_status sgs_renderer_render(sgs_renderer *renderer, const sgs_camera *camera,
                                       const sgs_pose *pose, const sgs_render_options *options,
                                       sgs_frame *frame);

// Gradient of a loss L with respect to the model, for the last successful sgs_renderer_render of
// this renderer, whose options had `differentiable` (else INVALID_ARGUMENT). The model must not
// have changed since.
//
// d_frame: dL/dcolour and dL/dtransmittance in the planes of the same names, sizes of that frame; a
// NULL plane is zero. The other planes (depths, hits, AOVs) have no gradient and must be NULL: make
// the frame with sgs_frame_create_with(width, height, 0, ...). A loss that lays the image over a
// background b, C + T b, has dL/dT = b . dL/d(image).
//
// d_model: a model of the same number of primitives, whose parameters are overwritten with
// dL/d(stored parameter): logit of the opacity (or opacity itself: linear_opacity), log of the
// scale, unnormalised quaternion. Read them with sgs_gaussians_read. Primitives without a counted
// hit have 0. As in 3DGS, alpha's clamp at 0.99 is ignored (straight-through), and a colour channel
// clamped at 0 has no gradient. The path of the pixel filter through the depth is included, that of
// a fixed render_options.filter_3d is not. Bits do not depend on the number of threads.
SGS_API sgs_status sgs_renderer_backward(sgs_renderer *renderer, const sgs_frame *d_frame,
                                         sgs_gaussians *d_model);

// ---- Deep pictures: what a ray meets, one by one ----

typedef struct sgs_deep_options {
    size_t struct_size; // set by sgs_deep_options_default()
    double tolerance; // hits closer than this fraction of their distance become one sample, [0, 1];
                      // default 0.01
    int max_samples;  // per pixel, 1..256: where there are more, the tolerance grows; default 32
} sgs_deep_options;

SGS_API sgs_deep_options sgs_deep_options_default(void);

// Receives the rows [y, y + rows) of a picture, bands in order. counts [rows][width]: samples per
// pixel; samples: all of them, pixel after pixel. Valid during the call. The frame's planes of
// these rows are complete. Anything but SGS_STATUS_OK ends the rendering with that status.
typedef sgs_status (*sgs_deep_rows_fn)(void *context, int y, int rows, const uint32_t *counts,
                                       const sgs_deep_sample *samples);

// Renders one view into a frame, as sgs_renderer_render does and to the same bits, and its samples
// on the way. depth_first of the frame equals z of a pixel's first sample.
SGS_API sgs_status sgs_renderer_render_deep(sgs_renderer *renderer, const sgs_camera *camera,
                                            const sgs_pose *pose, const sgs_render_options *options,
                                            const sgs_deep_options *deep, sgs_frame *frame,
                                            sgs_deep_rows_fn rows, void *context);

// ---- The oracle: brute force over all primitives, double precision, no BVH, no SIMD. O(pixels x
// primitives). ----

// Planes as in sgs_frame, in double (a primitive's row too, and -1 for none).
typedef struct sgs_reference_frame {
    int width, height;
    double *color[3];
    double *transmittance, *depth_mean, *depth_median, *depth_first, *hits;
    double *normal[3], *position[3], *primitive;
} sgs_reference_frame;

// Allocates all planes.
SGS_API sgs_status sgs_reference_frame_create(int width, int height, sgs_reference_frame *frame);
SGS_API void sgs_reference_frame_free(sgs_reference_frame *frame);

// One counted hit of one ray.
typedef struct sgs_hit {
    uint32_t primitive;
    double t, alpha, transmittance; // T in front of the hit
} sgs_hit;

// params: [count][SGS_PARAM_COUNT] doubles in SGS_PARAM_ order (so that finite differences can
// perturb them below float resolution).
SGS_API sgs_status sgs_reference_render(const double *params, size_t count,
                                        const sgs_camera *camera, const sgs_pose *pose,
                                        const sgs_render_options *options,
                                        sgs_reference_frame *frame);

// Counted hits of the ray through pixel (x, y)'s centre, in blending order. Writes at most
// `capacity`; returns the number there are.
SGS_API size_t sgs_reference_hits(const double *params, size_t count, const sgs_camera *camera,
                                  const sgs_pose *pose, const sgs_render_options *options, int x,
                                  int y, sgs_hit *hits, size_t capacity);

// Gradients of L given dL/dcolor (3 planes) and dL/dT (plane, may be NULL) of the render above:
// d_params [count][SGS_PARAM_COUNT] receives dL/d(stored parameter) (logit, log, unnormalised
// quaternion), overwritten. d_mean_no_sh [count][3], optional: dL/dmean without the part through
// the SH direction. The 0.99 clamp of alpha is ignored in the gradient, as in 3DGS
// (straight-through); a colour channel clamped at 0 gets none. The path of the 3dgs filter through
// z is included.
SGS_API sgs_status sgs_reference_backward(const double *params, size_t count,
                                          const sgs_camera *camera, const sgs_pose *pose,
                                          const sgs_render_options *options,
                                          const double *const d_color[3],
                                          const double *d_transmittance, double *d_params,
                                          double *d_mean_no_sh);

#ifdef __cplusplus
}
#endif
