// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// One affine map of colours per training photograph, learned with the scene: what the camera's
// exposure and white balance did to that picture alone (3DGS, "exposure compensation": the drawn
// image is mapped before it is compared). Knows the planes of an image, no tracer and no files.

#include "loss/loss.h"

enum {
    SGSI_EXPOSURE = 12
}; // row-major 3 x 4: mapped[c] = sum over k of map[4 c + k] image[k] + map[4 c + 3]

typedef struct sgsi_exposure sgsi_exposure;

// Identity maps for `count` photographs of up to plane_floats floats per plane and `height` rows.
sgs_status sgsi_exposure_create(size_t count, size_t plane_floats, size_t height,
                                sgsi_exposure **exposure);
void sgsi_exposure_destroy(sgsi_exposure *exposure); // accepts NULL

// Maps the image that `input` describes (colour over background) and points input to the mapped
// one, which has no transmittance left; the alpha term keeps the image's own.
void sgsi_exposure_forward(sgsi_exposure *exposure, size_t index, sgsi_loss_input *input);

// Gradients of the mapped image in output->d_color become those of the image, with dL/dT; `image`
// is what forward was given. Keeps dL/dmap for the step.
void sgsi_exposure_backward(sgsi_exposure *exposure, size_t index, const sgsi_loss_input *image,
                            sgsi_loss_output *output);

// One step of Adam (0.9, 0.999) on the map, by the gradient of the last backward call.
void sgsi_exposure_step(sgsi_exposure *exposure, size_t index, double rate);

// 0.01 falling to 0.001, log-linear, over the iterations (3DGS's rates).
double sgsi_exposure_lr(int iteration, int iterations);

// The state of all photographs as one block of doubles, for checkpoints: maps, both moments, steps.
double *sgsi_exposure_state(sgsi_exposure *exposure, size_t *count);
// The map of a photograph, [SGSI_EXPOSURE].
const double *sgsi_exposure_map(const sgsi_exposure *exposure, size_t index);
// dL/dmap of the last backward call, [SGSI_EXPOSURE], for tests.
const double *sgsi_exposure_gradient(const sgsi_exposure *exposure);
