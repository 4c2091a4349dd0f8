// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Calls of an iteration, each with a header of every rank:
//
//   1 agreement on the start          4 shared sums per cell (train/view_ranks.c)
//   2 delivered records               5 delivered gradients (train/view_shards.c)
//   3 exchanged tiles of the image    6 shared counts of the step (train/trainer_optimize.c)
//
// A delivery also gathers the sizes of all messages.

#include "train/rank_traffic.h"

#include <string.h>

#include "base/core.h"
#include "cluster/cut.h"
#include "cluster/rank_calls.h"
#include "loss/exposure.h"
#include "loss/loss.h"
#include "train/shard_routes.h"
#include "train/trainer_state.h"
#include "train/view_ranks.h"

enum { CALLS = 6, DELIVERIES = 2 };

typedef struct prediction {
    const sgsi_rank_input *input;
    const sgsi_cells *cells;
    int ranks;
    size_t *cut;     // [ranks + 1]
    uint16_t *owner; // [tiles]
    size_t *items;   // [ranks][ranks]: sender, receiver
    uint32_t *seen;  // [rows]: 1 + the last cell with a gradient of the row
    sgsi_shard_routes routes;
    sgsi_rank_traffic *traffic;
} prediction;

static void send(prediction *p, sgs_ranks_purpose purpose, int from, int to, uint64_t bytes)
{
    sgs_ranks_traffic *sent = &p->traffic[from].sent[purpose];
    ++sent->messages;
    sent->bytes += bytes;
    p->traffic[to].received[purpose] += bytes;
}

// Every rank sends bytes(rank) to all others, also an empty message.
static void share(prediction *p, sgs_ranks_purpose purpose, int from, uint64_t bytes)
{
    for (int to = 0; to < p->ranks; ++to)
        if (to != from)
            send(p, purpose, from, to, bytes);
    ++p->traffic[from].sent[purpose].calls;
}

// Messages of items[from][to] items each.
static void deliver(prediction *p, sgs_ranks_purpose purpose, size_t item)
{
    for (int from = 0; from < p->ranks; ++from) {
        ++p->traffic[from].sent[purpose].calls;
        for (int to = 0; to < p->ranks; ++to) {
            const size_t count = p->items[from * p->ranks + to];
            if (to != from && count)
                send(p, purpose, from, to, sgsi_shard_bytes(count, item));
        }
    }
}

static void clear_items(prediction *p)
{
    memset(p->items, 0, (size_t)p->ranks * (size_t)p->ranks * sizeof *p->items);
}

static sgs_status predict_records(prediction *p)
{
    const sgsi_rank_input *in = p->input;
    const sgs_status status =
        sgsi_shard_routes_find(&p->routes, in->view, sgsi_tracer_projected(in->tracer),
                               sgsi_tracer_bounds(in->tracer), in->rows, p->cut);
    if (status)
        return status;
    const sgsi_send_lists *lists = &p->routes.lists;
    clear_items(p);
    for (size_t row = 0; row < in->rows; ++row)
        p->traffic[sgsi_shard_owner(row, p->ranks)].traced +=
            sgsi_tracer_projected(
                in->tracer)[row * SGSI_PROJECTED_FLOATS + SGSI_PROJECTED_LOG_OPACITY] >
            SGSI_UNTRACED;
    for (int to = 0; to < p->ranks; ++to) {
        for (size_t i = lists->begin[to]; i < lists->begin[to + 1]; ++i)
            ++p->items[sgsi_shard_owner(lists->places[i], p->ranks) * p->ranks + to];
        p->traffic[to].primitives = lists->begin[to + 1] - lists->begin[to];
    }
    deliver(p, SGS_RANKS_RECORDS, SGSI_SHARD_RECORD);
    return SGS_STATUS_OK;
}

static void predict_image(prediction *p)
{
    clear_items(p);
    for (size_t tile = 0; tile < p->cells->tiles; ++tile)
        for (int to = 0; to < p->ranks; ++to)
            p->items[p->owner[tile] * p->ranks + to] +=
                sgsi_cut_reads_tile(p->cells, p->owner, tile, to);
    deliver(p, SGS_RANKS_IMAGE, SGSI_TILE_BYTES);
}

static void predict_sums(prediction *p)
{
    const size_t per_cell =
        sizeof(sgsi_loss_sums) + sizeof(float) +
        (p->input->exposure ? SGSI_EXPOSURE * sizeof(double) : 0); // and the cost
    for (int rank = 0; rank < p->ranks; ++rank) {
        const size_t first = p->cut[rank], last = p->cut[rank + 1];
        const size_t tiles = p->cells->tile_begin[last] - p->cells->tile_begin[first];
        share(p, SGS_RANKS_SUMS, rank,
              sgsi_ranks_padded((last - first) * per_cell + tiles * sizeof(float)));
        share(p, SGS_RANKS_SUMS, rank, sgsi_ranks_padded(sizeof(sgsi_step_counts)));
        for (size_t cell = first; cell < last; ++cell)
            p->traffic[rank].cost += sgsi_cell_cost(p->cells, p->input->tiles, cell);
    }
}

// One item per (cell, primitive) with a block hit.
static void predict_gradients(prediction *p)
{
    const sgsi_tile_list *lists = sgsi_tracer_lists(p->input->tracer);
    clear_items(p);
    memset(p->seen, 0, p->input->rows * sizeof *p->seen);
    for (int from = 0; from < p->ranks; ++from)
        for (size_t cell = p->cut[from]; cell < p->cut[from + 1]; ++cell)
            for (size_t i = p->cells->tile_begin[cell]; i < p->cells->tile_begin[cell + 1]; ++i) {
                const sgsi_tile_list *list = &lists[p->cells->tile_order[i]];
                for (uint32_t k = 0; k < list->count; ++k) {
                    const uint32_t row = list->ids[k];
                    p->items[from * p->ranks + sgsi_shard_owner(row, p->ranks)] +=
                        p->seen[row] != 1 + (uint32_t)cell;
                    p->seen[row] = 1 + (uint32_t)cell;
                }
            }
    for (size_t row = 0; row < p->input->rows; ++row)
        p->traffic[sgsi_shard_owner(row, p->ranks)].hit += p->seen[row] != 0;
    deliver(p, SGS_RANKS_GRADIENTS, SGSI_SHARD_SUM);
}

static void predict_status(prediction *p)
{
    for (int rank = 0; rank < p->ranks; ++rank) {
        for (int i = 0; i < CALLS; ++i)
            share(p, SGS_RANKS_STATUS, rank, SGSI_RANKS_HEADER_BYTES);
        for (int i = 0; i < DELIVERIES; ++i)
            share(p, SGS_RANKS_STATUS, rank, (uint64_t)p->ranks * sizeof(uint64_t));
    }
}

static sgs_status reserve(prediction *p)
{
    const size_t ranks = (size_t)p->ranks;
    p->cut = sgsi_calloc(ranks + 1, sizeof *p->cut);
    p->items = sgsi_calloc(ranks * ranks, sizeof *p->items);
    p->owner = sgsi_calloc(p->cells->tiles, sizeof *p->owner);
    p->seen = sgsi_calloc(p->input->rows + 1, sizeof *p->seen);
    return p->cut && p->items && p->owner && p->seen
               ? sgsi_shard_routes_create(p->ranks, &p->routes)
               : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for the lists of %d ranks",
                           p->ranks);
}

sgs_status sgsi_rank_traffic_predict(const sgsi_rank_input *input, int ranks,
                                     sgsi_rank_traffic *traffic)
{
    prediction p = {
        .input = input, .cells = &input->view->rays->cells, .ranks = ranks, .traffic = traffic};
    memset(traffic, 0, (size_t)ranks * sizeof *traffic);
    sgs_status status = reserve(&p);
    if (!status) {
        sgsi_cut_by_cost(p.cells, input->cell_costs, ranks, p.cut);
        sgsi_cut_owners(p.cells, p.cut, ranks, p.owner);
        status = predict_records(&p);
    }
    if (!status) {
        predict_image(&p);
        predict_sums(&p);
        predict_gradients(&p);
        predict_status(&p);
    }
    sgsi_shard_routes_free(&p.routes);
    sgsi_free(p.cut);
    sgsi_free(p.items);
    sgsi_free(p.owner);
    sgsi_free(p.seen);
    return status;
}
