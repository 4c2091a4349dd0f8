// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Every pass is divided into parts of consecutive rows. A first pass counts what each part
// produces, a prefix sum over the parts gives its place, and a second pass writes: the result is
// that of one thread. The sort is a stable radix sort with a histogram per part, so rows of equal
// keys keep their order.

#include "density/plan_rows.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/morton.h"
#include "base/threads.h"
#include "density/pipeline.h"

enum { GRAIN = 1 << 14, SORT_GRAIN = 1 << 16, SORT_PARTS = 128 };
enum { DIGIT_BITS = 11, DIGITS = 1 << DIGIT_BITS };

// What the rows of a part become.
typedef struct plan_part {
    size_t entries; // number, then place of the first one
    size_t cloned, split, pruned, spare_pruned, relocated;
    float low[3], high[3]; // of the means
} plan_part;

typedef struct plan_job {
    const sgsi_density_columns *columns;
    plan_part *parts;
    sgsi_plan_entry *entries;
    float low[3], inv_size[3]; // of the means of all rows
    size_t fixed;
} plan_job;

static uint32_t copies_of(const sgsi_density_columns *columns, size_t i)
{
    return columns->moves.copies ? columns->moves.copies[i] : 0;
}

// Number of entries of row i; counts its changes.
static size_t count_row(const sgsi_density_columns *columns, size_t i, plan_part *part)
{
    const bool prune_children = columns->prune_children[i],
               removed = sgsi_density_is_removed(columns, i);
    const uint32_t copies = copies_of(columns, i);
    if (columns->degenerate[i]) {
        ++part->pruned;
        return 0;
    }
    if (columns->action[i] == SGSI_ACTION_SPLIT) {
        ++part->split;
        part->pruned += prune_children ? 2 : 0;
        return prune_children ? 0 : 2;
    }
    const bool clones = columns->action[i] == SGSI_ACTION_CLONE;
    part->cloned += clones + copies;
    part->pruned += (size_t)removed + (clones && prune_children);
    part->spare_pruned += removed && !columns->removed[i];
    part->relocated += columns->moves.root && columns->moves.root[i] != i;
    return (size_t)(clones && !prune_children) + !removed + copies;
}

static void count_part(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const plan_job *job = context;
    const float *const axes[3] = {job->columns->x, job->columns->y, job->columns->z};
    plan_part part = {0};
    for (size_t i = begin; i < end; ++i)
        part.entries += count_row(job->columns, i, &part);
    for (int k = 0; k < 3; ++k) {
        float least = INFINITY, most = -INFINITY;
        for (size_t i = begin; i < end; ++i) {
            least = fminf(least, axes[k][i]);
            most = fmaxf(most, axes[k][i]);
        }
        part.low[k] = least;
        part.high[k] = most;
    }
    job->parts[begin / GRAIN] = part;
}

// Writes the entries of row i; returns their number.
static size_t write_row(const plan_job *job, size_t i, sgsi_plan_entry *to)
{
    const sgsi_density_columns *columns = job->columns;
    const size_t root = columns->moves.root ? columns->moves.root[i] : i;
    const float mean[3] = {columns->x[root], columns->y[root], columns->z[root]};
    const uint64_t key = sgsi_morton_code(mean, job->low, job->inv_size);
    const bool keeps_children = !columns->prune_children[i];
    const uint32_t row = (uint32_t)i, copies = copies_of(columns, i);
    size_t count = 0;
    if (columns->degenerate[i])
        return 0;
    if (columns->action[i] == SGSI_ACTION_SPLIT) {
        for (uint32_t kind = SGSI_PLAN_CHILD_0; kind <= SGSI_PLAN_CHILD_1 && keeps_children; ++kind)
            to[count++] = (sgsi_plan_entry){key, row, kind};
        return count;
    }
    if (columns->action[i] == SGSI_ACTION_CLONE && keeps_children)
        to[count++] = (sgsi_plan_entry){key, row, SGSI_PLAN_CLONE};
    if (!sgsi_density_is_removed(columns, i))
        to[count++] = (sgsi_plan_entry){key, row, SGSI_PLAN_KEEP};
    for (uint32_t k = 0; k < copies; ++k)
        to[count++] = (sgsi_plan_entry){key, row, SGSI_PLAN_CLONE};
    return count;
}

static void write_part(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const plan_job *job = context;
    sgsi_plan_entry *to = job->entries + job->parts[begin / GRAIN].entries;
    for (size_t i = begin; i < end; ++i)
        to += write_row(job, i, to);
}

// Adds up the parts, and replaces their numbers of entries by their places. Returns the number of
// all entries.
static size_t sum_parts(plan_job *job, size_t parts, sgsi_density_result *result)
{
    float low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    size_t total = 0;
    for (size_t p = 0; p < parts; ++p) {
        plan_part *part = &job->parts[p];
        const size_t entries = part->entries;
        part->entries = total;
        total += entries;
        result->cloned += part->cloned;
        result->split += part->split;
        result->pruned += part->pruned;
        result->spare_pruned += part->spare_pruned;
        result->relocated += part->relocated;
        for (int k = 0; k < 3; ++k) {
            low[k] = fminf(low[k], part->low[k]);
            high[k] = fmaxf(high[k], part->high[k]);
        }
    }
    for (int k = 0; k < 3; ++k) {
        job->low[k] = low[k];
        job->inv_size[k] = high[k] > low[k] ? 1.0f / (high[k] - low[k]) : 0.0f;
    }
    return total;
}

// ---- Sort ----

// A pass of the sort, over the digit at `shift`.
typedef struct sort_job {
    const sgsi_plan_entry *from;
    sgsi_plan_entry *to;
    size_t grain;
    uint32_t (*begin)[DIGITS]; // [parts]: number of each digit, then place of its next entry
    int shift;
} sort_job;

static uint32_t digit_of(const sort_job *job, size_t i)
{
    return job->from[i].key >> job->shift & (DIGITS - 1);
}

static void count_digits(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const sort_job *job = context;
    uint32_t *counts = job->begin[begin / job->grain];
    memset(counts, 0, DIGITS * sizeof *counts);
    for (size_t i = begin; i < end; ++i)
        ++counts[digit_of(job, i)];
}

static void scatter(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const sort_job *job = context;
    uint32_t *next = job->begin[begin / job->grain];
    for (size_t i = begin; i < end; ++i)
        job->to[next[digit_of(job, i)]++] = job->from[i];
}

// Least significant digit first. Sorts between the two buffers, from the first one.
static sgs_status sort_plan(sgsi_density_plan *plan)
{
    const size_t count = plan->count, least = (count + SORT_PARTS - 1) / SORT_PARTS,
                 grain = least > SORT_GRAIN ? least : SORT_GRAIN,
                 parts = (count + grain - 1) / grain;
    sort_job job = {.from = plan->buffers[0], .to = plan->buffers[1], .grain = grain};
    job.begin = sgsi_alloc(parts + 1, sizeof *job.begin);
    if (!job.begin)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory to sort the plan of a structural update");
    for (; job.shift < 63; job.shift += DIGIT_BITS) {
        sgsi_parallel_ranges(count, grain, count_digits, &job);
        uint32_t total = 0;
        for (size_t digit = 0; digit < DIGITS; ++digit)
            for (size_t p = 0; p < parts; ++p) {
                const uint32_t size = job.begin[p][digit];
                job.begin[p][digit] = total;
                total += size;
            }
        sgsi_parallel_ranges(count, grain, scatter, &job);
        sgsi_plan_entry *const sorted = job.to;
        job.to = sorted == plan->buffers[1] ? plan->buffers[0] : plan->buffers[1];
        job.from = plan->entries = sorted;
    }
    sgsi_free(job.begin);
    return SGS_STATUS_OK;
}

// ---- Plan ----

static void write_fixed(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const plan_job *job = context;
    for (size_t i = begin; i < end; ++i)
        job->entries[i] =
            (sgsi_plan_entry){.row = (uint32_t)(job->columns->count + i), .kind = SGSI_PLAN_FIXED};
}

sgs_status sgsi_plan_make(const sgsi_density_columns *columns, size_t fixed,
                          sgsi_density_result *result, sgsi_density_plan *plan)
{
    const size_t parts = (columns->count + GRAIN - 1) / GRAIN;
    plan_job job = {.columns = columns, .parts = sgsi_alloc(parts + 1, sizeof *job.parts)};
    *plan = (sgsi_density_plan){0};
    if (job.parts) {
        sgsi_parallel_ranges(columns->count, GRAIN, count_part, &job);
        plan->count = sum_parts(&job, parts, result);
    }
    for (int k = 0; k < 2 && job.parts; ++k)
        plan->buffers[k] = sgsi_alloc(plan->count + fixed + 1, sizeof(sgsi_plan_entry));
    if (!plan->buffers[0] || !plan->buffers[1]) {
        sgsi_free(job.parts);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory for the plan of a structural update");
    }
    job.entries = plan->entries = plan->buffers[0];
    sgsi_parallel_ranges(columns->count, GRAIN, write_part, &job);
    sgsi_free(job.parts);
    const sgs_status status = sort_plan(plan);
    if (status)
        return status;
    job.entries = plan->entries + plan->count;
    sgsi_parallel_ranges(fixed, GRAIN, write_fixed, &job);
    plan->count += fixed;
    return SGS_STATUS_OK;
}
