// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The target images of a region's training: the photos where the region's own primitives make
// up the image, the initial model's rendering where other primitives do.

#include "train/train_view.h"

// Fills views->targets from the photos and the initial model, whose first `own` rows are the
// region's. filter_3d as in sgs_render_options. Reports every view (sgsi_train_views_advance).
// Fails with OUT_OF_MEMORY, CANCELLED or as sgs_scene_photo.
sgs_status sgsi_region_targets_make(sgsi_train_views *views, const sgs_gaussians *model, size_t own,
                                    const float *filter_3d);
