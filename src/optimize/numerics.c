// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Reports of non-finite steps and gradients. The sums of a step stay valid until the next one, so
// the kernel can run again, block by block, to find the rows it rejected.

#include "optimize/numerics.h"

#include "base/core.h"

static bool is_due(sgsi_skipped *skipped)
{
    const uint64_t k = ++skipped->reports;
    return k <= 5 || !(k & (k - 1));
}

void sgsi_skip_step(sgsi_skipped *skipped, int iteration, const char *view, double loss)
{
    ++skipped->steps;
    if (is_due(skipped))
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
            if (sgsi_optimize_blocks(&one, 0, 1).broken)
                return 16 * block + lane;
        }
    }
    return input->count;
}

void sgsi_skip_gradients(sgsi_skipped *skipped, int iteration, const char *view, size_t rows,
                         const sgsi_optimize *input)
{
    skipped->gradients += rows;
    if (!is_due(skipped))
        return;
    const size_t first = first_rejected(input);
    const float *mean = input->params + first / 16 * SGS_PARAM_COUNT * SGS_LANES + first % 16;
    if (first < input->count)
        sgsi_warn("iteration %d, view %s: non-finite gradients of %zu primitive(s), first "
                  "primitive %zu at (%g, %g, %g); their update is skipped (%llu so far)",
                  iteration, view, rows, first, (double)mean[0], (double)mean[16], (double)mean[32],
                  (unsigned long long)skipped->gradients);
}
