// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The depth below which gradients count less for growth (schedule.h: near_depth).

#include "sparegs/scene.h"
#include "sparegs/status.h"

// *limit: 0.45 times the median depth of the scene's points in the images of the training views, in
// extents; 0 if no point is in an image. It is below the schedule's value where the subject is
// close for the extent of the cameras, as on a street or in a corridor. Looks at up to 2048 points
// in 256 views. Fails with OUT_OF_MEMORY.
sgs_status sgsi_near_depth_limit(const sgs_scene *scene, double *limit);
