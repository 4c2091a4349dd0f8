// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Quantisation, PSNR and SSIM against values known in closed form and against a 121-tap brute
// force.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/core.h"
#include "sparegs/metrics.h"
#include "sparegs/runtime.h"

typedef enum plant {
    PLANT_NONE,
    PLANT_RENORMALISED,
    PLANT_CONSTANTS,
    PLANT_SIGMA,
    PLANT_COUNT
} plant;

static sgs_image8 make_image(int width, int height, int channels, uint64_t seed, int base,
                             int range)
{
    const size_t values = (size_t)width * (size_t)height * (size_t)channels;
    sgs_image8 image = {width, height, channels, sgsi_alloc(values, 1)};
    assert_non_null(image.pixels);
    for (size_t i = 0; i < values; ++i)
        image.pixels[i] = (uint8_t)(base + (int)(sgsi_random_uniform(seed, i) * range));
    return image;
}

static double brute_force_ssim(const sgs_image8 *a, const sgs_image8 *b, plant error)
{
    const int width = a->width, height = a->height;
    const double c1 = error == PLANT_CONSTANTS ? 2e-4 : 1e-4, c2 = 9e-4,
                 spread = error == PLANT_SIGMA ? 4.0 : 4.5;
    double norm = 0.0, total = 0.0;
    for (int k = -5; k <= 5; ++k)
        norm += exp(-k * k / spread);
    for (int c = 0; c < 3; ++c)
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
                double e[5] = {0}, mass = 0.0;
                for (int dy = -5; dy <= 5; ++dy)
                    for (int dx = -5; dx <= 5; ++dx) {
                        if (x + dx < 0 || x + dx >= width || y + dy < 0 || y + dy >= height)
                            continue;
                        const double w = exp(-(dx * dx + dy * dy) / spread) / (norm * norm);
                        const size_t row = (size_t)c * (size_t)height + (size_t)(y + dy);
                        const size_t at = row * (size_t)width + (size_t)(x + dx);
                        const double p = a->pixels[at] / 255.0, q = b->pixels[at] / 255.0;
                        const double terms[5] = {p, q, p * p, q * q, p * q};
                        for (int m = 0; m < 5; ++m)
                            e[m] += w * terms[m];
                        mass += w;
                    }
                for (int m = 0; m < 5 && error == PLANT_RENORMALISED; ++m)
                    e[m] /= mass;
                total += (2 * e[0] * e[1] + c1) * (2 * (e[4] - e[0] * e[1]) + c2) /
                         ((e[0] * e[0] + e[1] * e[1] + c1) *
                          (e[2] - e[0] * e[0] + e[3] - e[1] * e[1] + c2));
            }
    return total / (3.0 * width * height);
}

static void ssim_matches_brute_force_and_catches_planted_errors(void **state)
{
    (void)state;
    const int sizes[][2] = {{1, 1}, {5, 3}, {17, 11}, {9, 40}, {70, 49}};
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; ++k)
        for (int kind = 0; kind < 3; ++kind) {
            const int base = kind == 1 ? 250 : 0, range = kind == 1 ? 5 : 256;
            sgs_image8 a = make_image(sizes[k][0], sizes[k][1], 3 + kind / 2, 1, base, range);
            sgs_image8 b = make_image(sizes[k][0], sizes[k][1], 3, 2, base, range);
            for (int error = PLANT_NONE; error < PLANT_COUNT; ++error) {
                const double difference =
                    fabs(sgs_ssim(&a, &b) - brute_force_ssim(&a, &b, (plant)error));
                if (error == PLANT_NONE)
                    assert_true(difference <= 1e-12);
                else if (kind == 0)
                    assert_true(difference > 1e-9);
            }
            assert_true(sgs_ssim(&a, &b) == sgs_ssim(&b, &a));
            sgsi_free(a.pixels);
            sgsi_free(b.pixels);
        }
}

static void ssim_of_one_pixel_has_a_closed_form(void **state)
{
    (void)state;
    uint8_t black[3] = {0, 0, 0}, grey[3] = {51, 51, 51}; // 0 and 0.2
    const sgs_image8 a = {1, 1, 3, black}, b = {1, 1, 3, grey};
    const double centre = 0.26601172486179436, w = centre * centre; // of the normalised window
    const double mean = 0.2 * w, variance = 0.04 * w - mean * mean;
    const double expected = 1e-4 * 9e-4 / ((mean * mean + 1e-4) * (variance + 9e-4));
    assert_true(fabs(sgs_ssim(&a, &b) - expected) < 1e-14);
}

static void identical_images_have_perfect_scores(void **state)
{
    (void)state;
    sgs_image8 a = make_image(61, 47, 3, 3, 0, 256);
    assert_true(sgs_ssim(&a, &a) == 1.0);
    assert_true(sgs_psnr(&a, &a) == (double)INFINITY);
    sgsi_free(a.pixels);
}

static void psnr_has_known_values(void **state)
{
    (void)state;
    sgs_image8 a = make_image(31, 17, 3, 3, 100, 1), b = make_image(31, 17, 4, 3, 101, 1);
    assert_true(fabs(sgs_psnr(&a, &b) - 48.130803608679) < 1e-9); // 20 log10 255
    memset(a.pixels, 0, 31 * 17 * 3);
    memset(b.pixels, 255, 31 * 17 * 3);
    assert_true(sgs_psnr(&a, &b) == 0.0);
    memset(b.pixels, 0, 31 * 17 * 3);
    b.pixels[5] = 255; // one value of 1581
    assert_true(fabs(sgs_psnr(&a, &b) - 10.0 * log10(1581.0)) < 1e-9);
    sgsi_free(a.pixels);
    sgsi_free(b.pixels);
}

static void figures_do_not_depend_on_threads(void **state)
{
    (void)state;
    const int before = sgs_threads_get();
    sgs_image8 a = make_image(203, 151, 3, 4, 0, 256), b = make_image(203, 151, 3, 5, 30, 200);
    sgs_threads_set(1);
    const double ssim = sgs_ssim(&a, &b), psnr = sgs_psnr(&a, &b);
    for (int threads = 2; threads <= 5; ++threads) {
        sgs_threads_set(threads);
        assert_true(sgs_ssim(&a, &b) == ssim && sgs_psnr(&a, &b) == psnr);
    }
    sgs_threads_set(before);
    sgsi_free(a.pixels);
    sgsi_free(b.pixels);
}

static void mismatched_images_have_no_metric(void **state)
{
    (void)state;
    sgs_image8 a = make_image(8, 8, 3, 4, 0, 256), b = make_image(8, 9, 3, 5, 0, 256);
    sgs_image8 grey = make_image(8, 8, 1, 5, 0, 9);
    assert_true(isnan(sgs_psnr(&a, &b)) && isnan(sgs_ssim(&a, &b)));
    assert_true(isnan(sgs_psnr(&a, &grey)) && isnan(sgs_ssim(&grey, &a)));
    const sgs_image8 empty = {0};
    assert_true(isnan(sgs_psnr(&empty, &empty)) && isnan(sgs_ssim(&empty, &empty)));
    sgsi_fail_allocation(1);
    assert_true(isnan(sgs_ssim(&a, &a)));
    sgsi_fail_allocation(0);
    sgsi_free(a.pixels);
    sgsi_free(b.pixels);
    sgsi_free(grey.pixels);
}

static void quantisation_rounds_like_the_papers(void **state)
{
    (void)state;
    enum { COUNT = 256 + 12 };
    float red[COUNT], zero[COUNT];
    uint8_t expected[COUNT];
    for (int i = 0; i < 256; ++i) {
        red[i] = (float)i / 255.0f;
        expected[i] = (uint8_t)i;
    }
    const float special[12] = {NAN,
                               -1.0f,
                               2.0f,
                               INFINITY,
                               -INFINITY,
                               -0.0f,
                               0.499f / 255.0f,
                               0.501f / 255.0f,
                               254.49f / 255.0f,
                               254.51f / 255.0f,
                               1e30f,
                               -1e-9f};
    const uint8_t rounded[12] = {0, 0, 255, 255, 0, 0, 0, 1, 254, 255, 255, 0};
    memcpy(red + 256, special, sizeof special);
    memcpy(expected + 256, rounded, sizeof rounded);
    memset(zero, 0, sizeof zero);
    const float *const color[3] = {red, zero, red};
    sgs_image8 image;
    assert_int_equal(sgs_image8_from_planes(color, NULL, NULL, COUNT, 1, &image), SGS_STATUS_OK);
    assert_true(image.width == COUNT && image.height == 1 && image.channels == 3);
    assert_memory_equal(image.pixels, expected, COUNT);
    assert_memory_equal(image.pixels + 2 * COUNT, expected, COUNT);
    assert_int_equal(image.pixels[COUNT + 17], 0);
    sgsi_free(image.pixels);
}

static void quantisation_composites_over_the_background(void **state)
{
    (void)state;
    const float color[2] = {0.25f, 0.5f}, transmittance[2] = {0.5f, 1.0f},
                background[3] = {1.0f, 0.5f, 0.0f};
    const float *const planes[3] = {color, color, color};
    sgs_image8 image;
    assert_int_equal(sgs_image8_from_planes(planes, transmittance, background, 1, 2, &image),
                     SGS_STATUS_OK);
    const uint8_t expected[6] = {191, 255, 128, 255, 64, 128};
    assert_memory_equal(image.pixels, expected, sizeof expected);
    sgsi_free(image.pixels);
    assert_int_equal(sgs_image8_from_planes(planes, transmittance, NULL, 1, 2, &image),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_int_equal(sgs_image8_from_planes(planes, NULL, NULL, 0, 2, &image),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_null(image.pixels);
    sgsi_fail_allocation(1);
    assert_int_equal(sgs_image8_from_planes(planes, NULL, NULL, 1, 2, &image),
                     SGS_STATUS_OUT_OF_MEMORY);
    sgsi_fail_allocation(0);
    assert_null(image.pixels);
}

// Values of the sRGB curve (IEC 61966-2-1): 0.5 is 0.735357, 0.2 is 0.484529, 0.002 is 0.02584.
static void compared_images_are_display_encoded(void **state)
{
    (void)state;
    static const float light[5] = {0.5f, 0.2f, 0.002f, 0.0f, 4.0f};
    static const uint8_t encoded[5] = {188, 124, 7, 0, 255}, as_given[5] = {128, 51, 1, 0, 255};
    static const float black[3];
    const float *const planes[3] = {light, light, light};
    sgs_image8 image;
    for (int linear = 0; linear < 2; ++linear) {
        assert_int_equal(sgs_image8_from_render(planes, NULL, NULL,
                                                linear ? SGS_SPACE_LINEAR : SGS_SPACE_SRGB, 5, 1,
                                                &image),
                         SGS_STATUS_OK);
        for (int c = 0; c < 3; ++c)
            assert_memory_equal(image.pixels + 5 * c, linear ? encoded : as_given, 5);
        sgs_image8_free(&image);
    }
    uint16_t halves[6] = {0x3800, 0x4400, 0x3800, 0x4400, 0x3800, 0x4400}; // 0.5 and 4
    const sgs_photo photo = {.width = 2, .height = 1, .channels = 3, .halves = halves};
    assert_int_equal(sgs_image8_from_photo(&photo, black, SGS_SPACE_LINEAR, &image), SGS_STATUS_OK);
    assert_memory_equal(image.pixels, ((const uint8_t[]){188, 255, 188, 255, 188, 255}), 6);
    sgs_image8_free(&image);
}

// alpha c + (1 - alpha) background before the encoding; an opaque photo has the bits of its file.
static void photos_are_compared_over_the_background(void **state)
{
    (void)state;
    uint8_t pixels[4 * 256];
    static const float background[3] = {1, 0, 0.2f};
    sgs_photo photo = {.width = 256, .height = 1, .channels = 3, .pixels = pixels};
    sgs_image8 image;
    float flat[3 * 256];
    for (int i = 0; i < 256; ++i) {
        for (int c = 0; c < 3; ++c)
            pixels[256 * c + i] = (uint8_t)(i ^ c);
        pixels[3 * 256 + i] = i % 2 ? 255 : 51; // alpha 1 or 0.2
    }
    assert_int_equal(sgs_image8_from_photo(&photo, background, SGS_SPACE_SRGB, &image),
                     SGS_STATUS_OK);
    assert_memory_equal(image.pixels, pixels, sizeof pixels / 4 * 3);
    sgs_image8_free(&image);
    photo.channels = 4;
    sgs_photo_flatten(&photo, background, flat);
    assert_int_equal(sgs_image8_from_photo(&photo, background, SGS_SPACE_SRGB, &image),
                     SGS_STATUS_OK);
    for (int c = 0; c < 3; ++c)
        for (int i = 0; i < 256; ++i) {
            const double alpha = i % 2 ? 1 : 0.2, value = pixels[256 * c + i] / 255.0,
                         expected = alpha * value + (1 - alpha) * (double)background[c];
            assert_true(fabs((double)flat[256 * c + i] - expected) <= 1e-6);
            assert_true(fabs(image.pixels[256 * c + i] - 255 * expected) <= 0.5001);
        }
    sgs_image8_free(&image);
    sgsi_fail_allocation(1);
    assert_int_equal(sgs_image8_from_photo(&photo, background, SGS_SPACE_SRGB, &image),
                     SGS_STATUS_OUT_OF_MEMORY);
    sgsi_fail_allocation(0);
    assert_null(image.pixels);
}

// Before anything is read: the product of two negative sizes is positive.
static void photos_without_pixels_are_refused(void **state)
{
    (void)state;
    static const int sizes[][2] = {{0, 0}, {0, 4}, {4, 0}, {-1, 4}, {4, -1}, {-2, -2}};
    static const float black[3] = {0};
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; ++k) {
        const sgs_photo photo = {.width = sizes[k][0], .height = sizes[k][1], .channels = 3};
        sgs_image8 image = {.width = 1};
        assert_int_equal(sgs_image8_from_photo(&photo, black, SGS_SPACE_SRGB, &image),
                         SGS_STATUS_INVALID_ARGUMENT);
        assert_true(!image.pixels && !image.width);
    }
}

// Invalid pixels may be black without any effect; PSNR covers valid pixels only.
static void masked_pixels_have_no_influence(void **state)
{
    (void)state;
    sgs_image8 a = make_image(45, 30, 3, 5, 20, 200), b = make_image(45, 30, 3, 6, 20, 200);
    const size_t plane = 45 * 30, words = 3;
    uint16_t valid_mask[30 * 3] = {0};
    size_t kept = 0;
    double squares = 0;
    for (size_t i = 0; i < plane; ++i) {
        const size_t x = i % 45, y = i / 45;
        if ((x > 10 && x < 25 && y > 5 && y < 22) || x == 44)
            continue;
        valid_mask[y * words + x / 16] |= (uint16_t)(1u << x % 16);
        ++kept;
        for (size_t c = 0; c < 3; ++c)
            squares += pow((a.pixels[c * plane + i] - b.pixels[c * plane + i]) / 255.0, 2);
    }
    for (size_t y = 0; y < 30; ++y)
        valid_mask[y * words + 2] |= 0xE000; // no pixels
    const double psnr = sgs_psnr_masked(&a, &b, valid_mask),
                 ssim = sgs_ssim_masked(&a, &b, valid_mask);
    assert_true(fabs(psnr - 10 * log10(3.0 * (double)kept / squares)) < 1e-9);
    for (size_t i = 0; i < plane; ++i)
        for (size_t c = 0; c < 3 && !(valid_mask[i / 45 * words + i % 45 / 16] >> i % 45 % 16 & 1);
             ++c)
            a.pixels[c * plane + i] = b.pixels[c * plane + i] = 0;
    assert_true(sgs_psnr_masked(&a, &b, valid_mask) == psnr &&
                sgs_ssim_masked(&a, &b, valid_mask) == ssim);
    // Black elsewhere: the excluded windows have another similarity.
    assert_true(fabs(sgs_ssim(&a, &b) - ssim) > 1e-3);
    memset(valid_mask, 0, sizeof valid_mask);
    assert_true(isnan(sgs_psnr_masked(&a, &b, valid_mask)) &&
                isnan(sgs_ssim_masked(&a, &b, valid_mask)));
    sgsi_free(a.pixels);
    sgsi_free(b.pixels);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ssim_matches_brute_force_and_catches_planted_errors),
        cmocka_unit_test(ssim_of_one_pixel_has_a_closed_form),
        cmocka_unit_test(identical_images_have_perfect_scores),
        cmocka_unit_test(psnr_has_known_values),
        cmocka_unit_test(figures_do_not_depend_on_threads),
        cmocka_unit_test(masked_pixels_have_no_influence),
        cmocka_unit_test(mismatched_images_have_no_metric),
        cmocka_unit_test(quantisation_rounds_like_the_papers),
        cmocka_unit_test(quantisation_composites_over_the_background),
        cmocka_unit_test(compared_images_are_display_encoded),
        cmocka_unit_test(photos_are_compared_over_the_background),
        cmocka_unit_test(photos_without_pixels_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
