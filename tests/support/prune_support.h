// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A scene of a few views around the origin, held in memory, for tests of scores from views. Include
// after cmocka.h.

#include "sparegs/scene.h"
#include "support/oracle_support.h"

enum { PRUNE_VIEWS = 3 };

// The last view is held out.
static inline sgs_scene *prune_scene(int width, int height)
{
    sgs_view_source sources[PRUNE_VIEWS + 1] = {0};
    uint8_t *pixels = oracle_memory((size_t)width * (size_t)height, 3);
    for (int k = 0; k <= PRUNE_VIEWS; ++k)
        sources[k] = (sgs_view_source){
            .camera = oracle_camera(SGS_CAMERA_PINHOLE, width, height),
            .pose = oracle_pose_look_at(3 * cos(2.0 * k), 0.4 * k - 0.5, 3.5 * sin(2.0 * k)),
            .split = k < PRUNE_VIEWS ? SGS_SPLIT_TRAIN : SGS_SPLIT_TEST,
            .channels = 3,
            .pixels = pixels};
    sgs_scene *scene;
    if (sgs_scene_create(sources, PRUNE_VIEWS + 1, NULL, NULL, 0, NULL, &scene))
        fail_msg("%s", sgs_last_error());
    free(pixels);
    return scene;
}
