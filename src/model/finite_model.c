// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "model/finite_model.h"

#include <math.h>

#include "base/core.h"

sgs_status sgsi_finite_model_check(const sgs_gaussians *model, const char *path)
{
    for (size_t i = 0; i < model->count; ++i)
        for (int k = 0; k < SGS_PARAM_COUNT; ++k) {
            const float value = *sgs_gaussians_at(model, i, k);
            const bool is_logit = k == SGS_PARAM_OPACITY && !model->linear_opacity;
            if (!isfinite(value) && !(is_logit && isinf(value)))
                return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                                 "%s%sprimitive %zu has a parameter that is not finite; remove it",
                                 path ? path : "", path ? ": " : "", i);
        }
    return SGS_STATUS_OK;
}
