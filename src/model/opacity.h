// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The opacity of a primitive from its stored parameter, in float as the kernels compute it.

#include <math.h>

#include "sparegs/gaussians.h"

// A logit as models that are read have it: instead of an infinite one, +-ln((1 - 1e-6) / 1e-6).
// Alpha is clamped at 0.99 in any case, and the sigmoid of this value has a gradient in float.
static inline float sgsi_finite_logit(float logit)
{
    return isinf(logit) ? copysignf(13.8155096f, logit) : logit;
}

// In [0, 1]; with linear opacity |x|, which may exceed 1.
static inline float sgsi_gaussians_opacity(const sgs_gaussians *model, size_t i)
{
    const float x = *sgs_gaussians_at(model, i, SGS_PARAM_OPACITY);
    return model->linear_opacity ? fabsf(x) : 1.0f / (1.0f + expf(-x));
}
