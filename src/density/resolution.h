// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Resolution schedule of DashGaussian: the down-scaling of the images at each iteration, from the
// energy of their spectra, and the corresponding reduction of a photo. Independent of model
// and rays.

#include "sparegs/scene.h"

enum { SGSI_RESOLUTION_LEVELS = 32 };

typedef struct sgsi_resolution {
    int until;                             // iteration from which on the resolution is full
    double scale[SGSI_RESOLUTION_LEVELS];  // down-scaling, decreasing to 1
    int begin[SGSI_RESOLUTION_LEVELS + 1]; // iteration at which each level begins, then `until`
    int decay_begin; // of the position rate: iteration of the first level with a scale below 2
} sgsi_resolution;

// Magnitudes of the centred 2D spectrum, summed over the channels of an image, and their
// summed-area table, [height + 1][width + 1] or NULL.
typedef struct sgsi_spectrum {
    int width, height;
    double *magnitude, *table; // magnitude: [height][width]
} sgsi_spectrum;

// Access to the training images, one at a time.
typedef struct sgsi_image_source {
    void *context;
    size_t count;
    void (*size)(void *context, size_t i, int *width, int *height);
    sgs_status (*get)(void *context, size_t i, sgs_image8 *image); // valid until the next call
    sgs_status (*advance)(void *context);                          // after each image, or NULL
} sgsi_image_source;

// Plans the levels for iterations up to `until`. The images of the most frequent size define the
// mean spectrum; all images limit the largest scale. Fails with OUT_OF_MEMORY or as `get` and
// `advance` do.
sgs_status sgsi_resolution_plan(const sgsi_image_source *images, int until, sgsi_resolution *plan);
// Half the size for iterations before `until`.
sgsi_resolution sgsi_resolution_half(int until);
// Whole down-scaling factor >= 1 at an iteration.
int sgsi_resolution_at(const sgsi_resolution *plan, int iteration);

// Parts of the plan, for tests. Free the spectrum. Fails with OUT_OF_MEMORY.
sgs_status sgsi_spectrum_of(const sgs_image8 *image, sgsi_spectrum *spectrum);
void sgsi_spectrum_free(sgsi_spectrum *spectrum);
// Energy of the part of the spectrum that an image reduced by `scale` keeps.
double sgsi_spectrum_window(const sgsi_spectrum *spectrum, double scale);

// Reduces all channels of an image to floor(size / scale) with a triangle filter of that support
// ("bilinear, antialias"), rounded to 8 bits; colours of 4 channels are weighted by alpha, and
// invalid pixels (valid_mask as in sgs_photo, NULL: none) do not mix in. Fails with OUT_OF_MEMORY;
// *out is then empty.
sgs_status sgsi_image8_triangle(const sgs_image8 *image, const uint16_t *valid_mask, int scale,
                                sgs_image8 *out);
