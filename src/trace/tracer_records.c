// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Primitives and gradient sums across processes. Each process works on a piece of the curve of
// cells, over primitives that it has received, and keeps records: the sums per (cell, primitive),
// in the order of the cells. The owner of a primitive adds its records in the order of the
// processes, which is that of the cells, so every division of the curve gives the bits of one
// process.

#include <string.h>

#include "base/core.h"
#include "trace/tracer_state.h"

enum {
    ROW_BYTES = SGSI_PROJECTED_FLOATS * sizeof(float),
    FIRST_RECORDS = 256,
    BUCKETS_PER_THREAD = 4
};

const uint32_t *sgsi_tracer_rows(const sgsi_tracer *tracer)
{
    return tracer->rows;
}

// Buckets are whole blocks of primitives: several per thread to balance the load, and small enough
// for the tables of sgsi_cell_sums.
int sgsi_bucket_shift(size_t primitives)
{
    const size_t threads = (size_t)sgsi_threads();
    const size_t max_buckets = threads > 1 ? BUCKETS_PER_THREAD * threads : 1;
    int shift = 4; // log2 of SGS_LANES: each `touched` flag belongs to one bucket
    while (shift < SGSI_BUCKET_SHIFT && primitives && (primitives - 1) >> shift >= max_buckets)
        ++shift;
    return shift;
}

void sgsi_tracer_set_piece(sgsi_tracer *tracer, const sgsi_tracer_piece *piece)
{
    tracer->has_piece = piece != NULL;
    if (piece)
        tracer->piece = *piece;
}

sgs_status sgsi_records_begin(sgsi_tracer *tracer, size_t buckets)
{
    if (buckets > tracer->record_capacity) {
        if (!sgsi_grow((void **)&tracer->records, tracer->record_capacity, buckets,
                       sizeof *tracer->records))
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                             "not enough memory for %zu buckets of gradients", buckets);
        for (size_t i = tracer->record_capacity; i < buckets; ++i)
            tracer->records[i] = (sgsi_bucket_records){0};
        tracer->record_capacity = buckets;
    }
    for (size_t i = 0; i < buckets; ++i)
        tracer->records[i].count = 0;
    tracer->record_buckets = buckets;
    return SGS_STATUS_OK;
}

bool sgsi_records_add(sgsi_bucket_records *records, const sgsi_cell_sums *sums)
{
    const size_t count = records->count + sums->count;
    if (count > records->capacity) {
        const size_t larger = count + count / 2 + FIRST_RECORDS;
        if (!sgsi_grow((void **)&records->ids, records->count, larger, sizeof *records->ids) ||
            !sgsi_grow((void **)&records->sums, records->count, larger, ROW_BYTES))
            return false;
        records->capacity = larger;
    }
    memcpy(records->ids + records->count, sums->ids, sums->count * sizeof *sums->ids);
    memcpy(records->sums + records->count * SGSI_PROJECTED_FLOATS, sums->sums,
           (size_t)sums->count * ROW_BYTES);
    records->count = count;
    return true;
}

void sgsi_records_free(sgsi_tracer *tracer)
{
    for (size_t i = 0; i < tracer->record_capacity; ++i) {
        sgsi_free(tracer->records[i].ids);
        sgsi_free(tracer->records[i].sums);
    }
    sgsi_free(tracer->records);
    tracer->records = NULL;
    tracer->record_capacity = tracer->record_buckets = 0;
}

size_t sgsi_tracer_buckets(const sgsi_tracer *tracer)
{
    return tracer->record_buckets;
}

size_t sgsi_tracer_buckets_max(const sgsi_tracer *tracer)
{
    return (tracer->count + SGS_LANES - 1) / SGS_LANES;
}

sgsi_sum_list sgsi_tracer_records(const sgsi_tracer *tracer, size_t bucket)
{
    const sgsi_bucket_records *records = &tracer->records[bucket];
    return (sgsi_sum_list){records->ids, records->sums, records->count};
}

// ---- Adding ----

// Each list is sorted by bucket first, so that a thread adds whole buckets of primitives.
typedef struct fold_job {
    sgsi_tracer *tracer;
    const sgsi_sum_list *lists;
    size_t *begin;  // [lists][buckets + 2]: where a bucket begins in the list's order
    size_t *orders; // [lists]: where the order of a list begins in fold_order
    size_t buckets;
    int count, shift;
    _Atomic int broken; // 1 + a list with an id out of range
} fold_job;

static void sort_list(void *context, size_t r, int thread)
{
    (void)thread;
    fold_job *job = context;
    const sgsi_sum_list *list = &job->lists[r];
    size_t *begin = job->begin + r * (job->buckets + 2);
    uint32_t *order = job->tracer->fold_order + job->orders[r];
    memset(begin, 0, (job->buckets + 2) * sizeof *begin);
    for (size_t i = 0; i < list->count; ++i) {
        if (list->ids[i] >= job->tracer->count) {
            job->broken = 1 + (int)r;
            return;
        }
        ++begin[(list->ids[i] >> job->shift) + 2];
    }
    for (size_t k = 2; k <= job->buckets; ++k)
        begin[k + 1] += begin[k];
    for (size_t i = 0; i < list->count; ++i)
        order[begin[(list->ids[i] >> job->shift) + 1]++] = (uint32_t)i;
}

static void fold_bucket(void *context, size_t bucket, int thread)
{
    (void)thread;
    const fold_job *job = context;
    for (int r = 0; r < job->count; ++r) {
        const sgsi_sum_list *list = &job->lists[r];
        const size_t *begin = job->begin + (size_t)r * (job->buckets + 2) + bucket;
        const uint32_t *order = job->tracer->fold_order + job->orders[r];
        for (size_t i = begin[0]; i < begin[1]; ++i)
            sgsi_add_to_primitive(job->tracer, list->ids[order[i]],
                                  list->sums + (size_t)order[i] * SGSI_PROJECTED_FLOATS);
    }
}

static sgs_status reserve_fold(fold_job *job)
{
    sgsi_tracer *tracer = job->tracer;
    size_t total = 0;
    job->begin = sgsi_alloc((size_t)job->count * (job->buckets + 2), sizeof *job->begin);
    job->orders = sgsi_alloc((size_t)job->count, sizeof *job->orders);
    for (int r = 0; r < job->count && job->orders; ++r) {
        job->orders[r] = total;
        total += job->lists[r].count;
    }
    bool done = job->begin && job->orders;
    if (done && total > tracer->fold_capacity) {
        const size_t larger = total + total / 4;
        done = sgsi_grow((void **)&tracer->fold_order, 0, larger, sizeof *tracer->fold_order);
        tracer->fold_capacity = done ? larger : tracer->fold_capacity;
    }
    return done ? SGS_STATUS_OK
                : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to add %zu gradients",
                            total);
}

sgs_status sgsi_tracer_fold(sgsi_tracer *tracer, const sgsi_sum_list *lists, int count)
{
    const double start = sgsi_seconds();
    fold_job job = {.tracer = tracer,
                    .lists = lists,
                    .count = count,
                    .shift = sgsi_bucket_shift(tracer->count)};
    job.buckets = tracer->count ? ((tracer->count - 1) >> job.shift) + 1 : 0;
    memset(tracer->touched, 0, tracer->capacity / SGS_LANES);
    sgs_status status = reserve_fold(&job);
    if (!status)
        sgsi_parallel_for((size_t)count, 1, sort_list, &job);
    if (job.broken)
        status = sgsi_fail(SGS_STATUS_FORMAT, "gradients of process %d do not belong to this view",
                           job.broken - 1);
    if (!status)
        sgsi_parallel_parts(job.buckets, sgsi_tracer_buckets_max(tracer), fold_bucket, &job);
    sgsi_free(job.begin);
    sgsi_free(job.orders);
    tracer->seconds.reduce = sgsi_seconds() - start;
    return status;
}
