// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A lock protects the states; decoding runs outside of it. A photo is ABSENT, QUEUED (prefetch
// requested), DECODING (by a thread or the caller) or READY. Space is freed before decoding
// starts and is counted from then on. Three kinds of photos are not evicted: the one in use, those
// being decoded, and those that were prefetched but not yet used, unless the caller needs their
// space.
//
// Which of the others goes: each epoch of a training run is a new random permutation of its views.
// A photo not yet used in this epoch is needed before its end; one that was used is needed in the
// next epoch, at a random place. So any photo of this epoch may go, and the most recently used one
// is of this epoch. For passes in a fixed order, as of an evaluation, that choice is optimal. It
// would keep photos forever that are not used at all any more, those of held-out views in
// particular. In permutations, at most two passes lie between two uses of a photo; a photo that was
// not used for that long goes first.

#include "image/photo_cache.h"

#include <pthread.h>
#include <string.h>

#include "base/core.h"
#include "base/float_mode.h"
#include "base/library_thread.h"

typedef enum photo_state { ABSENT, QUEUED, DECODING, READY } photo_state;

enum {
    QUEUE = 64, // prefetch requests at a time; further ones are ignored
    KEPT = 64   // gets for which an unused prefetched photo is kept
};

typedef struct entry {
    sgsi_photo_source source;
    size_t bytes;
    photo_state state;
    unsigned long long used;      // clock of the last use, or of its decoding
    unsigned long long requested; // number of the prefetch request; 0 = none since the last use
    unsigned long long renewed;   // clock of the last request
    sgs_photo photo;
    sgs_status status; // of the last decoding
    char *error;
} entry;

struct sgsi_photo_cache {
    pthread_mutex_t lock;
    pthread_cond_t changed; // a state changed, or `stop` is set
    pthread_t threads[SGSI_DECODERS_MAX];
    int decoders;
    bool stop;
    bool wanted; // the caller waits for space: no thread begins to decode
    size_t count, limit, bytes;
    size_t current; // in use; initially `count`
    sgsi_photo_cache_counts counts;
    unsigned long long clock, requests; // number of gets, of prefetch requests
    size_t queue[QUEUE];                // prefetch requests, oldest first
    size_t queued;
    entry entries[];
};

int sgsi_photo_decoders(int threads)
{
    const int share = threads / 8, least = threads < 4 ? 1 : 2;
    return share < least ? least : share > SGSI_DECODERS_MAX ? SGSI_DECODERS_MAX : share;
}

static void drop(sgsi_photo_cache *cache, entry *e)
{
    sgsi_photo_free(&e->photo);
    cache->bytes -= e->bytes;
    e->state = ABSENT;
    e->requested = 0;
}

// True if the photo was prefetched, and its use is still expected.
static bool is_awaited(const sgsi_photo_cache *cache, const entry *e)
{
    return e->requested && cache->clock - e->renewed <= KEPT;
}

// Which of two photos is evicted first. Of the awaited ones, that is the one requested last.
static bool goes_before(const sgsi_photo_cache *cache, const entry *a, const entry *b)
{
    const bool awaited_a = is_awaited(cache, a), awaited_b = is_awaited(cache, b);
    if (awaited_a != awaited_b)
        return awaited_b;
    if (awaited_a)
        return a->requested > b->requested;
    const unsigned long long oldest = a->used < b->used ? a->used : b->used;
    const bool stale = cache->clock - oldest > 2 * cache->count;
    return stale ? a->used < b->used : a->used > b->used;
}

// Evicts photos until `bytes` more fit. Returns whether they fit. awaited_too: evict prefetched
// photos as well.
static bool make_room(sgsi_photo_cache *cache, size_t bytes, bool awaited_too)
{
    while (cache->bytes + bytes > cache->limit) {
        entry *first = NULL;
        for (size_t i = 0; i < cache->count; ++i) {
            entry *e = &cache->entries[i];
            const bool kept =
                e->state != READY || i == cache->current || (!awaited_too && is_awaited(cache, e));
            if (!kept && (!first || goes_before(cache, e, first)))
                first = e;
        }
        if (!first)
            return false;
        drop(cache, first);
    }
    return true;
}

static void count_bytes(sgsi_photo_cache *cache, size_t bytes)
{
    cache->bytes += bytes;
    if (cache->bytes > cache->counts.peak)
        cache->counts.peak = cache->bytes;
}

// Decodes an entry for which space was freed. Releases the lock while decoding.
static void decode(sgsi_photo_cache *cache, entry *e)
{
    sgsi_photo_report report;
    e->state = DECODING;
    count_bytes(cache, e->bytes);
    ++cache->counts.decodes;
    ++cache->counts.decoding;
    pthread_mutex_unlock(&cache->lock);
    sgs_photo photo;
    const sgsi_float_mode mode = sgsi_float_mode_enter(); // of any caller and of the thread
    const sgs_status status = sgsi_photo_load(&e->source, &photo, &report);
    sgsi_float_mode_set(mode);
    char *error = status ? sgsi_strdup(sgs_last_error()) : NULL;
    pthread_mutex_lock(&cache->lock);
    sgsi_free(e->error);
    e->photo = photo;
    e->status = status;
    e->error = error;
    e->used = cache->clock;
    e->state = READY;
    --cache->counts.decoding;
    pthread_cond_broadcast(&cache->changed);
}

static void *decode_ahead(void *context)
{
    sgsi_photo_cache *cache = context;
    pthread_mutex_lock(&cache->lock);
    while (!cache->stop) {
        entry *next = cache->queued ? &cache->entries[cache->queue[0]] : NULL;
        // If the unused prefetched photos leave no space, wait until they are used.
        if (!next || cache->wanted ||
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

static void stop_threads(sgsi_photo_cache *cache)
{
    pthread_mutex_lock(&cache->lock);
    cache->stop = true;
    pthread_cond_broadcast(&cache->changed);
    pthread_mutex_unlock(&cache->lock);
    for (int k = 0; k < cache->decoders; ++k)
        pthread_join(cache->threads[k], NULL);
}

sgs_status sgsi_photo_cache_create(const sgsi_photo_source *sources, const size_t *bytes,
                                   size_t count, size_t limit, int decoders,
                                   sgsi_photo_cache **cache)
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
    // One thread is enough: the system may limit their number.
    while (made->decoders < decoders &&
           sgsi_thread_create(&made->threads[made->decoders], decode_ahead, made))
        ++made->decoders;
    if (made->decoders)
        return SGS_STATUS_OK;
    sgsi_photo_cache_destroy(made);
    *cache = NULL;
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "cannot start a thread of the image cache");
}

void sgsi_photo_cache_destroy(sgsi_photo_cache *cache)
{
    if (!cache)
        return;
    stop_threads(cache);
    for (size_t i = 0; i < cache->count; ++i) {
        sgsi_photo_free(&cache->entries[i].photo);
        sgsi_free(cache->entries[i].error);
    }
    pthread_cond_destroy(&cache->changed);
    pthread_mutex_destroy(&cache->lock);
    sgsi_free(cache);
}

void sgsi_photo_cache_put(sgsi_photo_cache *cache, size_t index, sgs_photo *photo)
{
    pthread_mutex_lock(&cache->lock);
    entry *e = &cache->entries[index];
    e->photo = *photo;
    e->state = READY;
    count_bytes(cache, e->bytes);
    pthread_mutex_unlock(&cache->lock);
    photo->pixels = NULL;
    photo->halves = photo->valid_mask = NULL;
}

// Decodes the photo in use in the calling thread. QUEUED also: its place in the queue then has no
// effect.
static void decode_now(sgsi_photo_cache *cache, entry *e)
{
    cache->wanted = true;
    while (!make_room(cache, e->bytes, true) && cache->counts.decoding)
        pthread_cond_wait(&cache->changed, &cache->lock);
    cache->wanted = false;
    decode(cache, e);
}

sgs_status sgsi_photo_cache_get(sgsi_photo_cache *cache, size_t index, const sgs_photo **photo)
{
    *photo = NULL;
    entry *e = &cache->entries[index];
    pthread_mutex_lock(&cache->lock);
    cache->current = index;
    ++cache->clock;
    pthread_cond_broadcast(&cache->changed); // the previous photo may be evicted now
    while (e->state == DECODING)
        pthread_cond_wait(&cache->changed, &cache->lock);
    if (e->state != READY)
        decode_now(cache, e);
    e->requested = 0;
    e->used = cache->clock;
    const sgs_status status = e->status;
    if (status) {
        sgsi_record_error("%s", e->error ? e->error : "not enough memory for an image");
        drop(cache, e);
    } else {
        *photo = &e->photo;
    }
    pthread_cond_broadcast(&cache->changed);
    pthread_mutex_unlock(&cache->lock);
    return status;
}

void sgsi_photo_cache_prefetch(sgsi_photo_cache *cache, size_t index)
{
    pthread_mutex_lock(&cache->lock);
    entry *e = &cache->entries[index];
    if (e->state == ABSENT && cache->queued < QUEUE) {
        e->state = QUEUED;
        cache->queue[cache->queued++] = index;
        pthread_cond_broadcast(&cache->changed);
    }
    if (e->state != ABSENT && !is_awaited(cache, e))
        e->requested = ++cache->requests;
    e->renewed = cache->clock;
    pthread_mutex_unlock(&cache->lock);
}

size_t sgsi_photo_cache_ahead(const sgsi_photo_cache *cache)
{
    return (size_t)cache->decoders + 1;
}

sgsi_photo_cache_counts sgsi_photo_cache_count(sgsi_photo_cache *cache)
{
    pthread_mutex_lock(&cache->lock);
    const sgsi_photo_cache_counts counts = cache->counts;
    pthread_mutex_unlock(&cache->lock);
    return counts;
}
