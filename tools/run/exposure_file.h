// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// OUT/exposure.json: the colour map that each training image was learned with, as 3DGS writes it:
// the image's name and the three rows of a 3 x 4 matrix. And what an evaluation does with such
// maps.

#include <jansson.h>
#include <stdbool.h>

#include "sparegs/render.h"
#include "sparegs/trainer.h"

// Writes the maps of all training views; nothing when none are learned. False after printing the
// error.
bool exposure_write(const char *path, const sgs_scene *scene, const sgs_trainer *trainer);

// NULL when there is no such file; *failed is set after printing that it is damaged.
json_t *exposure_read(const char *path, bool *failed);

// The map of an image; false when there is none.
bool exposure_find(const json_t *exposures, const char *name, double map[12]);

// The map that takes the drawn image closest to the photograph (least squares) over the left halves
// of both. Planes as in sgs_frame; `keep` as in sgs_photo. Without enough pixels, the identity.
void exposure_fit(float *const drawn[3], float *const photo[3], const uint16_t *valid_mask,
                  int width, int height, double map[12]);

// mapped[c] = sum over k of map[4 c + k] image[k] + map[4 c + 3], in place.
void exposure_apply(float *const planes[3], size_t pixels, const double map[12]);

// A plane like sgs_photo.valid_mask that keeps what `keep` keeps of the right half. Release with
// free(); NULL without memory.
uint16_t *exposure_right_half(const uint16_t *valid_mask, int width, int height);
