// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Distillation to SH degree 2.

#include "compress/compress_method.h"

// Trains the job's rows for `iterations` steps so that they render as before with SH degree 2, and
// sets job->sh_degree. A model of degree 2 or lower is unchanged. Requires a scene.
sgs_status sgsi_distill(sgsi_compress_job *job, int iterations);

// Learning rate of parameter `param` in step `step` >= 1 in a scene of this extent.
double sgsi_distill_rate(int param, int step, double extent);
