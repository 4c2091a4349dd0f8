// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A random model with a camera, its renderer, and the frames and gradients of a drawing. Include
// after cmocka.h.

#include "sparegs/render.h"
#include "support/oracle_support.h"

typedef struct drawing {
    oracle_scene scene;
    sgs_camera camera;
    sgs_pose pose;
    sgs_render_options options;
    sgs_renderer *renderer;
    sgs_frame frame, d_frame;
    sgs_gaussians *d_model;
} drawing;

// planes: of the frame, SGS_AOV_ bits. The gradients of the image are 0.
static inline drawing drawing_of(uint64_t seed, size_t count, sgs_camera_model lens, int width,
                                 int height, unsigned planes)
{
    drawing d = {.scene = oracle_random_model(seed, count, NULL),
                 .camera = oracle_camera(lens, width, height),
                 .pose = oracle_pose_look_at(1.9, -1.2, -3.3)};
    assert_int_equal(sgs_renderer_create(d.scene.model, &d.renderer), SGS_STATUS_OK);
    assert_int_equal(sgs_frame_create_with(width, height, planes, &d.frame), SGS_STATUS_OK);
    assert_int_equal(sgs_frame_create_with(width, height, 0, &d.d_frame), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_create(count, &d.d_model), SGS_STATUS_OK);
    assert_int_equal(sgs_gaussians_resize(d.d_model, count), SGS_STATUS_OK);
    return d;
}

static inline void drawing_free(drawing *d)
{
    sgs_renderer_destroy(d->renderer);
    sgs_frame_free(&d->frame);
    sgs_frame_free(&d->d_frame);
    sgs_gaussians_destroy(d->d_model);
    oracle_scene_free(&d->scene);
}
