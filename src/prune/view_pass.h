// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Traces a model in every training view of a scene, one after the other, and passes each traced
// view to a function. Shared by all scores that need views. Computes no score itself.

#include "sparegs/prune.h"
#include "trace/tracer.h"

// A traced view. The tracer holds the lists of hits; planes: colour and transmittance.
typedef struct sgsi_traced_view {
    const sgs_gaussians *model;
    sgsi_tracer *tracer;
    const sgsi_view *view;
    const sgsi_planes *planes;
    const sgs_camera *camera; // at the size that was traced
    const sgs_pose *pose;
    const sgs_render_options *render;
} sgsi_traced_view;

typedef sgs_status (*sgsi_traced_view_fn)(void *context, const sgsi_traced_view *traced);

// Checks options and calls `visit` for each training view in the order of the scene. Fails as
// sgs_contributions does, or as `visit`.
sgs_status sgsi_view_pass(const sgs_gaussians *model, const sgs_scene *scene,
                          const sgs_view_pass_options *options, sgsi_traced_view_fn visit,
                          void *context);
