// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// FLIP against the output of NVIDIA's evaluator (CPU) for the same images, and sharpness against
// closed forms. `test_flip RENDER PHOTO` prints both for two image files, for the tests of the
// program; `test_flip RENDER PHOTO MAP` checks an error map.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/core.h"
#include "sparegs/metrics.h"
#include "sparegs/runtime.h"

enum { WIDTH = 96, HEIGHT = 64, PIXELS = WIDTH * HEIGHT };

// Integer arithmetic only, so that another program can create the same images.
static uint8_t reference_value(int x, int y, int c)
{
    return (uint8_t)((x * (3 + c) + y * (5 - c) + (x / 8 + y / 8) % 2 * 60 + x * y / (16 + c)) %
                     256);
}

static uint8_t test_value(int kind, int x, int y, int c)
{
    if (kind == 0) // box blur of 3x1
        return (uint8_t)((reference_value(x > 0 ? x - 1 : 0, y, c) + reference_value(x, y, c) +
                          reference_value(x < WIDTH - 1 ? x + 1 : x, y, c)) /
                         3);
    if (kind == 1) // colour cast
        return (uint8_t)(reference_value(x, y, c) * (8 - c) / 10);
    return (uint8_t)(255 - reference_value(x, y, c));
}

static void make(sgs_image8 *image, int kind)
{
    *image = (sgs_image8){WIDTH, HEIGHT, 3, sgsi_alloc(3, PIXELS)};
    assert_non_null(image->pixels);
    for (int c = 0; c < 3; ++c)
        for (int i = 0; i < PIXELS; ++i)
            image->pixels[c * PIXELS + i] = kind < 0 ? reference_value(i % WIDTH, i / WIDTH, c)
                                                     : test_value(kind, i % WIDTH, i / WIDTH, c);
}

static void flip_agrees_with_the_published_evaluator(void **state)
{
    (void)state;
    static const double pixels_per_degree[] = {67, 30};
    static const double expected[3][2] = {
        {0.152264, 0.185063}, {0.618721, 0.612688}, {0.855354, 0.885579}};
    sgs_image8 reference;
    make(&reference, -1);
    for (int kind = 0; kind < 3; ++kind) {
        sgs_image8 test;
        make(&test, kind);
        for (int k = 0; k < 2; ++k) {
            double mean;
            assert_int_equal(sgs_flip(&reference, &test, NULL, pixels_per_degree[k], NULL, &mean),
                             SGS_STATUS_OK);
            if (!(fabs(mean - expected[kind][k]) <= 2e-6))
                fail_msg("kind %d at %g pixels per degree: %.6f, expected %.6f", kind,
                         pixels_per_degree[k], mean, expected[kind][k]);
        }
        sgsi_free(test.pixels);
    }
    sgsi_free(reference.pixels);
}

static void flip_of_equal_images_is_zero_and_masked_pixels_have_no_influence(void **state)
{
    (void)state;
    enum { WORDS = (WIDTH + 15) / 16 };
    sgs_image8 a, b;
    make(&a, -1);
    make(&b, -1);
    float *map = sgsi_alloc(PIXELS, sizeof *map);
    double mean;
    assert_int_equal(sgs_flip(&a, &b, NULL, 67, map, &mean), SGS_STATUS_OK);
    assert_true(mean == 0);
    uint16_t mask[WORDS * HEIGHT];
    memset(mask, 0xff, sizeof mask);
    for (int y = 10; y < 20; ++y)
        mask[y * WORDS + 2] = 0; // pixels 32 to 47
    for (int y = 10; y < 20; ++y)
        for (int x = 32; x < 48; ++x)
            b.pixels[y * WIDTH + x] = (uint8_t)~b.pixels[y * WIDTH + x];
    assert_int_equal(sgs_flip(&a, &b, mask, 67, map, &mean), SGS_STATUS_OK);
    assert_true(mean == 0);
    assert_int_equal(sgs_flip(&a, &b, NULL, 67, map, &mean), SGS_STATUS_OK);
    double sum = 0;
    for (int i = 0; i < PIXELS; ++i) {
        assert_true(map[i] >= 0 && map[i] <= 1);
        sum += (double)map[i];
    }
    assert_true(mean > 0.01 && fabs(sum / PIXELS - mean) < 1e-12);
    memset(mask, 0, sizeof mask);
    assert_int_equal(sgs_flip(&a, &b, mask, 67, NULL, &mean), SGS_STATUS_OK);
    assert_true(isnan(mean));
    sgsi_free(map);
    sgsi_free(a.pixels);
    sgsi_free(b.pixels);
}

static void flip_is_the_same_on_any_number_of_threads_and_refuses_bad_input(void **state)
{
    (void)state;
    sgs_image8 a, b;
    make(&a, -1);
    make(&b, 0);
    double mean[3];
    for (int threads = 1; threads <= 3; ++threads) {
        sgs_threads_set(threads);
        assert_int_equal(sgs_flip(&a, &b, NULL, 67, NULL, &mean[threads - 1]), SGS_STATUS_OK);
    }
    sgs_threads_set(0);
    assert_true(mean[0] == mean[1] && mean[0] == mean[2]);
    const double wrong[] = {0, -1, NAN, INFINITY, 4000, 3700.1};
    for (size_t k = 0; k < sizeof wrong / sizeof *wrong; ++k)
        assert_int_equal(sgs_flip(&a, &b, NULL, wrong[k], NULL, mean), SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_flip(&a, &b, NULL, 3700, NULL, mean), SGS_STATUS_OK);
    b.width = WIDTH - 1;
    assert_int_equal(sgs_flip(&a, &b, NULL, 67, NULL, mean), SGS_STATUS_INVALID_ARGUMENT);
    assert_true(isnan(sgs_sharpness(&a, &b, NULL)));
    sgsi_free(a.pixels);
    sgsi_free(b.pixels);
}

static void sharpness_is_the_ratio_of_laplacian_energies(void **state)
{
    (void)state;
    uint8_t photo[3][5 * 5] = {0}, render[3][5 * 5] = {0};
    const sgs_image8 a = {5, 5, 3, photo[0]}, b = {5, 5, 3, render[0]};
    assert_true(isnan(sgs_sharpness(&b, &a, NULL))); // flat photo
    photo[1][12] = 200;                              // a point: 16 + 4 times its square
    render[1][12] = 100;
    assert_true(fabs(sgs_sharpness(&b, &a, NULL) - 0.25) < 1e-12);
    memset(render, 0, sizeof render);
    render[0][12] = 200; // red instead of green
    const double ratio = 0.299 / 0.587;
    assert_true(fabs(sgs_sharpness(&b, &a, NULL) - ratio * ratio) < 1e-12);
    uint16_t mask[5] = {31, 31, 31, 31, 31};
    mask[2] = 31 & ~4; // without the point, no valid stencil contains it
    assert_true(isnan(sgs_sharpness(&b, &a, mask)));
}

static double plain_luma(const sgs_image8 *image, int x, int y)
{
    const uint8_t *at = image->pixels + y * WIDTH + x;
    return 0.299 * at[0] + 0.587 * at[PIXELS] + 0.114 * at[2 * PIXELS];
}

static double plain_energy(const sgs_image8 *image, const uint16_t *mask)
{
    double energy = 0;
    for (int y = 1; y < HEIGHT - 1; ++y)
        for (int x = 1; x < WIDTH - 1; ++x) {
            static const int around[5][2] = {{0, 0}, {1, 0}, {-1, 0}, {0, 1}, {0, -1}};
            double laplacian = 0;
            bool valid = true;
            for (int k = 0; k < 5; ++k) {
                laplacian += (k ? 1 : -4) * plain_luma(image, x + around[k][0], y + around[k][1]);
                valid = valid && sgs_mask_is_valid(mask, WIDTH, x + around[k][0], y + around[k][1]);
            }
            energy += valid ? laplacian * laplacian : 0;
        }
    return energy;
}

static void sharpness_equals_a_plain_loop_on_any_number_of_threads(void **state)
{
    (void)state;
    uint16_t mask[HEIGHT * WIDTH / 16];
    for (size_t i = 0; i < HEIGHT * WIDTH / 16; ++i)
        mask[i] = i % 7 == 3 ? 0xF7FF : 0xFFFF;
    for (int kind = 0; kind < 3; ++kind) {
        sgs_image8 photo, render;
        make(&photo, -1);
        make(&render, kind);
        for (int masked = 0; masked < 2; ++masked) {
            const uint16_t *valid = masked ? mask : NULL;
            const double expected = plain_energy(&render, valid) / plain_energy(&photo, valid);
            sgs_threads_set(1);
            const double sharpness = sgs_sharpness(&render, &photo, valid);
            assert_true(fabs(sharpness / expected - 1) <= 1e-12);
            for (int threads = 2; threads <= 4; ++threads) {
                sgs_threads_set(threads);
                assert_true(sgs_sharpness(&render, &photo, valid) == sharpness);
            }
        }
        sgsi_free(photo.pixels);
        sgsi_free(render.pixels);
    }
    sgs_threads_set(0);
}

// The Laplacian of a ramp is 0, with real weights only up to rounding.
static void a_ramp_has_no_detail(void **state)
{
    (void)state;
    sgs_image8 photo, render;
    make(&photo, -1);
    make(&render, 0);
    for (int i = 0; i < 3 * PIXELS; ++i)
        photo.pixels[i] = (uint8_t)(i % WIDTH + i / WIDTH % HEIGHT + i / PIXELS);
    assert_true(isnan(sgs_sharpness(&render, &photo, NULL)));
    sgsi_free(photo.pixels);
    sgsi_free(render.pixels);
}

// A wave of a quarter of the sampling rate: the blur [1 2 1] / 4 scales it, and its Laplacian, by
// (1 + cos(pi / 2)) / 2.
static void a_blurred_wave_has_the_sharpness_of_the_filter(void **state)
{
    (void)state;
    static const uint8_t wave[4] = {20, 20, 220, 220}, blurred[4] = {70, 70, 170, 170};
    sgs_image8 photo, render;
    make(&photo, -1);
    make(&render, -1);
    for (int i = 0; i < 3 * PIXELS; ++i) {
        photo.pixels[i] = wave[i % WIDTH % 4];
        render.pixels[i] = blurred[i % WIDTH % 4];
        const int x = i % WIDTH; // the table is what the filter does to the wave
        assert_int_equal(render.pixels[i] * 4,
                         wave[(x + 3) % 4] + 2 * wave[x % 4] + wave[(x + 1) % 4]);
    }
    const double response = (1 + cos(acos(-1.0) / 2)) / 2;
    assert_true(fabs(sgs_sharpness(&render, &photo, NULL) - response * response) < 1e-12);
    assert_true(sgs_sharpness(&render, &photo, NULL) < 0.5);
    sgsi_free(photo.pixels);
    sgsi_free(render.pixels);
}

// Every pixel on its own, without tiles: images larger than one tile in both directions, and
// smaller than the filters.
static void flip_does_not_depend_on_the_tile_of_a_pixel(void **state)
{
    (void)state;
    sgs_image8 a, b;
    make(&a, -1);
    make(&b, 0);
    float *whole = sgsi_alloc(PIXELS, sizeof *whole), *part = sgsi_alloc(PIXELS, sizeof *part);
    double mean;
    assert_int_equal(sgs_flip(&a, &b, NULL, 30, whole, &mean), SGS_STATUS_OK);
    // Columns 5 to 84: away from the new borders by the radius of the filters, nothing changes.
    enum { FIRST = 5, COLUMNS = 80, MARGIN = 5 };
    sgs_image8 cut[2] = {{COLUMNS, HEIGHT, 3, sgsi_alloc(3, COLUMNS * HEIGHT)},
                         {COLUMNS, HEIGHT, 3, sgsi_alloc(3, COLUMNS * HEIGHT)}};
    for (int i = 0; i < 3 * COLUMNS * HEIGHT; ++i)
        for (int k = 0; k < 2; ++k)
            cut[k].pixels[i] = (k ? b : a).pixels[i / COLUMNS * WIDTH + FIRST + i % COLUMNS];
    assert_int_equal(sgs_flip(&cut[0], &cut[1], NULL, 30, part, &mean), SGS_STATUS_OK);
    for (int y = 0; y < HEIGHT; ++y)
        for (int x = MARGIN; x < COLUMNS - MARGIN; ++x)
            assert_true(part[y * COLUMNS + x] == whole[y * WIDTH + FIRST + x]);
    sgs_image8 dot[2] = {{1, 1, 3, sgsi_alloc(3, 1)}, {1, 1, 3, sgsi_alloc(3, 1)}};
    memset(dot[0].pixels, 0, 3);
    memset(dot[1].pixels, 255, 3);
    float error;
    assert_int_equal(sgs_flip(&dot[0], &dot[1], NULL, 67, &error, &mean), SGS_STATUS_OK);
    assert_true(mean > 0.9 && mean <= 1 && mean == (double)error);
    for (int k = 0; k < 2; ++k) {
        sgsi_free(cut[k].pixels);
        sgsi_free(dot[k].pixels);
    }
    sgsi_free(whole);
    sgsi_free(part);
    sgsi_free(a.pixels);
    sgsi_free(b.pixels);
}

// The colours of a map: one per step of 1/255, known ones at five steps, lighter with the error.
static bool map_is_right(const float *flip, const sgs_image8 *map)
{
    static const int known[][4] = {
        {0, 0, 0, 4}, {64, 81, 18, 124}, {128, 183, 55, 121}, {192, 252, 137, 97}};
    const size_t pixels = (size_t)map->width * (size_t)map->height;
    int colors[256][3], found = 0, steps = 0;
    memset(colors, -1, sizeof colors);
    for (size_t i = 0; i < pixels; ++i) {
        int *color = colors[(int)floor(255 * (double)flip[i] + 0.5)];
        for (size_t c = 0; c < 3; ++c) {
            if (color[c] >= 0 && color[c] != map->pixels[c * pixels + i])
                return false;
            color[c] = map->pixels[c * pixels + i];
        }
    }
    for (size_t k = 0; k < sizeof known / sizeof *known; ++k)
        for (int c = 0; c < 3 && colors[known[k][0]][0] >= 0; ++c, ++found)
            if (abs(colors[known[k][0]][c] - known[k][c + 1]) > 1)
                return false;
    int luma = -1;
    for (int i = 0; i < 256; ++i) {
        if (colors[i][0] < 0)
            continue;
        const int next = 299 * colors[i][0] + 587 * colors[i][1] + 114 * colors[i][2];
        if (next + 500 < luma) // 8-bit rounding
            return false;
        luma = next;
        ++steps;
    }
    return found >= 3 && steps > 30;
}

static int check_map(const char *render_path, const char *photo_path, const char *map_path)
{
    sgs_image8 render = {0}, photo = {0}, map = {0};
    bool done = !sgs_image8_read(render_path, &render) && !sgs_image8_read(photo_path, &photo) &&
                !sgs_image8_read(map_path, &map);
    float *flip = sgsi_alloc((size_t)photo.width * (size_t)photo.height, sizeof *flip);
    double mean;
    done = done && flip && map.width == photo.width && map.height == photo.height &&
           !sgs_flip(&photo, &render, NULL, SGS_FLIP_PIXELS_PER_DEGREE, flip, &mean) &&
           map_is_right(flip, &map);
    sgsi_free(flip);
    sgs_image8_free(&render);
    sgs_image8_free(&photo);
    sgs_image8_free(&map);
    return !done;
}

static int print_figures(const char *render_path, const char *photo_path)
{
    sgs_image8 render = {0}, photo = {0};
    double flip = NAN;
    const bool done = !sgs_image8_read(render_path, &render) &&
                      !sgs_image8_read(photo_path, &photo) &&
                      !sgs_flip(&photo, &render, NULL, SGS_FLIP_PIXELS_PER_DEGREE, NULL, &flip);
    if (done)
        printf("%.9f %.9f %.9f %.9f\n", sgs_psnr(&render, &photo), sgs_ssim(&render, &photo), flip,
               sgs_sharpness(&render, &photo, NULL));
    sgs_image8_free(&render);
    sgs_image8_free(&photo);
    return !done;
}

int main(int argc, char **argv)
{
    if (argc == 4)
        return check_map(argv[1], argv[2], argv[3]);
    if (argc == 3)
        return print_figures(argv[1], argv[2]);
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(flip_agrees_with_the_published_evaluator),
        cmocka_unit_test(flip_of_equal_images_is_zero_and_masked_pixels_have_no_influence),
        cmocka_unit_test(flip_is_the_same_on_any_number_of_threads_and_refuses_bad_input),
        cmocka_unit_test(flip_does_not_depend_on_the_tile_of_a_pixel),
        cmocka_unit_test(sharpness_is_the_ratio_of_laplacian_energies),
        cmocka_unit_test(sharpness_equals_a_plain_loop_on_any_number_of_threads),
        cmocka_unit_test(a_ramp_has_no_detail),
        cmocka_unit_test(a_blurred_wave_has_the_sharpness_of_the_filter),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
