// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The caller's models may hold any sh_degree; what counts coefficients by it checks it first.

#include "base/core.h"
#include "sparegs/gaussians.h"

// Fails with INVALID_ARGUMENT outside 0..3. path: begins the error, or NULL.
static inline sgs_status sgsi_sh_degree_check(const sgs_gaussians *model, const char *path)
{
    if (model->sh_degree >= 0 && model->sh_degree <= 3)
        return SGS_STATUS_OK;
    return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                     "%s%sSH degree %d of the model is not within 0 to 3", path ? path : "",
                     path ? ": " : "", model->sh_degree);
}
