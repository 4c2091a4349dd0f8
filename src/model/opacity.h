// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The opacity of a primitive from its stored parameter, in float as the kernels compute it.

#include <math.h>

#include "sparegs/gaussians.h"

// In [0, 1]; with linear opacity |x|, which may exceed 1.
static inline float sgsi_gaussians_opacity(const sgs_gaussians *model, size_t i)
{
    const float x = *sgs_gaussians_at(model, i, SGS_PARAM_OPACITY);
    return model->linear_opacity ? fabsf(x) : 1.0f / (1.0f + expf(-x));
}
