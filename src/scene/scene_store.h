// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Source of a scene's photos if they exceed the image cache. Created by scene.c; photos
// are read through sgs_scene_photo.

#include "image/photo_cache.h"

typedef struct sgs_scene_store sgs_scene_store;

// Takes ownership of `planes` (the array and its [plane_count] elements), which the sources point
// to, and of decode_limit. Frees them on failure.
sgs_status sgsi_scene_store_create(const sgsi_photo_source *sources, const size_t *bytes,
                                   size_t count, size_t limit, uint16_t **planes,
                                   size_t plane_count, sgsi_decode_limit *decode_limit,
                                   sgs_scene_store **store);
void sgsi_scene_store_destroy(sgs_scene_store *store); // accepts NULL

sgsi_photo_cache *sgsi_scene_store_cache(const sgs_scene_store *store);
