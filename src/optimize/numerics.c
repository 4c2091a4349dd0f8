// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Reports of steps and gradients that were not finite. The sums of a step stay where they are until
// the next one, so the kernel can be asked again, block by block, which of them it refused.

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
        sgsi_warn("iteration %d, view %s: the loss is %g; the step is skipped (%llu so far)",
                  iteration, view, loss, (unsigned long long)skipped->steps);
}

// First row that the kernel refuses, or count.
static size_t first_refused(const sgsi_optimize *input)
{
    sgsi_optimize question = *input;
    question.apply = false;
    question.gradient_sum = NULL;
    for (size_t block = 0; 16 * block < input->count; ++block) {
        if (!input->touched[block] || !sgsi_optimize_blocks(&question, block, block + 1))
            continue;
        // One row at a time: the rows of a block before and behind it have no hits in a copy of the
        // sums.
        for (size_t lane = 0; lane < 16 && 16 * block + lane < input->count; ++lane) {
            float sums[16 * 16] __attribute__((aligned(64))) = {0};
            for (int k = 0; k < 16; ++k)
                sums[16 * lane + (size_t)k] = input->sums[16 * (16 * block + lane) + (size_t)k];
            sgsi_optimize one = question;
            one.params = input->params + block * SGS_PARAM_COUNT * SGS_LANES;
            one.count = input->count - 16 * block;
            one.sums = sums;
            one.touched = input->touched + block;
            one.visible = NULL;
            if (sgsi_optimize_blocks(&one, 0, 1))
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
    const size_t first = first_refused(input);
    const float *mean = input->params + first / 16 * SGS_PARAM_COUNT * SGS_LANES + first % 16;
    if (first < input->count)
        sgsi_warn("iteration %d, view %s: the gradients of %zu primitive(s) are not finite, the "
                  "first is primitive %zu at "
                  "(%g, %g, %g); they are left as they were (%llu so far)",
                  iteration, view, rows, first, (double)mean[0], (double)mean[16], (double)mean[32],
                  (unsigned long long)skipped->gradients);
}
