// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Checks that the memory suffices for a training run, before its images are loaded.

#include <stdbool.h>

#include "arguments/train_options.h"
#include "sparegs/scene.h"

// Initial number of primitives: `continued`, of the checkpoint to resume, if it is not 0; else of
// --init, or of the scene.
size_t memory_first_count(const sgs_scene *scene, const train_values *values, size_t continued);

// Memory besides training, in this process: `bytes`, and `row_bytes` per primitive.
typedef struct memory_reserve {
    size_t bytes, row_bytes;
} memory_reserve;
// Of those of --view, for one picture or EXR file and for one photo. With --max-memory, the viewer
// makes no larger ones.
enum { VIEW_PICTURE_BYTES = 150000000, VIEW_PHOTO_BYTES = 60000000 };
// That of --view: the second model and its renderer, for pictures of up to 1920 x 1080 pixels. Zero
// without the option, and on ranks other than 0.
memory_reserve memory_of_view(const train_values *values);

// Memory of a process: max_memory or, if that is 0, the memory of the machine divided by the ranks
// that run on it.
uint64_t memory_of_process(uint64_t max_memory);

// Compares the estimate for `count` primitives, and `reserve`, with the memory of the process. The
// images of the scene need not be loaded. False after printing the error.
bool memory_check(const sgs_scene *scene, const sgs_train_options *options, size_t image_cache,
                  size_t count, memory_reserve reserve, uint64_t max_memory);
