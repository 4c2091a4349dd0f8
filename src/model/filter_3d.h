// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The 3D smoothing filter of Mip-Splatting (Yu et al. 2024, section 5.1): the sampling limit of the
// training cameras per primitive, and models with the filter baked into scales and opacities, which
// training removes again.

#include "sparegs/gaussians.h"
#include "sparegs/scene.h"

// The filter f3 of every primitive in two steps, because several processes may share a model.
// views: [view_count] indices into scene->views, at least one. _sample writes the nearest depth
// beyond near_limit, that of rendering, at which a view samples each primitive to filter_3d
// [count], world units, -1 if none does; *farthest: the largest of them, 0 if there is none. Fails
// with OUT_OF_MEMORY. _scale turns the depths into filters, world units; `farthest`, the largest
// depth of the rows of all processes, is that of primitives that no view samples. It cannot fail.
sgs_status sgsi_filter_3d_sample(const sgs_gaussians *model, const sgs_scene *scene,
                                 const size_t *views, size_t view_count, double near_limit,
                                 float *filter_3d, float *farthest);
void sgsi_filter_3d_scale(const sgs_scene *scene, const size_t *views, size_t view_count,
                          float farthest, float *filter_3d, size_t count);

// sqrt(product s^2 / product (s^2 + f3^2)): the factor of the filter on the opacity of a primitive.
double sgsi_filter_3d_factor(const sgs_gaussians *model, size_t i, float filter_3d);

// Applies the filter f3 to the scales and the opacity logit of one primitive.
void sgsi_filter_3d_fuse(float params[SGS_PARAM_COUNT], double filter_3d);
// Removes it, so that sgsi_filter_3d_fuse restores the primitive: raw scales sqrt(s^2 - f3^2), and
// an opacity that grows as the volume shrinks. A scale s of less than about f3 has no raw scale,
// and an opacity that would exceed 1 no raw opacity: the square of the raw scale is then at least a
// share of s^2, from 1 % to all of it, the smallest one that leaves the opacity below 1. Fusing
// then restores opacity times volume, with larger scales.
void sgsi_filter_3d_unfuse(float params[SGS_PARAM_COUNT], double filter_3d);

// All rows of a model; filter_3d: [count]. The opacities of `to` are logits; it may be `from`.
void sgsi_filter_3d_fuse_rows(const sgs_gaussians *from, const float *filter_3d, sgs_gaussians *to);
// Of a model with logits.
void sgsi_filter_3d_unfuse_rows(sgs_gaussians *model, const float *filter_3d);
