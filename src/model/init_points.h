// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The initial model from a point cloud, for pipelines whose initial opacities and scales differ
// from those of 3DGS.

#include "sparegs/gaussians.h"

// sgs_gaussians_init_points with an opacity in (0, 1) instead of 0.1 and a factor > 0 on the
// scales. Fails as that function.
sgs_status sgsi_gaussians_init_points(const float *points, const unsigned char *colors, size_t n,
                                      double fallback_scale, double opacity, double scale_factor,
                                      sgs_gaussians **model);
