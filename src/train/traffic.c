// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "train/traffic.h"

#include <math.h>

#include "bvh/bvh.h"

enum { WORD = 4, RECORD = SGSI_PROJECTED_FLOATS * WORD, PLANES = 4 }; // colour and transmittance

// Blocks of 16 rows that the optimiser visits.
static double stepped_blocks(const sgsi_traffic *traffic)
{
    const uint8_t *touched = sgsi_tracer_touched(traffic->rows);
    const uint16_t *visible = sgsi_tracer_visible(traffic->rows);
    const size_t blocks = (traffic->primitives + SGS_LANES - 1) / SGS_LANES;
    size_t stepped = 0;
    for (size_t i = 0; i < blocks; ++i)
        stepped += traffic->dense || touched[i] || (traffic->steps && visible[i]);
    return (double)stepped;
}

// (tile, primitive) pairs with a hit, and the pixels of the tiles that have any.
static double tile_hits(const sgsi_traffic *traffic, double *pixels)
{
    const sgsi_tile_list *lists = sgsi_tracer_lists(traffic->tracer);
    size_t pairs = 0, tiles = 0;
    for (size_t i = 0; i < traffic->tiles; ++i) {
        pairs += lists[i].count;
        tiles += lists[i].count != 0;
    }
    *pixels = fmin((double)(tiles * SGSI_TILE * SGSI_TILE), (double)traffic->pixels);
    return (double)pairs;
}

void sgsi_traffic_add(const sgsi_traffic *traffic, sgs_train_bytes *bytes)
{
    const sgsi_trace_counts counts = sgsi_tracer_counts(traffic->tracer);
    const double rows = (double)traffic->primitives, pixels = (double)traffic->pixels;
    double drawn;
    const double pairs = tile_hits(traffic, &drawn), stepped = SGS_LANES * stepped_blocks(traffic);
    const double bands = (traffic->sh_degree + 1) * (traffic->sh_degree + 1);
    const double shape = SGS_PARAM_SH_DC * WORD, color = 3.0 * WORD * bands;
    const double statistics =
        traffic->collects ? 2.0 * 2.0 * WORD : 0.0; // two columns, read and written
    sgs_train_bytes add = {0};
    // All shapes and boxes; colours and records of the blocks in view.
    add.project = rows * (shape + sizeof(sgsi_bounds) + statistics) + stepped * (color + RECORD);
    // Each box read, each node read and written.
    add.bvh = rows * sizeof(sgsi_bounds) + 2.0 * (double)sgsi_bvh_bytes();
    // Each callback reads the record; a second one in the macrotile is most likely cached.
    add.gather = (double)counts.callbacks * (RECORD + WORD);
    add.forward = pixels * PLANES * WORD + (pairs + (double)counts.block_hits) * WORD;
    add.loss = pixels * (2.0 * PLANES * WORD + traffic->channels);
    // Reads lists, projected records and gradient planes; writes a record of sums per (tile,
    // primitive). The reduction reads it, reads ids three times, and writes and reads their order.
    add.reduce = pairs * (RECORD + WORD * 5.0) + 2.0 * stepped * RECORD;
    add.backward = drawn * PLANES * WORD + (pairs + (double)counts.block_hits) * WORD +
                   2.0 * pairs * RECORD + add.reduce;
    // Reads sums; reads and writes parameters and both moments.
    add.optimizer = stepped * (RECORD + (traffic->steps ? 6.0 * (shape + color) : shape + color) +
                               0.5 * statistics);
    bytes->project += add.project;
    bytes->bvh += add.bvh;
    bytes->gather += add.gather;
    bytes->forward += add.forward;
    bytes->loss += add.loss;
    bytes->backward += add.backward;
    bytes->reduce += add.reduce;
    bytes->optimizer += add.optimizer;
    bytes->iterations += 1.0;
    bytes->macrotiles += (double)traffic->macrotiles;
    bytes->total +=
        add.project + add.bvh + add.gather + add.forward + add.loss + add.backward + add.optimizer;
}
