// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Fine-tuning of a stored model: a trainer from the first iteration to the last, and the model that
// it leaves, as it is saved.

#include <string.h>

#include "base/core.h"
#include "sparegs/trainer.h"

void sgs_finetune_options_init(sgs_finetune_options *options, size_t size)
{
    const sgs_finetune_options defaults = {.iterations = 5000, .compact_box = 1};
    sgsi_options_init(options, size, &defaults, sizeof defaults);
}

static sgs_status copy_model(const sgs_gaussians *from, sgs_gaussians **to)
{
    sgs_status status = sgs_gaussians_create(from->count, to);
    if (!status)
        status = sgs_gaussians_copy(*to, from);
    if (status) {
        sgs_gaussians_destroy(*to);
        *to = NULL;
    }
    return status;
}

static sgs_status run(sgs_trainer *trainer, const sgs_finetune_options *options)
{
    sgs_step_info info = {.stop = SGS_STOP_NONE};
    sgs_status status = SGS_STATUS_OK;
    while (!status && info.stop == SGS_STOP_NONE) {
        status = sgs_trainer_step(trainer, &info);
        if (!status && options->progress && !options->progress(options->progress_user, &info))
            status = sgsi_fail(SGS_STATUS_CANCELLED, "fine-tuning was cancelled");
    }
    return status;
}

sgs_status sgs_finetune(const sgs_gaussians *model, const sgs_scene *scene,
                        const sgs_finetune_options *options, sgs_gaussians **tuned)
{
    *tuned = NULL;
    sgs_finetune_options own = sgs_finetune_options_default();
    sgs_status status = sgsi_options_read(options, "sgs_finetune_options", &own, sizeof own);
    sgs_train_options training = sgs_train_options_default();
    training.iterations = own.iterations;
    training.schedule = SGS_SCHEDULE_FINETUNE;
    training.filter = own.filter;
    training.compact_box = own.compact_box;
    training.sh_degree = model->sh_degree;
    memcpy(training.background, own.background, sizeof training.background);
    training.seed = own.seed;
    training.spare = 0;
    training.init = model;
    sgs_trainer *trainer = NULL;
    if (!status)
        status = sgs_trainer_create(scene, &training, &trainer);
    if (!status)
        status = run(trainer, &own);
    if (!status) {
        const float *filter = sgs_trainer_filter_3d(trainer);
        const sgs_gaussians *trained = sgs_trainer_model(trainer);
        status = filter ? sgs_gaussians_fuse_filter_3d(trained, filter, tuned)
                        : copy_model(trained, tuned);
    }
    sgs_trainer_destroy(trainer);
    return status;
}
