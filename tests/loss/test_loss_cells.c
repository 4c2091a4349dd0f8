// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The loss of single cells of an image. Small cells are computed in pairs; a division of their
// curve separates some pairs, and the sums and gradients keep their bits. A workspace without
// memory.

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/core.h"
#include "base/image_cells.h"
#include "loss/loss.h"

enum { PLANES = 4, CHANNELS = 4 };

typedef struct cells_scene {
    sgsi_loss_workspace *workspace;
    sgsi_loss_input input;
    sgsi_loss_output output;
    sgs_photo target;
    sgsi_cells cells;
    size_t floats; // of a plane
} cells_scene;

static void *take(size_t count, size_t size)
{
    void *block = sgsi_calloc(count, size);
    assert_non_null(block);
    return block;
}

static float *random_plane(size_t floats, uint64_t seed)
{
    float *plane = take(floats, sizeof *plane);
    for (size_t i = 0; i < floats; ++i)
        plane[i] = (float)(1.5 * sgsi_random_uniform(seed, i) - 0.25);
    return plane;
}

// Random image, photo with alpha, and a mask that removes every third pixel.
static void open_scene(cells_scene *s, int width, int height)
{
    const size_t stride = (size_t)(width + 15) / 16 * 16, words = sgs_mask_words(width);
    *s = (cells_scene){.target = {.width = width, .height = height, .channels = CHANNELS},
                       .floats = stride * (size_t)height};
    const size_t bytes = CHANNELS * (size_t)width * (size_t)height;
    s->target.pixels = take(bytes, 1);
    for (size_t i = 0; i < bytes; ++i)
        s->target.pixels[i] = (uint8_t)sgsi_random_bits(9, i);
    s->target.valid_mask = take(words * (size_t)height, sizeof *s->target.valid_mask);
    for (size_t y = 0; y < (size_t)height; ++y)
        for (size_t x = 0; x < (size_t)width; ++x)
            if ((x + y) % 3) {
                s->target.valid_mask[y * words + x / 16] |= (uint16_t)(1u << x % 16);
                ++s->target.kept;
            }
    s->input = (sgsi_loss_input){.width = width,
                                 .height = height,
                                 .stride = stride,
                                 .transmittance = random_plane(s->floats, 3),
                                 .background = {1.0f, 0.5f, 0.25f},
                                 .target = &s->target,
                                 .ssim_weight = 0.2f,
                                 .alpha_weight = 0.5f};
    s->output.d_transmittance = take(s->floats, sizeof(float));
    for (int c = 0; c < 3; ++c) {
        s->input.color[c] = random_plane(s->floats, (uint64_t)c);
        s->output.d_color[c] = take(s->floats, sizeof(float));
    }
    assert_int_equal(sgsi_loss_create(&s->workspace), SGS_STATUS_OK);
    assert_true(sgsi_cells_set(&s->cells, width, height));
}

static void close_scene(cells_scene *s)
{
    for (int c = 0; c < 3; ++c) {
        sgsi_free((void *)s->input.color[c]);
        sgsi_free(s->output.d_color[c]);
    }
    sgsi_free((void *)s->input.transmittance);
    sgsi_free(s->output.d_transmittance);
    sgsi_free(s->target.pixels);
    sgsi_free(s->target.valid_mask);
    sgsi_cells_free(&s->cells);
    sgsi_loss_destroy(s->workspace);
}

static void evaluate(cells_scene *s, size_t first, size_t last, sgsi_loss_sums *sums)
{
    sgsi_loss_sums *all;
    assert_int_equal(sgsi_loss_cells(s->workspace, &s->input, first, last, &s->output, &all),
                     SGS_STATUS_OK);
    memcpy(sums + first, all + first, (last - first) * sizeof *sums);
}

static void check_divisions(int width, int height, int side)
{
    static const size_t pieces[] = {1, 2, 3, 7};
    cells_scene s;
    open_scene(&s, width, height);
    const size_t count = s.cells.count;
    assert_int_equal(s.cells.side, side);
    assert_true(count > 8);
    float *const planes[PLANES] = {s.output.d_color[0], s.output.d_color[1], s.output.d_color[2],
                                   s.output.d_transmittance};
    float *expected = take(PLANES * s.floats, sizeof *expected);
    sgsi_loss_sums *whole = take(count, sizeof *whole), *sums = take(count, sizeof *sums);
    evaluate(&s, 0, count, whole);
    for (size_t k = 0; k < PLANES; ++k)
        memcpy(expected + k * s.floats, planes[k], s.floats * sizeof(float));
    for (size_t p = 0; p < sizeof pieces / sizeof *pieces; ++p) {
        memset(sums, 0xff, count * sizeof *sums);
        for (size_t k = 0; k < PLANES; ++k)
            memset(planes[k], 0xff, s.floats * sizeof(float));
        for (size_t i = 0; i < count; i += pieces[p])
            evaluate(&s, i, i + pieces[p] < count ? i + pieces[p] : count, sums);
        assert_memory_equal(sums, whole, count * sizeof *sums);
        for (size_t k = 0; k < PLANES; ++k)
            assert_memory_equal(planes[k], expected + k * s.floats, s.floats * sizeof(float));
    }
    sgsi_free(expected);
    sgsi_free(whole);
    sgsi_free(sums);
    close_scene(&s);
}

static void divisions_of_the_curve_give_the_same_bits(void **state)
{
    (void)state;
    check_divisions(421, 203, 4);
    check_divisions(203, 421, 4);
    check_divisions(2048, 2048, 8);
}

static void every_failed_allocation_is_reported(void **state)
{
    (void)state;
    for (size_t n = 1;; ++n) {
        sgsi_loss_workspace *workspace = NULL;
        sgsi_fail_allocation(n);
        sgs_status status = sgsi_loss_create(&workspace);
        if (status == SGS_STATUS_OK)
            status = sgsi_loss_reserve(workspace, 100, 100);
        sgsi_fail_allocation(0);
        sgsi_loss_destroy(workspace);
        if (status == SGS_STATUS_OK) {
            assert_int_equal(n, 10);
            break;
        }
        assert_int_equal(status, SGS_STATUS_OUT_OF_MEMORY);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(divisions_of_the_curve_give_the_same_bits),
        cmocka_unit_test(every_failed_allocation_is_reported),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
