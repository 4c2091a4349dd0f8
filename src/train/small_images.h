// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Training views at a reduced size, for runs that start with small images: the plan of the
// sizes, and the photos of one size. Independent of model and schedule.

#include "density/resolution.h"
#include "train/train_view.h"

// Plans the sizes for iterations up to `until`. Reports every view (sgsi_train_views_advance).
// Fails with UNSUPPORTED when a photo is not 8-bit, or with CANCELLED.
sgs_status sgsi_small_images_plan(sgsi_train_views *views, int until, sgsi_resolution *plan);

// The photos at `scale` (>= 1), or images->scale 0 if it is the current scale. Reduces them
// all, unless the scene has an image cache. Fails with OUT_OF_MEMORY, with UNSUPPORTED when a
// photo is not 8-bit, or as sgs_scene_photo; *images is then empty.
sgs_status sgsi_small_images_make(const sgsi_train_views *views, int scale,
                                  sgsi_small_images *images);
void sgsi_small_images_free(sgsi_small_images *images);

// The photo of training view `index` at the current scale, which is above 1. Valid until the
// next call. Fails as sgsi_small_images_make.
sgs_status sgsi_small_images_photo(const sgsi_train_views *views, size_t index,
                                   const sgs_photo **photo);

// Moves *images into the views and frees the previous ones; returns false without a change if
// images->scale is 0. Depth bounds of another scale are invalid.
bool sgsi_small_images_adopt(sgsi_train_views *views, sgsi_small_images *images);
