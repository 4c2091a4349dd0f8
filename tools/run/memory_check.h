// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Checks that the memory suffices for a training, before its images are loaded.

#include <stdbool.h>

#include "cli/train_options.h"
#include "sparegs/scene.h"

// Initial number of primitives: `continued`, of the checkpoint to resume, if it is not 0; else of
// --init, or of the scene.
size_t memory_first_count(const sgs_scene *scene, const train_values *values, size_t continued);

// Compares the estimate for `count` primitives with max_memory or, if that is 0, with the memory of
// the machine divided by the ranks that run on it. The images of the scene need not be loaded.
// False after printing the error.
bool memory_check(const sgs_scene *scene, const sgs_train_options *options, size_t image_cache,
                  size_t count, uint64_t max_memory);
