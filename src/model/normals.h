// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The normal of a primitive, for pictures: its shortest axis, turned towards the camera.

#include "sparegs/gaussians.h"

// normals [model->count][4], world axes, unit, the fourth 0. Of equally short axes the first is
// taken; a primitive at `center` keeps the axis's own sign, one without a finite rotation gets 0.
// Cannot fail.
void sgsi_normals_fill(const sgs_gaussians *model, const float center[3], float *normals);
