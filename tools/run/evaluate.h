// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Image quality by the protocol of the 3DGS papers: each view is rendered, quantised to 8 bits and
// compared with its photograph (PSNR, SSIM). Writes no files.

#include <jansson.h>

#include "cli/shared_options.h"
#include "sparegs/image.h"

typedef struct evaluator {
    const sgs_scene *scene; // with images
    sgs_renderer *renderer;
    sgs_render_options render;
    float background[3];
    const json_t *exposures; // of OUT/exposure.json, or NULL; set it after opening
} evaluator;

// Creates the renderer for a model, which must outlive the evaluator. False after printing the
// error.
bool evaluator_open(evaluator *evaluation, const sgs_gaussians *model, const sgs_scene *scene,
                    const drawing_values *drawing);
void evaluator_close(evaluator *evaluation);

typedef struct view_score {
    double psnr, ssim;
} view_score;

// Scores one view. drawn and photo, if not NULL, receive the two 8-bit images (release with
// sgs_image8_free).
bool evaluate_view(const evaluator *evaluation, const sgs_view *view, view_score *score,
                   sgs_image8 *drawn, sgs_image8 *photo);

// PSNR of an image that is identical to its photograph in the mean of a split: the mean of an
// infinite value would be infinite.
#define IDENTICAL_PSNR 100.0

typedef struct split_score {
    size_t images, identical; // identical images are among `images`
    double psnr, ssim;        // means over the images
} split_score;

// Adds a view to the sums in *sum. A view without a valid pixel is skipped with a warning.
void split_score_add(split_score *sum, const sgs_view *view, const view_score *score);

// Scores a split. A request to stop (interrupt.h) ends it early with images = 0.
bool evaluate_split(const evaluator *evaluation, sgs_split split, split_score *score);

// {"images":n,"identical":n,"psnr":dB,"ssim":x,"lpips":null}; psnr and ssim are null without
// images.
json_t *split_score_json(const split_score *score);
