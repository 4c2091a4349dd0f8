// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "run/finetune.h"

#include <stdlib.h>
#include <string.h>

#include "cli/interrupt.h"
#include "cli/progress.h"
#include "sparegs/prune.h"

// The trained model, with Mip-Splatting's 3D filter fused into it as `train` saves it. NULL after
// printing the error.
static sgs_gaussians *take_model(const sgs_trainer *trainer)
{
    const sgs_gaussians *model = sgs_trainer_model(trainer);
    const float *filter = sgs_trainer_filter_3d(trainer);
    sgs_gaussians *out = NULL;
    bool *all = NULL;
    sgs_status status = SGS_STATUS_OK;
    if (filter) {
        status = sgs_gaussians_fuse_filter_3d(model, filter, &out);
    } else {
        all = malloc(model->count ? model->count : 1);
        if (!all) {
            fail_run("no memory for %zu primitives", model->count);
            return NULL;
        }
        memset(all, true, model->count);
        status = sgs_gaussians_keep(model, all, &out);
        free(all);
    }
    if (status)
        fail_library();
    return out;
}

static bool iterate(sgs_trainer *trainer, int iterations)
{
    sgs_step_info info = {.stop = SGS_STOP_NONE};
    progress_start(0);
    while (info.stop == SGS_STOP_NONE && !interrupt_signal()) {
        if (sgs_trainer_step(trainer, &info)) {
            progress_end();
            fail_library();
            return false;
        }
        const progress_state state = {.iteration = info.iteration,
                                      .total = iterations,
                                      .loss = info.loss_average,
                                      .psnr = info.psnr_average,
                                      .gaussians = info.gaussians};
        progress_step(&state);
    }
    progress_end();
    return !interrupt_signal();
}

bool finetune_model(sgs_gaussians **model, const sgs_scene *scene, const drawing_values *drawing,
                    int iterations, uint64_t seed)
{
    sgs_train_options options = sgs_train_options_default();
    options.iterations = iterations;
    options.schedule = SGS_SCHEDULE_FINETUNE;
    options.filter = (sgs_filter)drawing->filter;
    options.compact_box = drawing->compact_box;
    options.sh_degree = (*model)->sh_degree;
    memcpy(options.background, drawing->background, sizeof options.background);
    options.spare = 0;
    options.seed = seed;
    options.init = *model;
    sgs_trainer *trainer = NULL;
    if (sgs_trainer_create(scene, &options, &trainer)) {
        fail_library();
        return false;
    }
    sgs_gaussians *trained = iterate(trainer, iterations) ? take_model(trainer) : NULL;
    sgs_trainer_destroy(trainer);
    if (!trained)
        return false;
    sgs_gaussians_destroy(*model);
    *model = trained;
    return true;
}
