// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Resolution schedule of DashGaussian: spectra against the defining sum, levels against the
// published formulae, and reduced photos against the definition of the filter.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>

#include "base/core.h"
#include "base/threads.h"
#include "density/resolution.h"
#include "sparegs/image.h"

static sgs_image8 make_image(int width, int height, uint64_t seed, double roughness)
{
    sgs_image8 image = {.width = width, .height = height, .channels = 3};
    image.pixels = sgsi_alloc((size_t)width * (size_t)height, 3);
    assert_non_null(image.pixels);
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
                const size_t at =
                    ((size_t)c * (size_t)height + (size_t)y) * (size_t)width + (size_t)x;
                const double smooth = 0.5 + 0.3 * sin(0.11 * x + c) * cos(0.07 * y),
                             rough = sgsi_random_uniform(seed, at) - 0.5;
                image.pixels[at] = (uint8_t)(255 * fmin(fmax(smooth + roughness * rough, 0), 1));
            }
    return image;
}

static void size_of(void *context, size_t i, int *width, int *height)
{
    const sgs_image8 *images = context;
    *width = images[i].width;
    *height = images[i].height;
}

static sgs_status get(void *context, size_t i, sgs_image8 *image)
{
    *image = ((const sgs_image8 *)context)[i];
    return SGS_STATUS_OK;
}

static void spectrum_is_the_sum_that_defines_it(void **state)
{
    (void)state;
    const int sizes[][2] = {{7, 6}, {8, 5}, {9, 9}, {6, 8}, {1, 13}, {37, 22}};
    for (int n = 0; n < 6; ++n) {
        const int w = sizes[n][0], h = sizes[n][1];
        sgs_image8 image = make_image(w, h, 1, 0.5);
        sgsi_spectrum spectrum;
        assert_int_equal(sgsi_spectrum_of(&image, &spectrum), SGS_STATUS_OK);
        double total = 0;
        for (int v = 0; v < h; ++v)
            for (int u = 0; u < w; ++u) {
                double expected = 0;
                for (int c = 0; c < 3; ++c) {
                    double re = 0, im = 0;
                    for (int y = 0; y < h; ++y)
                        for (int x = 0; x < w; ++x) {
                            const double phase =
                                -2 * M_PI * ((double)u * x / w + (double)v * y / h);
                            const double value =
                                image.pixels[((size_t)c * (size_t)h + (size_t)y) * (size_t)w +
                                             (size_t)x] /
                                255.0;
                            re += value * cos(phase);
                            im += value * sin(phase);
                        }
                    expected += hypot(re, im);
                }
                const int x = (u + w / 2) % w,
                          y = (v + h / 2) % h; // the zero frequency in the centre
                assert_true(fabs(spectrum.magnitude[(size_t)y * (size_t)w + (size_t)x] -
                                 expected) <= 1e-9 * (1 + expected));
                total += expected;
            }
        for (double scale = 1; scale < 5;
             scale += 0.37) { // rows and columns as the paper's code takes them
            const int rows = (int)(h / scale), columns = (int)(w / scale), cy = (h + 1) / 2,
                      cx = (w + 1) / 2;
            double expected = 0;
            for (int y = cy - rows / 2; y < cy + rows / 2; ++y)
                for (int x = cx - columns / 2; x < cx + columns / 2; ++x)
                    expected += y >= 0 && y < h && x >= 0 && x < w
                                    ? spectrum.magnitude[(size_t)y * (size_t)w + (size_t)x]
                                    : 0;
            assert_true(fabs(sgsi_spectrum_window(&spectrum, scale) - expected) <= 1e-9 * total);
        }
        sgsi_spectrum_free(&spectrum);
        sgs_image8_free(&image);
    }
}

// The table has the bits of one loop: sums along a row, added from top to bottom.
static void spectra_do_not_depend_on_the_threads(void **state)
{
    (void)state;
    const int sizes[][2] = {{97, 61}, {1, 40}, {130, 1}, {64, 200}};
    for (int n = 0; n < 4; ++n) {
        const int w = sizes[n][0], h = sizes[n][1];
        sgs_image8 image = make_image(w, h, 5, 0.6);
        sgsi_spectrum first;
        sgsi_threads_set(1);
        assert_int_equal(sgsi_spectrum_of(&image, &first), SGS_STATUS_OK);
        const size_t pitch = (size_t)w + 1, cells = pitch * ((size_t)h + 1);
        for (size_t y = 0; y < (size_t)h; ++y) {
            double row = 0;
            for (size_t x = 0; x < (size_t)w; ++x) {
                row += first.magnitude[y * (size_t)w + x];
                assert_true(first.table[(y + 1) * pitch + x + 1] ==
                            first.table[y * pitch + x + 1] + row);
            }
            assert_true(first.table[y * pitch] == 0);
        }
        for (int threads = 2; threads < 8; threads += 3) {
            sgsi_spectrum other;
            sgsi_threads_set(threads);
            assert_int_equal(sgsi_spectrum_of(&image, &other), SGS_STATUS_OK);
            assert_memory_equal(first.table, other.table, cells * sizeof(double));
            assert_memory_equal(first.magnitude, other.magnitude,
                                (size_t)w * (size_t)h * sizeof(double));
            sgsi_spectrum_free(&other);
        }
        sgsi_threads_set(0);
        sgsi_spectrum_free(&first);
        sgs_image8_free(&image);
    }
}

static void levels_follow_the_published_formulae(void **state)
{
    (void)state;
    sgs_image8 images[3];
    double scale_max = 8;
    sgsi_spectrum mean = {0};
    for (int i = 0; i < 3; ++i) {
        images[i] = make_image(160, 120, 7 + (uint64_t)i, 0.4);
        sgsi_spectrum one;
        assert_int_equal(sgsi_spectrum_of(&images[i], &one), SGS_STATUS_OK);
        // The smallest window with a quarter of the energy, by trying all sizes.
        const double quarter = 0.25 * sgsi_spectrum_window(&one, 1);
        double largest = 1;
        for (double scale = 1; scale < 12; scale += 1e-3)
            if (sgsi_spectrum_window(&one, scale) >= quarter)
                largest = scale;
        scale_max = fmin(scale_max, largest);
        if (i == 2)
            mean = one;
        else
            sgsi_spectrum_free(&one);
    }
    sgsi_resolution plan;
    assert_int_equal(
        sgsi_resolution_plan(&(sgsi_image_source){images, 3, size_of, get, NULL}, 27000, &plan),
        SGS_STATUS_OK);
    assert_true(fabs(plan.scale[0] - scale_max) <= 2e-3 * scale_max);
    assert_true(plan.scale[0] > 1.5);
    assert_true(plan.scale[31] == 1 && plan.begin[32] == 27000 && plan.begin[0] == 0 &&
                plan.begin[1] == 0);
    for (int i = 1; i < 32; ++i) {
        assert_true(plan.scale[i] <= plan.scale[i - 1] && plan.begin[i] >= plan.begin[i - 1] &&
                    plan.begin[i] < 27000);
    }
    // With one image, energies and begins follow from its spectrum.
    assert_int_equal(
        sgsi_resolution_plan(&(sgsi_image_source){images + 2, 1, size_of, get, NULL}, 27000, &plan),
        SGS_STATUS_OK);
    const double least = sgsi_spectrum_window(&mean, plan.scale[0]),
                 total = sgsi_spectrum_window(&mean, 1);
    for (int i = 1; i < 31; ++i) {
        const double energy = least + (total - least) * i / 31.0,
                     before = least + (total - least) * (i - 1) / 31.0;
        assert_true(sgsi_spectrum_window(&mean, plan.scale[i] * 1.001) <= energy * 1.0001);
        assert_true(sgsi_spectrum_window(&mean, plan.scale[i] * 0.999) >= energy * 0.9999);
        assert_true(abs(plan.begin[i] - (int)(27000 * log(before / least) / log(total / least))) <=
                    1);
    }
    int last = 1000;
    for (int t = 1; t <= 27000; t += 50) {
        const int scale = sgsi_resolution_at(&plan, t);
        assert_true(scale >= 1 && scale <= last && scale <= (int)plan.scale[0]);
        last = scale;
    }
    assert_int_equal(sgsi_resolution_at(&plan, 1), (int)plan.scale[0]);
    assert_int_equal(sgsi_resolution_at(&plan, 27000), 1);
    sgsi_spectrum_free(&mean);
    for (int i = 0; i < 3; ++i)
        sgs_image8_free(&images[i]);
}

static void half_size_ends_at_the_given_iteration(void **state)
{
    (void)state;
    for (int until = 0; until < 40; ++until) {
        const sgsi_resolution plan = sgsi_resolution_half(until);
        for (int t = 0; t < 50; ++t)
            assert_int_equal(sgsi_resolution_at(&plan, t), t < until ? 2 : 1);
    }
}

static void flat_images_have_a_valid_scale(void **state)
{
    (void)state;
    sgs_image8 image = make_image(64, 48, 1, 0);
    for (size_t i = 0; i < 3 * 64 * 48; ++i)
        image.pixels[i] = 100; // all energy is at frequency 0, in every window
    sgsi_resolution plan;
    assert_int_equal(
        sgsi_resolution_plan(&(sgsi_image_source){&image, 1, size_of, get, NULL}, 1000, &plan),
        SGS_STATUS_OK);
    for (int t = 1; t < 1100; t += 7)
        assert_in_range(sgsi_resolution_at(&plan, t), 1, 8);
    sgs_image8_free(&image);
}

static void reduced_images_are_the_triangle_filter(void **state)
{
    (void)state;
    sgs_image8 image = make_image(37, 26, 3, 0.8), small;
    for (int scale = 1; scale <= 8; ++scale) {
        assert_int_equal(sgsi_image8_triangle(&image, NULL, scale, &small), SGS_STATUS_OK);
        assert_int_equal(small.width, 37 / scale);
        assert_int_equal(small.height, 26 / scale);
        for (int y = 0; y < small.height; ++y)
            for (int x = 0; x < small.width; ++x) {
                const double sx = 37.0 / small.width, sy = 26.0 / small.height, cx = (x + 0.5) * sx,
                             cy = (y + 0.5) * sy;
                double sum = 0, weight = 0;
                for (int v = 0; v < 26; ++v)
                    for (int u = 0; u < 37; ++u) {
                        const double w = fmax(0, 1 - fabs(u + 0.5 - cx) / sx) *
                                         fmax(0, 1 - fabs(v + 0.5 - cy) / sy);
                        sum += w * image.pixels[(size_t)v * 37 + (size_t)u];
                        weight += w;
                    }
                assert_true(fabs(sum / weight -
                                 small.pixels[(size_t)y * (size_t)small.width + (size_t)x]) <=
                            0.501);
            }
        sgs_image8_free(&small);
    }
    sgs_image8_free(&image);
}

// Colours are weighted by alpha: those of transparent pixels have no effect.
static void transparent_pixels_do_not_mix_in(void **state)
{
    (void)state;
    enum { W = 22, H = 14, N = W * H };
    sgs_image8 image = {.width = W, .height = H, .channels = 4}, small;
    image.pixels = sgsi_alloc(N, 4);
    for (size_t i = 0; i < 4 * (size_t)N; ++i)
        image.pixels[i] = (uint8_t)(255 * sgsi_random_uniform(7, i));
    for (size_t i = 0; i < N; ++i)
        image.pixels[3 * N + i] = i % W < 8 ? 0 : image.pixels[3 * N + i];
    assert_int_equal(sgsi_image8_triangle(&image, NULL, 2, &small), SGS_STATUS_OK);
    for (int y = 0; y < H / 2; ++y)
        for (int x = 0; x < W / 2; ++x) {
            double sum[3] = {0}, alpha = 0, weight = 0;
            for (int v = 0; v < H; ++v)
                for (int u = 0; u < W; ++u) {
                    const double w = fmax(0, 1 - fabs(u + 0.5 - 2 * x - 1) / 2) *
                                     fmax(0, 1 - fabs(v + 0.5 - 2 * y - 1) / 2);
                    const size_t at = (size_t)(v * W + u);
                    weight += w;
                    alpha += w * image.pixels[3 * N + at];
                    for (size_t c = 0; c < 3; ++c)
                        sum[c] += w * image.pixels[3 * N + at] * image.pixels[c * N + at];
                }
            const size_t at = (size_t)(y * (W / 2) + x);
            for (size_t c = 0; c < 3; ++c)
                assert_true(fabs((alpha > 0 ? sum[c] / alpha : 0) -
                                 small.pixels[c * (N / 4) + at]) <= 0.51);
            assert_true(fabs(alpha / weight - small.pixels[3 * (N / 4) + at]) <= 0.51);
        }
    sgs_image8_free(&small);
    sgs_image8_free(&image);
}

// Neither colours nor alpha of masked pixels have an effect where some pixel is valid.
static void masked_pixels_do_not_mix_in(void **state)
{
    (void)state;
    enum { W = 22, H = 14, N = W * H };
    uint16_t valid[H][(W + 15) / 16] = {0};
    for (int y = 0; y < H; ++y)
        for (int x = 7; x < W; ++x)
            valid[y][x / 16] |= (uint16_t)(1u << (x % 16));
    for (int channels = 3; channels <= 4; ++channels) {
        sgs_image8 small[2];
        for (int noise = 0; noise < 2; ++noise) {
            sgs_image8 image = {.width = W, .height = H, .channels = channels};
            image.pixels = sgsi_alloc(N, 4);
            for (size_t i = 0; i < (size_t)channels * N; ++i) {
                const bool masked = i % W < 7;
                image.pixels[i] = (uint8_t)(255 * sgsi_random_uniform(masked && noise ? 8 : 7, i));
                if (!masked && i < 3 * (size_t)N)
                    image.pixels[i] = 200;
            }
            assert_int_equal(sgsi_image8_triangle(&image, &valid[0][0], 2, &small[noise]),
                             SGS_STATUS_OK);
            sgs_image8_free(&image);
        }
        for (int c = 0; c < channels; ++c)
            for (int y = 0; y < H / 2; ++y)
                for (int x = 3; x < W / 2; ++x) {
                    const int at = (c * (H / 2) + y) * (W / 2) + x;
                    assert_int_equal(small[0].pixels[at], small[1].pixels[at]);
                    assert_true(c == 3 || small[0].pixels[at] == 200);
                }
        sgs_image8_free(&small[0]);
        sgs_image8_free(&small[1]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(spectrum_is_the_sum_that_defines_it),
        cmocka_unit_test(spectra_do_not_depend_on_the_threads),
        cmocka_unit_test(levels_follow_the_published_formulae),
        cmocka_unit_test(half_size_ends_at_the_given_iteration),
        cmocka_unit_test(flat_images_have_a_valid_scale),
        cmocka_unit_test(reduced_images_are_the_triangle_filter),
        cmocka_unit_test(transparent_pixels_do_not_mix_in),
        cmocka_unit_test(masked_pixels_do_not_mix_in),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
