// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Reports of non-finite steps and gradients. The sums of a step stay valid until the next one, so
// the kernel can run again, block by block, to find the rows it rejected.

#include "optimize/numerics.h"

#include "base/core.h"

bool sgsi_skip_is_due(const sgsi_skipped *skipped)
{
    const uint64_t k = skipped->reports + 1;
    return k <= 5 || !(k & (k - 1));
}

static bool take_report(sgsi_skipped *skipped)
{
    const bool due = sgsi_skip_is_due(skipped);
    ++skipped->reports;
    return due;
}

void sgsi_skip_step(sgsi_skipped *skipped, int iteration, const char *view, double loss)
{
    ++skipped->steps;
    if (take_report(skipped))
        sgsi_warn("iteration %d, view %s: loss is %g; step skipped (%llu so far)", iteration, view,
                  loss, (unsigned long long)skipped->steps);
}

// First row that the kernel rejects, or count.
static size_t first_rejected(const sgsi_optimize *input)
{
    sgsi_optimize probe = *input;
    probe.apply = false;
    probe.gradient_sum = probe.abs_grad_sum = NULL;
    for (size_t block = 0; 16 * block < input->count; ++block) {
        if (!input->touched[block] || !sgsi_optimize_blocks(&probe, block, block + 1).broken)
            continue;
        // One row at a time: all other rows of the block have zero sums.
        for (size_t lane = 0; lane < 16 && 16 * block + lane < input->count; ++lane) {
            float sums[16 * 16] __attribute__((aligned(64))) = {0};
            for (int k = 0; k < 16; ++k)
                sums[16 * lane + (size_t)k] = input->sums[16 * (16 * block + lane) + (size_t)k];
            sgsi_optimize one = probe;
            one.params = input->params + block * SGS_PARAM_COUNT * SGS_LANES;
            one.count = input->count - 16 * block;
            one.sums = sums;
            one.touched = input->touched + block;
            one.visible = NULL;
            if (one.view.filter_3d)
                one.view.filter_3d += 16 * block;
            if (sgsi_optimize_blocks(&one, 0, 1).broken)
                return 16 * block + lane;
        }
    }
    return input->count;
}

void sgsi_find_rejected(const sgsi_optimize *input, sgsi_rejected *rejected)
{
    const size_t first = first_rejected(input);
    rejected->first = UINT64_MAX;
    if (first == input->count)
        return;
    const float *mean = input->params + first / 16 * SGS_PARAM_COUNT * SGS_LANES + first % 16;
    rejected->first = first;
    for (int k = 0; k < 3; ++k)
        rejected->mean[k] = mean[k * SGS_LANES];
}

void sgsi_skip_gradients(sgsi_skipped *skipped, int iteration, const char *view,
                         const sgsi_rejected *rejected)
{
    skipped->gradients += rejected->rows;
    if (take_report(skipped) && rejected->first != UINT64_MAX)
        sgsi_warn("iteration %d, view %s: non-finite gradients of %zu primitive(s), first "
                  "primitive %zu at (%g, %g, %g); their update is skipped (%llu so far)",
                  iteration, view, (size_t)rejected->rows, (size_t)rejected->first,
                  (double)rejected->mean[0], (double)rejected->mean[1], (double)rejected->mean[2],
                  (unsigned long long)skipped->gradients);
}
