// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The bundled scene, and trainers whose creation and steps must succeed. Include after cmocka.h.

#include "sparegs/scene.h"
#include "sparegs/trainer.h"

// For the setup of a group: 0 on success. Every test_every-th view is held out, 0 = none. The
// caller destroys *scene.
static inline int room_load_split(int downscale, int test_every, sgs_scene **scene)
{
    sgs_scene_options options = sgs_scene_options_default();
    options.downscale = downscale;
    options.test_every = test_every;
    return sgs_scene_load(SGSI_TEST_DATA "/room", &options, scene) != SGS_STATUS_OK;
}

static inline int room_load(int downscale, sgs_scene **scene)
{
    return room_load_split(downscale, sgs_scene_options_default().test_every, scene);
}

// The caller destroys it.
static inline sgs_trainer *trainer_create(const sgs_scene *scene, const sgs_train_options *options)
{
    sgs_trainer *trainer;
    if (sgs_trainer_create(scene, options, &trainer))
        fail_msg("%s", sgs_last_error());
    return trainer;
}

// Returns the result of the last step.
static inline sgs_step_info trainer_run(sgs_trainer *trainer, int steps)
{
    sgs_step_info info = {0};
    for (int i = 0; i < steps; ++i)
        if (sgs_trainer_step(trainer, &info))
            fail_msg("%s", sgs_last_error());
    return info;
}
