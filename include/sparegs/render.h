// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Rendering a model from a camera and differentiating the image: the Embree tracer, and the slow
// double-precision reference that defines its results. No training, no files.
//
// Threads: a renderer takes one call at a time. Different renderers may run at the same time on
// different threads, also with the same model; the model must not change meanwhile. The reference
// consists of pure functions.
//
// Response of a Gaussian to a ray x(t) = c + t d, |d| = 1, with M = S^-1 R^T, p = M (c - mean) and
// g = M d: rho^2 = |p x g|^2 / |g|^2 at t = -(p.g) / |g|^2, alpha = min(0.99, o exp(-rho^2 / 2)).
//
// Counted hits of a ray: those with alpha >= 1/255 and t > near, in the order (t, id), up to the
// first one that would reduce the transmittance below 1e-4, which is excluded (as in 3DGS). The
// tracer computes t in single precision: hits whose t differ only by rounding may be in another
// order. Primitives of the same shape and mean are ordered by id.
//
// Pixel filters. `3dgs`: s'^2 = s^2 + 0.3 (z / f)^2 with z the camera depth of the mean (for
// fisheye lenses its distance) and f = sqrt(fx fy): the dilation of 3DGS by 0.3 px^2 on the optical
// axis. It is isotropic in space, so at an angle theta from the axis it over-dilates the radial
// direction by 1 / cos(theta). `none`: the unfiltered Gaussian. `mip` (Yu et al. 2024): s'^2 = s^2
// + f3^2 with the model's 3D filter f3, then + 0.1 (z / f)^2 with the opacity factors of the paper.

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
    sgs_filter filter;  // default SGS_FILTER_3DGS
    // Hits at t <= near are ignored, world units, >= 0; default 0.2, the culling distance of 3DGS.
    // See sgs_near_distance.
    double near_distance;
    int sh_degree; // highest band used, 0..3; default 3
    // [count] Mip-Splatting's f3 in world units, or NULL = 0; used by SGS_FILTER_MIP only.
    const float *filter_3d;
    // Distances of the frame are measured along the camera's axis (z) instead of the ray; default
    // false. Not defined, and UNSUPPORTED, if a ray of the camera is 90 degrees or more from the
    // axis.
    bool axis_depth;
    // In (0, 1]; default 1, exact. A tile of 16x16 pixels ignores a primitive if rho^2 exceeds this
    // fraction of the support, 2 ln(255 o), for all rays of the tile; FastGS's rasteriser uses 0.5.
    double compact_box;
    // Keep what sgs_renderer_backward requires: the list of hits of each tile.
    bool differentiable;
    // Called between bands of rows, and with `done` 0 while the rays of a frame of a million pixels
    // or more are prepared; or NULL. Must be NULL with `differentiable`.
    sgs_progress_fn progress;
    void *progress_user;
} sgs_render_options;

// Near distance for a scene of this extent (sgs_scene.extent), world units: 0.2, and 0.2 * extent
// for extents below 1. Cannot fail.
SGS_API double sgs_near_distance(double extent);

// Writes the defaults to a struct of `size` bytes, see status.h. Cannot fail.
SGS_API void sgs_render_options_init(sgs_render_options *options, size_t size);
static inline sgs_render_options sgs_render_options_default(void)
{
    sgs_render_options options;
    sgs_render_options_init(&options, sizeof options);
    return options;
}

// Planes that sgs_frame_create_with allocates besides colour and transmittance (AOVs).
enum {
    SGS_AOV_DEPTH_MEAN = 1,
    SGS_AOV_DEPTH_MEDIAN = 2,
    SGS_AOV_DEPTH_FIRST = 4,
    SGS_AOV_HITS = 8,
    SGS_AOV_NORMAL = 16,
    SGS_AOV_POSITION = 32,
    SGS_AOV_PRIMITIVE = 64,
    SGS_AOV_CANDIDATES = 128,
    SGS_AOVS_BASIC = 15,
    SGS_AOVS_ALL = 255
};

#define SGS_NO_PRIMITIVE UINT32_MAX

// Planes of a rendered view: [height][width] row-major, top row first; a NULL plane is not
// rendered. Owned by the caller. w is the blending weight T alpha of a hit, t its distance along
// the unit ray (along the axis with sgs_render_options.axis_depth) in world units.
typedef struct sgs_frame {
    int width, height;    // must equal the camera's
    float *color[3];      // sum of w times the SH colour: premultiplied, WITHOUT background
    float *transmittance; // T after the last counted hit; alpha = 1 - T
    float *depth_mean;    // sum(w t) / sum(w); 0 without a hit
    float *depth_median;  // t of the hit that reduces T to 0.5 or below; 0 if none does
    float *depth_first;   // smallest t of a counted hit; 0 without a hit
    float *hits;          // number of counted hits
    // World, unit: direction of sum(w n), n the primitive's shortest axis (the first of equal ones)
    // turned towards the camera centre; 0 without a hit or if the sum vanishes.
    float *normal[3];
    float *position[3];  // world: sum(w x) / sum(w), x the point of a hit; 0 without a hit
    uint32_t *primitive; // row of the primitive with the largest w; SGS_NO_PRIMITIVE without a hit
    // Primitives that the BVH returned for the pixel's tile of 16x16 pixels and that rays of the
    // tile may hit: the cost of the tile. With this plane every rendering rebuilds the BVH, so that
    // the values do not depend on earlier ones.
    float *candidates;
} sgs_frame;

// Memory for rendering into one of `count` frames of this size, in bytes: colour, transmittance and
// the planes of `planes` (SGS_AOV_ bits) of each, and what a renderer holds per pixel while it
// creates the rays of a camera of this size. Without the model. Cannot fail; UINT64_MAX if larger,
// 0 for an invalid size.
SGS_API uint64_t sgs_frame_memory(int width, int height, unsigned planes, int count);

// Allocates colour, transmittance and the planes of SGS_AOVS_BASIC, 64-byte aligned and zeroed.
// Free them with sgs_frame_free. Fails with INVALID_ARGUMENT (size) or OUT_OF_MEMORY, also if the
// machine has less than sgs_frame_memory of one frame; all planes are then NULL.
SGS_API sgs_status sgs_frame_create(int width, int height, sgs_frame *frame);
// The same with the planes of `planes`, a combination of SGS_AOV_ bits.
SGS_API sgs_status sgs_frame_create_with(int width, int height, unsigned planes, sgs_frame *frame);
// Frees the planes of a frame that these functions allocated and zeroes the struct; accepts a
// zeroed one.
SGS_API void sgs_frame_free(sgs_frame *frame);

typedef struct sgs_renderer sgs_renderer;

// Creates a renderer; release it with sgs_renderer_destroy. The model must outlive it; call
// sgs_renderer_update or sgs_renderer_refit after every change. The first rendering builds the BVH.
// Fails with OUT_OF_MEMORY, UNSUPPORTED (no Embree device for this processor) or INTERNAL (Embree);
// *renderer is then NULL.
SGS_API sgs_status sgs_renderer_create(const sgs_gaussians *model, sgs_renderer **renderer);
SGS_API void sgs_renderer_destroy(sgs_renderer *renderer); // accepts NULL
// Limit of the memory for ray tables, bytes; 1 GiB initially. A renderer keeps the tables of recent
// cameras, about 10 bytes per pixel for each lens and size, because building one takes a noticeable
// fraction of the time of a rendering. The table of the last rendering is kept even if it exceeds
// the limit. Applies from the next call that needs a table. Cannot fail.
SGS_API void sgs_renderer_ray_limit_set(sgs_renderer *renderer, size_t bytes);
// Bytes of the ray tables that the renderer holds. Cannot fail.
SGS_API size_t sgs_renderer_ray_bytes(const sgs_renderer *renderer);
// Call it after every change of the model's values or count: the next rendering rebuilds the BVH.
// Cannot fail.
SGS_API sgs_status sgs_renderer_update(sgs_renderer *renderer);
// The same for small changes of the values, such as a step of an optimiser: the next rendering
// refits the BVH, which is faster. The image has the same bits, but the further the primitives have
// moved since the last rebuild, the slower the tracing. Cannot fail.
SGS_API sgs_status sgs_renderer_refit(sgs_renderer *renderer);
// Renders one view into the planes of `frame` that are not NULL. options NULL = the defaults. The
// result does not depend on the number of threads, bit for bit. Fails with INVALID_ARGUMENT
// (options out of range, sgs_camera_validate, sgs_pose_validate, frame size differs from the
// camera's), UNSUPPORTED (a lens too wide for its image, axis_depth with a ray 90 degrees or more
// from the axis), OUT_OF_MEMORY, INTERNAL (Embree) or CANCELLED; the contents of the planes are
// then undefined.
SGS_API sgs_status sgs_renderer_render(sgs_renderer *renderer, const sgs_camera *camera,
                                       const sgs_pose *pose, const sgs_render_options *options,
                                       sgs_frame *frame);

// Gradient of a loss L with respect to the model, for the last sgs_renderer_render of this
// renderer, which must have succeeded with options.differentiable. The model must not have changed
// since.
//
// d_frame: dL/dcolour and dL/dtransmittance in the planes of the same names, of the size of that
// frame; NULL planes are zero. The other planes have no gradient and must be NULL: create the frame
// with sgs_frame_create_with(width, height, 0, ...). For an image composited over a background b,
// C + T b, dL/dT = b . dL/d(image).
//
// d_model: a model with the same number of primitives. Its parameters are overwritten with
// dL/d(stored parameter): logit of the opacity (opacity itself with linear_opacity), log of the
// scale, unnormalised quaternion; 0 for primitives without a counted hit. Read them with
// sgs_gaussians_read.
//
// Where the clamp alpha = min(0.99, a) applies, a = o exp(-rho^2 / 2), its derivative is taken as
// 0.99 / a: alpha dL/dalpha passes through it unchanged, as dL/dlog a. 3DGS takes 1, which differs
// by at most 1 % for opacities <= 1. A colour channel clamped at 0 has no gradient, as in 3DGS. The
// pixel filter's dependence on depth is included; options.filter_3d is constant. The result does
// not depend on the number of threads, bit for bit. Fails with INVALID_ARGUMENT or OUT_OF_MEMORY;
// d_model is then undefined.
SGS_API sgs_status sgs_renderer_backward(sgs_renderer *renderer, const sgs_frame *d_frame,
                                         sgs_gaussians *d_model);

// ---- Deep images: the samples along each ray ----

typedef struct sgs_deep_options {
    size_t struct_size; // set by sgs_deep_options_default()
    // Hits closer than this fraction of their distance are merged into one sample, [0, 1]; default
    // 0.01.
    double tolerance;
    int max_samples; // per pixel, 1..256; the tolerance of a pixel with more grows; default 32
} sgs_deep_options;

// Writes the defaults to a struct of `size` bytes, see status.h. Cannot fail.
SGS_API void sgs_deep_options_init(sgs_deep_options *options, size_t size);
static inline sgs_deep_options sgs_deep_options_default(void)
{
    sgs_deep_options options;
    sgs_deep_options_init(&options, sizeof options);
    return options;
}

// Receives the rows [y, y + rows) of a deep image, from top to bottom. counts: [rows][width]
// samples per pixel; samples: of all these pixels, consecutively. Both are valid during the call.
// The frame's planes are complete for these rows. A status other than SGS_STATUS_OK ends the
// rendering with that status; sgs_last_error() is then what the function made it, or else says
// that it failed.
typedef sgs_status (*sgs_deep_rows_fn)(void *context, int y, int rows, const uint32_t *counts,
                                       const sgs_deep_sample *samples);

// Renders one view like sgs_renderer_render, with the same bits in the frame, and passes the
// samples to `rows`. depth_first of the frame equals z of a pixel's first sample. deep NULL = the
// defaults. Ignores options.differentiable; sgs_renderer_backward fails until the next
// differentiable sgs_renderer_render. Fails as sgs_renderer_render, with INVALID_ARGUMENT for deep
// options out of range, or with the status of `rows`.
SGS_API sgs_status sgs_renderer_render_deep(sgs_renderer *renderer, const sgs_camera *camera,
                                            const sgs_pose *pose, const sgs_render_options *options,
                                            const sgs_deep_options *deep, sgs_frame *frame,
                                            sgs_deep_rows_fn rows, void *context);

// ---- The reference: every ray against every primitive in double precision, no BVH, no SIMD.
// O(pixels x primitives) ----

// Planes as in sgs_frame, in double; `primitive` is the row, -1 for none.
typedef struct sgs_reference_frame {
    int width, height;
    double *color[3];
    double *transmittance, *depth_mean, *depth_median, *depth_first, *hits;
    double *normal[3], *position[3], *primitive;
    double *candidates; // of the pixel, not its tile: primitives with a hit of alpha >= 1/255
} sgs_reference_frame;

// Allocates all planes, zeroed; free them with sgs_reference_frame_free. Fails with
// INVALID_ARGUMENT or OUT_OF_MEMORY; all planes are then NULL.
SGS_API sgs_status sgs_reference_frame_create(int width, int height, sgs_reference_frame *frame);
SGS_API void sgs_reference_frame_free(sgs_reference_frame *frame);

// One counted hit of one ray.
typedef struct sgs_hit {
    uint32_t primitive;
    double t, alpha, transmittance; // T in front of the hit
} sgs_hit;

// Renders all planes. params: [count][SGS_PARAM_COUNT] in the order of SGS_PARAM_; double, so that
// finite differences can perturb them below float resolution. sh_degree is clamped to 0..3, and any
// near_distance is accepted: a negative one shows hits behind the camera. Otherwise fails as
// sgs_renderer_render, with UNSUPPORTED for a compact_box other than 1, or with LIMIT (more than
// 2^32 - 1 primitives).
SGS_API sgs_status sgs_reference_render(const double *params, size_t count,
                                        const sgs_camera *camera, const sgs_pose *pose,
                                        const sgs_render_options *options,
                                        sgs_reference_frame *frame);

// Counted hits of the ray through the centre of pixel (x, y), in blending order. Writes at most
// `capacity` of them to `hits` (may be NULL if that is 0) and their total number to *hit_count: 0
// for a pixel outside of the image or without a ray. t is measured along the ray, whatever
// axis_depth. Fails as sgs_reference_render; *hit_count is then 0.
SGS_API sgs_status sgs_reference_hits(const double *params, size_t count, const sgs_camera *camera,
                                      const sgs_pose *pose, const sgs_render_options *options,
                                      int x, int y, sgs_hit *hits, size_t capacity,
                                      size_t *hit_count);

// Gradients of a loss L for sgs_reference_render with the same arguments. d_color, d_transmittance:
// [height][width] planes of dL/dcolour and dL/dtransmittance; d_transmittance may be NULL.
// d_params: [count][SGS_PARAM_COUNT], overwritten with dL/d(stored parameter); conventions as in
// sgs_renderer_backward, but the derivative of the clamp of alpha is 1. d_mean_no_sh: [count][3],
// dL/dmean without the part through the SH direction, or NULL.
SGS_API sgs_status sgs_reference_backward(const double *params, size_t count,
                                          const sgs_camera *camera, const sgs_pose *pose,
                                          const sgs_render_options *options,
                                          const double *const d_color[3],
                                          const double *d_transmittance, double *d_params,
                                          double *d_mean_no_sh);

#ifdef __cplusplus
}
#endif
