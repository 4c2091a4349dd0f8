// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Selections of rows that several pipelines share: the best by score, a weighted draw, the
// stochastic pruning of Taming 3DGS and FastGS, and the pruning after densification of 3DGS and
// Mip-Splatting.

#include <float.h>
#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "density/pipeline.h"

enum { GRAIN = 1 << 14, RANK_GRAIN = 1 << 17 };

typedef struct ranked_row {
    double score;
    uint32_t row;
} ranked_row;

static bool ranks_before(ranked_row a, ranked_row b)
{
    return a.score > b.score || (a.score == b.score && a.row < b.row);
}

static void sift_down(ranked_row *heap, size_t count, size_t at)
{
    for (;;) {
        size_t worst = at;
        for (size_t child = 2 * at + 1; child <= 2 * at + 2; ++child)
            if (child < count && ranks_before(heap[worst], heap[child]))
                worst = child;
        if (worst == at)
            return;
        const ranked_row kept = heap[at];
        heap[at] = heap[worst];
        heap[worst] = kept;
        at = worst;
    }
}

// Heap of the best rows so far; the root is the worst of them.
sgs_status sgsi_select_best(const double *score, const uint8_t *eligible, size_t count,
                            size_t wanted, uint8_t *chosen)
{
    memset(chosen, 0, count);
    if (!wanted)
        return SGS_STATUS_OK;
    wanted = wanted < count ? wanted : count;
    ranked_row *heap = sgsi_alloc(wanted ? wanted : 1, sizeof *heap);
    if (!heap)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to rank %zu primitives",
                         count);
    size_t held = 0;
    for (size_t i = 0; i < count; ++i) {
        if (eligible && !eligible[i])
            continue;
        const ranked_row row = {score[i], (uint32_t)i};
        if (held < wanted) {
            heap[held++] = row;
            for (size_t k = held / 2; held == wanted && k-- > 0;)
                sift_down(heap, held, k);
        } else if (ranks_before(row, heap[0])) {
            heap[0] = row;
            sift_down(heap, held, 0);
        }
    }
    for (size_t k = 0; k < held; ++k)
        chosen[heap[k].row] = 1;
    sgsi_free(heap);
    return SGS_STATUS_OK;
}

sgs_status sgsi_select_weighted(const double *weight, const uint8_t *eligible, size_t count,
                                size_t wanted, uint64_t seed, uint8_t *chosen)
{
    double *key = sgsi_alloc(count ? count : 1, sizeof *key);
    if (!key)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to draw from %zu primitives",
                         count);
    for (size_t i = 0; i < count; ++i) // log of u^(1/w) has the same order
        key[i] = weight[i] > 0.0 ? log(sgsi_random_uniform(seed, i)) / weight[i] : -DBL_MAX;
    const sgs_status status = sgsi_select_best(key, eligible, count, wanted, chosen);
    sgsi_free(key);
    return status;
}

sgs_status sgsi_prune_stochastic(const sgsi_density_options *options, sgsi_density_columns *c,
                                 const double *weight)
{
    uint8_t *stays = sgsi_alloc(c->count ? c->count : 1, 1),
            *chosen = sgsi_alloc(c->count ? c->count : 1, 1);
    sgs_status status = stays && chosen ? SGS_STATUS_OK : SGS_STATUS_OUT_OF_MEMORY;
    size_t prunable = 0;
    for (size_t i = 0; i < c->count && !status; ++i) {
        if (sgsi_density_should_prune_after(options, c, i))
            prunable += c->action[i] == SGSI_ACTION_KEEP ? 1 : 2;
        stays[i] = c->action[i] != SGSI_ACTION_SPLIT;
    }
    const uint64_t seed = sgsi_random_bits(options->seed ^ 0x9A0E, (uint64_t)options->iteration);
    if (!status)
        status = sgsi_select_weighted(weight, stays, c->count, prunable / 2, seed, chosen);
    for (size_t i = 0; i < c->count && !status; ++i)
        c->removed[i] =
            chosen[i] && sgsi_density_should_prune(options, c->opacity[i], c->scale_max[i]);
    sgsi_free(stays);
    sgsi_free(chosen);
    return status ? sgsi_fail(status, "not enough memory to prune %zu primitives", c->count)
                  : status;
}

// ---- Decisions on single rows ----

typedef struct decide_job {
    const sgsi_density_decision *decision;
    atomic_size_t suppressed, boosted;
} decide_job;

static void decide_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    decide_job *job = context;
    sgsi_density_result counts = {0};
    for (size_t i = begin; i < end; ++i)
        job->decision->row(job->decision, i, &counts);
    atomic_fetch_add(&job->suppressed, counts.bmd_suppressed);
    atomic_fetch_add(&job->boosted, counts.bmd_boosted);
}

void sgsi_density_decide_rows(const sgsi_density_decision *decision, sgsi_density_result *result)
{
    decide_job job = {.decision = decision};
    sgsi_parallel_ranges(decision->columns->count, GRAIN, decide_range, &job);
    result->bmd_suppressed += job.suppressed;
    result->bmd_boosted += job.boosted;
}

static void thin_row(const sgsi_density_decision *decision, size_t i, sgsi_density_result *result)
{
    (void)result;
    sgsi_density_columns *c = decision->columns;
    c->action[i] = SGSI_ACTION_KEEP;
    c->removed[i] = sgsi_density_should_prune(decision->options, c->opacity[i], c->scale_max[i]);
    c->prune_children[i] = c->removed[i];
}

void sgsi_density_decide_thinning(const sgsi_density_options *options, sgsi_density_columns *c)
{
    sgsi_density_result none = {0};
    sgsi_density_decide_rows(&(sgsi_density_decision){options, c, 0.0f, thin_row}, &none);
}

// ---- Ranks ----

enum { BINS = 1 << 11 };

// Counts the digit at `shift` of the values whose higher bits are `high`.
typedef struct rank_job {
    const float *values;
    uint32_t high, mask;
    int shift, high_shift;
    atomic_uint bins[BINS];
} rank_job;

static void count_values(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    rank_job *job = context;
    uint32_t bins[BINS] = {0};
    for (size_t i = begin; i < end; ++i) {
        uint32_t bits = 0;
        if (job->values[i] > 0.0f)
            memcpy(&bits, &job->values[i], sizeof bits);
        if ((uint64_t)bits >> job->high_shift == job->high)
            ++bins[bits >> job->shift & job->mask];
    }
    for (size_t k = 0; k < BINS; ++k)
        if (bins[k])
            atomic_fetch_add_explicit(&job->bins[k], bins[k], memory_order_relaxed);
}

float sgsi_positive_rank(const float *values, size_t count, size_t k)
{
    // Positive floats are ordered like their bits: passes over 11, 11 and 10 bits.
    static const int shifts[] = {21, 10, 0}, widths[] = {11, 11, 10};
    rank_job job = {.values = values, .high_shift = 32};
    for (int pass = 0; pass < 3; ++pass) {
        job.shift = shifts[pass];
        job.mask = (1u << widths[pass]) - 1;
        for (size_t bin = 0; bin < BINS; ++bin)
            atomic_init(&job.bins[bin], 0);
        sgsi_parallel_ranges(count, RANK_GRAIN, count_values, &job);
        uint32_t bin = 0;
        while (k >= job.bins[bin])
            k -= job.bins[bin++];
        job.high = job.high << widths[pass] | bin;
        job.high_shift = job.shift;
    }
    float value;
    memcpy(&value, &job.high, sizeof value);
    return value;
}
