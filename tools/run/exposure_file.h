// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// OUT/exposure.json: the optimised colour map of each training image, in the format of 3DGS: the
// image's name and the three rows of a 3 x 4 matrix. Also applies and fits such maps for
// evaluation.

#include <jansson.h>
#include <stdbool.h>

#include "arguments/model_path.h"
#include "sparegs/render.h"
#include "sparegs/trainer.h"

// Writes the maps of all training views, if exposure was optimised. False after printing the error.
bool exposure_write(const char *path, const sgs_scene *scene, const sgs_trainer *trainer);

// NULL with a warning if the file does not exist, or with *failed set after printing the error.
json_t *exposure_read(const char *path, bool *failed);

// Those of a model of a run, beside the model or, for a model derived from it, in the run folder.
// NULL if the run was trained without --exposure or there is no run; to be released. The names are
// those of the scene's views: if none of the file is, they are searched in other folders. False
// after printing the error.
bool exposure_of_model(const model_path *located, const sgs_scene *scene, json_t **exposures);

// Warns that fine-tuning a model of a run with --exposure does not compensate exposure.
void exposure_warn_finetune(const char *path, const json_t *config);

// The map of an image. False if there is none.
bool exposure_find(const json_t *exposures, const char *name, double map[12]);

// Fits the map from render to photo by least squares over their left halves. Planes as in
// sgs_frame, valid_mask as in sgs_photo. The identity if there are too few pixels. With
// `transmittance`, both are over black and the offset of the map is multiplied by the opacity of
// the render; NULL: they are opaque.
void exposure_fit(float *const drawn[3], const float *transmittance, float *const photo[3],
                  const uint16_t *valid_mask, int width, int height, double map[12]);

// Applies a map in place; transmittance as above.
void exposure_apply(float *const planes[3], const float *transmittance, size_t pixels,
                    const double map[12]);

// A copy of valid_mask (sgs_photo) with the left half excluded. Release with free(). NULL if out of
// memory.
uint16_t *exposure_right_half(const uint16_t *valid_mask, int width, int height);
