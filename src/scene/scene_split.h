// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Options, train/test split, extent and plausibility of the cameras of a scene. Used while a scene
// is loaded or created.

#include <stdbool.h>

#include "sparegs/scene.h"

// Fails with INVALID_ARGUMENT for values out of range; the error names the field.
sgs_status sgsi_scene_options_check(const char *path, const sgs_scene_options *options);

// Sets the split of each view: by options->held_out, else by the names in options->test_images,
// else by the data set's own split (has_split: already set in the views), else every
// options->test_every-th view. Fails with INVALID_ARGUMENT for names in test_images without a view
// and if no training view is left.
sgs_status sgsi_scene_split(sgs_scene *scene, const sgs_scene_options *options, bool has_split);

// Sets scene->center and scene->extent (world units, > 0) from the training cameras, at least one;
// from the points if all cameras coincide. Warns if single precision is too coarse at their
// distance from the origin. Fails with FORMAT if a camera is too far away.
sgs_status sgsi_scene_measure_extent(sgs_scene *scene);

// Warns of principal points outside of their images: intrinsics of another image size, without that
// size, have no other symptom. Cannot fail.
void sgsi_scene_warn_centers(const sgs_scene *scene);

// sgs_scene.digest
uint64_t sgsi_scene_digest(const sgs_scene *scene);

// Fails with OUT_OF_MEMORY for the scene at `path`.
sgs_status sgsi_scene_no_memory(const char *path);

// Fails with SGS_STATUS_CANCELLED.
sgs_status sgsi_scene_cancelled(const char *path);
