// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Crop and clean: what the filters of `convert` would remove, as a picture and as a file. Functions
// require the source's lock.

#include "run/model_filter.h"
#include "viewer/view_message.h"
#include "viewer/view_source.h"

// [count] flags of the primitives that the crop keeps; release with free(). NULL on failure.
unsigned char *crop_keep(const view_crop *crop, view_source *source);

// A copy of the source's model with the primitives that a crop rejects coloured red or removed.
typedef struct crop_preview {
    view_crop crop; // that the copy shows
    uint64_t version;
    sgs_gaussians *model;
    sgs_renderer *renderer;
    size_t removed;
} crop_preview;

// Prepares the copy. False if out of memory, or after printing the error.
bool crop_preview_prepare(crop_preview *preview, const view_crop *crop, view_source *source);
void crop_preview_free(crop_preview *preview);

// Writes the kept primitives as FOLDER/crop_N.ply for the first free N: {"type": "crop", "path",
// "kept", "removed"}. NULL after printing the error, or if `progress` cancels before the file is
// opened; it may be NULL.
json_t *crop_save(const view_crop *crop, view_source *source, sgs_progress_fn progress, void *user);
