// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// One photograph on its way from its files into memory: decoded, reduced, masked. Can be repeated at any time with the
// same result. Knows no scene.

#include <stdbool.h>

#include "sparegs/scene.h"

typedef struct sgsi_photo_source {
    const char *image_path, *mask_path; // mask_path may be NULL
    int file_width, file_height;        // of the photograph's file
    int width, height;                  // wanted, at most that
    bool invert_mask;
    sgs_alpha alpha;
    const uint16_t *lens; // pixels with a ray, width x height, or NULL = all
} sgsi_photo_source;

// Fails as sgs_image8_read does when the photograph cannot be read. With *mask_failed set, it is the mask that is
// wrong. On failure the photo is empty.
sgs_status sgsi_photo_load(const sgsi_photo_source *source, sgs_photo *photo, bool *mask_failed);

// Frees the contents and zeroes the struct; accepts an empty one.
void sgsi_photo_free(sgs_photo *photo);
