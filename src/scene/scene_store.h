// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Where a scene's photographs come from when they are more than the image cache may hold. Used by
// scene.c alone; readers of photographs call sgs_scene_photo.

#include "image/photo_cache.h"

typedef struct sgs_scene_store sgs_scene_store;

// Takes over `planes` ([plane_count], with the array itself) and `colorspace`, which the sources
// point to; on failure they are freed.
sgs_status sgsi_scene_store_create(const sgsi_photo_source *sources, const size_t *bytes,
                                   size_t count, size_t limit, uint16_t **planes,
                                   size_t plane_count, char *colorspace, sgs_scene_store **store);
void sgsi_scene_store_destroy(sgs_scene_store *store); // accepts NULL

sgsi_photo_cache *sgsi_scene_store_cache(const sgs_scene_store *store);
