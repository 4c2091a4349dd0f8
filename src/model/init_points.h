// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The first model of a training from a cloud of points, for pipelines with another start than 3DGS.

#include "sparegs/gaussians.h"

// sgs_gaussians_init_points with another opacity in (0, 1) and a factor > 0 on the scales.
sgs_status sgsi_gaussians_init_points(const float *points, const unsigned char *colors, size_t n,
                                      double fallback_scale, double opacity, double scale_factor,
                                      sgs_gaussians **model);
