// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Collective calls. Each begins with a header of every rank: status, flags, the kind of call and
// the number of bytes. If a rank failed, all receive its message and leave; else the bytes follow.
// A rank that fails elsewhere calls sgs_ranks_agree, whose header reaches the others in whatever
// call they make next.

#include "cluster/rank_calls.h"

#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/core.h"

enum {
    MESSAGE_BYTES = 960,
    MAX_RANKS = 1 << 16,
    MAX_GATHERED = 1 << 30 // bytes of a rank: counts of MPI are ints
};

typedef struct header {
    int32_t status;
    uint32_t flags;
    uint64_t kind, bytes;
} header;
_Static_assert(sizeof(header) == SGSI_RANKS_HEADER_BYTES, "rank_calls.h has the size");

// Kinds of calls; a difference between ranks is an error of the program.
enum {
    KIND_AGREE,
    KIND_SHARE,
    KIND_EXCHANGE,
    KIND_DELIVER,
    KIND_GATHER,
    KIND_BROADCAST,
    KIND_COPY
};

typedef struct failure {
    char node[64], text[MESSAGE_BYTES];
} failure;
_Static_assert(sizeof(failure) % SGSI_TRANSPORT_UNIT == 0, "is sent in whole units");

static void count_bytes(sgs_ranks *ranks, sgs_ranks_purpose purpose, uint64_t bytes,
                        uint64_t messages)
{
    ranks->counted[purpose].calls += 1;
    ranks->counted[purpose].messages += messages;
    ranks->counted[purpose].bytes += bytes;
}

// Counts bytes that have moved since `start`.
static void count_moved(sgs_ranks *ranks, sgs_ranks_purpose purpose, double start, uint64_t bytes,
                        uint64_t messages)
{
    ranks->spent[purpose].moving += sgsi_seconds() - start;
    count_bytes(ranks, purpose, bytes, messages);
}

static uint64_t others(const sgs_ranks *ranks)
{
    return (uint64_t)ranks->transport.count - 1;
}

static sgs_status fail_again(const sgs_ranks *ranks)
{
    return sgsi_fail(ranks->failed, "%s", ranks->message);
}

// All ranks learn the message of rank `failing`; -1: none failed. Allocates nothing, as the others
// wait for this message.
static sgs_status fail_alike(sgs_ranks *ranks, int failing, sgs_status status, const char *text)
{
    failure own = {{0}, {0}}, got;
    ranks->failed = status;
    if (failing < 0) {
        snprintf(ranks->message, sizeof ranks->message,
                 "the ranks made different collective calls; this is a bug in sparegs");
        return fail_again(ranks);
    }
    snprintf(own.node, sizeof own.node, "%s", ranks->node);
    snprintf(own.text, sizeof own.text, "%s", text ? text : sgs_last_error());
    memset(ranks->sizes, 0, (size_t)ranks->transport.count * sizeof *ranks->sizes);
    ranks->sizes[failing] = sizeof own;
    ranks->transport.gather_sizes(ranks->transport.state, &own, ranks->sizes, &got);
    snprintf(ranks->message, sizeof ranks->message, "rank %d (%.63s): %.*s", failing, got.node,
             (int)MESSAGE_BYTES - 1, got.text);
    return fail_again(ranks);
}

// Exchanges the headers, which waits for the last rank. sizes [count] receives the bytes of each
// rank; NULL ignores them.
static sgs_status meet_with(sgs_ranks *ranks, sgs_ranks_purpose purpose, header own, size_t *sizes,
                            const char *text)
{
    const double start = sgsi_seconds();
    header *all = ranks->headers; // allocated before: the others wait
    const int count = ranks->transport.count;
    if (ranks->failed)
        return fail_again(ranks);
    own.flags = atomic_load(&ranks->own);
    ranks->transport.gather(ranks->transport.state, &own, sizeof own, all);
    ranks->spent[purpose].waiting += sgsi_seconds() - start;
    count_bytes(ranks, SGS_RANKS_STATUS, others(ranks) * sizeof own, others(ranks));
    int failing = count;
    bool differs = false;
    for (int r = 0; r < count; ++r) {
        ranks->raised |= all[r].flags;
        differs = differs || all[r].kind != own.kind;
        if (all[r].status && failing == count)
            failing = r;
        if (sizes)
            sizes[r] = (size_t)all[r].bytes;
    }
    const sgs_status status = failing < count ? (sgs_status)all[failing].status
                              : differs       ? SGS_STATUS_INTERNAL
                                              : SGS_STATUS_OK;
    return status ? fail_alike(ranks, failing < count ? failing : -1, status, text) : SGS_STATUS_OK;
}

static sgs_status meet(sgs_ranks *ranks, sgs_ranks_purpose purpose, header own, size_t *sizes)
{
    return meet_with(ranks, purpose, own, sizes, NULL);
}

static void free_ranks(sgs_ranks *ranks)
{
    if (!ranks)
        return;
    sgsi_free(ranks->send);
    sgsi_free(ranks->got);
    sgsi_free(ranks->sizes);
    sgsi_free(ranks->matrix);
    sgsi_free(ranks->headers);
    sgsi_free(ranks);
}

// NULL if out of memory.
static sgs_ranks *make_ranks(const sgsi_transport *transport)
{
    const size_t count = (size_t)transport->count;
    sgs_ranks *made = sgsi_calloc(1, sizeof *made);
    if (!made)
        return NULL;
    made->transport = *transport;
    made->sizes = sgsi_calloc(count, sizeof *made->sizes);
    made->matrix = sgsi_calloc(count * count, sizeof *made->matrix);
    made->headers = sgsi_calloc(count, sizeof(header));
    if (made->sizes && made->matrix && made->headers)
        return made;
    free_ranks(made);
    return NULL;
}

// First rank that has failed, or -1.
static int first_failing(const sgsi_transport *transport, bool fails)
{
    unsigned char own = fails, all[MAX_RANKS];
    transport->gather(transport->state, &own, 1, all);
    for (int r = 0; r < transport->count; ++r)
        if (all[r])
            return r;
    return -1;
}

sgs_status sgsi_ranks_create(const sgsi_transport *transport, sgs_ranks **ranks)
{
    *ranks = NULL;
    if (transport->count > MAX_RANKS) {
        transport->close(transport->state);
        return sgsi_fail(SGS_STATUS_LIMIT, "%d ranks exceed the limit of %d", transport->count,
                         MAX_RANKS);
    }
    sgs_ranks *made = make_ranks(transport);
    const int failing = first_failing(transport, !made);
    if (!made || failing >= 0) {
        free_ranks(made);
        transport->close(transport->state);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "rank %d: not enough memory for %d ranks",
                         failing, transport->count);
    }
    if (gethostname(made->node, sizeof made->node - 1))
        snprintf(made->node, sizeof made->node, "unknown node");
    *ranks = made;
    return SGS_STATUS_OK;
}

void sgs_ranks_close(sgs_ranks *ranks)
{
    if (!ranks)
        return;
    if (!ranks->failed) // another rank may have failed where this one has nothing left to do
        sgs_ranks_agree(ranks, SGS_STATUS_OK);
    ranks->transport.close(ranks->transport.state);
    free_ranks(ranks);
}

int sgs_ranks_rank(const sgs_ranks *ranks)
{
    return ranks ? ranks->transport.rank : 0;
}

int sgs_ranks_count(const sgs_ranks *ranks)
{
    return ranks ? ranks->transport.count : 1;
}

sgs_status sgs_ranks_agree(sgs_ranks *ranks, sgs_status own)
{
    const header mine = {.status = (int32_t)own, .kind = KIND_AGREE};
    return ranks ? meet(ranks, SGS_RANKS_STATUS, mine, NULL) : own;
}

sgs_status sgs_ranks_agree_text(sgs_ranks *ranks, sgs_status own, const char *text)
{
    const header mine = {.status = (int32_t)own, .kind = KIND_AGREE};
    if (!ranks)
        return own && text ? sgsi_fail(own, "%s", text) : own;
    return meet_with(ranks, SGS_RANKS_STATUS, mine, NULL, text);
}

void sgs_ranks_raise(sgs_ranks *ranks, uint32_t flags)
{
    if (ranks)
        atomic_fetch_or(&ranks->own, flags);
}

uint32_t sgs_ranks_raised(const sgs_ranks *ranks)
{
    return ranks ? ranks->raised : 0;
}

void sgs_ranks_lower(sgs_ranks *ranks, uint32_t flags)
{
    if (!ranks)
        return;
    atomic_fetch_and(&ranks->own, ~flags);
    ranks->raised &= ~flags;
}

void sgs_ranks_recover(sgs_ranks *ranks)
{
    if (ranks)
        ranks->failed = SGS_STATUS_OK;
}

// ---- Buffers ----

static bool reserve(unsigned char **block, size_t *capacity, size_t bytes)
{
    if (bytes <= *capacity)
        return true;
    const size_t larger = bytes + bytes / 4;
    if (!sgsi_grow((void **)block, 0, larger, 1))
        return false;
    *capacity = larger;
    return true;
}

void *sgsi_ranks_room(sgs_ranks *ranks, size_t bytes)
{
    return reserve(&ranks->send, &ranks->send_capacity, bytes ? bytes : 1) ? ranks->send : NULL;
}

static sgs_status reserve_got(sgs_ranks *ranks, size_t bytes)
{
    return reserve(&ranks->got, &ranks->got_capacity, bytes ? bytes : 1)
               ? SGS_STATUS_OK
               : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                           "not enough memory for %zu bytes of other ranks", bytes);
}

// ---- Data ----

sgs_status sgsi_ranks_share(sgs_ranks *ranks, sgs_status own, sgs_ranks_purpose purpose,
                            size_t bytes, const unsigned char **got, const size_t **sizes)
{
    size_t *all = ranks->sizes, total = 0;
    const header mine = {
        .status = (int32_t)own, .kind = KIND_SHARE, .bytes = sgsi_ranks_padded(bytes)};
    sgs_status status = meet(ranks, purpose, mine, all);
    if (status)
        return status;
    for (int r = 0; r < ranks->transport.count; ++r)
        total += all[r];
    if (total > ranks->most_shared) { // the same decision on all ranks, which receive the same
        status = sgs_ranks_agree(ranks, reserve_got(ranks, total));
        if (status)
            return status;
        ranks->most_shared = total;
    }
    const double start = sgsi_seconds();
    ranks->transport.gather_sizes(ranks->transport.state, ranks->send, all, ranks->got);
    count_moved(ranks, purpose, start, others(ranks) * sgsi_ranks_padded(bytes), others(ranks));
    *got = ranks->got;
    *sizes = all;
    return SGS_STATUS_OK;
}

sgs_status sgsi_ranks_exchange(sgs_ranks *ranks, sgs_status own, sgs_ranks_purpose purpose,
                               const size_t *to, const size_t *from, const unsigned char **got)
{
    size_t sent = 0, received = 0;
    uint64_t messages = 0;
    for (int r = 0; r < ranks->transport.count; ++r) {
        sent += to[r];
        received += from[r];
        messages += to[r] && r != ranks->transport.rank;
    }
    if (!own)
        own = reserve_got(ranks, received);
    const header mine = {.status = (int32_t)own, .kind = KIND_EXCHANGE};
    const sgs_status status = meet(ranks, purpose, mine, NULL);
    if (status)
        return status;
    const double start = sgsi_seconds();
    ranks->transport.exchange(ranks->transport.state, ranks->send, to, ranks->got, from);
    count_moved(ranks, purpose, start, sent - to[ranks->transport.rank], messages);
    *got = ranks->got;
    return SGS_STATUS_OK;
}

// Gathers the bytes that each rank sends to each other one: ranks->matrix. They count as part of
// the header, the time as that of the call.
static void share_sizes(sgs_ranks *ranks, sgs_ranks_purpose purpose, const uint64_t *row)
{
    const size_t bytes = (size_t)ranks->transport.count * sizeof *row;
    const double start = sgsi_seconds();
    ranks->transport.gather(ranks->transport.state, row, bytes, ranks->matrix);
    ranks->spent[purpose].moving += sgsi_seconds() - start;
    count_bytes(ranks, SGS_RANKS_STATUS, others(ranks) * bytes, others(ranks));
}

// Sizes of what each rank receives: ranks->sizes for this one. Returns the largest total.
static size_t read_matrix(sgs_ranks *ranks)
{
    const size_t count = (size_t)ranks->transport.count;
    size_t most = 0;
    for (size_t to = 0; to < count; ++to) {
        size_t total = 0;
        for (size_t from = 0; from < count; ++from)
            total += (size_t)ranks->matrix[from * count + to];
        most = total > most ? total : most;
    }
    for (size_t from = 0; from < count; ++from)
        ranks->sizes[from] = (size_t)ranks->matrix[from * count + (size_t)ranks->transport.rank];
    return most;
}

sgs_status sgsi_ranks_deliver(sgs_ranks *ranks, sgs_status own, sgs_ranks_purpose purpose,
                              const size_t *to, const unsigned char **got, const size_t **from)
{
    enum { FEW = 64 };
    const size_t count = (size_t)ranks->transport.count, rank = (size_t)ranks->transport.rank;
    uint64_t few[FEW], *row = count > FEW ? sgsi_alloc(count, sizeof *row) : few;
    uint64_t sent = 0, messages = 0;
    if (!row && !own)
        own = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu ranks", count);
    const header mine = {.status = (int32_t)own, .kind = KIND_DELIVER};
    sgs_status status = meet(ranks, purpose, mine, NULL);
    for (size_t r = 0; r < count && !status; ++r) {
        row[r] = to[r];
        sent += r == rank ? 0 : to[r];
        messages += to[r] && r != rank;
    }
    if (!status)
        share_sizes(ranks, purpose, row);
    if (row != few)
        sgsi_free(row);
    if (status)
        return status;
    const size_t most = read_matrix(ranks);
    if (most > ranks->most_received) { // the same decision on all ranks
        // All make the same room, so that later calls need not agree again.
        const size_t larger = most + most / 4;
        status = sgs_ranks_agree(ranks, reserve_got(ranks, larger));
        if (status)
            return status;
        ranks->most_received = larger;
    }
    const double start = sgsi_seconds();
    ranks->transport.exchange(ranks->transport.state, ranks->send, to, ranks->got, ranks->sizes);
    count_moved(ranks, purpose, start, sent, messages);
    *got = ranks->got;
    *from = ranks->sizes;
    return SGS_STATUS_OK;
}

sgs_status sgsi_ranks_copy(sgs_ranks *ranks, sgs_status own, sgs_ranks_purpose purpose, void *data,
                           size_t bytes)
{
    const header mine = {.status = (int32_t)own, .kind = KIND_COPY};
    const sgs_status status = meet(ranks, purpose, mine, NULL);
    if (status)
        return status;
    const bool sends = !ranks->transport.rank;
    const double start = sgsi_seconds();
    ranks->transport.broadcast(ranks->transport.state, data, bytes);
    count_moved(ranks, purpose, start, sends ? others(ranks) * bytes : 0,
                sends ? others(ranks) : 0);
    return SGS_STATUS_OK;
}

// All ranks see the same sizes, and fail alike.
static sgs_status fail_sizes(sgs_ranks *ranks, int differing)
{
    ranks->failed = SGS_STATUS_INVALID_ARGUMENT;
    snprintf(ranks->message, sizeof ranks->message, "rank %d gathers %zu bytes, but rank 0 %zu",
             differing, ranks->sizes[differing], ranks->sizes[0]);
    return fail_again(ranks);
}

sgs_status sgs_ranks_gather(sgs_ranks *ranks, sgs_status own, const void *bytes, size_t size,
                            void *got)
{
    if (!ranks) {
        if (!own)
            memcpy(got, bytes, size);
        return own;
    }
    if (!own && size > MAX_GATHERED)
        own = sgsi_fail(SGS_STATUS_LIMIT, "%zu bytes of a rank exceed the limit of %d", size,
                        MAX_GATHERED);
    const header mine = {.status = (int32_t)own, .kind = KIND_GATHER, .bytes = size};
    const sgs_status status = meet(ranks, SGS_RANKS_OTHER, mine, ranks->sizes);
    if (status)
        return status;
    for (int r = 1; r < ranks->transport.count; ++r)
        if (ranks->sizes[r] != ranks->sizes[0])
            return fail_sizes(ranks, r);
    const double start = sgsi_seconds();
    ranks->transport.gather(ranks->transport.state, bytes, size, got);
    count_moved(ranks, SGS_RANKS_OTHER, start, others(ranks) * size, others(ranks));
    return SGS_STATUS_OK;
}

sgs_status sgs_ranks_collect(sgs_ranks *ranks, sgs_status own, const void *bytes, size_t size,
                             int senders, void *got)
{
    if (!ranks) {
        if (!own)
            memcpy(got, bytes, size);
        return own;
    }
    const int rank = ranks->transport.rank;
    const size_t count = (size_t)ranks->transport.count, padded = sgsi_ranks_padded(size);
    if (!own && (senders < 1 || (size_t)senders > count))
        own = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%d senders of %zu ranks", senders, count);
    const size_t sent = rank < senders ? padded : 0;
    unsigned char *room = own ? NULL : sgsi_ranks_room(ranks, sent);
    size_t *sizes = sgsi_calloc(2 * count, sizeof *sizes); // to and from each rank
    if (!own && (!room || !sizes))
        own =
            sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu bytes to rank 0", size);
    if (own) {
        sgsi_free(sizes);
        return sgs_ranks_agree(ranks, own);
    }
    if (sent)
        memcpy(room, bytes, size);
    sizes[0] = sent;
    for (int r = 0; r < senders && !rank; ++r)
        sizes[count + (size_t)r] = padded;
    const unsigned char *all;
    const sgs_status status =
        sgsi_ranks_exchange(ranks, own, SGS_RANKS_OTHER, sizes, sizes + count, &all);
    for (size_t r = 0; r < (size_t)senders && !rank && !status; ++r)
        memcpy((unsigned char *)got + r * size, all + r * padded, size);
    sgsi_free(sizes);
    return status;
}

sgs_status sgs_ranks_broadcast(sgs_ranks *ranks, sgs_status own, void **bytes, size_t *size)
{
    if (!ranks)
        return own;
    const int rank = ranks->transport.rank;
    const header mine = {.status = (int32_t)own, .kind = KIND_BROADCAST, .bytes = rank ? 0 : *size};
    size_t *sizes = ranks->sizes;
    sgs_status status = meet(ranks, SGS_RANKS_OTHER, mine, sizes);
    if (status)
        return status;
    *size = sizes[0];
    void *fresh = rank ? malloc(*size + 1) : *bytes;
    status = sgs_ranks_agree(
        ranks, fresh || !rank
                   ? SGS_STATUS_OK
                   : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu bytes", *size));
    if (status) {
        if (rank)
            free(fresh);
        return status;
    }
    const double start = sgsi_seconds();
    ranks->transport.broadcast(ranks->transport.state, fresh, *size);
    count_moved(ranks, SGS_RANKS_OTHER, start, rank ? 0 : others(ranks) * *size,
                rank ? 0 : others(ranks));
    if (rank && fresh)
        ((char *)fresh)[*size] = 0;
    *bytes = fresh;
    return SGS_STATUS_OK;
}

// The part of a line from `begin` on that is shown: all of it, or what surrounds `at`, where the
// lines differ. A message has room for two.
enum { EXCERPT = 240, BEFORE_DIFFERENCE = 60 };
typedef struct excerpt {
    const char *before, *text, *after;
    int length;
} excerpt;

static excerpt excerpt_of(const char *line, size_t begin, size_t at)
{
    const size_t length = strcspn(line, "\n");
    excerpt part = {"", line + begin, "", (int)(length - begin)};
    if (length - begin <= EXCERPT)
        return part;
    if (at > begin + BEFORE_DIFFERENCE) {
        part.before = "...";
        part.text = line + at - BEFORE_DIFFERENCE;
        part.length = (int)(length - at + BEFORE_DIFFERENCE);
    }
    if (part.length > EXCERPT) {
        part.after = "...";
        part.length = EXCERPT;
    }
    return part;
}

// The first line "what: value" of `own` that differs from `first`.
static sgs_status fail_difference(const char *own, const char *first)
{
    size_t line = 0, at = 0;
    for (; own[at] == first[at]; ++at)
        if (own[at] == '\n')
            line = at + 1;
    at -= line;
    const char *const texts[2] = {own + line, first + line};
    int length[2], value[2];
    for (int k = 0; k < 2; ++k) {
        const char *colon = strstr(texts[k], ": ");
        length[k] = (int)strcspn(texts[k], "\n");
        value[k] = colon && colon < texts[k] + length[k] ? (int)(colon - texts[k]) : length[k];
    }
    const bool same = value[0] == value[1] && !strncmp(texts[0], texts[1], (size_t)value[0]) &&
                      value[0] < length[0] && value[1] < length[1];
    const size_t begin = same ? (size_t)value[0] + 2 : 0;
    const excerpt mine = excerpt_of(texts[0], begin, at), other = excerpt_of(texts[1], begin, at);
    if (same)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%.*s is %s%.*s%s, but %s%.*s%s on rank 0",
                         value[0], texts[0], mine.before, mine.length, mine.text, mine.after,
                         other.before, other.length, other.text, other.after);
    return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "has '%s%.*s%s', but rank 0 has '%s%.*s%s'",
                     mine.before, mine.length, mine.text, mine.after, other.before, other.length,
                     other.text, other.after);
}

sgs_status sgs_ranks_compare(sgs_ranks *ranks, sgs_status own, const char *text)
{
    if (!ranks)
        return own;
    void *first = (void *)text; // rank 0 does not change it
    size_t size = strlen(text);
    sgs_status status = sgs_ranks_broadcast(ranks, own, &first, &size);
    if (status)
        return status;
    if (ranks->transport.rank) {
        if (strcmp(text, first) != 0)
            status = fail_difference(text, first);
        free(first);
    }
    return sgs_ranks_agree(ranks, status);
}

// ---- Counts ----

sgs_ranks_traffic sgs_ranks_traffic_get(const sgs_ranks *ranks, sgs_ranks_purpose purpose)
{
    return ranks && (unsigned)purpose < SGS_RANKS_PURPOSE_COUNT ? ranks->counted[purpose]
                                                                : (sgs_ranks_traffic){0};
}

sgs_ranks_seconds sgs_ranks_seconds_get(const sgs_ranks *ranks, sgs_ranks_purpose purpose)
{
    return ranks && (unsigned)purpose < SGS_RANKS_PURPOSE_COUNT ? ranks->spent[purpose]
                                                                : (sgs_ranks_seconds){0};
}

const char *sgs_ranks_purpose_name(sgs_ranks_purpose purpose)
{
    static const char *const names[SGS_RANKS_PURPOSE_COUNT] = {
        [SGS_RANKS_STATUS] = "status",       [SGS_RANKS_IMAGE] = "image",
        [SGS_RANKS_SUMS] = "sums",           [SGS_RANKS_RECORDS] = "records",
        [SGS_RANKS_GRADIENTS] = "gradients", [SGS_RANKS_STRUCTURE] = "structure",
        [SGS_RANKS_SCORES] = "scores",       [SGS_RANKS_OTHER] = "other"};
    return (unsigned)purpose < SGS_RANKS_PURPOSE_COUNT ? names[purpose] : "unknown";
}
