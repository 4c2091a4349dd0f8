// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Mip-Splatting's 3D smoothing filter: the width below which no training camera can tell a
// primitive's shape, and models with that filter worked into their scales and opacities. Knows no
// images.

#include "sparegs/gaussians.h"
#include "sparegs/scene.h"

// f3 of every primitive, world units: filter_3d [count] is written. views: [view_count] indices
// into scene->views. Primitives that no view samples get the filter of the most distant one that
// some view does.
void sgsi_filter_3d_compute(const sgs_gaussians *model, const sgs_scene *scene, const size_t *views,
                            size_t view_count, float *filter_3d);

// sqrt of product s^2 / product (s^2 + f3^2): what the filter leaves of a primitive's opacity.
double sgsi_filter_3d_factor(const sgs_gaussians *model, size_t i, float filter_3d);
