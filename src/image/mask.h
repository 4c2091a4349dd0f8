// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Valid masks of photos: bit planes (sgs_photo.valid_mask) from mask files, alpha channels and
// lenses. Independent of scenes and losses.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "sparegs/scene.h"

// Where masks are searched, in this order.
typedef struct sgsi_mask_places {
    const char *const *folders;
    size_t folder_count;
    unsigned extensions; // sgsi_mask_extensions of all of them
    bool beside;         // next to the photo
} sgsi_mask_places;

// The extensions of masks that occur in a folder, and png, as bits, so that the others are not
// tried for every photo. Cannot fail: without permission, all.
unsigned sgsi_mask_extensions(const char *folder);

// Finds the mask file of photo `name`, whose file is image_path; *path is NULL if there is none. In
// a folder: STEM, NAME or STEM_mask with the extension png, else with that of JPEG or TIFF, in
// lower or upper case; next to the photo: STEM_mask.png, then dynamic_mask_STEM.png of instant-ngp
// (*dynamic). `skip`: length of the part of the name that is the image folder, which the paths of
// masks may omit. IO: a mask exists but cannot be read as a regular file.
sgs_status sgsi_mask_find(const sgsi_mask_places *places, const char *image_path, const char *name,
                          size_t skip, char **path, bool *dynamic);

// Allocates photo->valid_mask with all pixels valid, unless it exists.
sgs_status sgsi_mask_begin(sgs_photo *photo);

typedef struct sgsi_mask_file {
    const char *path, *photo_path;
    int width, height; // of the photo's file; the mask must have this size or an enlargement of it
    bool invert;
    bool dynamic; // of instant-ngp: all but black is excluded, or with `invert` valid
} sgsi_mask_file;

// What a mask file does.
typedef struct sgsi_mask_use {
    bool excludes;     // a pixel at least
    bool excludes_all; // of its pixels
    bool by_alpha;     // through its alpha channel alone
} sgsi_mask_use;

// Clears the pixels that a mask file excludes. White is valid: values of at least 128, or all
// except 0 in a file whose largest value is less than 128. The value is the mean of the colours
// times alpha, or alpha alone if it varies and the colours are not those of a mask: they have more
// than two values, or one other than white. Fails with FORMAT for another size.
sgs_status sgsi_mask_apply_file(sgs_photo *photo, const sgsi_mask_file *file, sgsi_mask_use *use);

// Clears the pixels that overlap source pixel (x, y) of a width x height image. Requires a mask.
void sgsi_mask_drop(sgs_photo *photo, int width, int height, int x, int y);

// Mask of the pixels for which a lens has rays: a new plane (sgsi_free), or NULL if all have one;
// *rays: their number. `circle` > 0: pixels that are not entirely within this radius (pixels) of
// the image centre have none.
sgs_status sgsi_mask_of_lens(const sgs_camera *camera, double circle, uint16_t **valid_mask,
                             size_t *rays);

// Clears the pixels that `valid_mask` (same size) clears; NULL clears none.
sgs_status sgsi_mask_intersect(sgs_photo *photo, const uint16_t *valid_mask);

// Number of valid pixels of a mask; NULL = all are valid.
size_t sgsi_mask_count(const uint16_t *valid_mask, int width, int height);

// Counts photo->kept. Frees a mask with all pixels valid.
void sgsi_mask_finish(sgs_photo *photo);
