// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A lock protects the states; decoding runs outside of it. A photo is ABSENT, QUEUED (prefetch
// requested), DECODING (by the thread or the caller) or READY. Space is freed before decoding
// starts and is counted from then on. Three kinds of photos are never evicted: the one in use,
// those being decoded, and the few that were prefetched but not yet used.

#include "image/photo_cache.h"

#include <pthread.h>
#include <string.h>

#include "base/core.h"

typedef enum photo_state { ABSENT, QUEUED, DECODING, READY } photo_state;

enum { QUEUE = 8 }; // prefetch requests at a time; further ones are ignored

typedef struct entry {
    sgsi_photo_source source;
    size_t bytes;
    photo_state state;
    bool prefetched; // prefetch requested and not yet used
    unsigned long long used;
    sgs_photo photo;
    sgs_status status; // of the last decoding
    char *error;
} entry;

struct sgsi_photo_cache {
    pthread_mutex_t lock;
    pthread_cond_t changed; // a state changed, or `stop` is set
    pthread_t thread;
    bool stop;
    size_t count, limit, bytes, peak;
    size_t current; // in use; initially `count`
    unsigned long long clock;
    size_t queue[QUEUE]; // prefetch requests, oldest first
    size_t queued;
    entry entries[];
};

static void drop(sgsi_photo_cache *cache, entry *e)
{
    sgsi_photo_free(&e->photo);
    cache->bytes -= e->bytes;
    e->state = ABSENT;
    e->prefetched = false;
}

// Evicts the least recently used photos until `bytes` more fit. Returns whether they fit.
// prefetched_too: evict prefetched photos as well.
static bool make_room(sgsi_photo_cache *cache, size_t bytes, bool prefetched_too)
{
    while (cache->bytes + bytes > cache->limit) {
        entry *oldest = NULL;
        for (size_t i = 0; i < cache->count; ++i) {
            entry *e = &cache->entries[i];
            const bool kept =
                e->state != READY || i == cache->current || (e->prefetched && !prefetched_too);
            if (!kept && (!oldest || e->used < oldest->used))
                oldest = e;
        }
        if (!oldest)
            return false;
        drop(cache, oldest);
    }
    return true;
}

// Decodes an entry for which space was freed. Releases the lock while decoding.
static void decode(sgsi_photo_cache *cache, entry *e)
{
    sgsi_photo_report report;
    e->state = DECODING;
    cache->bytes += e->bytes;
    cache->peak = cache->bytes > cache->peak ? cache->bytes : cache->peak;
    pthread_mutex_unlock(&cache->lock);
    sgs_photo photo;
    const sgs_status status = sgsi_photo_load(&e->source, &photo, &report);
    char *error = status ? sgsi_strdup(sgs_last_error()) : NULL;
    pthread_mutex_lock(&cache->lock);
    sgsi_free(e->error);
    e->photo = photo;
    e->status = status;
    e->error = error;
    e->used = ++cache->clock;
    e->state = READY;
    pthread_cond_broadcast(&cache->changed);
}

static void *decode_ahead(void *context)
{
    sgsi_photo_cache *cache = context;
    pthread_mutex_lock(&cache->lock);
    while (!cache->stop) {
        entry *next = cache->queued ? &cache->entries[cache->queue[0]] : NULL;
        // If the unused prefetched photos leave no space, wait until they are used.
        if (!next ||
            (next->state == QUEUED && !make_room(cache, next->bytes, false) && cache->bytes > 0)) {
            pthread_cond_wait(&cache->changed, &cache->lock);
            continue;
        }
        --cache->queued;
        memmove(cache->queue, cache->queue + 1, cache->queued * sizeof *cache->queue);
        if (next->state == QUEUED)
            decode(cache, next);
    }
    pthread_mutex_unlock(&cache->lock);
    return NULL;
}

sgs_status sgsi_photo_cache_create(const sgsi_photo_source *sources, const size_t *bytes,
                                   size_t count, size_t limit, sgsi_photo_cache **cache)
{
    *cache = sgsi_calloc(1, sizeof **cache + count * sizeof(entry));
    if (!*cache)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the image cache");
    sgsi_photo_cache *made = *cache;
    made->count = made->current = count;
    made->limit = limit;
    for (size_t i = 0; i < count; ++i) {
        made->entries[i].source = sources[i];
        made->entries[i].bytes = bytes[i];
    }
    pthread_mutex_init(&made->lock, NULL);
    pthread_cond_init(&made->changed, NULL);
    if (pthread_create(&made->thread, NULL, decode_ahead, made)) {
        pthread_cond_destroy(&made->changed);
        pthread_mutex_destroy(&made->lock);
        sgsi_free(made);
        *cache = NULL;
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "cannot start the thread of the image cache");
    }
    return SGS_STATUS_OK;
}

void sgsi_photo_cache_destroy(sgsi_photo_cache *cache)
{
    if (!cache)
        return;
    pthread_mutex_lock(&cache->lock);
    cache->stop = true;
    pthread_cond_broadcast(&cache->changed);
    pthread_mutex_unlock(&cache->lock);
    pthread_join(cache->thread, NULL);
    for (size_t i = 0; i < cache->count; ++i) {
        sgsi_photo_free(&cache->entries[i].photo);
        sgsi_free(cache->entries[i].error);
    }
    pthread_cond_destroy(&cache->changed);
    pthread_mutex_destroy(&cache->lock);
    sgsi_free(cache);
}

sgs_status sgsi_photo_cache_get(sgsi_photo_cache *cache, size_t index, const sgs_photo **photo)
{
    *photo = NULL;
    entry *e = &cache->entries[index];
    pthread_mutex_lock(&cache->lock);
    cache->current = index;
    while (e->state == DECODING)
        pthread_cond_wait(&cache->changed, &cache->lock);
    // QUEUED also: the entry's place in the queue then has no effect.
    if (e->state != READY) {
        (void)make_room(cache, e->bytes, true);
        decode(cache, e);
    }
    e->prefetched = false;
    e->used = ++cache->clock;
    const sgs_status status = e->status;
    if (status) {
        sgsi_record_error("%s", e->error ? e->error : "not enough memory for an image");
        drop(cache, e);
    } else {
        *photo = &e->photo;
    }
    pthread_cond_broadcast(&cache->changed); // the previous photo may be evicted now
    pthread_mutex_unlock(&cache->lock);
    return status;
}

void sgsi_photo_cache_prefetch(sgsi_photo_cache *cache, size_t index)
{
    pthread_mutex_lock(&cache->lock);
    entry *e = &cache->entries[index];
    if (e->state == READY)
        e->used = ++cache->clock;
    if (e->state == ABSENT && cache->queued < QUEUE) {
        e->state = QUEUED;
        cache->queue[cache->queued++] = index;
        pthread_cond_broadcast(&cache->changed);
    }
    e->prefetched = e->state != ABSENT;
    pthread_mutex_unlock(&cache->lock);
}

size_t sgsi_photo_cache_peak(sgsi_photo_cache *cache)
{
    pthread_mutex_lock(&cache->lock);
    const size_t peak = cache->peak;
    pthread_mutex_unlock(&cache->lock);
    return peak;
}
