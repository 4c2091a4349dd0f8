// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// One affine colour map per training image, learned with the scene. It models the exposure and
// white balance of that image (exposure compensation of 3DGS: the rendered image is mapped before
// the comparison). Works on image planes only.

#include "loss/loss.h"

enum {
    SGSI_EXPOSURE = 12
}; // row-major 3 x 4: mapped[c] = sum over k of map[4 c + k] image[k] + map[4 c + 3]

typedef struct sgsi_exposure sgsi_exposure;

// Identity maps for `count` images of up to plane_floats floats per plane. Fails with
// OUT_OF_MEMORY; *exposure is then NULL.
sgs_status sgsi_exposure_create(size_t count, size_t plane_floats, sgsi_exposure **exposure);
void sgsi_exposure_destroy(sgsi_exposure *exposure); // accepts NULL

// Maps the image of `input` (colour over background) and points input to the result, which has no
// transmittance left; the alpha term keeps the transmittance of the image. If the target has an
// alpha channel, only the primitives are mapped: the transmittance and the background remain.
void sgsi_exposure_forward(sgsi_exposure *exposure, size_t index, sgsi_loss_input *input);

// Converts the gradients of the mapped image in output->d_color to those of the image, with dL/dT.
// `image` is the input of forward. Stores dL/dmap for the step. Fails with OUT_OF_MEMORY.
sgs_status sgsi_exposure_backward(sgsi_exposure *exposure, size_t index,
                                  const sgsi_loss_input *image, sgsi_loss_output *output);

// The two parts of sgsi_exposure_backward. The first converts the gradients of the cells [first,
// last) along the curve (base/image_cells.h) and writes their entries of *sums, an array [cells]
// owned by `exposure`. The second adds all entries.
sgs_status sgsi_exposure_cells(sgsi_exposure *exposure, size_t index, const sgsi_loss_input *image,
                               size_t first, size_t last, sgsi_loss_output *output,
                               double (**sums)[SGSI_EXPOSURE]);
void sgsi_exposure_total(sgsi_exposure *exposure);

// One Adam step (0.9, 0.999) on the map with the gradient of the last backward call.
void sgsi_exposure_step(sgsi_exposure *exposure, size_t index, double rate);

// Learning rate: 0.01 to 0.001, log-linear over the iterations, as in 3DGS.
double sgsi_exposure_lr(int iteration, int iterations);

// The state of all images as one block of doubles, for checkpoints: maps, both moments, steps.
double *sgsi_exposure_state(sgsi_exposure *exposure, size_t *count);
// The map of an image, [SGSI_EXPOSURE].
const double *sgsi_exposure_map(const sgsi_exposure *exposure, size_t index);
// dL/dmap of the last backward call, [SGSI_EXPOSURE], for tests.
const double *sgsi_exposure_gradient(const sgsi_exposure *exposure);
