// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Kheradmand et al. 2024, stochastic gradient Langevin dynamics. Adam's step becomes one of
// Langevin dynamics by noise of the primitive's own covariance: Sigma xi, not its root, as printed.
// The gate lets primitives that contribute little explore; opaque ones stay where they are. Three
// normals per row take time, so rows above SGSI_NOISE_OPACITY_MAX get none by definition, with
// every instruction set.

#include "density/position_noise.h"

#include <math.h>

#include "base/core.h"
#include "base/row_groups.h"
#include "base/threads.h"
#include "model/opacity.h"

enum { NOISE_TAG = 0x4015E, GRAIN = 1024 };

typedef struct noise_loop {
    sgs_gaussians *model;
    int rank, ranks;
    double scale;
    uint64_t seed;
    float logit_most;
} noise_loop;

double sgsi_position_noise_gate(double opacity)
{
    return 1.0 / (1.0 + exp(100.0 * (opacity - 0.005)));
}

// Rotation matrix of the stored quaternion, row-major; the identity for a zero one.
static void rotation_of(const float *column, double r[9])
{
    double q[4], norm = 0.0;
    for (int k = 0; k < 4; ++k) {
        q[k] = (double)column[(SGS_PARAM_ROTATION + k) * SGS_LANES];
        norm += q[k] * q[k];
    }
    if (!(norm > 1e-30)) {
        q[0] = norm = 1.0;
        q[1] = q[2] = q[3] = 0.0;
    }
    const double s = 2.0 / norm, w = q[0], x = q[1], y = q[2], z = q[3];
    r[0] = 1.0 - s * (y * y + z * z);
    r[1] = s * (x * y - w * z);
    r[2] = s * (x * z + w * y);
    r[3] = s * (x * y + w * z);
    r[4] = 1.0 - s * (x * x + z * z);
    r[5] = s * (y * z - w * x);
    r[6] = s * (x * z - w * y);
    r[7] = s * (y * z + w * x);
    r[8] = 1.0 - s * (x * x + y * y);
}

static void add_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const noise_loop *loop = context;
    for (size_t i = begin; i < end; ++i) {
        float *column = sgs_gaussians_at(loop->model, i, 0);
        if (column[SGS_PARAM_OPACITY * SGS_LANES] > loop->logit_most)
            continue;
        double r[9], xi[3], local[3];
        rotation_of(column, r);
        const uint64_t row = sgsi_shard_row(i, loop->rank, loop->ranks);
        for (int k = 0; k < 3; ++k)
            xi[k] = sgsi_random_normal(loop->seed, 3 * row + (uint64_t)k);
        const double gate =
            loop->scale * sgsi_position_noise_gate((double)sgsi_gaussians_opacity(loop->model, i));
        for (int k = 0; k < 3; ++k)
            local[k] = gate * exp(2.0 * (double)column[(SGS_PARAM_SCALE + k) * SGS_LANES]) *
                       (r[k] * xi[0] + r[3 + k] * xi[1] + r[6 + k] * xi[2]);
        for (int k = 0; k < 3; ++k) {
            float *mean = column + (SGS_PARAM_MEAN + k) * SGS_LANES;
            const float moved = (float)((double)*mean + r[3 * k] * local[0] +
                                        r[3 * k + 1] * local[1] + r[3 * k + 2] * local[2]);
            *mean = isfinite(moved) ? moved : *mean;
        }
    }
}

void sgsi_position_noise_add(sgs_gaussians *model, int rank, int ranks, double scale, uint64_t seed,
                             int iteration)
{
    const double most = SGSI_NOISE_OPACITY_MAX;
    noise_loop loop = {.model = model,
                       .rank = rank,
                       .ranks = ranks,
                       .scale = scale,
                       .seed = sgsi_random_bits(seed ^ NOISE_TAG, (uint64_t)iteration),
                       .logit_most = (float)log(most / (1.0 - most))};
    sgsi_parallel_ranges(model->count, GRAIN, add_range, &loop);
}
