// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/finetune.h"

#include <string.h>

#include "cli/progress.h"
#include "processes/interrupt.h"

static bool show_iteration(void *user, const sgs_step_info *info)
{
    const progress_state state = {.iteration = info->iteration,
                                  .total = *(const int *)user,
                                  .loss = info->loss_average,
                                  .psnr = info->psnr_average,
                                  .gaussians = info->gaussians};
    progress_step(&state);
    return !interrupt_signal();
}

bool finetune_model(sgs_gaussians **model, const sgs_scene *scene, const drawing_values *drawing,
                    int iterations, uint64_t seed)
{
    sgs_finetune_options options = sgs_finetune_options_default();
    options.iterations = iterations;
    options.filter = (sgs_filter)drawing->filter;
    options.compact_box = drawing->compact_box;
    memcpy(options.background, drawing->background, sizeof options.background);
    options.seed = seed;
    options.progress = show_iteration;
    options.progress_user = &iterations;
    sgs_gaussians *tuned = NULL;
    progress_start(0);
    const sgs_status status = sgs_finetune(*model, scene, &options, &tuned);
    progress_end();
    if (status && status != SGS_STATUS_CANCELLED)
        fail_library();
    if (status)
        return false;
    sgs_gaussians_destroy(*model);
    *model = tuned;
    return true;
}
