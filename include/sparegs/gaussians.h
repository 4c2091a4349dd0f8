// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The model: 3D Gaussians with their stored (pre-activation) parameters, and its file, the PLY of
// 3DGS. No gradients, no optimiser state, no BVH.
//
// Stored values and activations (Kerbl et al. 2023): mean in world units; rotation as a quaternion
// (w, x, y, z), normalised when used; log of the scale in world units; logit of the opacity;
// spherical harmonics: colour = max(0, sum + 0.5) in the space of the photos. An infinite logit is
// the opacity 1 or 0; sgs_model_write, sgs_compress and the scores of prune.h accept it, but no
// other value that is not finite, nor an infinite linear opacity.
//
// Threads: functions with a const model may run at the same time on the same model; a call that
// changes a model must be the only one on it. Different models are independent.
//
// The memory layout is internal and may change; use sgs_gaussians_read, _write, _get and _set.
// (Blocks of 16 primitives, one cache line per parameter: parameter k of primitive i is data[((i /
// 16) * SGS_PARAM_COUNT + k) * 16 + i % 16].)

#include <stdbool.h>
#include <stddef.h>

#include "sparegs/status.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    SGS_LANES = 16,
    SGS_PARAM_MEAN = 0,     // x, y, z
    SGS_PARAM_ROTATION = 3, // w, x, y, z
    SGS_PARAM_SCALE = 7,    // 3 logs
    SGS_PARAM_OPACITY = 10, // logit; see linear_opacity
    SGS_PARAM_SH_DC = 11,   // r, g, b
    SGS_PARAM_SH_REST = 14, // [15][3]: coefficient-major, so the lower degrees come first
    SGS_PARAM_COUNT = 59
};

typedef struct sgs_gaussians {
    size_t count;
    size_t capacity; // multiple of 16
    int sh_degree;   // 0..3: degree stored in files; higher coefficients are 0
    // SGS_PARAM_OPACITY holds x, opacity |x|, which may exceed 1, instead of the logit. Files and
    // hashes contain the logit of at most 1 - 1e-6.
    bool linear_opacity;
    // [capacity / 16][SGS_PARAM_COUNT][16], 64-byte aligned, owned; rows >= count are inert.
    float *data;
} sgs_gaussians;

// Creates an empty model with room for `capacity` primitives; release it with
// sgs_gaussians_destroy. Fails with OUT_OF_MEMORY or LIMIT (more than 2^31 - 16); *model is then
// NULL.
SGS_API sgs_status sgs_gaussians_create(size_t capacity, sgs_gaussians **model);

// Accepts NULL.
SGS_API void sgs_gaussians_destroy(sgs_gaussians *model);

// Grows the capacity (never shrinks it); the contents are kept. Fails as create; the model is then
// unchanged.
SGS_API sgs_status sgs_gaussians_reserve(sgs_gaussians *model, size_t capacity);

// Sets the count. New rows are inert: opacity logit -30 (or opacity 0), identity rotation, log
// scale -20, zero elsewhere. Fails as reserve; the model is then unchanged.
SGS_API sgs_status sgs_gaussians_resize(sgs_gaussians *model, size_t count);

// Makes `to`, an existing model, equal to `from`. Fails as resize; `to` is then unchanged.
SGS_API sgs_status sgs_gaussians_copy(sgs_gaussians *to, const sgs_gaussians *from);

// One parameter of one primitive in the internal layout; no bounds check.
static inline float *sgs_gaussians_at(const sgs_gaussians *model, size_t i, int param)
{
    return model->data + ((i / SGS_LANES) * SGS_PARAM_COUNT + (size_t)param) * SGS_LANES +
           i % SGS_LANES;
}

// Copies all stored parameters of primitive i, in the order of SGS_PARAM_, out of or into the
// model. No bounds check.
SGS_API void sgs_gaussians_get(const sgs_gaussians *model, size_t i, float params[SGS_PARAM_COUNT]);
SGS_API void sgs_gaussians_set(sgs_gaussians *model, size_t i, const float params[SGS_PARAM_COUNT]);

// Copies stored parameter `param` (SGS_PARAM_MEAN + 1 is y) of the primitives [first, first +
// count) to or from floats that are `stride_bytes` apart (0 = packed), for bindings and optimisers.
// Fails with INVALID_ARGUMENT if parameter or range are outside the model or the stride is below 4.
// Values are not checked.
SGS_API sgs_status sgs_gaussians_read(const sgs_gaussians *model, int param, size_t first,
                                      size_t count, float *out, size_t stride_bytes);
SGS_API sgs_status sgs_gaussians_write(sgs_gaussians *model, int param, size_t first, size_t count,
                                       const float *in, size_t stride_bytes);

// Opacity of primitive i as stored in files: the logit, of at most 1 - 1e-6 for linear opacities.
// No bounds check.
SGS_API float sgs_gaussians_opacity_logit(const sgs_gaussians *model, size_t i);

// Converts the logits of all rows to opacities and sets linear_opacity; no effect if it is set.
// Cannot fail.
SGS_API void sgs_gaussians_linearize_opacity(sgs_gaussians *model);
// Declares that rows [0, count) already hold opacities: sets linear_opacity and makes the rows
// after them inert. Cannot fail.
SGS_API void sgs_gaussians_declare_linear_opacity(sgs_gaussians *model);

// Initial model of 3DGS for a point cloud (Kerbl et al. 2023, section 5.1): scale = RMS distance to
// the 3 nearest other points (exact), opacity 0.1, identity rotation, SH band 0 from the colour.
// points: [n][3], world; colors: [n][3], 8-bit, or NULL for grey.
//
// fallback_scale: a hundredth of the scene's extent, world units. A single point has this scale.
// The squared distance is at least 1e-7, times the square of the extent if that is below 1, and at
// least 1e-36. The caller destroys *model. Fails with INVALID_ARGUMENT (a point is not finite, or a
// single point without a positive fallback_scale of at most 1e18), OUT_OF_MEMORY or LIMIT; *model
// is then NULL.
SGS_API sgs_status sgs_gaussians_init_points(const float *points, const unsigned char *colors,
                                             size_t n, double fallback_scale,
                                             sgs_gaussians **model);

// Reads a 3DGS PLY: binary (either byte order) or ASCII, any order of properties, any SH degree (0,
// 9, 24 or 45 f_rest; 72 without the last band); unknown properties are ignored. An opacity of +inf
// or -inf is read as the logit of 1 - 1e-6 or 1e-6, a log scale of -inf as -30, as in a file of
// 2DGS, which has no scale_2; other rows with non-finite values are dropped with one warning. A
// zero quaternion becomes the identity, with a warning. The caller destroys *model. Fails with IO,
// FORMAT, UNSUPPORTED, LIMIT or OUT_OF_MEMORY; the error names file and place, *model is then NULL.
SGS_API sgs_status sgs_ply_read(const char *path, sgs_gaussians **model);

// Writes the little-endian PLY of 3DGS with 62 properties (fewer f_rest for a lower sh_degree),
// atomically: on failure (INVALID_ARGUMENT for sh_degree, IO, OUT_OF_MEMORY) an existing file is
// unchanged.
SGS_API sgs_status sgs_ply_write(const char *path, const sgs_gaussians *model);

// The same with an additional last property filter_3D: filter_3d[count], Mip-Splatting's f3 in
// world units.
SGS_API sgs_status sgs_ply_write_filter_3d(const char *path, const sgs_gaussians *model,
                                           const float *filter_3d);

// A copy of the model with Mip-Splatting's 3D filter [count] applied to scales and opacities (Yu et
// al. 2024, section 5.1), for viewers without the filter. The caller destroys *fused. Fails with
// OUT_OF_MEMORY; *fused is then NULL.
SGS_API sgs_status sgs_gaussians_fuse_filter_3d(const sgs_gaussians *model, const float *filter_3d,
                                                sgs_gaussians **fused);

// Writes a point cloud (x y z nx ny nz red green blue) like the input.ply of 3DGS, atomically.
// points: [n][3], world; colors: [n][3]. Fails with IO or OUT_OF_MEMORY.
SGS_API sgs_status sgs_ply_write_points(const char *path, const float *points,
                                        const unsigned char *colors, size_t n);

// XXH3 (64 bits) of count, SH degree and all parameters, row by row, as 16 hex digits and a NUL.
// The hash depends on the order of the rows. Cannot fail.
SGS_API void sgs_gaussians_hash(const sgs_gaussians *model, char hex[17]);

#ifdef __cplusplus
}
#endif
