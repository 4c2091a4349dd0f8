// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The reference renderer takes all parameters in double precision, which needs more memory than the
// model, and reads every one. So primitives that the ray cannot hit are left out (is_near), and the
// others are passed in chunks first. The transmittance in front of a hit is at least as
// large among the primitives of its chunk as among all of them, so a hit that counts among all
// counts in its chunk. The first hit that does not count ends the list, so it is required too: it
// is the first hit of the chunk's other primitives. All of these, in the order of their rows, are
// passed once more and give the result.

#include "viewer/ray_inspect.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "cli/json_output.h"
#include "viewer/view_crop.h"

enum { CHUNK = 4096 };

typedef struct row_list {
    uint32_t *rows; // [count]
    size_t count, capacity;
} row_list;

static int compare_rows(const void *a, const void *b)
{
    const uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

static void load_row(const sgs_gaussians *model, size_t row, double *params)
{
    for (int k = 0; k < SGS_PARAM_COUNT; ++k)
        params[k] = (double)*sgs_gaussians_at(model, row, k);
    params[SGS_PARAM_OPACITY] = (double)sgs_gaussians_opacity_logit(model, row);
}

// Part of a model that is passed to the reference renderer at once.
typedef struct row_chunk {
    uint32_t rows[CHUNK];                   // [count]
    double params[CHUNK * SGS_PARAM_COUNT]; // [count][SGS_PARAM_COUNT]
    sgs_hit hits[CHUNK];
    size_t count;
} row_chunk;

// Appends the rows of hits of a chunk.
static bool add_rows(row_list *list, const sgs_hit *hits, size_t count, const row_chunk *chunk)
{
    if (list->count + count > list->capacity) {
        const size_t capacity = 2 * list->capacity + count;
        uint32_t *rows = realloc(list->rows, capacity * sizeof *rows);
        if (!rows)
            return false;
        list->rows = rows;
        list->capacity = capacity;
    }
    for (size_t i = 0; i < count; ++i)
        list->rows[list->count++] = chunk->rows[hits[i].primitive];
    return true;
}

typedef struct ray_query {
    const sgs_camera *camera;
    const sgs_pose *pose;
    const sgs_render_options *options;
    int x, y;
    double center[3], direction[3]; // of the ray, world; unit
    double filter_scale;            // variance of the pixel filter at distance 1, at most
} ray_query;

// False if the pixel has no ray.
static bool query_aim(ray_query *query)
{
    double axial[3], fx, fy, cx, cy;
    const sgs_camera *camera = query->camera;
    if (query->x < 0 || query->y < 0 || query->x >= camera->width || query->y >= camera->height ||
        !sgs_camera_unproject(camera, (double[2]){query->x + 0.5, query->y + 0.5}, axial))
        return false;
    sgs_pose_center(query->pose, query->center);
    for (int k = 0; k < 3; ++k)
        query->direction[k] = query->pose->rotation[k] * axial[0] +
                              query->pose->rotation[3 + k] * axial[1] +
                              query->pose->rotation[6 + k] * axial[2];
    sgs_camera_intrinsics(camera, &fx, &fy, &cx, &cy);
    query->filter_scale = query->options->filter == SGS_FILTER_NONE ? 0 : 0.3 / (fx * fy);
    return true;
}

// False if the primitive has no hit on the ray. Its response is at most
// exp(-d^2 / (2 s^2)), for the distance d of its mean from the line of the ray and its largest
// filtered scale s; hits require 1/255, so d^2 <= 2 ln(255) s^2. The pixel filter is largest if its
// depth is the distance.
static bool is_near(const sgs_gaussians *model, const ray_query *query, size_t row)
{
    const double reach = 11.083; // 2 ln(255) = 11.0825...
    double to_mean[3], squared = 0, along = 0, largest = -HUGE_VAL;
    for (int k = 0; k < 3; ++k) {
        to_mean[k] = (double)*sgs_gaussians_at(model, row, SGS_PARAM_MEAN + k) - query->center[k];
        squared += to_mean[k] * to_mean[k];
        along += to_mean[k] * query->direction[k];
        largest = fmax(largest, (double)*sgs_gaussians_at(model, row, SGS_PARAM_SCALE + k));
    }
    const double variance = exp(2 * largest) + query->filter_scale * squared;
    const double rounding = 1e-9 * squared; // of the difference
    return !(squared - along * along > reach * variance + rounding);
}

// False if out of memory.
static bool query_hits(const ray_query *query, const double *params, size_t count, sgs_hit *hits,
                       size_t *found)
{
    return !sgs_reference_hits(params, count, query->camera, query->pose, query->options, query->x,
                               query->y, hits, count, found);
}

// The row of the first hit of a chunk that is not among its `found` hits, by a query without them.
// Changes params. *any: there is one. False if out of memory.
static bool next_hit(const ray_query *query, double *params, size_t count, sgs_hit *hits,
                     size_t found, uint32_t *row, bool *any)
{
    bool counted[CHUNK] = {false};
    uint32_t rows[CHUNK];
    size_t kept = 0;
    for (size_t i = 0; i < found; ++i)
        counted[hits[i].primitive] = true;
    for (size_t i = 0; i < count; ++i)
        if (!counted[i]) {
            memmove(params + kept * SGS_PARAM_COUNT, params + i * SGS_PARAM_COUNT,
                    SGS_PARAM_COUNT * sizeof *params);
            rows[kept++] = (uint32_t)i;
        }
    size_t next;
    if (!query_hits(query, params, kept, hits, &next))
        return false;
    *any = next > 0;
    *row = next ? rows[hits[0].primitive] : 0;
    return true;
}

// Adds the hits of a chunk, and the hit that ends their list. Changes the chunk.
static bool add_chunk(const ray_query *query, row_chunk *chunk, row_list *list)
{
    const double may_end =
        0.0101; // alpha is at most 0.99: then T is below 1e-4 behind the next hit
    size_t found;
    if (!query_hits(query, chunk->params, chunk->count, chunk->hits, &found))
        return false;
    if (!found)
        return true;
    const sgs_hit *last = &chunk->hits[found - 1];
    const bool ends = last->transmittance * (1 - last->alpha) < may_end;
    sgs_hit end = {0};
    bool any = false;
    if (!add_rows(list, chunk->hits, found, chunk) ||
        (ends &&
         !next_hit(query, chunk->params, chunk->count, chunk->hits, found, &end.primitive, &any)))
        return false;
    return !any || add_rows(list, &end, 1, chunk);
}

static bool find_rows(const sgs_gaussians *model, const unsigned char *keep, const ray_query *query,
                      row_list *list)
{
    row_chunk *chunk = malloc(sizeof *chunk);
    bool done = chunk != NULL;
    if (chunk)
        chunk->count = 0;
    for (size_t row = 0; row < model->count && done; ++row) {
        if ((keep && !keep[row]) || !is_near(model, query, row))
            continue;
        chunk->rows[chunk->count] = (uint32_t)row;
        load_row(model, row, chunk->params + chunk->count * SGS_PARAM_COUNT);
        if (++chunk->count == CHUNK) {
            done = add_chunk(query, chunk, list);
            chunk->count = 0;
        }
    }
    done = done && (!chunk->count || add_chunk(query, chunk, list));
    free(chunk);
    return done;
}

bool ray_hits(const sgs_gaussians *model, const unsigned char *keep, const sgs_camera *camera,
              const sgs_pose *pose, const sgs_render_options *options, int x, int y, sgs_hit **hits,
              size_t *count)
{
    row_list list = {0};
    double *params = NULL;
    *hits = NULL;
    *count = 0;
    ray_query query = {.camera = camera, .pose = pose, .options = options, .x = x, .y = y};
    bool done = !query_aim(&query) || find_rows(model, keep, &query, &list);
    if (done) {
        params = malloc((list.count + 1) * SGS_PARAM_COUNT * sizeof *params);
        *hits = malloc((list.count + 1) * sizeof **hits);
        done = params && *hits;
    }
    if (done) {
        if (list.count)
            qsort(list.rows, list.count, sizeof *list.rows, compare_rows);
        for (size_t i = 0; i < list.count; ++i)
            load_row(model, list.rows[i], params + i * SGS_PARAM_COUNT);
        done = query_hits(&query, params, list.count, *hits, count);
        for (size_t i = 0; list.rows && i < *count; ++i)
            (*hits)[i].primitive = list.rows[(*hits)[i].primitive];
    }
    if (!done) {
        free(*hits);
        *hits = NULL;
    }
    free(params);
    free(list.rows);
    return done;
}

static json_t *hit_json(const sgs_gaussians *model, const region_map *regions, const sgs_hit *hit)
{
    json_t *scale = json_array();
    const size_t row = hit->primitive;
    for (int k = 0; k < 3; ++k)
        json_array_append_new(
            scale, json_number(exp((double)*sgs_gaussians_at(model, row, SGS_PARAM_SCALE + k))));
    const double opacity = 1 / (1 + exp(-(double)sgs_gaussians_opacity_logit(model, row)));
    const bool any = row < regions->count && regions->region[row] != SGS_NO_PRIMITIVE;
    return json_pack("{s:I,s:f,s:f,s:f,s:f,s:o,s:f,s:o}", "id", (json_int_t)row, "t", hit->t,
                     "alpha", hit->alpha, "transmittance", hit->transmittance, "weight",
                     hit->alpha * hit->transmittance, "scale", scale, "opacity", opacity, "region",
                     any ? json_integer(regions->region[row]) : json_null());
}

json_t *ray_inspect(view_source *source, const view_request *request, int x, int y)
{
    sgs_hit *hits;
    size_t count;
    if (x >= request->camera.width || y >= request->camera.height)
        return NULL;
    const sgs_render_options options = drawing_render_options(&source->drawing);
    const bool hides = request->crop.preview == CROP_HIDE;
    unsigned char *keep = hides ? crop_keep(&request->crop, source) : NULL;
    const bool done = (keep || !hides) && ray_hits(source->model, keep, &request->camera,
                                                   &request->pose, &options, x, y, &hits, &count);
    free(keep);
    if (!done)
        return NULL;
    const region_map *regions = view_source_regions(source);
    json_t *list = json_array();
    double transmittance = 1;
    for (size_t i = 0; i < count; ++i) {
        transmittance = hits[i].transmittance * (1 - hits[i].alpha);
        if (i < RAY_HITS)
            json_array_append_new(list, hit_json(source->model, regions, &hits[i]));
    }
    free(hits);
    return json_pack("{s:s,s:i,s:i,s:I,s:f,s:o}", "type", "ray", "x", x, "y", y, "count",
                     (json_int_t)count, "transmittance", transmittance, "hits", list);
}
