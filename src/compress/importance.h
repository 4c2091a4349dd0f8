// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Importance of primitives for the compression methods, and fine-tuning without a quantiser.

#include "compress/compress_method.h"

// importance [job->count], overwritten: LightGaussian's global significance in the training views
// of the scene, or 1 without a scene.
sgs_status sgsi_significance(const sgsi_compress_job *job, double *importance);

// The same for MesonGS: sums of the blending weights, or opacities without a scene, times a power
// of the volume.
sgs_status sgsi_blending_importance(const sgsi_compress_job *job, double *importance);

// A model of the job's rows. The caller destroys it.
sgs_status sgsi_rows_model(const sgsi_compress_job *job, sgs_gaussians **model);
// The rows of a model with at most as many primitives; sets job->count.
void sgsi_rows_set(sgsi_compress_job *job, const sgs_gaussians *model);
// Keeps the rows i with keep[i], in their order.
void sgsi_rows_keep(sgsi_compress_job *job, const bool *keep);

// options->finetune; -1 means `automatic` iterations, or none without a scene. Fails with
// INVALID_ARGUMENT if a scene is required.
sgs_status sgsi_finetune_iterations(const sgsi_compress_job *job, int automatic, int *iterations);
// Trains the rows for that number of iterations, as sgs_finetune. It may reorder the rows, so
// arrays with a value per row are no longer valid.
sgs_status sgsi_rows_finetune(sgsi_compress_job *job, int automatic);
