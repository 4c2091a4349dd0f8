// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Cells of an image: squares of 4 x 4 or 8 x 8 tiles, numbered along a Hilbert curve (Hilbert
// 1891). Sums over an image are computed per cell and added in the order of the curve. Any division
// of the cells into contiguous pieces of the curve, among threads or processes, then gives the same
// bits, and a piece is compact: few primitives overlap more than one. Depends on the image size
// only.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    SGSI_CELL_TILE = 16, // pixels per side of a tile
    SGSI_CELL_SIDE = 8   // maximum, tiles
};

typedef struct sgsi_cells {
    int width, height;    // pixels
    int tiles_x, tiles_y; // of the image
    int side;             // tiles per side of a cell: 8 if that gives at least 256 cells, else 4
    int cells_x, cells_y; // of the image
    size_t count, tiles;  // cells_x * cells_y, tiles_x * tiles_y
    uint32_t *raster;     // [count]: y * cells_x + x of the cells along the curve
    uint32_t *position;   // [count]: the inverse, place on the curve by y * cells_x + x
    uint32_t *tile_begin; // [count + 1]: where a cell begins in tile_order
    uint32_t *tile_order; // [tiles]: y * tiles_x + x, cell by cell; in raster order in each
    size_t count_capacity, tile_capacity;
} sgsi_cells;

// Pixel rectangle of a cell, clipped to the image.
typedef struct sgsi_cell_rect {
    int x, y, width, height;
} sgsi_cell_rect;

// A circular cone from the camera that encloses the rays of a cell.
typedef struct sgsi_cone {
    double axis[3]; // unit
    double cosine;  // of the half angle; <= 0: encloses all directions
    bool any;       // false: the cell has no rays
} sgsi_cone;

// Sets up a zeroed or used struct for an image of at least 1 x 1 pixels. Does nothing if the size
// is the same, and does not allocate if an earlier image had as many tiles. False if out of memory:
// the struct is empty then.
bool sgsi_cells_set(sgsi_cells *cells, int width, int height);
void sgsi_cells_free(sgsi_cells *cells);

// Cell `index` along the curve.
static inline sgsi_cell_rect sgsi_cell_at(const sgsi_cells *cells, size_t index)
{
    const int size = cells->side * SGSI_CELL_TILE, raster = (int)cells->raster[index];
    const int x = raster % cells->cells_x * size, y = raster / cells->cells_x * size;
    return (sgsi_cell_rect){.x = x,
                            .y = y,
                            .width = cells->width - x < size ? cells->width - x : size,
                            .height = cells->height - y < size ? cells->height - y : size};
}
