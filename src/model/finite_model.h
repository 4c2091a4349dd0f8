// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The caller's models may hold any value; what cannot use every value checks the model first.

#include "sparegs/gaussians.h"

// Fails with INVALID_ARGUMENT, naming the first primitive with a parameter that is not finite. An
// infinite logit is valid: it is the opacity 1 or 0 of a file. An infinite linear opacity is not:
// no file contains it, and the primitive would have no bounds. path: begins the error, or NULL.
sgs_status sgsi_finite_model_check(const sgs_gaussians *model, const char *path);
