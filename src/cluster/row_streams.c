// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Parts are windows of groups: a whole number of turns of all ranks, so that each rank has one
// piece of memory in it. The last group of a piece may be incomplete; pieces are padded.

#include "cluster/row_streams.h"

#include <string.h>

#include "base/core.h"

enum { WINDOW_BYTES = 4 << 20 };

// Groups [first, last) of the array.
typedef struct window {
    size_t first, last;
} window;

static size_t group_count(const sgsi_row_array *array)
{
    return array->group ? (array->total + array->group - 1) / array->group : 0;
}

static size_t group_bytes(const sgsi_row_array *array, size_t group)
{
    const size_t begin = group * array->group;
    return array->total - begin < array->group ? array->total - begin : array->group;
}

static size_t window_bytes(const sgsi_row_array *array, window w)
{
    const size_t end = w.last * array->group;
    return (end < array->total ? end : array->total) - w.first * array->group;
}

// Bytes of a rank's groups in a window that begins at a multiple of `ranks`.
static size_t piece_bytes(const sgsi_row_array *array, window w, int rank, int ranks)
{
    size_t bytes = 0;
    for (size_t g = w.first + (size_t)rank; g < w.last; g += (size_t)ranks)
        bytes += group_bytes(array, g);
    return bytes;
}

size_t sgsi_row_array_bytes(const sgsi_row_array *array, int rank, int ranks)
{
    return piece_bytes(array, (window){0, group_count(array)}, rank, ranks);
}

static window next_window(const sgsi_row_array *array, size_t first, int ranks)
{
    const size_t count = group_count(array), turn = (size_t)ranks * array->group;
    const size_t turns = turn < WINDOW_BYTES ? WINDOW_BYTES / turn : 1;
    const size_t last = first + turns * (size_t)ranks;
    return (window){first, last < count ? last : count};
}

// Copies the groups of a window between the pieces of all ranks, and the array in order.
static void interleave(const sgsi_row_array *array, window w, int ranks, unsigned char *pieces,
                       const size_t *begin, unsigned char *ordered, bool into_pieces)
{
    for (size_t g = w.first; g < w.last; ++g) {
        const size_t rank = g % (size_t)ranks, size = group_bytes(array, g);
        unsigned char *piece = pieces + begin[rank] + (g - w.first) / (size_t)ranks * array->group;
        memcpy(into_pieces ? piece : ordered, into_pieces ? ordered : piece, size);
        ordered += size;
    }
}

static size_t piece_begin(const sgsi_row_array *array, size_t first_group, int ranks)
{
    return first_group / (size_t)ranks * array->group;
}

sgs_status sgsi_rows_gather(sgs_ranks *ranks, sgs_status own, sgs_ranks_purpose purpose,
                            const sgsi_row_array *array, void *whole)
{
    const int rank = sgs_ranks_rank(ranks), count = sgs_ranks_count(ranks);
    const size_t bytes = sgsi_row_array_bytes(array, rank, count);
    void *message = own ? NULL : sgsi_ranks_room(ranks, sgsi_ranks_padded(bytes));
    size_t *begin = sgsi_alloc((size_t)count, sizeof *begin);
    if (!own && (!message || !begin))
        own = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to send %zu bytes", bytes);
    if (!own && bytes)
        memcpy(message, array->own, bytes);
    const unsigned char *got;
    const size_t *sizes;
    const sgs_status status = sgsi_ranks_share(ranks, own, purpose, bytes, &got, &sizes);
    for (int r = 0; r < count && !status; ++r)
        begin[r] = r ? begin[r - 1] + sizes[r - 1] : 0;
    if (!status)
        interleave(array, (window){0, group_count(array)}, count, (unsigned char *)got, begin,
                   whole, false);
    sgsi_free(begin);
    return status;
}

// Buffers of a stream.
typedef struct stream {
    size_t *to, *from, *begin; // [ranks]
    unsigned char *ordered;    // a window, on rank 0
} stream;

static sgs_status open_stream(const sgsi_row_array *array, int rank, int ranks, stream *s)
{
    const size_t most = (WINDOW_BYTES / array->group + 2 * (size_t)ranks) * array->group;
    *s = (stream){.to = sgsi_alloc(3 * (size_t)ranks, sizeof *s->to)};
    if (!rank)
        s->ordered = sgsi_alloc(most, 1);
    if (!s->to || (!rank && !s->ordered))
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to send %zu bytes", most);
    s->from = s->to + ranks;
    s->begin = s->from + ranks;
    return SGS_STATUS_OK;
}

static void close_stream(stream *s)
{
    sgsi_free(s->to);
    sgsi_free(s->ordered);
}

// Sizes of the messages of a window: `ends` is what rank 0 receives or sends, `own` the other side.
static size_t measure(const sgsi_row_array *array, window w, int rank, int ranks, size_t *own,
                      size_t *ends, size_t *begin)
{
    size_t total = 0;
    for (int r = 0; r < ranks; ++r) {
        own[r] = r ? 0 : sgsi_ranks_padded(piece_bytes(array, w, rank, ranks));
        ends[r] = rank ? 0 : sgsi_ranks_padded(piece_bytes(array, w, r, ranks));
        begin[r] = total;
        total += ends[r];
    }
    return total;
}

sgs_status sgsi_rows_collect(sgs_ranks *ranks, sgs_status own, const sgsi_row_array *array,
                             void (*take)(void *context, void *bytes, size_t size), void *context)
{
    const int rank = sgs_ranks_rank(ranks), count = sgs_ranks_count(ranks);
    stream s = {0};
    sgs_status status = own ? own : open_stream(array, rank, count, &s);
    status = sgs_ranks_agree(ranks, status);
    for (window w = {0, 0}; w.first < group_count(array) && !status; w.first = w.last) {
        w = next_window(array, w.first, count);
        measure(array, w, rank, count, s.to, s.from, s.begin);
        const size_t bytes = piece_bytes(array, w, rank, count);
        void *message = sgsi_ranks_room(ranks, s.to[0]);
        if (!message)
            own = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to send %zu bytes", bytes);
        else if (bytes)
            memcpy(message, (char *)array->own + piece_begin(array, w.first, count), bytes);
        const unsigned char *got;
        status = sgsi_ranks_exchange(ranks, own, SGS_RANKS_OTHER, s.to, s.from, &got);
        if (status || rank)
            continue;
        interleave(array, w, count, (unsigned char *)got, s.begin, s.ordered, false);
        take(context, s.ordered, window_bytes(array, w));
    }
    close_stream(&s);
    return status;
}

sgs_status sgsi_rows_distribute(sgs_ranks *ranks, sgs_status own, const sgsi_row_array *array,
                                void (*give)(void *context, void *bytes, size_t size),
                                void *context)
{
    const int rank = sgs_ranks_rank(ranks), count = sgs_ranks_count(ranks);
    stream s = {0};
    sgs_status status = own ? own : open_stream(array, rank, count, &s);
    status = sgs_ranks_agree(ranks, status);
    for (window w = {0, 0}; w.first < group_count(array) && !status; w.first = w.last) {
        w = next_window(array, w.first, count);
        const size_t total = measure(array, w, rank, count, s.from, s.to, s.begin);
        unsigned char *message = sgsi_ranks_room(ranks, total);
        if (!message)
            own = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to send %zu bytes", total);
        if (!rank && !own) {
            give(context, s.ordered, window_bytes(array, w));
            interleave(array, w, count, message, s.begin, s.ordered, true);
        }
        const unsigned char *got;
        status = sgsi_ranks_exchange(ranks, own, SGS_RANKS_OTHER, s.to, s.from, &got);
        const size_t bytes = piece_bytes(array, w, rank, count);
        if (!status && bytes)
            memcpy((char *)array->own + piece_begin(array, w.first, count), got, bytes);
    }
    close_stream(&s);
    return status;
}
