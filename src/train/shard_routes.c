// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "train/shard_routes.h"

#include <math.h>

#include "base/core.h"
#include "base/threads.h"

enum { GRAIN = 1024 };

sgs_status sgsi_shard_routes_create(int ranks, sgsi_shard_routes *routes)
{
    *routes = (sgsi_shard_routes){.ranks = ranks};
    return sgsi_router_create(ranks, &routes->router);
}

void sgsi_shard_routes_free(sgsi_shard_routes *routes)
{
    sgsi_router_destroy(routes->router);
    sgsi_free(routes->cones);
    sgsi_free(routes->found);
    sgsi_send_lists_free(&routes->lists);
    *routes = (sgsi_shard_routes){0};
}

typedef struct find_job {
    const sgsi_shard_routes *routes;
    const sgsi_view *view;
    const float *projected;
    const sgsi_bounds *bounds;
    size_t words;
} find_job;

static void find_range(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const find_job *job = context;
    uint32_t guess = 0;
    for (size_t i = begin; i < end; ++i) {
        const float *row = job->projected + i * SGSI_PROJECTED_FLOATS;
        const sgsi_bounds *box = &job->bounds[i];
        uint64_t *found = job->routes->found + i * job->words;
        for (size_t w = 0; w < job->words; ++w)
            found[w] = 0;
        if (!(row[SGSI_PROJECTED_LOG_OPACITY] > SGSI_UNTRACED))
            continue;
        // The box is around the mean. 1e-3 and 4e-6 are beyond the rounding of the projection.
        float center[3], magnitude = 0.0f;
        for (int k = 0; k < 3; ++k) {
            const float mean = 0.5f * box->lower[k] + 0.5f * box->upper[k];
            center[k] = mean - job->view->center[k] - job->view->center_low[k];
            magnitude = fmaxf(magnitude, fabsf(mean));
        }
        const float radius = 1.001f * row[SGSI_PROJECTED_RADIUS] + 4e-6f * magnitude;
        sgsi_router_find(job->routes->router, center, radius, &guess, found);
    }
}

static sgs_status reserve(sgsi_shard_routes *routes, size_t cells, size_t words)
{
    bool done = true;
    if (cells > routes->cone_capacity) {
        done = sgsi_grow((void **)&routes->cones, 0, cells, sizeof *routes->cones);
        routes->cone_capacity = done ? cells : routes->cone_capacity;
    }
    if (done && words > routes->found_capacity) {
        done = sgsi_grow((void **)&routes->found, 0, words, sizeof *routes->found);
        routes->found_capacity = done ? words : routes->found_capacity;
    }
    return done ? SGS_STATUS_OK
                : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                            "not enough memory to divide a view among %d ranks", routes->ranks);
}

// Camera to world, in double precision: narrow cones need it.
static void turn_cones(sgsi_shard_routes *routes, const sgsi_view *view)
{
    for (size_t i = 0; i < view->rays->cells.count; ++i) {
        double *axis = routes->cones[i].axis, world[3], length = 0.0;
        for (int k = 0; k < 3; ++k) {
            world[k] = (double)view->rotation[k] * axis[0] +
                       (double)view->rotation[3 + k] * axis[1] +
                       (double)view->rotation[6 + k] * axis[2];
            length += world[k] * world[k];
        }
        for (int k = 0; k < 3 && length > 0.0; ++k)
            axis[k] = world[k] / sqrt(length);
    }
}

sgs_status sgsi_shard_routes_find(sgsi_shard_routes *routes, const sgsi_view *view,
                                  const float *projected, const sgsi_bounds *bounds, size_t rows,
                                  const size_t *cut)
{
    const size_t cells = view->rays->cells.count, words = sgsi_router_words(routes->router);
    sgs_status status = reserve(routes, cells, rows * words);
    if (status)
        return status;
    sgsi_rays_cell_cones(view->rays, routes->cones);
    turn_cones(routes, view);
    status = sgsi_router_set(routes->router, routes->cones, cells, cut);
    if (status)
        return status;
    find_job job = {routes, view, projected, bounds, words};
    sgsi_parallel_ranges(rows, GRAIN, find_range, &job);
    return sgsi_send_lists_make(&routes->lists, routes->found, rows, routes->ranks);
}
