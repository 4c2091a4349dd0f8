// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Quality of a merged model at the seams between blocks: the error of pixels whose traced position
// is near a face, compared with that of all other pixels. What is near a face may be harder than
// the rest: on a plush toy with its background, pixels near a plane through the toy have 2.3 dB
// less in a model that was never divided. The figures therefore refer to those of a reference
// without seams, the coarse model.

#include <jansson.h>

#include "blocks/block_plan.h"
#include "run/evaluate.h"

// Pixels within this distance of a face, in extents of the scene, belong to the seam.
#define SEAM_WIDTH 0.02
// Loss of PSNR at the seams from which they count as visible, dB.
#define SEAM_LIMIT 0.5

typedef struct seam_report {
    size_t images;
    sgs_split split; // of the images
    // [seam]: compared values, and the sum of their squared errors with both models.
    double pixels[2], squares[2], reference[2];
    bool has_reference;
} seam_report;

// reference: of a model without seams, or NULL. Renders up to `most` images, held-out ones if there
// are any, at equal intervals. A request to stop (interrupt.h) ends it early. False after printing
// the error.
bool seam_report_make(evaluator *evaluation, evaluator *reference, const block_plan *plan,
                      size_t most, seam_report *report);

// {"images", "split", "width", "pixel_share", "psnr_seam", "psnr_rest", "reference_psnr_seam",
// "reference_psnr_rest", "loss"}
json_t *seam_report_json(const seam_report *report);

// Prints the figures on stdout, or a warning on stderr if the seams are visible.
void seam_report_print(const seam_report *report, bool quiet);
