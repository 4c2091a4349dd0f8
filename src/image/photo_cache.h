// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The photographs of a scene that does not fit into memory: at most so many bytes of them decoded,
// the least recently used ones go first, and one thread decodes ahead those that were announced.
// What a photograph holds never depends on whether it was there.

#include "image/photo.h"

typedef struct sgsi_photo_cache sgsi_photo_cache;

// `sources` (copied; their strings and planes must outlive the cache) has one entry per photograph,
// `bytes` what each takes in memory. The limit is exceeded only where the photograph in use and the
// one decoded next do not fit into it. Starts the thread.
sgs_status sgsi_photo_cache_create(const sgsi_photo_source *sources, const size_t *bytes,
                                   size_t count, size_t limit, sgsi_photo_cache **cache);
void sgsi_photo_cache_destroy(sgsi_photo_cache *cache); // accepts NULL

// The photograph, valid until the next call. Fails as sgsi_photo_load does. One thread at a time.
sgs_status sgsi_photo_cache_get(sgsi_photo_cache *cache, size_t index, const sgs_photo **photo);

// Announces that the photograph will be asked for. Does not wait, cannot fail.
void sgsi_photo_cache_expect(sgsi_photo_cache *cache, size_t index);

// Most bytes that were held at a time, for tests.
size_t sgsi_photo_cache_peak(sgsi_photo_cache *cache);
