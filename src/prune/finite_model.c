// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include <math.h>

#include "base/core.h"
#include "prune/scores.h"

sgs_status sgsi_prune_model_check(const sgs_gaussians *model)
{
    for (size_t i = 0; i < model->count; ++i)
        for (int k = 0; k < SGS_PARAM_COUNT; ++k) {
            const float value = *sgs_gaussians_at(model, i, k);
            const bool is_logit = k == SGS_PARAM_OPACITY && !model->linear_opacity;
            if (!isfinite(value) && !(is_logit && isinf(value)))
                return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                                 "primitive %zu has a parameter that is not finite; remove it", i);
        }
    return SGS_STATUS_OK;
}
