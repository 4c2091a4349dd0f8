// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// One photograph on its way from its files into memory: decoded, reduced, masked. Can be repeated
// at any time with the same result. Knows no scene.

#include <stdbool.h>
#include <stdint.h>

#include "image/image_oiio.h"
#include "sparegs/scene.h"

typedef struct sgsi_photo_source {
    const char *image_path, *mask_path; // mask_path may be NULL
    int file_width, file_height;        // of the photograph's file
    int width, height;                  // wanted, at most that
    bool invert_mask;
    sgs_alpha alpha;
    const char *colorspace; // NULL = the file's
    sgs_space space;
    double white_point;   // > 0
    const uint16_t *lens; // pixels with a ray, width x height, or NULL = all
} sgsi_photo_source;

// What a load found out besides.
typedef struct sgsi_photo_report {
    bool mask_failed;     // the error is the mask's, not the photograph's
    size_t pixels_broken; // of the file: some channel is infinite or no number
} sgsi_photo_report;

// Fails as sgs_image8_read does when the photograph cannot be read. On failure the photo is empty.
sgs_status sgsi_photo_load(const sgsi_photo_source *source, sgs_photo *photo,
                           sgsi_photo_report *report);

// How bright the pixels of linear photographs are: counts of max(R, G, B) > 0 by 32nds of an
// octave.
enum {
    SGSI_LIGHT_OCTAVE = 32,
    SGSI_LIGHT_LOW = -40, // octaves
    SGSI_LIGHT_HIGH = 40,
    SGSI_LIGHT_BINS = (SGSI_LIGHT_HIGH - SGSI_LIGHT_LOW) * SGSI_LIGHT_OCTAVE
};

typedef struct sgsi_light {
    uint64_t bins[SGSI_LIGHT_BINS];
} sgsi_light;

// Adds a file's pixels.
sgs_status sgsi_light_add(sgsi_light *light, const char *path, const char *colorspace);

// The light that `share` of the pixels do not exceed; 1 when there are none.
double sgsi_light_quantile(const sgsi_light *light, double share);

// Bytes of memory that a photograph of this kind takes at this size, with a mask.
size_t sgsi_photo_bytes(const sgsi_image_info *info, sgs_space space, int width, int height);

// Frees the planes and keeps what is known of the photograph.
void sgsi_photo_release(sgs_photo *photo);

// Frees the contents and zeroes the struct; accepts an empty one.
void sgsi_photo_free(sgs_photo *photo);
