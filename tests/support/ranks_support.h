// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Ranks as threads of one process. Include after cmocka.h.

#include <pthread.h>
#include <stdlib.h>

#include "cluster/rank_calls.h"

enum { RANKS_MAX = 8 };

typedef struct ranks_thread {
    sgsi_transport transport;
    void (*run)(void *member, sgs_ranks *ranks);
    void *member;
} ranks_thread;

static inline void *ranks_thread_run(void *context)
{
    const ranks_thread *thread = context;
    sgs_ranks *ranks;
    if (sgsi_ranks_create(&thread->transport, &ranks))
        abort();
    thread->run(thread->member, ranks);
    sgs_ranks_close(ranks);
    return NULL;
}

// Calls run(member, ranks) at once on `count` ranks; the members have `size` bytes each.
static inline void ranks_run(int count, void *members, size_t size,
                             void (*run)(void *member, sgs_ranks *ranks))
{
    sgsi_transport transports[RANKS_MAX];
    ranks_thread all[RANKS_MAX];
    pthread_t threads[RANKS_MAX];
    assert_in_range(count, 1, RANKS_MAX);
    assert_true(sgsi_ranks_threads(count, transports));
    for (int r = 0; r < count; ++r) {
        all[r] = (ranks_thread){transports[r], run, (char *)members + (size_t)r * size};
        assert_int_equal(pthread_create(&threads[r], NULL, ranks_thread_run, &all[r]), 0);
    }
    for (int r = 0; r < count; ++r)
        pthread_join(threads[r], NULL);
}
