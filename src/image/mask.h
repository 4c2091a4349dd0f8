// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Which pixels of a photograph count: bit planes (sgs_photo.valid_mask) from mask files, alpha
// channels and lenses. Knows no scene and no loss.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/scene.h"

// Words per row of a bit plane.
static inline size_t sgsi_mask_words(int width)
{
    return ((size_t)width + 15) / 16;
}

// True if pixel (x, y) counts; a NULL plane keeps everything.
static inline bool sgsi_mask_is_valid(const uint16_t *valid_mask, int width, int x, int y)
{
    return !valid_mask ||
           (valid_mask[(size_t)y * sgsi_mask_words(width) + (size_t)x / 16] >> x % 16 & 1);
}

// The file of the mask for the photograph NAME (relative to image_folder), NULL in *path when there
// is none. `root` is where the folders `masks` and `mask` are looked for, `folder` replaces them
// (relative to root, or absolute).
sgs_status sgsi_mask_find(const char *root, const char *folder, const char *image_folder,
                          const char *name, char **path);

// True for names that sgsi_mask_find takes for masks beside photographs: STEM_mask.png.
bool sgsi_mask_is_name(const char *name);

// Sets photo->valid_mask to a plane that keeps everything, unless there is one.
sgs_status sgsi_mask_begin(sgs_photo *photo);

// Drops what a file masks. file_width x file_height is the size of the photograph's file, of which
// the mask must have the size or an enlargement. Fails with FORMAT and both names otherwise.
sgs_status sgsi_mask_apply_file(sgs_photo *photo, const char *mask_path, const char *photo_path,
                                int file_width, int file_height, bool invert);

// Drops the pixels that source pixel (x, y) of a width x height image overlaps. Needs a plane.
void sgsi_mask_drop(sgs_photo *photo, int width, int height, int x, int y);

// The pixels that a lens has rays for: a fresh plane (sgsi_free), or NULL when that is all of them.
sgs_status sgsi_mask_of_lens(const sgs_camera *camera, uint16_t **valid_mask);

// Drops what `keep` (of the photo's size) drops; NULL drops nothing.
sgs_status sgsi_mask_intersect(sgs_photo *photo, const uint16_t *valid_mask);

// Counts photo->kept; frees a plane that keeps everything.
void sgsi_mask_finish(sgs_photo *photo);
