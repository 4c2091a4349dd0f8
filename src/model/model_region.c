// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// See model_region.h. A centre that an optimiser step, noise or a split moves out of the box is
// moved back to it: projected gradient descent. Otherwise the primitive would belong to the
// neighbouring block, which does not have it.

#include "model/model_region.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"

bool sgsi_region_has(const sgs_gaussians *model, size_t i, const sgs_box *box)
{
    const float center[3] = {*sgs_gaussians_at(model, i, SGS_PARAM_MEAN),
                             *sgs_gaussians_at(model, i, SGS_PARAM_MEAN + 1),
                             *sgs_gaussians_at(model, i, SGS_PARAM_MEAN + 2)};
    return sgs_box_contains(box, center);
}

sgs_status sgsi_region_order(sgs_gaussians *model, const sgs_box *box, size_t *own)
{
    const size_t bytes = model->capacity * SGS_PARAM_COUNT * sizeof(float);
    sgs_gaussians old = *model;
    old.data = sgsi_alloc(bytes ? bytes : 1, 1);
    *own = 0;
    if (!old.data)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for a second copy of %zu primitives", model->count);
    memcpy(old.data, model->data, bytes);
    size_t to = 0;
    for (int pass = 0; pass < 2; ++pass) {
        for (size_t i = 0; i < old.count; ++i) {
            float params[SGS_PARAM_COUNT];
            if (sgsi_region_has(&old, i, box) != (pass == 0))
                continue;
            sgs_gaussians_get(&old, i, params);
            sgs_gaussians_set(model, to++, params);
        }
        if (!pass)
            *own = to;
    }
    sgsi_free(old.data);
    return SGS_STATUS_OK;
}

typedef struct clamp_job {
    sgs_gaussians *model;
    float low[3], most[3]; // both inside
} clamp_job;

static void clamp_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const clamp_job *job = context;
    for (size_t i = begin; i < end; ++i)
        for (int k = 0; k < 3; ++k) {
            float *x = sgs_gaussians_at(job->model, i, SGS_PARAM_MEAN + k);
            *x = *x < job->low[k] ? job->low[k] : *x > job->most[k] ? job->most[k] : *x;
        }
}

void sgsi_region_clamp(sgs_gaussians *model, size_t own, const sgs_box *box)
{
    clamp_job job = {.model = model};
    for (int k = 0; k < 3; ++k) {
        job.low[k] = box->low[k];
        job.most[k] = nextafterf(box->high[k], -INFINITY);
    }
    sgsi_parallel_ranges(own, 4096, clamp_range, &job);
}
