// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The photometric loss (1 - lambda) L1 + lambda (1 - SSIM) of Kerbl et al. 2023, equation 7 (there
// lambda = 0.2), and its exact gradient, in float, vectorised and threaded. SSIM window of 3DGS:
// 11x11 Gaussian, sigma 1.5 unless another one is given, zero padding, weights not renormalised at
// borders.

#include "sparegs/scene.h"

#define SGSI_SSIM_SIGMA 1.5 // pixels

typedef struct sgsi_loss_workspace sgsi_loss_workspace;

// Fails with OUT_OF_MEMORY; *workspace is then NULL.
sgs_status sgsi_loss_create(sgsi_loss_workspace **workspace);
void sgsi_loss_destroy(sgsi_loss_workspace *workspace); // accepts NULL
// Prepares the workspace for images up to this size, so that sgsi_loss_evaluate does not allocate.
// Fails with INVALID_ARGUMENT (size) or OUT_OF_MEMORY.
sgs_status sgsi_loss_reserve(sgsi_loss_workspace *workspace, int width, int height);

typedef struct sgsi_loss_input {
    int width, height;
    size_t stride; // floats per row of every float plane, multiple of 16, >= width
    const float
        *color[3]; // rendered, premultiplied, without background; [height][stride], 64-byte aligned
    const float *transmittance; // [height][stride]
    float background[3];
    const sgs_photo *target; // RGB, or RGB + straight alpha: composited over `background` first
    float ssim_weight;       // lambda, 0 to 1
    float ssim_sigma;        // of the window, pixels, at most 3; 0 = SGSI_SSIM_SIGMA
    const float *alpha_transmittance; // T of the alpha term; NULL = transmittance
    float alpha_weight; // of mean |(1 - T) - alpha|, for targets with an alpha channel; 0 = none
    bool opaque;        // targets without an alpha channel have the alpha term too, with alpha 1
} sgsi_loss_input;

typedef struct sgsi_loss_output {
    double loss, l1, ssim, alpha; // alpha: mean |(1 - T) - alpha|, 0 when disabled
    double mse;                   // of the clamped image over the valid pixels, for PSNR
    float *d_color[3];            // dL/d(color), [height][stride]; columns >= width are set to 0
    // dL/dT: sum over channels of background * dL/dI, plus the alpha term.
    float *d_transmittance;
} sgsi_loss_output;

// Sums over the pixels of a cell and the three channels.
typedef struct sgsi_loss_sums {
    double l1, square, dissimilarity; // |I - G|, (I - G)^2, 1 - S
    double alpha;                     // |(1 - T) - alpha|, one channel
} sgsi_loss_sums;

// Invalid pixels (target->valid_mask) are mid-grey in both images: they add nothing to L1 or alpha,
// do not influence the windows of other pixels, and have gradient zero. All means are over all
// pixels, so that a mask does not change the weight of the others.
//
// I = clamp(color + T * background, 0, 1) is compared (without the upper clamp for HDR targets).
// The gradient is zero where the clamp acts (I > 1 or I < 0). The sums are those of
// sgsi_loss_cells, added along the curve of the cells: they do not depend on the number of threads.
// Fails with INVALID_ARGUMENT (a NULL plane, sizes, stride, channels) or OUT_OF_MEMORY.
sgs_status sgsi_loss_evaluate(sgsi_loss_workspace *workspace, const sgsi_loss_input *input,
                              sgsi_loss_output *output);

// The two parts of sgsi_loss_evaluate. The first writes the gradient of the cells [first, last)
// along the curve (base/image_cells.h), from an image that is valid up to ten pixels around them,
// and their entries of *sums, an array [cells] owned by the workspace. The second adds all entries.
sgs_status sgsi_loss_cells(sgsi_loss_workspace *workspace, const sgsi_loss_input *input,
                           size_t first, size_t last, sgsi_loss_output *output,
                           sgsi_loss_sums **sums);
void sgsi_loss_total(const sgsi_loss_workspace *workspace, const sgsi_loss_input *input,
                     sgsi_loss_output *output);
