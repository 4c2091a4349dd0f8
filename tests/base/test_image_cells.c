// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Cells of an image: their order equals that of the Hilbert index computed bit by bit, tiles are
// listed once, and smaller images need no memory.

#include <limits.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "base/core.h"
#include "base/image_cells.h"

static const int sizes[][2] = {{1, 1},       {16, 16},   {17, 65},   {640, 480},  {1297, 840},
                               {2048, 2048}, {5000, 16}, {33, 9000}, {4096, 2304}};
enum { SIZES = sizeof sizes / sizeof *sizes };

// Index of (x, y) along the curve through a square of `side` cells, from its quadrants: the first
// one is transposed, the last one transposed and reversed.
static long hilbert_index(long side, long x, long y)
{
    long index = 0;
    for (long half = side / 2; half > 0; half /= 2) {
        const long right = (x & half) != 0, up = (y & half) != 0;
        index += half * half * ((3 * right) ^ up);
        if (!up) {
            if (right) {
                x = side - 1 - x;
                y = side - 1 - y;
            }
            const long kept = x;
            x = y;
            y = kept;
        }
    }
    return index;
}

static void cells_follow_a_hilbert_curve(void **state)
{
    (void)state;
    for (int s = 0; s < SIZES; ++s) {
        sgsi_cells cells = {0};
        assert_true(sgsi_cells_set(&cells, sizes[s][0], sizes[s][1]));
        assert_int_equal(cells.count, cells.cells_x * cells.cells_y);
        long side = 1, last[2] = {-1, -1};
        while (side < cells.cells_x || side < cells.cells_y)
            side *= 2;
        for (size_t i = 0; i < cells.count; ++i) {
            const long x = cells.raster[i] % (uint32_t)cells.cells_x,
                       y = cells.raster[i] / (uint32_t)cells.cells_x;
            assert_int_equal(cells.position[cells.raster[i]], i);
            // The curve or its mirror image at the diagonal, the same for all cells.
            const long index[2] = {hilbert_index(side, x, y), hilbert_index(side, y, x)};
            for (int k = 0; k < 2; ++k)
                last[k] = last[k] == LONG_MAX || index[k] <= last[k] ? LONG_MAX : index[k];
        }
        assert_true(last[0] != LONG_MAX || last[1] != LONG_MAX);
        sgsi_cells_free(&cells);
    }
}

static void tiles_are_listed_once_by_cell(void **state)
{
    (void)state;
    for (int s = 0; s < SIZES; ++s) {
        sgsi_cells cells = {0};
        assert_true(sgsi_cells_set(&cells, sizes[s][0], sizes[s][1]));
        uint8_t *seen = calloc(cells.tiles, 1);
        size_t pixels = 0;
        assert_int_equal(cells.tile_begin[0], 0);
        assert_int_equal(cells.tile_begin[cells.count], cells.tiles);
        for (size_t i = 0; i < cells.count; ++i) {
            const sgsi_cell_rect rect = sgsi_cell_at(&cells, i);
            assert_true(rect.width > 0 && rect.height > 0);
            assert_true(rect.x + rect.width <= sizes[s][0] && rect.y + rect.height <= sizes[s][1]);
            pixels += (size_t)rect.width * (size_t)rect.height;
            for (uint32_t k = cells.tile_begin[i]; k < cells.tile_begin[i + 1]; ++k) {
                const int tile = (int)cells.tile_order[k];
                const int x = tile % cells.tiles_x * SGSI_CELL_TILE,
                          y = tile / cells.tiles_x * SGSI_CELL_TILE;
                assert_true(x >= rect.x && x < rect.x + rect.width);
                assert_true(y >= rect.y && y < rect.y + rect.height);
                assert_true(k == cells.tile_begin[i] ||
                            cells.tile_order[k] > cells.tile_order[k - 1]);
                assert_int_equal(seen[tile]++, 0);
            }
        }
        assert_int_equal(pixels, (size_t)sizes[s][0] * (size_t)sizes[s][1]);
        free(seen);
        sgsi_cells_free(&cells);
    }
}

static void large_cells_only_where_there_are_many(void **state)
{
    (void)state;
    sgsi_cells cells = {0};
    assert_true(sgsi_cells_set(&cells, 2048, 2048));
    assert_int_equal(cells.side, 8);
    assert_int_equal(cells.count, 256);
    const size_t before = sgsi_allocation_count();
    assert_true(sgsi_cells_set(&cells, 2048, 1920));
    assert_int_equal(cells.side, 4);
    assert_int_equal(cells.count, 32 * 30);
    assert_true(sgsi_cells_set(&cells, 7, 2000));
    assert_int_equal(sgsi_allocation_count(), before);
    sgsi_cells_free(&cells);
}

static void failed_allocations_leave_nothing(void **state)
{
    (void)state;
    for (size_t n = 1; n <= 4; ++n) {
        sgsi_cells cells = {0};
        sgsi_fail_allocation(n);
        assert_false(sgsi_cells_set(&cells, 300, 200));
        sgsi_fail_allocation(0);
        assert_int_equal(cells.count, 0);
        assert_true(sgsi_cells_set(&cells, 300, 200));
        sgsi_cells_free(&cells);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cells_follow_a_hilbert_curve),
        cmocka_unit_test(tiles_are_listed_once_by_cell),
        cmocka_unit_test(large_cells_only_where_there_are_many),
        cmocka_unit_test(failed_allocations_leave_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
