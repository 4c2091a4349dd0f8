// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Prepares the primitives of a view for the kernel of the Fisher matrices.

#include "prune/fisher.h"
#include "prune/view_pass.h"

typedef struct sgsi_fisher_camera {
    const sgs_camera *camera;
    const sgs_pose *pose;
    double center[3], near_distance;
    double filter_scale; // eps^2 = filter_scale z^2
    bool mip, fisheye;
    const float *filter_3d; // [model->count] or NULL
    int sh_degree;
} sgsi_fisher_camera;

void sgsi_fisher_camera_set(sgsi_fisher_camera *camera, const sgsi_traced_view *traced);

// Row `row` of the model in this view.
void sgsi_fisher_primitive_set(const sgsi_fisher_camera *camera, const sgs_gaussians *model,
                               size_t row, sgsi_fisher_primitive *out);
