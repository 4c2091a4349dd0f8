// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Gradient sums across processes. Each process works on a piece of the curve of cells and sends its
// records: the sums per (cell, primitive), by bucket of primitives and in the order of the cells.
// All add the records in the order of the processes, which is that of the cells, so every division
// of the curve gives the bits of one process.
//
// Bytes of a process: u32 records per bucket, padded to 64 bytes; float[16] sums of each record;
// u32 primitive of each record.

#include <string.h>

#include "base/core.h"
#include "trace/tracer_state.h"

enum { ROW_BYTES = SGSI_PROJECTED_FLOATS * sizeof(float), ALIGNED = 64, FIRST_RECORDS = 256 };

void sgsi_tracer_set_piece(sgsi_tracer *tracer, const sgsi_tracer_piece *piece)
{
    tracer->has_piece = piece != NULL;
    if (piece)
        tracer->piece = *piece;
}

sgs_status sgsi_records_begin(sgsi_tracer *tracer, size_t buckets, int shift)
{
    if (buckets > tracer->record_capacity) {
        if (!sgsi_grow((void **)&tracer->records, tracer->record_capacity, buckets,
                       sizeof *tracer->records))
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "no memory for %zu buckets of gradients",
                             buckets);
        for (size_t i = tracer->record_capacity; i < buckets; ++i)
            tracer->records[i] = (sgsi_bucket_records){0};
        tracer->record_capacity = buckets;
    }
    for (size_t i = 0; i < buckets; ++i)
        tracer->records[i].count = 0;
    tracer->record_buckets = buckets;
    tracer->record_shift = shift;
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
}

static size_t head_bytes(const sgsi_tracer *tracer)
{
    return (tracer->record_buckets * sizeof(uint32_t) + ALIGNED - 1) / ALIGNED * ALIGNED;
}

static size_t record_count(const sgsi_tracer *tracer)
{
    size_t count = 0;
    for (size_t i = 0; i < tracer->record_buckets; ++i)
        count += tracer->records[i].count;
    return count;
}

size_t sgsi_tracer_records_bytes(const sgsi_tracer *tracer)
{
    return head_bytes(tracer) + record_count(tracer) * (ROW_BYTES + sizeof(uint32_t));
}

void sgsi_tracer_records_pack(const sgsi_tracer *tracer, void *bytes)
{
    const size_t total = record_count(tracer);
    uint32_t *head = bytes;
    float *sums = (float *)((char *)bytes + head_bytes(tracer));
    uint32_t *ids = (uint32_t *)(sums + total * SGSI_PROJECTED_FLOATS);
    for (size_t i = 0; i < tracer->record_buckets; ++i) {
        const sgsi_bucket_records *records = &tracer->records[i];
        head[i] = (uint32_t)records->count;
        if (!records->count)
            continue;
        memcpy(sums, records->sums, records->count * ROW_BYTES);
        memcpy(ids, records->ids, records->count * sizeof *ids);
        sums += records->count * SGSI_PROJECTED_FLOATS;
        ids += records->count;
    }
}

// ---- Adding ----

typedef struct fold_job {
    sgsi_tracer *tracer;
    const unsigned char *got;
    const size_t *sizes;
    int count;
} fold_job;

// Records of one process.
typedef struct piece_records {
    const uint32_t *head, *ids;
    const float *sums;
    size_t total;
} piece_records;

static piece_records open_piece(const sgsi_tracer *tracer, const unsigned char *bytes)
{
    piece_records piece = {.head = (const uint32_t *)bytes,
                           .sums = (const float *)(bytes + head_bytes(tracer))};
    for (size_t i = 0; i < tracer->record_buckets; ++i)
        piece.total += piece.head[i];
    piece.ids = (const uint32_t *)(piece.sums + piece.total * SGSI_PROJECTED_FLOATS);
    return piece;
}

static void fold_bucket(void *context, size_t bucket, int thread)
{
    (void)thread;
    const fold_job *job = context;
    const unsigned char *at = job->got;
    for (int r = 0; r < job->count; at += job->sizes[r++]) {
        const piece_records piece = open_piece(job->tracer, at);
        size_t first = 0;
        for (size_t i = 0; i < bucket; ++i)
            first += piece.head[i];
        for (size_t i = first; i < first + piece.head[bucket]; ++i)
            sgsi_add_to_primitive(job->tracer, piece.ids[i],
                                  piece.sums + i * SGSI_PROJECTED_FLOATS);
    }
}

// The buckets of all pieces agree with the sizes and with the bucket of each primitive.
static bool is_sound(const sgsi_tracer *tracer, const unsigned char *bytes, size_t size)
{
    if (size < head_bytes(tracer))
        return false;
    const uint32_t *head = (const uint32_t *)bytes;
    size_t total = 0;
    for (size_t i = 0; i < tracer->record_buckets; ++i)
        total += head[i];
    if (total > (size - head_bytes(tracer)) / (ROW_BYTES + sizeof(uint32_t)))
        return false;
    const piece_records piece = open_piece(tracer, bytes);
    const uint32_t *id = piece.ids;
    for (size_t i = 0; i < tracer->record_buckets; ++i)
        for (uint32_t k = 0; k < head[i]; ++k, ++id)
            if (*id >= tracer->count || *id >> tracer->record_shift != i)
                return false;
    return true;
}

sgs_status sgsi_tracer_fold(sgsi_tracer *tracer, const unsigned char *got, const size_t *sizes,
                            int count)
{
    const double start = sgsi_seconds();
    const unsigned char *at = got;
    for (int r = 0; r < count; at += sizes[r++])
        if (!is_sound(tracer, at, sizes[r]))
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "gradients of process %d do not belong to this view", r);
    memset(tracer->touched, 0, tracer->capacity / SGS_LANES);
    fold_job job = {tracer, got, sizes, count};
    sgsi_parallel_for(tracer->record_buckets, 1, fold_bucket, &job);
    tracer->seconds.reduce += sgsi_seconds() - start;
    return SGS_STATUS_OK;
}
