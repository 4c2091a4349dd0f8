// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Cache of decoded photos for scenes that do not fit in memory: a byte limit, and threads that
// decode prefetched photos. It evicts the photo that was used most recently: passes over all views,
// in random or in fixed order, use that one again last. The contents of a photo do not depend on
// the cache.

#include "image/photo.h"

typedef struct sgsi_photo_cache sgsi_photo_cache;

enum { SGSI_DECODERS_MAX = 16 };

// Number of decoding threads beside `threads` threads that train: one of eight, at least two unless
// there are fewer than four. Cannot fail.
int sgsi_photo_decoders(int threads);

// `sources` has one entry per photo and is copied; its strings, planes and decode limit must
// outlive the cache. `bytes`: decoded size of each. `decoders`: decoding threads, which it starts,
// 1 to SGSI_DECODERS_MAX. The limit is exceeded only by a photo in use that alone exceeds it, or
// that does not fit together with one being decoded.
sgs_status sgsi_photo_cache_create(const sgsi_photo_source *sources, const size_t *bytes,
                                   size_t count, size_t limit, int decoders,
                                   sgsi_photo_cache **cache);
void sgsi_photo_cache_destroy(sgsi_photo_cache *cache); // accepts NULL

// Adds a photo that is already decoded and takes over its planes: photo->pixels, halves and
// valid_mask are NULL afterwards. Its bytes must fit within the limit. Call it before the first
// get.
void sgsi_photo_cache_put(sgsi_photo_cache *cache, size_t index, sgs_photo *photo);

// Returns a photo, valid until the next call. Fails like sgsi_photo_load. Not thread-safe.
sgs_status sgsi_photo_cache_get(sgsi_photo_cache *cache, size_t index, const sgs_photo **photo);

// Requests a photo in advance. Does not block and cannot fail.
void sgsi_photo_cache_prefetch(sgsi_photo_cache *cache, size_t index);

// Number of photos to request ahead of the one in use, such that all decoding threads work.
size_t sgsi_photo_cache_ahead(const sgsi_photo_cache *cache);

// For tests.
typedef struct sgsi_photo_cache_counts {
    size_t peak;     // of the bytes held
    size_t decodes;  // begun so far
    size_t decoding; // now
} sgsi_photo_cache_counts;
sgsi_photo_cache_counts sgsi_photo_cache_count(sgsi_photo_cache *cache);
