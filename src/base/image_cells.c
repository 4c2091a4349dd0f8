// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The curve is drawn recursively over the smallest square of 2^k cells that covers the image.
// Quadrants outside the image are skipped, so the cost is proportional to the number of cells.

#include "base/image_cells.h"

#include "base/core.h"

enum { MANY_CELLS = 256 };

// A square of the recursion: corner and the two axes, whose length is the side in cells. The curve
// begins at the corner and ends at the end of the second axis.
typedef struct square {
    long x, y, ax, ay, bx, by;
} square;

static bool is_outside(const sgsi_cells *cells, const square *s)
{
    const long x = s->x + (s->ax + s->bx < 0 ? s->ax + s->bx : 0),
               y = s->y + (s->ay + s->by < 0 ? s->ay + s->by : 0);
    return x >= cells->cells_x || y >= cells->cells_y;
}

// One of the axes is horizontal and the other vertical, so ax + bx and ay + by are the signed
// sides.
static void draw(sgsi_cells *cells, square s, long side)
{
    if (is_outside(cells, &s))
        return;
    if (side == 1) {
        const long x = s.x + (s.ax + s.bx < 0 ? -1 : 0), y = s.y + (s.ay + s.by < 0 ? -1 : 0);
        cells->position[y * cells->cells_x + x] = (uint32_t)cells->count;
        cells->raster[cells->count++] = (uint32_t)(y * cells->cells_x + x);
        return;
    }
    const long ax = s.ax / 2, ay = s.ay / 2, bx = s.bx / 2, by = s.by / 2;
    draw(cells, (square){s.x, s.y, bx, by, ax, ay}, side / 2);
    draw(cells, (square){s.x + ax, s.y + ay, ax, ay, bx, by}, side / 2);
    draw(cells, (square){s.x + ax + bx, s.y + ay + by, ax, ay, bx, by}, side / 2);
    draw(cells, (square){s.x + ax + s.bx, s.y + ay + s.by, -bx, -by, -ax, -ay}, side / 2);
}

static void list_tiles(sgsi_cells *cells)
{
    uint32_t at = 0;
    for (size_t i = 0; i < cells->count; ++i) {
        const int x0 = (int)cells->raster[i] % cells->cells_x * cells->side,
                  y0 = (int)cells->raster[i] / cells->cells_x * cells->side;
        cells->tile_begin[i] = at;
        for (int y = y0; y < y0 + cells->side && y < cells->tiles_y; ++y)
            for (int x = x0; x < x0 + cells->side && x < cells->tiles_x; ++x)
                cells->tile_order[at++] = (uint32_t)(y * cells->tiles_x + x);
    }
    cells->tile_begin[cells->count] = at;
}

static int divide_up(int size, int by)
{
    return (size - 1) / by + 1;
}

// At least the cells of any image that has small cells, so that smaller images fit, too.
static bool reserve(sgsi_cells *cells, size_t count, size_t tiles)
{
    if (count < 4 * MANY_CELLS)
        count = 4 * MANY_CELLS;
    if (count > cells->count_capacity || tiles > cells->tile_capacity) {
        sgsi_cells_free(cells);
        cells->raster = sgsi_alloc(count, sizeof *cells->raster);
        cells->position = sgsi_alloc(count, sizeof *cells->position);
        cells->tile_begin = sgsi_alloc(count + 1, sizeof *cells->tile_begin);
        cells->tile_order = sgsi_alloc(tiles, sizeof *cells->tile_order);
        if (!cells->raster || !cells->position || !cells->tile_begin || !cells->tile_order) {
            sgsi_cells_free(cells);
            return false;
        }
        cells->count_capacity = count;
        cells->tile_capacity = tiles;
    }
    return true;
}

bool sgsi_cells_set(sgsi_cells *cells, int width, int height)
{
    if (cells->width == width && cells->height == height)
        return true;
    const int tiles_x = divide_up(width, SGSI_CELL_TILE),
              tiles_y = divide_up(height, SGSI_CELL_TILE);
    int side = SGSI_CELL_SIDE;
    if ((long)divide_up(tiles_x, side) * divide_up(tiles_y, side) < MANY_CELLS)
        side /= 2;
    const int cells_x = divide_up(tiles_x, side), cells_y = divide_up(tiles_y, side);
    if (!reserve(cells, (size_t)cells_x * (size_t)cells_y, (size_t)tiles_x * (size_t)tiles_y))
        return false;
    cells->width = width;
    cells->height = height;
    cells->tiles_x = tiles_x;
    cells->tiles_y = tiles_y;
    cells->tiles = (size_t)tiles_x * (size_t)tiles_y;
    cells->side = side;
    cells->cells_x = cells_x;
    cells->cells_y = cells_y;
    cells->count = 0;
    long square_side = 1;
    while (square_side < cells_x || square_side < cells_y)
        square_side *= 2;
    draw(cells, (square){.ax = square_side, .by = square_side}, square_side);
    list_tiles(cells);
    return true;
}

void sgsi_cells_free(sgsi_cells *cells)
{
    sgsi_free(cells->raster);
    sgsi_free(cells->position);
    sgsi_free(cells->tile_begin);
    sgsi_free(cells->tile_order);
    *cells = (sgsi_cells){0};
}
