// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Messages of one view. Their sizes follow from the cut, which all ranks know.

#include "train/view_ranks.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "cluster/cut.h"
#include "cluster/rank_calls.h"
#include "train/view_shards.h"

enum { PLANES = 4, TILE_FLOATS = SGSI_TILE_BYTES / sizeof(float) };

struct sgsi_view_ranks {
    size_t *cut;                // [ranks + 1]: of the present view
    uint16_t *owner;            // [tiles]: rank of each tile, of the present view
    size_t *to, *from;          // [ranks]: bytes
    sgsi_tile_cost *tile_costs; // [tiles]: of the last forward pass
    float **cell_costs;         // [views][cells]: of the last visit
    size_t *cost_counts;        // [views]: cells of the last visit, 0 = none
    size_t tiles;               // of the largest view
};

static const sgsi_cells *cells_of(const sgsi_train_view *view)
{
    return &view->view.rays->cells;
}

static sgs_status create_arrays(sgsi_train_views *views, struct sgsi_view_ranks *r)
{
    const size_t ranks = (size_t)sgs_ranks_count(views->ranks);
    bool made = true;
    for (size_t i = 0; i < views->count; ++i)
        r->tiles = views->tile_counts[i] > r->tiles ? views->tile_counts[i] : r->tiles;
    made = (r->cut = sgsi_calloc(ranks + 1, sizeof *r->cut)) && made;
    made = (r->to = sgsi_calloc(2 * ranks, sizeof *r->to)) && made;
    made = (r->owner = sgsi_calloc(r->tiles, sizeof *r->owner)) && made;
    made = (r->tile_costs = sgsi_calloc(r->tiles, sizeof *r->tile_costs)) && made;
    made = (r->cell_costs = sgsi_calloc(views->count, sizeof *r->cell_costs)) && made;
    made = (r->cost_counts = sgsi_calloc(views->count, sizeof *r->cost_counts)) && made;
    // A cell has at least one tile. Small images have small cells.
    for (size_t i = 0; i < views->count && made; ++i)
        made = (r->cell_costs[i] = sgsi_calloc(views->tile_counts[i], sizeof(float)));
    r->from = r->to ? r->to + ranks : NULL;
    return made ? SGS_STATUS_OK
                : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the cuts of %zu views",
                            views->count);
}

sgs_status sgsi_view_ranks_create(sgsi_train_views *views, sgs_ranks *ranks)
{
    views->ranks = ranks;
    if (sgs_ranks_count(ranks) < 2)
        return SGS_STATUS_OK;
    views->view_ranks = sgsi_calloc(1, sizeof *views->view_ranks);
    if (!views->view_ranks)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the cuts of the views");
    sgs_status status = create_arrays(views, views->view_ranks);
    views->rows = NULL;
    if (!status)
        status = sgsi_view_shards_create(views);
    if (!status)
        sgsi_tracer_watch_tiles(views->tracer, views->view_ranks->tile_costs);
    return status;
}

void sgsi_view_ranks_free(sgsi_train_views *views)
{
    struct sgsi_view_ranks *r = views->view_ranks;
    if (!r)
        return;
    for (size_t i = 0; r->cell_costs && i < views->count; ++i)
        sgsi_free(r->cell_costs[i]);
    void *const arrays[] = {r->cut, r->to, r->owner, r->tile_costs, r->cell_costs, r->cost_counts};
    for (size_t i = 0; i < sizeof arrays / sizeof *arrays; ++i)
        sgsi_free(arrays[i]);
    sgsi_free(r);
    views->view_ranks = NULL;
}

void sgsi_view_ranks_cut(sgsi_train_views *views, const sgsi_train_view *view)
{
    struct sgsi_view_ranks *r = views->view_ranks;
    sgs_ranks *ranks = views->ranks;
    const sgsi_cells *cells = cells_of(view);
    const int count = sgs_ranks_count(ranks);
    const bool known = r->cost_counts[view->index] == cells->count;
    if (ranks->cut_seed)
        sgsi_cut_randomly(cells, sgsi_random_bits(ranks->cut_seed, (uint64_t)view->iteration),
                          count, r->cut);
    else
        sgsi_cut_by_cost(cells, known ? r->cell_costs[view->index] : NULL, count, r->cut);
    sgsi_cut_owners(cells, r->cut, count, r->owner);
    const sgsi_tracer_piece piece = sgsi_view_ranks_piece(views);
    sgsi_tracer_set_piece(views->tracer, &piece);
}

sgsi_tracer_piece sgsi_view_ranks_piece(const sgsi_train_views *views)
{
    const int rank = sgs_ranks_rank(views->ranks);
    return (sgsi_tracer_piece){.first = views->view_ranks->cut[rank],
                               .last = views->view_ranks->cut[rank + 1]};
}

const size_t *sgsi_view_ranks_begin(const sgsi_train_views *views)
{
    return views->view_ranks->cut;
}

// ---- Image ----

// Copies a tile between the planes of the view and a message. Rows below the image stay unset.
static void copy_tile(const sgsi_planes *planes, const sgsi_cells *cells, size_t tile,
                      float *message, bool into_planes)
{
    const int x = (int)tile % cells->tiles_x * SGSI_TILE,
              y0 = (int)tile / cells->tiles_x * SGSI_TILE;
    float *const all[PLANES] = {planes->color[0], planes->color[1], planes->color[2],
                                planes->transmittance};
    for (int k = 0; k < PLANES; ++k)
        for (int y = 0; y < SGSI_TILE && y0 + y < planes->height; ++y) {
            float *pixels = all[k] + (size_t)(y0 + y) * planes->stride + (size_t)x;
            float *row = message + (k * SGSI_TILE + y) * SGSI_TILE;
            memcpy(into_planes ? pixels : row, into_planes ? row : pixels,
                   SGSI_TILE * sizeof(float));
        }
}

static bool reads_tile(const sgsi_train_views *views, const sgsi_train_view *view, size_t tile,
                       int reader)
{
    return view->need == SGSI_IMAGE_PIECES
               ? sgsi_cut_reads_tile(cells_of(view), views->view_ranks->owner, tile, reader)
               : view->need == SGSI_IMAGE_ALL || reader == view->receiver;
}

// Visits the tiles that `owner` sends to `reader`, in the order of the curve. Returns their number;
// copies them if message is not NULL.
static size_t visit_tiles(const sgsi_train_views *views, const sgsi_train_view *view, int owner,
                          int reader, float *message, bool into_planes)
{
    const struct sgsi_view_ranks *r = views->view_ranks;
    const sgsi_cells *cells = cells_of(view);
    size_t count = 0;
    if (owner == reader)
        return 0;
    for (size_t i = cells->tile_begin[r->cut[owner]]; i < cells->tile_begin[r->cut[owner + 1]];
         ++i) {
        const size_t tile = cells->tile_order[i];
        if (!reads_tile(views, view, tile, reader))
            continue;
        if (message)
            copy_tile(&view->planes, cells, tile, message + count * TILE_FLOATS, into_planes);
        ++count;
    }
    return count;
}

sgs_status sgsi_view_ranks_image(sgsi_train_views *views, const sgsi_train_view *view)
{
    struct sgsi_view_ranks *r = views->view_ranks;
    sgs_ranks *ranks = views->ranks;
    const int count = sgs_ranks_count(ranks), rank = sgs_ranks_rank(ranks);
    size_t total = 0;
    for (int k = 0; k < count; ++k) {
        r->to[k] = visit_tiles(views, view, rank, k, NULL, false) * SGSI_TILE_BYTES;
        r->from[k] = visit_tiles(views, view, k, rank, NULL, false) * SGSI_TILE_BYTES;
        total += r->to[k];
    }
    float *message = sgsi_ranks_room(ranks, total);
    const sgs_status own =
        message ? SGS_STATUS_OK
                : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                            "not enough memory to send %zu bytes of an image", total);
    for (int k = 0; k < count && !own; ++k)
        message += visit_tiles(views, view, rank, k, message, false) * TILE_FLOATS;
    const unsigned char *got;
    const sgs_status status = sgsi_ranks_exchange(
        ranks, own, sgsi_train_view_purpose(view, SGS_RANKS_IMAGE), r->to, r->from, &got);
    if (status)
        return status;
    for (int k = 0; k < count; got += r->from[k++])
        visit_tiles(views, view, k, rank, (float *)got, true);
    return SGS_STATUS_OK;
}

// ---- Sums per cell ----

// Copies between `message`, or only measures it if NULL, and the arrays of a view.
typedef struct sums_copy {
    sgsi_train_views *views;
    const sgsi_train_view *view;
    sgsi_loss_sums *loss;
    double (*exposure)[SGSI_EXPOSURE];
    bool reads; // from the message
} sums_copy;

static size_t copy_part(unsigned char *message, void *data, size_t bytes, bool reads)
{
    if (message)
        memcpy(reads ? data : message, reads ? message : data, bytes);
    return bytes;
}

// The part of rank `owner`.
static size_t copy_sums(const sums_copy *copy, int owner, unsigned char *message)
{
    struct sgsi_view_ranks *r = copy->views->view_ranks;
    const sgsi_cells *cells = cells_of(copy->view);
    const size_t first = r->cut[owner], count = r->cut[owner + 1] - first,
                 index = copy->view->index;
    float *bounds = copy->views->depth_bounds[index];
    size_t at = 0;
#define NEXT(data, bytes) at += copy_part(message ? message + at : NULL, data, bytes, copy->reads)
    NEXT(copy->loss + first, count * sizeof *copy->loss);
    if (copy->exposure)
        NEXT(copy->exposure + first, count * sizeof *copy->exposure);
    NEXT(r->cell_costs[index] + first, count * sizeof(float));
    for (size_t i = cells->tile_begin[first]; i < cells->tile_begin[first + count]; ++i)
        NEXT(bounds + cells->tile_order[i], sizeof(float));
#undef NEXT
    return at;
}

double sgsi_cell_cost(const sgsi_cells *cells, const sgsi_tile_cost *tiles, size_t cell)
{
    // Of a whole iteration, in units of an evaluation: fitted to the times of 600 pieces of a
    // training with AVX-512 (11 us, 0.16 us and 0.016 us).
    enum { PER_TILE = 700, PER_CANDIDATE = 10 };
    double cost = 0;
    for (size_t i = cells->tile_begin[cell]; i < cells->tile_begin[cell + 1]; ++i) {
        const sgsi_tile_cost *tile = &tiles[cells->tile_order[i]];
        cost += PER_TILE + PER_CANDIDATE * (double)tile->candidates + (double)tile->evaluations;
    }
    return cost;
}

// The cells of this rank.
static void measure_cells(const sgsi_train_views *views, const sgsi_train_view *view)
{
    struct sgsi_view_ranks *r = views->view_ranks;
    const sgsi_cells *cells = cells_of(view);
    const int rank = sgs_ranks_rank(views->ranks);
    for (size_t cell = r->cut[rank]; cell < r->cut[rank + 1]; ++cell)
        r->cell_costs[view->index][cell] = (float)sgsi_cell_cost(cells, r->tile_costs, cell);
    r->cost_counts[view->index] = cells->count;
}

sgs_status sgsi_view_ranks_sums(sgsi_train_views *views, const sgsi_train_view *view,
                                sgsi_loss_sums *loss, double (*exposure)[SGSI_EXPOSURE])
{
    sgs_ranks *ranks = views->ranks;
    const int count = sgs_ranks_count(ranks), rank = sgs_ranks_rank(ranks);
    sums_copy copy = {views, view, loss, exposure, false};
    measure_cells(views, view);
    const size_t bytes = copy_sums(&copy, rank, NULL);
    unsigned char *message = sgsi_ranks_room(ranks, sgsi_ranks_padded(bytes));
    const sgs_status own = message ? SGS_STATUS_OK
                                   : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                               "not enough memory to send the sums of a view");
    if (message)
        copy_sums(&copy, rank, message);
    const unsigned char *got;
    const size_t *sizes;
    const sgs_status status = sgsi_ranks_share(
        ranks, own, sgsi_train_view_purpose(view, SGS_RANKS_SUMS), bytes, &got, &sizes);
    if (status)
        return status;
    copy.reads = true;
    for (int k = 0; k < count; got += sizes[k++])
        copy_sums(&copy, k, (unsigned char *)got);
    return SGS_STATUS_OK;
}
