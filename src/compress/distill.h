// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Distillation of the harmonics to degree 2.

#include "compress/compress_method.h"

// Trains the job's rows for `iterations` steps to render like before with harmonics of degree 2,
// and sets job->sh_degree. Nothing happens to a model of degree 2 or lower. Requires a scene.
sgs_status sgsi_distill(sgsi_compress_job *job, int iterations);
