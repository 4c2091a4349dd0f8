// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Loss and gradient of a model in the training views of a scene, for methods that train through
// their own quantiser. No optimiser.

#include "compress/compress_method.h"
#include "loss/loss.h"

typedef struct sgsi_view_gradient {
    const sgs_scene *scene;
    sgs_render_options render;
    float background[3];
    size_t count;           // training views
    size_t *views;          // [count] of the scene
    uint32_t *order;        // [count] permutation of the current epoch
    sgs_renderer *renderer; // of `model`
    sgs_gaussians *d_model; // the gradient; see sgs_renderer_backward
    sgsi_loss_workspace *loss;
    sgs_frame frame, d_frame; // of the size of the last view
    float *planes;            // 8 planes with the stride of the loss
} sgsi_view_gradient;

// `photos`: only training views with a photo, as sgsi_view_gradient_evaluate requires; otherwise
// all. model must outlive it. Fails with INVALID_ARGUMENT (no such view) or OUT_OF_MEMORY; free it
// also after a failure.
sgs_status sgsi_view_gradient_create(const sgsi_compress_job *job, const sgs_gaussians *model,
                                     bool photos, sgsi_view_gradient *views);
void sgsi_view_gradient_free(sgsi_view_gradient *views);

// The view of step `step` = 1, 2, ..., to be called for every step: each epoch of `count` steps has
// all views, in an order that depends on seed and epoch.
size_t sgsi_view_gradient_next(sgsi_view_gradient *views, uint64_t seed, int step);

// Renders view `k` < count of the current model. *mse: of the clamped image. `gradient`: also fills
// d_model with the gradient of 0.8 L1 + 0.2 (1 - SSIM).
sgs_status sgsi_view_gradient_evaluate(sgsi_view_gradient *views, size_t k, bool gradient,
                                       double *mse);
// The same for any pose and the given image.
sgs_status sgsi_view_gradient_compare(sgsi_view_gradient *views, const sgs_camera *camera,
                                      const sgs_pose *pose, const sgs_photo *photo, bool gradient,
                                      double *mse);
