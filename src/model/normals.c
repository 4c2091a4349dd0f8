// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Normals of primitives. A trained Gaussian lies flat on its surface, so its shortest axis
// estimates the surface normal, with the sign that faces the camera. Computed once per view and
// primitive in plain C: one percent of the cost of the hits.

#include "model/normals.h"

#include <math.h>

#include "base/threads.h"

enum { GRAIN = 4096 };

typedef struct normals_job {
    const sgs_gaussians *model;
    const double *center;
    float *normals;
} normals_job;

// Column `k` of the rotation matrix of a quaternion (w, x, y, z) of any norm; a zero quaternion is
// the identity.
static void rotation_column(const float stored[4], int k, float column[3])
{
    const float norm = sqrtf(stored[0] * stored[0] + stored[1] * stored[1] + stored[2] * stored[2] +
                             stored[3] * stored[3]);
    const float scale = norm > 1e-15f ? 1.0f / norm : 0.0f;
    const float w = scale > 0.0f ? stored[0] * scale : 1.0f;
    const float v[3] = {stored[1] * scale, stored[2] * scale, stored[3] * scale};
    // R e_k = (w^2 - v.v) e_k + 2 v_k v + 2 w v x e_k
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    column[k] = 1.0f - 2.0f * (v[i] * v[i] + v[j] * v[j]);
    column[i] = 2.0f * (v[k] * v[i] + w * v[j]);
    column[j] = 2.0f * (v[k] * v[j] - w * v[i]);
}

static void fill_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const normals_job *job = context;
    for (size_t n = begin; n < end; ++n) {
        const float *row = sgs_gaussians_at(job->model, n, 0);
        int shortest = 0;
        for (int k = 1; k < 3; ++k)
            if (row[(SGS_PARAM_SCALE + k) * SGS_LANES] <
                row[(SGS_PARAM_SCALE + shortest) * SGS_LANES])
                shortest = k;
        float quaternion[4], axis[3], along = 0.0f;
        for (int k = 0; k < 4; ++k)
            quaternion[k] = row[(SGS_PARAM_ROTATION + k) * SGS_LANES];
        rotation_column(quaternion, shortest, axis);
        for (int k = 0; k < 3; ++k)
            along +=
                axis[k] * (float)((double)row[(SGS_PARAM_MEAN + k) * SGS_LANES] - job->center[k]);
        const float sign = along > 0.0f ? -1.0f : 1.0f;
        float *normal = job->normals + 4 * n;
        for (int k = 0; k < 3; ++k)
            normal[k] = isfinite(axis[k]) ? sign * axis[k] : 0.0f;
        normal[3] = 0.0f;
    }
}

void sgsi_normals_fill(const sgs_gaussians *model, const double center[3], float *normals)
{
    normals_job job = {model, center, normals};
    sgsi_parallel_ranges(model->count, GRAIN, fill_range, &job);
}
