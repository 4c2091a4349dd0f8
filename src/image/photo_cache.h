// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Cache of decoded photos for scenes that do not fit in memory: a byte limit, least recently
// used eviction, and one thread that decodes prefetched photos. The contents of a photo
// do not depend on the cache.

#include "image/photo.h"

typedef struct sgsi_photo_cache sgsi_photo_cache;

// `sources` has one entry per photo and is copied; its strings and planes must outlive the
// cache. `bytes`: decoded size of each. The limit is exceeded only if the photo in use and the
// one being decoded do not fit together. Starts the decoding thread.
sgs_status sgsi_photo_cache_create(const sgsi_photo_source *sources, const size_t *bytes,
                                   size_t count, size_t limit, sgsi_photo_cache **cache);
void sgsi_photo_cache_destroy(sgsi_photo_cache *cache); // accepts NULL

// Returns a photo, valid until the next call. Fails like sgsi_photo_load. Not thread-safe.
sgs_status sgsi_photo_cache_get(sgsi_photo_cache *cache, size_t index, const sgs_photo **photo);

// Requests a photo in advance. Does not block and cannot fail.
void sgsi_photo_cache_prefetch(sgsi_photo_cache *cache, size_t index);

// Peak of the bytes held, for tests.
size_t sgsi_photo_cache_peak(sgsi_photo_cache *cache);
