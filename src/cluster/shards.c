// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The router is a binary tree of cones over the cells along the curve. Contiguous pieces of the
// curve are compact, so a node is a narrow cone. A branch ends where the sphere misses the cone, or
// where all cells belong to a rank that is found already: a small primitive costs about two tests
// per level, or, if the cell of the primitive before it is tested first, two or three in all.
//
// A sphere of radius r at distance D, at `along` on the axis and `across` from it, touches a cone
// of half angle a < 90 degrees if across cos a - along sin a <= r: the left side is its distance
// from the nearest line of the cone, or less.

#include "cluster/shards.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "cluster/transport.h"

enum { CHUNK = 4096, MAX_DEPTH = 64 };

// ---- Messages ----

size_t sgsi_shard_bytes(size_t count, size_t item)
{
    return sgsi_ranks_padded(count * item);
}

size_t sgsi_shard_items(size_t bytes, size_t item)
{
    return bytes / item; // the padding is shorter than an item
}

// ---- Router ----

// Cells [first, last). The children of node i are i + 1 and `second`; a leaf has one cell.
typedef struct node {
    double axis[3], cosine, sine; // sine < 0: no rays; cosine <= 0: everything
    uint32_t first, last, second;
    int32_t rank; // of all cells, or -1
} node;

struct sgsi_router {
    int ranks;
    node *nodes;
    size_t count, capacity;
    const sgsi_cone *cones; // during sgsi_router_set
    const size_t *cut;
};

sgs_status sgsi_router_create(int ranks, sgsi_router **router)
{
    *router = sgsi_calloc(1, sizeof **router);
    if (!*router)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                         "not enough memory to send primitives to %d ranks", ranks);
    (*router)->ranks = ranks;
    return SGS_STATUS_OK;
}

void sgsi_router_destroy(sgsi_router *router)
{
    if (!router)
        return;
    sgsi_free(router->nodes);
    sgsi_free(router);
}

size_t sgsi_router_words(const sgsi_router *router)
{
    return ((size_t)router->ranks + 63) / 64;
}

// The cone around the cones of a node's cells.
static void enclose(const sgsi_router *router, node *made)
{
    double axis[3] = {0}, least = 1.0;
    bool any = false;
    for (size_t i = made->first; i < made->last; ++i)
        for (int k = 0; k < 3 && router->cones[i].any; ++k)
            axis[k] += router->cones[i].axis[k];
    const double length = sqrt(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
    for (int k = 0; k < 3; ++k)
        made->axis[k] = length > 1e-6 ? axis[k] / length : 0.0;
    for (size_t i = made->first; i < made->last; ++i) {
        const sgsi_cone *cone = &router->cones[i];
        double along = 0.0;
        if (!cone->any)
            continue;
        any = true;
        for (int k = 0; k < 3; ++k)
            along += made->axis[k] * cone->axis[k];
        // cos(a + b), the farthest line of the cell's cone
        along = fmin(fmax(along, -1.0), 1.0);
        const double across = sqrt(1.0 - along * along),
                     sine = sqrt(fmax(0.0, 1.0 - cone->cosine * cone->cosine));
        const double farthest = along * cone->cosine - across * sine;
        least = cone->cosine > 0.0 && along > 0.0 ? fmin(least, farthest) : -1.0;
        if (least < 0.0)
            break;
    }
    // The margin exceeds the rounding of touches(): a sphere that touches a cell touches the nodes
    // above it.
    made->cosine = least > 0.0 ? least - 1e-11 : -1.0;
    made->sine = any ? sqrt(fmax(0.0, 1.0 - made->cosine * made->cosine)) : -1.0;
}

static int rank_of(const sgsi_router *router, size_t cell)
{
    int rank = 0;
    while (router->cut[rank + 1] <= cell)
        ++rank;
    return rank;
}

static void build(sgsi_router *router, size_t first, size_t last)
{
    const size_t own = router->count++;
    node *made = &router->nodes[own];
    const int rank = rank_of(router, first);
    *made = (node){.first = (uint32_t)first,
                   .last = (uint32_t)last,
                   .rank = last <= router->cut[rank + 1] ? rank : -1};
    enclose(router, made);
    if (last - first == 1)
        return;
    const size_t middle = first + (last - first) / 2;
    build(router, first, middle);
    made->second = (uint32_t)router->count;
    build(router, middle, last);
}

sgs_status sgsi_router_set(sgsi_router *router, const sgsi_cone *cones, size_t cells,
                           const size_t *cut)
{
    router->count = 0;
    if (2 * cells > router->capacity) {
        if (!sgsi_grow((void **)&router->nodes, 0, 2 * cells, sizeof *router->nodes))
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                             "not enough memory for the cones of %zu cells", cells);
        router->capacity = 2 * cells;
    }
    router->cones = cones;
    router->cut = cut;
    if (cells)
        build(router, 0, cells);
    return SGS_STATUS_OK;
}

static bool touches(const node *n, const double center[3], double distance2, double radius)
{
    if (n->sine < 0.0)
        return false;
    if (n->cosine <= 0.0)
        return true;
    const double along = n->axis[0] * center[0] + n->axis[1] * center[1] + n->axis[2] * center[2];
    const double reach = radius + along * n->sine;
    const double across2 = distance2 - along * along;
    return reach >= 0.0 && across2 * n->cosine * n->cosine <= reach * reach;
}

// True if a sphere in front of the camera touches the cell of a leaf. Behind it, touches() may
// accept a narrow cone and not the wider ones around it.
static bool touches_leaf(const sgsi_router *router, uint32_t leaf, const double center[3],
                         double distance2, double reach)
{
    const node *n = leaf < router->count ? &router->nodes[leaf] : NULL;
    return n && n->last - n->first == 1 && reach * reach < distance2 &&
           n->axis[0] * center[0] + n->axis[1] * center[1] + n->axis[2] * center[2] > 0.0 &&
           touches(n, center, distance2, reach);
}

static void add_rank(uint64_t *ranks, int rank)
{
    ranks[rank / 64] |= (uint64_t)1 << (rank % 64);
}

void sgsi_router_find(const sgsi_router *router, const float center[3], float radius,
                      uint32_t *guess, uint64_t *ranks)
{
    uint32_t stack[MAX_DEPTH];
    int depth = 0;
    const double c[3] = {(double)center[0], (double)center[1], (double)center[2]};
    const double distance2 = c[0] * c[0] + c[1] * c[1] + c[2] * c[2];
    const double reach = (double)radius + 1e-4 * sqrt(distance2);
    memset(ranks, 0, sgsi_router_words(router) * sizeof *ranks);
    if (touches_leaf(router, *guess, c, distance2, reach))
        add_rank(ranks, router->nodes[*guess].rank);
    if (router->count)
        stack[depth++] = 0;
    while (depth) {
        const uint32_t at = stack[--depth];
        const node *n = &router->nodes[at];
        const bool found = n->rank >= 0 && ranks[n->rank / 64] >> (n->rank % 64) & 1;
        // Not a number counts as everywhere.
        if (found || (reach * reach < distance2 && !touches(n, c, distance2, reach)))
            continue;
        if (n->last - n->first == 1) {
            if (n->sine < 0.0)
                continue;
            add_rank(ranks, n->rank);
            *guess = at;
        } else {
            stack[depth++] = n->second;
            stack[depth++] = at + 1;
        }
    }
}

// ---- Lists ----

void sgsi_send_lists_free(sgsi_send_lists *lists)
{
    sgsi_free(lists->places);
    sgsi_free(lists->begin);
    sgsi_free(lists->chunks);
    *lists = (sgsi_send_lists){0};
}

typedef struct list_job {
    sgsi_send_lists *lists;
    const uint64_t *found;
    size_t words;
    bool fills; // else counts
} list_job;

static void list_chunk(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    const list_job *job = context;
    size_t *at = job->lists->chunks + begin / CHUNK * (size_t)job->lists->ranks;
    for (size_t i = begin; i < end; ++i)
        for (size_t w = 0; w < job->words; ++w)
            for (uint64_t bits = job->found[i * job->words + w]; bits; bits &= bits - 1) {
                const size_t rank = 64 * w + (size_t)__builtin_ctzll(bits);
                if (job->fills)
                    job->lists->places[at[rank]] = (uint32_t)i;
                ++at[rank];
            }
}

// From the number of rows per chunk and rank to where each begins.
static void place_chunks(sgsi_send_lists *lists, size_t chunks)
{
    size_t total = 0;
    for (int r = 0; r < lists->ranks; ++r) {
        lists->begin[r] = total;
        for (size_t k = 0; k < chunks; ++k) {
            size_t *count = &lists->chunks[k * (size_t)lists->ranks + (size_t)r];
            const size_t own = *count;
            *count = total;
            total += own;
        }
    }
    lists->begin[lists->ranks] = total;
}

static sgs_status reserve_lists(sgsi_send_lists *lists, size_t chunks, int ranks)
{
    const size_t wanted = (chunks + 1) * (size_t)ranks;
    bool done = true;
    if (ranks > lists->ranks)
        done = sgsi_grow((void **)&lists->begin, 0, (size_t)ranks + 1, sizeof *lists->begin);
    if (done && wanted > lists->chunk_capacity) {
        done = sgsi_grow((void **)&lists->chunks, 0, wanted, sizeof *lists->chunks);
        lists->chunk_capacity = done ? wanted : lists->chunk_capacity;
    }
    lists->ranks = done ? ranks : lists->ranks;
    return done ? SGS_STATUS_OK
                : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the lists of %d ranks",
                            ranks);
}

sgs_status sgsi_send_lists_make(sgsi_send_lists *lists, const uint64_t *found, size_t rows,
                                int ranks)
{
    const size_t chunks = (rows + CHUNK - 1) / CHUNK;
    const sgs_status status = reserve_lists(lists, chunks, ranks);
    if (status)
        return status;
    memset(lists->chunks, 0, (chunks + 1) * (size_t)ranks * sizeof *lists->chunks);
    list_job job = {lists, found, ((size_t)ranks + 63) / 64, false};
    sgsi_parallel_ranges(rows, CHUNK, list_chunk, &job);
    place_chunks(lists, chunks);
    const size_t total = lists->begin[ranks];
    if (total > lists->capacity) {
        const size_t larger = total + total / 4;
        if (!sgsi_grow((void **)&lists->places, 0, larger, sizeof *lists->places))
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to send %zu primitives",
                             total);
        lists->capacity = larger;
    }
    job.fills = true;
    sgsi_parallel_ranges(rows, CHUNK, list_chunk, &job);
    return SGS_STATUS_OK;
}
