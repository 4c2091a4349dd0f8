// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Normals of primitives for images: the shortest axis, turned towards the camera.

#include "sparegs/gaussians.h"

// normals [model->count][4]: unit, world axes; the fourth component is 0. The first of equally
// short axes is used. A primitive at `center` keeps the sign of its axis; one without a finite
// rotation gets 0. Cannot fail.
void sgsi_normals_fill(const sgs_gaussians *model, const double center[3], float *normals);
