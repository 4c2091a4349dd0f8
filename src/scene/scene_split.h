// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The split of a scene's views and its extent. Used by scene.c alone, while it loads.

#include <stdbool.h>

#include "sparegs/scene.h"

// Sets the split of every view: by options->held_out, by the names in options->test_images, by the
// data set's own split (has_split: the views carry it already) or every options->test_every-th
// view. INVALID_ARGUMENT for a name of test_images that no view has, and when no view is left to
// train on.
sgs_status sgsi_scene_split(sgs_scene *scene, const sgs_scene_options *options, bool has_split);

// Sets scene->center and scene->extent (world units, > 0) from the cameras that train, at least
// one; from the points where all cameras are in one place. FORMAT when it would not be finite.
sgs_status sgsi_scene_measure_extent(sgs_scene *scene);

// Fails with OUT_OF_MEMORY: loading the scene at `path` needs more memory than there is.
sgs_status sgsi_scene_no_memory(const char *path);
