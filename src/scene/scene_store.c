// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "scene/scene_store.h"

#include "base/core.h"
#include "base/threads.h"

struct sgs_scene_store {
    sgsi_photo_cache *cache;
    uint16_t **planes; // valid masks of the lenses
    size_t plane_count;
    sgsi_decode_limit *decode_limit; // of the sources
};

void sgsi_scene_store_destroy(sgs_scene_store *store)
{
    if (!store)
        return;
    sgsi_photo_cache_destroy(store->cache);
    for (size_t i = 0; i < store->plane_count; ++i)
        sgsi_free(store->planes[i]);
    sgsi_free(store->planes);
    sgsi_decode_limit_destroy(store->decode_limit);
    sgsi_free(store);
}

sgs_status sgsi_scene_store_create(const sgsi_photo_source *sources, const size_t *bytes,
                                   size_t count, size_t limit, uint16_t **planes,
                                   size_t plane_count, sgsi_decode_limit *decode_limit,
                                   sgs_scene_store **store)
{
    const sgs_scene_store left = {NULL, planes, plane_count, decode_limit};
    sgs_scene_store *made = sgsi_calloc(1, sizeof *made);
    *store = NULL;
    if (!made) {
        for (size_t i = 0; i < plane_count; ++i)
            sgsi_free(planes[i]);
        sgsi_free(planes);
        sgsi_decode_limit_destroy(decode_limit);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the image cache");
    }
    *made = left;
    const sgs_status status = sgsi_photo_cache_create(
        sources, bytes, count, limit, sgsi_photo_decoders(sgsi_threads()), &made->cache);
    if (status)
        sgsi_scene_store_destroy(made);
    else
        *store = made;
    return status;
}

sgsi_photo_cache *sgsi_scene_store_cache(const sgs_scene_store *store)
{
    return store->cache;
}

sgs_status sgs_scene_photo(const sgs_scene *scene, size_t index, const sgs_photo **photo)
{
    *photo = NULL;
    if (index >= scene->view_count)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: has no view %zu", scene->path, index);
    if (scene->store)
        return sgsi_photo_cache_get(scene->store->cache, index, photo);
    *photo = &scene->views[index].image;
    return SGS_STATUS_OK;
}

sgs_status sgs_scene_photo_read(const sgs_scene *scene, size_t index, int width, int height,
                                sgs_photo *photo)
{
    *photo = (sgs_photo){0};
    if (index >= scene->view_count || scene->format == SGS_SCENE_MEMORY || width < 1 || height < 1)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "%s: view %zu has no image file to read at %d x %d pixels", scene->path,
                         index, width, height);
    const sgsi_photo_source source = {.image_path = scene->views[index].image_path,
                                      .display_window = scene->views[index].display_window,
                                      .width = width,
                                      .height = height,
                                      .alpha = scene->alpha,
                                      .colorspace = scene->colorspace,
                                      .space = scene->space,
                                      .white_point = scene->white_point};
    sgsi_photo_report report;
    const sgs_status status = sgsi_photo_load(&source, photo, &report);
    if (status)
        return status;
    sgsi_free(photo->valid_mask);
    photo->valid_mask = NULL;
    photo->kept = (size_t)width * (size_t)height;
    return SGS_STATUS_OK;
}

void sgs_scene_prefetch(const sgs_scene *scene, size_t index)
{
    if (scene->store && index < scene->view_count)
        sgsi_photo_cache_prefetch(scene->store->cache, index);
}

size_t sgs_scene_prefetch_count(const sgs_scene *scene)
{
    return scene->store ? sgsi_photo_cache_ahead(scene->store->cache) : 0;
}
