// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "cluster/cut.h"

#include "base/core.h"

static double cost_of(const sgsi_cells *cells, const float *cost, size_t cell)
{
    const sgsi_cell_rect rect = sgsi_cell_at(cells, cell);
    return cost ? (double)cost[cell] : (double)rect.width * (double)rect.height;
}

void sgsi_cut_by_cost(const sgsi_cells *cells, const float *cost, int ranks, size_t *begin)
{
    double total = 0.0, sum = 0.0;
    for (size_t i = 0; i < cells->count; ++i)
        total += cost_of(cells, cost, i);
    size_t cell = 0;
    begin[0] = 0;
    for (int r = 1; r < ranks; ++r) {
        const double target = total * r / ranks;
        // The cell on the boundary goes to the side that leaves the smaller error.
        while (cell < cells->count && sum + 0.5 * cost_of(cells, cost, cell) <= target)
            sum += cost_of(cells, cost, cell++);
        begin[r] = cell;
    }
    begin[ranks] = cells->count;
}

void sgsi_cut_owners(const sgsi_cells *cells, const size_t *begin, int ranks, uint16_t *owner)
{
    for (int k = 0; k < ranks; ++k)
        for (size_t i = cells->tile_begin[begin[k]]; i < cells->tile_begin[begin[k + 1]]; ++i)
            owner[cells->tile_order[i]] = (uint16_t)k;
}

bool sgsi_cut_reads_tile(const sgsi_cells *cells, const uint16_t *owner, size_t tile, int rank)
{
    const int x = (int)tile % cells->tiles_x, y = (int)tile / cells->tiles_x;
    for (int v = y > 0 ? y - 1 : 0; v <= y + 1 && v < cells->tiles_y; ++v)
        for (int u = x > 0 ? x - 1 : 0; u <= x + 1 && u < cells->tiles_x; ++u)
            if (owner[v * cells->tiles_x + u] == rank)
                return true;
    return false;
}

void sgsi_cut_randomly(const sgsi_cells *cells, uint64_t seed, int ranks, size_t *begin)
{
    begin[0] = 0;
    begin[ranks] = cells->count;
    for (int r = 1; r < ranks; ++r) {
        size_t cut = (size_t)(sgsi_random_uniform(seed, (uint64_t)r) * (double)(cells->count + 1));
        if (cut > cells->count)
            cut = cells->count;
        int at = r; // insertion: the cuts in ascending order
        for (; at > 1 && begin[at - 1] > cut; --at)
            begin[at] = begin[at - 1];
        begin[at] = cut;
    }
}
