// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Ranks as threads of one process: every call publishes its pointers, waits for the others, copies,
// and waits again. For tests and sanitizers.

#include <pthread.h>
#include <string.h>

#include "base/core.h"
#include "cluster/rank_calls.h"

typedef struct hall hall;

typedef struct seat {
    hall *hall;
    int rank;
    const unsigned char *send; // published
    const size_t *to;
} seat;

struct hall {
    pthread_barrier_t barrier;
    int count, left;
    pthread_mutex_t lock;
    seat seats[];
};

static void wait_for_all(seat *own)
{
    pthread_barrier_wait(&own->hall->barrier);
}

static void gather(void *state, const void *send, size_t bytes, void *got)
{
    seat *own = state;
    own->send = send;
    wait_for_all(own);
    for (int r = 0; r < own->hall->count; ++r)
        memcpy((char *)got + (size_t)r * bytes, own->hall->seats[r].send, bytes);
    wait_for_all(own);
}

static void gather_sizes(void *state, const void *send, const size_t *sizes, void *got)
{
    seat *own = state;
    unsigned char *to = got;
    own->send = send;
    wait_for_all(own);
    for (int r = 0; r < own->hall->count; to += sizes[r++])
        if (sizes[r])
            memcpy(to, own->hall->seats[r].send, sizes[r]);
    wait_for_all(own);
}

static void exchange(void *state, const void *send, const size_t *to, void *got, const size_t *from)
{
    seat *own = state;
    unsigned char *at = got;
    own->send = send;
    own->to = to;
    wait_for_all(own);
    for (int r = 0; r < own->hall->count; at += from[r++]) {
        const seat *sender = &own->hall->seats[r];
        size_t begin = 0;
        for (int k = 0; k < own->rank; ++k)
            begin += sender->to[k];
        if (from[r])
            memcpy(at, sender->send + begin, from[r]);
    }
    wait_for_all(own);
}

static void broadcast(void *state, void *bytes, size_t size)
{
    seat *own = state;
    own->send = bytes;
    wait_for_all(own);
    if (own->rank && size)
        memcpy(bytes, own->hall->seats[0].send, size);
    wait_for_all(own);
}

static void leave(void *state)
{
    hall *all = ((seat *)state)->hall;
    pthread_barrier_wait(&all->barrier);
    pthread_mutex_lock(&all->lock);
    const bool is_last = ++all->left == all->count;
    pthread_mutex_unlock(&all->lock);
    if (!is_last)
        return;
    pthread_barrier_destroy(&all->barrier);
    pthread_mutex_destroy(&all->lock);
    sgsi_free(all);
}

bool sgsi_ranks_threads(int count, sgsi_transport *transports)
{
    hall *made = sgsi_calloc(1, sizeof *made + (size_t)count * sizeof *made->seats);
    if (!made)
        return false;
    made->count = count;
    pthread_barrier_init(&made->barrier, NULL, (unsigned)count);
    pthread_mutex_init(&made->lock, NULL);
    for (int r = 0; r < count; ++r) {
        made->seats[r] = (seat){.hall = made, .rank = r};
        transports[r] = (sgsi_transport){.rank = r,
                                         .count = count,
                                         .state = &made->seats[r],
                                         .gather = gather,
                                         .gather_sizes = gather_sizes,
                                         .exchange = exchange,
                                         .broadcast = broadcast,
                                         .close = leave};
    }
    return true;
}
