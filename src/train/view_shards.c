// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Messages, padded to 64 bytes: records of 15 floats, a box of 6 and the row; gradients as
// float[count][16] and then the place of each row at its owner.

#include "train/view_shards.h"

#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "cluster/rank_calls.h"
#include "train/shard_routes.h"

enum { GRAIN = 1024, SENT_FLOATS = 15, ROW_FLOATS = SGSI_PROJECTED_FLOATS };

struct sgsi_view_shards {
    sgsi_shard_routes routes; // routes.lists: the records sent in the present view
    size_t *to, *from;        // [ranks]: bytes
    size_t *begin;            // [ranks + 1]: where the primitives received from a rank begin
    sgsi_sum_list *lists;     // [ranks]: gradients received
    size_t *places;           // [place_capacity]: by bucket and owner
    float *centers;           // [center_capacity][2]: of the primitives received
    size_t place_capacity, center_capacity;
};

sgs_status sgsi_view_shards_create(sgsi_train_views *views)
{
    const size_t ranks = (size_t)sgs_ranks_count(views->ranks);
    struct sgsi_view_shards *made = sgsi_calloc(1, sizeof *made);
    if (!made)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu ranks", ranks);
    views->view_shards = made;
    made->to = sgsi_calloc(3 * ranks + 1, sizeof *made->to);
    made->lists = sgsi_calloc(ranks, sizeof *made->lists);
    if (!made->to || !made->lists)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu ranks", ranks);
    made->from = made->to + ranks;
    made->begin = made->from + ranks;
    const sgs_status status = sgsi_shard_routes_create((int)ranks, &made->routes);
    return status ? status : sgsi_tracer_create(&views->rows);
}

void sgsi_view_shards_free(sgsi_train_views *views)
{
    struct sgsi_view_shards *s = views->view_shards;
    if (!s)
        return;
    sgsi_shard_routes_free(&s->routes);
    sgsi_free(s->to);
    sgsi_free(s->lists);
    sgsi_free(s->places);
    sgsi_free(s->centers);
    sgsi_free(s);
    views->view_shards = NULL;
    sgsi_tracer_destroy(views->rows);
    views->rows = NULL;
}

static void *reserve_message(sgs_ranks *ranks, size_t bytes, sgs_status *status)
{
    void *message = sgsi_ranks_room(ranks, bytes);
    if (!message)
        *status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to send %zu bytes", bytes);
    return message;
}

// ---- Records ----

// Records between a tracer and a message for, or from, one rank.
typedef struct record_job {
    const uint32_t *places; // of the records sent
    const float *projected;
    const sgsi_bounds *bounds;
    sgsi_received received; // at the first record received
    unsigned char *message;
    int rank, ranks;
} record_job;

static void pack_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const record_job *job = context;
    for (size_t i = begin; i < end; ++i) {
        const uint32_t place = job->places[i];
        const uint32_t row = (uint32_t)sgsi_shard_row(place, job->rank, job->ranks);
        unsigned char *at = job->message + i * SGSI_SHARD_RECORD;
        memcpy(at, job->projected + (size_t)place * ROW_FLOATS, SENT_FLOATS * sizeof(float));
        memcpy(at + 60, job->bounds[place].lower, 12);
        memcpy(at + 72, job->bounds[place].upper, 12);
        memcpy(at + 84, &row, sizeof row);
    }
}

static void unpack_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const record_job *job = context;
    for (size_t i = begin; i < end; ++i) {
        const unsigned char *at = job->message + i * SGSI_SHARD_RECORD;
        float *row = job->received.projected + i * ROW_FLOATS;
        sgsi_bounds box = {0};
        memcpy(row, at, SENT_FLOATS * sizeof(float));
        row[SENT_FLOATS] = 0.0f;
        memcpy(box.lower, at + 60, 12);
        memcpy(box.upper, at + 72, 12);
        job->received.bounds[i] = box;
        memcpy(&job->received.rows[i], at + 84, sizeof *job->received.rows);
    }
}

static sgs_status pack_records(sgsi_train_views *views, unsigned char **message)
{
    struct sgsi_view_shards *s = views->view_shards;
    const sgsi_send_lists *lists = &s->routes.lists;
    sgs_status status = SGS_STATUS_OK;
    size_t total = 0;
    for (int r = 0; r < s->routes.ranks; ++r) {
        s->to[r] = sgsi_shard_bytes(lists->begin[r + 1] - lists->begin[r], SGSI_SHARD_RECORD);
        total += s->to[r];
    }
    *message = reserve_message(views->ranks, total, &status);
    unsigned char *at = *message;
    for (int r = 0; r < s->routes.ranks && !status; at += s->to[r++]) {
        record_job job = {.places = lists->places + lists->begin[r],
                          .projected = sgsi_tracer_projected(views->rows),
                          .bounds = sgsi_tracer_bounds(views->rows),
                          .message = at,
                          .rank = sgs_ranks_rank(views->ranks),
                          .ranks = s->routes.ranks};
        sgsi_parallel_ranges(lists->begin[r + 1] - lists->begin[r], GRAIN, pack_range, &job);
    }
    return status;
}

static sgs_status unpack_records(sgsi_train_views *views, const unsigned char *got,
                                 const size_t *from)
{
    struct sgsi_view_shards *s = views->view_shards;
    for (int r = 0; r < s->routes.ranks; ++r)
        s->begin[r + 1] = s->begin[r] + sgsi_shard_items(from[r], SGSI_SHARD_RECORD);
    sgsi_received all;
    const sgs_status status = sgsi_tracer_receive(views->tracer, s->begin[s->routes.ranks], &all);
    if (status)
        return status;
    for (int r = 0; r < s->routes.ranks; got += from[r++]) {
        const size_t first = s->begin[r];
        record_job job = {
            .received = {all.projected + first * ROW_FLOATS, all.bounds + first, all.rows + first},
            .message = (unsigned char *)got};
        sgsi_parallel_ranges(s->begin[r + 1] - first, GRAIN, unpack_range, &job);
    }
    return SGS_STATUS_OK;
}

sgs_status sgsi_view_shards_send(sgsi_train_views *views, const sgsi_train_view *view,
                                 const size_t *cut)
{
    struct sgsi_view_shards *s = views->view_shards;
    unsigned char *message = NULL;
    const unsigned char *got;
    const size_t *from;
    sgs_status own =
        sgsi_shard_routes_find(&s->routes, &view->view, sgsi_tracer_projected(views->rows),
                               sgsi_tracer_bounds(views->rows), view->model->count, cut);
    if (!own)
        own = pack_records(views, &message);
    sgs_status status = sgsi_ranks_deliver(
        views->ranks, own, sgsi_train_view_purpose(view, SGS_RANKS_RECORDS), s->to, &got, &from);
    if (!status)
        status = unpack_records(views, got, from);
    // A Morton build over this rank's part is faster than a refit over all primitives.
    return status ? status : sgsi_tracer_commit(views->tracer, true, SGSI_BVH_LOW);
}

sgs_status sgsi_view_shards_centers(sgsi_train_views *views, const float *own_centers,
                                    const float **centers)
{
    struct sgsi_view_shards *s = views->view_shards;
    const sgsi_send_lists *lists = &s->routes.lists;
    const int ranks = s->routes.ranks;
    sgs_status own = SGS_STATUS_OK;
    size_t total = 0;
    for (int r = 0; r < ranks; ++r) {
        s->to[r] = sgsi_shard_bytes(lists->begin[r + 1] - lists->begin[r], SGSI_SHARD_CENTER);
        s->from[r] = sgsi_shard_bytes(s->begin[r + 1] - s->begin[r], SGSI_SHARD_CENTER);
        total += s->to[r];
    }
    unsigned char *at = reserve_message(views->ranks, total, &own);
    for (int r = 0; r < ranks && !own; at += s->to[r++])
        for (size_t i = lists->begin[r]; i < lists->begin[r + 1]; ++i)
            memcpy(at + (i - lists->begin[r]) * SGSI_SHARD_CENTER,
                   own_centers + 2 * (size_t)lists->places[i], SGSI_SHARD_CENTER);
    const size_t count = s->begin[ranks];
    if (count > s->center_capacity && !own) {
        const size_t larger = count + count / 4;
        if (!sgsi_grow((void **)&s->centers, 0, larger, SGSI_SHARD_CENTER))
            own = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to score %zu primitives",
                            count);
        s->center_capacity = own ? s->center_capacity : larger;
    }
    const unsigned char *got;
    const sgs_status status =
        sgsi_ranks_exchange(views->ranks, own, SGS_RANKS_SCORES, s->to, s->from, &got);
    if (status)
        return status;
    for (int r = 0; r < ranks; got += s->from[r++])
        if (s->begin[r + 1] > s->begin[r])
            memcpy(s->centers + 2 * s->begin[r], got,
                   (s->begin[r + 1] - s->begin[r]) * SGSI_SHARD_CENTER);
    *centers = s->centers;
    return SGS_STATUS_OK;
}

// ---- Gradients ----

typedef struct gradient_job {
    const sgsi_tracer *tracer;
    const uint32_t *rows; // of the primitives
    size_t *places;       // [buckets][ranks]: counts, then the place of the next record
    unsigned char *message;
    const size_t *begin; // [ranks]: bytes, where a rank's message begins
    const size_t *count; // [ranks]: its records
    int ranks;
} gradient_job;

static void count_bucket(void *context, size_t bucket, int thread)
{
    (void)thread;
    const gradient_job *job = context;
    const sgsi_sum_list list = sgsi_tracer_records(job->tracer, bucket);
    size_t *counts = job->places + bucket * (size_t)job->ranks;
    memset(counts, 0, (size_t)job->ranks * sizeof *counts);
    for (size_t i = 0; i < list.count; ++i)
        ++counts[sgsi_shard_owner(job->rows[list.ids[i]], job->ranks)];
}

static void pack_bucket(void *context, size_t bucket, int thread)
{
    (void)thread;
    const gradient_job *job = context;
    const sgsi_sum_list list = sgsi_tracer_records(job->tracer, bucket);
    size_t *places = job->places + bucket * (size_t)job->ranks;
    for (size_t i = 0; i < list.count; ++i) {
        const size_t row = job->rows[list.ids[i]];
        const int owner = sgsi_shard_owner(row, job->ranks);
        const uint32_t place = (uint32_t)sgsi_shard_place(row, job->ranks);
        const size_t at = places[owner]++;
        unsigned char *message = job->message + job->begin[owner];
        memcpy(message + at * 64, list.sums + i * ROW_FLOATS, 64);
        memcpy(message + job->count[owner] * 64 + at * 4, &place, sizeof place);
    }
}

static sgs_status reserve_places(struct sgsi_view_shards *s, size_t buckets)
{
    const size_t wanted = (buckets + 2) * (size_t)s->routes.ranks;
    if (wanted <= s->place_capacity)
        return SGS_STATUS_OK;
    if (!sgsi_grow((void **)&s->places, 0, wanted, sizeof *s->places))
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory to sort the gradients of a view");
    s->place_capacity = wanted;
    return SGS_STATUS_OK;
}

// From counts per bucket and owner to places in the owner's message; to[] receives its bytes.
static size_t place_gradients(struct sgsi_view_shards *s, size_t buckets, size_t *begin,
                              size_t *count)
{
    size_t total = 0;
    for (int r = 0; r < s->routes.ranks; ++r) {
        count[r] = 0;
        for (size_t b = 0; b < buckets; ++b) {
            size_t *place = &s->places[b * (size_t)s->routes.ranks + (size_t)r];
            const size_t own = *place;
            *place = count[r];
            count[r] += own;
        }
        begin[r] = total;
        s->to[r] = sgsi_shard_bytes(count[r], SGSI_SHARD_SUM);
        total += s->to[r];
    }
    return total;
}

static sgs_status pack_gradients(sgsi_train_views *views)
{
    struct sgsi_view_shards *s = views->view_shards;
    const size_t buckets = sgsi_tracer_buckets(views->tracer);
    sgs_status status = reserve_places(s, buckets);
    if (status)
        return status;
    size_t *begin = s->places + buckets * (size_t)s->routes.ranks, *count = begin + s->routes.ranks;
    gradient_job job = {.tracer = views->tracer,
                        .rows = sgsi_tracer_rows(views->tracer),
                        .places = s->places,
                        .begin = begin,
                        .count = count,
                        .ranks = s->routes.ranks};
    sgsi_parallel_parts(buckets, sgsi_tracer_buckets_max(views->tracer), count_bucket, &job);
    const size_t total = place_gradients(s, buckets, begin, count);
    job.message = reserve_message(views->ranks, total, &status);
    if (!status)
        sgsi_parallel_parts(buckets, sgsi_tracer_buckets_max(views->tracer), pack_bucket, &job);
    return status;
}

sgs_status sgsi_view_shards_return(sgsi_train_views *views, const sgsi_train_view *view)
{
    struct sgsi_view_shards *s = views->view_shards;
    const unsigned char *got;
    const size_t *from;
    const sgs_status own = pack_gradients(views);
    const sgs_status status = sgsi_ranks_deliver(
        views->ranks, own, sgsi_train_view_purpose(view, SGS_RANKS_GRADIENTS), s->to, &got, &from);
    if (status)
        return status;
    for (int r = 0; r < s->routes.ranks; got += from[r++]) {
        const size_t count = sgsi_shard_items(from[r], SGSI_SHARD_SUM);
        s->lists[r] = (sgsi_sum_list){.ids = (const uint32_t *)(got + 64 * count),
                                      .sums = (const float *)got,
                                      .count = count};
    }
    return sgsi_tracer_fold(views->rows, s->lists, s->routes.ranks);
}
