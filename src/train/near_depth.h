// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The depth below which gradients count less for growth (schedule.h: near_depth).

#include "sparegs/scene.h"
#include "sparegs/status.h"

// *share: the given share of the extent or, where points are close to the cameras for the extent,
// as on a street or in a corridor, a share of the median depth of the scene's points in the images
// of the training views. The smaller one, in extents. Looks at up to 2048 points in 256 views.
// Fails with OUT_OF_MEMORY.
sgs_status sgsi_near_depth_limit(const sgs_scene *scene, double *share);
