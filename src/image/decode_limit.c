// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "image/decode_limit.h"

#include <pthread.h>

#include "base/core.h"

struct sgsi_decode_limit {
    pthread_mutex_t lock;
    pthread_cond_t changed;
    size_t bytes, used, peak;
};

sgsi_decode_limit *sgsi_decode_limit_create(size_t bytes)
{
    sgsi_decode_limit *limit = sgsi_calloc(1, sizeof *limit);
    if (!limit)
        return NULL;
    limit->bytes = bytes;
    pthread_mutex_init(&limit->lock, NULL);
    pthread_cond_init(&limit->changed, NULL);
    return limit;
}

void sgsi_decode_limit_destroy(sgsi_decode_limit *limit)
{
    if (!limit)
        return;
    pthread_cond_destroy(&limit->changed);
    pthread_mutex_destroy(&limit->lock);
    sgsi_free(limit);
}

void sgsi_decode_begin(sgsi_decode_limit *limit, size_t bytes)
{
    if (!limit)
        return;
    pthread_mutex_lock(&limit->lock);
    while (limit->used && (bytes > limit->bytes || limit->used > limit->bytes - bytes))
        pthread_cond_wait(&limit->changed, &limit->lock);
    limit->used += bytes;
    limit->peak = limit->used > limit->peak ? limit->used : limit->peak;
    pthread_mutex_unlock(&limit->lock);
}

void sgsi_decode_end(sgsi_decode_limit *limit, size_t bytes)
{
    if (!limit)
        return;
    pthread_mutex_lock(&limit->lock);
    limit->used -= bytes;
    pthread_cond_broadcast(&limit->changed);
    pthread_mutex_unlock(&limit->lock);
}

size_t sgsi_decode_limit_peak(sgsi_decode_limit *limit)
{
    pthread_mutex_lock(&limit->lock);
    const size_t peak = limit->peak;
    pthread_mutex_unlock(&limit->lock);
    return peak;
}
