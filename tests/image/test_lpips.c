// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// LPIPS of generated weights and pictures against values of PyTorch in double precision (printed by
// `lpips_reference.py small`), and files of weights that must be refused.

#include <libdeflate.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "base/core.h"
#include "image/lpips.h"
#include "sparegs/runtime.h"
#include "support/bad_input.h"

enum { VGG, ALEX, HEADER = 24 };

// out, in, kernel of the convolutions and channels of the heads
static const int shapes[2][13][3] = {
    {{64, 3, 3},
     {64, 64, 3},
     {128, 64, 3},
     {128, 128, 3},
     {256, 128, 3},
     {256, 256, 3},
     {256, 256, 3},
     {512, 256, 3},
     {512, 512, 3},
     {512, 512, 3},
     {512, 512, 3},
     {512, 512, 3},
     {512, 512, 3}},
    {{64, 3, 11}, {192, 64, 5}, {384, 192, 3}, {256, 384, 3}, {256, 256, 3}}};
static const int counts[2] = {13, 5},
                 heads[2][5] = {{64, 128, 256, 512, 512}, {64, 192, 384, 256, 256}};

typedef struct bytes {
    uint8_t *data;
    size_t size;
} bytes;

static char path[64];

static void put_u32(bytes *b, uint32_t value)
{
    for (int k = 0; k < 4; ++k)
        b->data[b->size++] = (uint8_t)(value >> 8 * k);
}

static uint32_t random_state;

static double next_uniform(void)
{
    random_state = random_state * 1664525U + 1013904223U;
    return (random_state >> 8) / 16777216.0;
}

static void put_tensor(bytes *b, const uint32_t shape[4], double offset, double scale)
{
    size_t count = 1;
    for (int k = 0; k < 4; ++k) {
        put_u32(b, shape[k]);
        count *= shape[k];
    }
    for (size_t i = 0; i < count; ++i) {
        const double u = next_uniform();
        const float value = (float)(offset != 0 ? (2 * u - 1) * scale : u);
        uint32_t bits;
        memcpy(&bits, &value, sizeof bits);
        put_u32(b, bits);
    }
}

static void seal(bytes *b)
{
    const uint32_t crc = libdeflate_crc32(0, b->data + HEADER, b->size - HEADER);
    for (int k = 0; k < 4; ++k)
        b->data[20 + k] = (uint8_t)(crc >> 8 * k);
}

static bytes make_file(int network)
{
    bytes b = {malloc((size_t)64 << 20), 0};
    assert_non_null(b.data);
    memcpy(b.data, "SGSLPIPS", 8);
    b.size = 8;
    put_u32(&b, 1);
    put_u32(&b, (uint32_t)network);
    put_u32(&b, 2 * (uint32_t)counts[network] + 5);
    put_u32(&b, 0);
    random_state = 1;
    for (int i = 0; i < counts[network]; ++i) {
        const uint32_t out = (uint32_t)shapes[network][i][0], in = (uint32_t)shapes[network][i][1],
                       kernel = (uint32_t)shapes[network][i][2];
        put_tensor(&b, (uint32_t[]){out, in, kernel, kernel}, 1,
                   sqrt(6.0 / (in * kernel * kernel)));
        put_tensor(&b, (uint32_t[]){out, 1, 1, 1}, 1, 0.1);
    }
    for (int i = 0; i < 5; ++i)
        put_tensor(&b, (uint32_t[]){1, (uint32_t)heads[network][i], 1, 1}, 0, 1);
    seal(&b);
    return b;
}

static void write_file(const uint8_t *data, size_t size)
{
    FILE *stream = fopen(path, "wb");
    assert_non_null(stream);
    assert_int_equal(fwrite(data, 1, size, stream), size);
    assert_int_equal(fclose(stream), 0);
}

static sgs_lpips *read_network(int network)
{
    bytes b = make_file(network);
    sgs_lpips *lpips = NULL;
    write_file(b.data, b.size);
    assert_int_equal(sgs_lpips_read(path, &lpips), SGS_STATUS_OK);
    free(b.data);
    return lpips;
}

// The pictures of test_flip.c.
static sgs_image8 picture(int width, int height, bool changed)
{
    sgs_image8 image = {width, height, 3, sgsi_alloc(3, (size_t)width * (size_t)height)};
    for (int c = 0, i = 0; c < 3; ++c)
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x, ++i) {
                const int value =
                    (x * (3 + c) + y * (5 - c) + (x / 8 + y / 8) % 2 * 60 + x * y / (16 + c)) % 256;
                image.pixels[i] = (uint8_t)(changed ? value * (8 - c) / 10 : value);
            }
    return image;
}

static double measure(const sgs_lpips *lpips, sgs_lpips_input input, const sgs_image8 *a,
                      const sgs_image8 *b, const uint16_t *mask)
{
    double distance;
    assert_int_equal(sgs_lpips_distance(lpips, input, a, b, mask, &distance), SGS_STATUS_OK);
    return distance;
}

static void distances_agree_with_pytorch(void **state)
{
    (void)state;
    static const int sizes[2][2] = {{50, 37}, {33, 64}};
    static const double expected[2][2][2] = {
        {{0.0135317691, 0.5244142660}, {0.0126930781, 0.4650805727}},
        {{0.0120276000, 0.4081526617}, {0.0127581606, 0.3957842841}}};
    for (int network = 0; network < 2; ++network) {
        sgs_lpips *lpips = read_network(network);
        assert_string_equal(sgs_lpips_network(lpips), network ? "alex" : "vgg");
        for (int s = 0; s < 2; ++s) {
            sgs_image8 a = picture(sizes[s][0], sizes[s][1], false),
                       b = picture(sizes[s][0], sizes[s][1], true);
            for (int input = 0; input < 2; ++input) {
                const double value = measure(lpips, (sgs_lpips_input)input, &a, &b, NULL);
                const double error = fabs(value / expected[network][s][input] - 1);
                if (!(error <= 2e-6))
                    fail_msg("network %d, %dx%d, input %d: %.10f, expected %.10f", network,
                             sizes[s][0], sizes[s][1], input, value, expected[network][s][input]);
                assert_true(fabs(measure(lpips, (sgs_lpips_input)input, &b, &a, NULL) - value) <=
                            1e-12);
            }
            assert_true(measure(lpips, SGS_LPIPS_UNIT, &a, &a, NULL) == 0);
            sgs_image8_free(&a);
            sgs_image8_free(&b);
        }
        sgs_lpips_destroy(lpips);
    }
}

// Of four halvings (VGG), and of strides 4, 2, 2 with kernels 11, 3, 3 and 2 pixels of padding.
static void images_may_have_the_smallest_size(void **state)
{
    (void)state;
    for (int network = 0; network < 2; ++network) {
        sgs_lpips *lpips = read_network(network);
        const int smallest = network ? 31 : 16;
        assert_int_equal(sgs_lpips_min_size(lpips), smallest);
        for (int k = 0; k < 3; ++k) {
            const int width = smallest - (k == 1), height = smallest - (k == 2);
            sgs_image8 a = picture(width, height, false), b = picture(width, height, true);
            double distance = -1;
            const sgs_status status =
                sgs_lpips_distance(lpips, SGS_LPIPS_UNIT, &a, &b, NULL, &distance);
            assert_int_equal(status, k ? SGS_STATUS_INVALID_ARGUMENT : SGS_STATUS_OK);
            assert_true(k || (distance > 0 && isfinite(distance)));
            sgs_image8_free(&a);
            sgs_image8_free(&b);
        }
        sgs_lpips_destroy(lpips);
    }
}

static void bits_do_not_depend_on_threads_or_bands(void **state)
{
    (void)state;
    sgs_lpips *lpips = read_network(VGG);
    // So wide that the first blocks run in bands: the rows of the left part see the same pictures.
    sgs_image8 a = picture(300, 20, false), b = picture(300, 20, true);
    double value[3];
    for (int threads = 1; threads <= 3; ++threads) {
        sgs_threads_set(threads);
        value[threads - 1] = measure(lpips, SGS_LPIPS_UNIT, &a, &b, NULL);
    }
    assert_true(value[0] == value[1] && value[0] == value[2]);
    const size_t whole = sgsi_lpips_band_bytes;
    sgsi_lpips_band_bytes = 1 << 20; // 8 rows
    assert_true(measure(lpips, SGS_LPIPS_UNIT, &a, &b, NULL) == value[0]);
    sgsi_lpips_band_bytes = whole;
    sgs_threads_set(0);
    const sgs_isa isa = sgs_isa_get();
    for (int other = 0; other < SGS_ISA_COUNT; ++other)
        if (sgs_isa_supported((sgs_isa)other)) {
            assert_int_equal(sgs_isa_set((sgs_isa)other), SGS_STATUS_OK);
            const double found = measure(lpips, SGS_LPIPS_UNIT, &a, &b, NULL);
            assert_true(fabs(found / value[0] - 1) < (other == SGS_ISA_BASELINE ? 1e-5 : 1e-300));
        }
    sgs_isa_set(isa);
    sgs_image8_free(&a);
    sgs_image8_free(&b);
    sgs_lpips_destroy(lpips);
}

static void masked_pixels_have_no_influence(void **state)
{
    (void)state;
    enum { SIZE = 48, WORDS = 3 };
    sgs_lpips *lpips = read_network(ALEX);
    sgs_image8 a = picture(SIZE, SIZE, false), b = picture(SIZE, SIZE, true);
    uint16_t mask[WORDS * SIZE];
    memset(mask, 0xff, sizeof mask);
    const double all = measure(lpips, SGS_LPIPS_UNIT, &a, &b, NULL);
    assert_true(fabs(measure(lpips, SGS_LPIPS_UNIT, &a, &b, mask) / all - 1) < 1e-12);
    for (int y = 8; y < 40; ++y)
        mask[WORDS * y + 1] = 0; // pixels 16 to 31
    const double masked = measure(lpips, SGS_LPIPS_UNIT, &a, &b, mask);
    for (int y = 8; y < 40; ++y)
        for (int x = 16; x < 32; ++x)
            b.pixels[y * SIZE + x] ^= 0xff;
    assert_true(measure(lpips, SGS_LPIPS_UNIT, &a, &b, mask) == masked);
    assert_true(measure(lpips, SGS_LPIPS_UNIT, &a, &b, NULL) != masked);
    memset(mask, 0, sizeof mask);
    assert_true(isnan(measure(lpips, SGS_LPIPS_UNIT, &a, &b, mask)));
    sgs_image8 dot = {1, 1, 3, a.pixels};
    double distance;
    assert_int_equal(sgs_lpips_distance(lpips, SGS_LPIPS_UNIT, &dot, &dot, NULL, &distance),
                     SGS_STATUS_INVALID_ARGUMENT);
    assert_non_null(strstr(sgs_last_error(), "at least 31"));
    dot.width = SIZE;
    assert_int_equal(sgs_lpips_distance(lpips, SGS_LPIPS_UNIT, &a, &dot, NULL, &distance),
                     SGS_STATUS_INVALID_ARGUMENT);
    sgs_image8_free(&a);
    sgs_image8_free(&b);
    sgs_lpips_destroy(lpips);
}

static void refuse(const bytes *b, size_t size, const char *text)
{
    bad_input();
    sgs_lpips *lpips = (sgs_lpips *)1;
    write_file(b->data, size);
    assert_int_not_equal(sgs_lpips_read(path, &lpips), SGS_STATUS_OK);
    assert_null(lpips);
    if (!strstr(sgs_last_error(), text) || strchr(sgs_last_error(), '\n'))
        fail_msg("no '%s' in: %s", text, sgs_last_error());
}

static void put_float(bytes *b, size_t at, float value)
{
    memcpy(b->data + at, &value, sizeof value);
    seal(b);
}

static void bad_files_are_refused(void **state)
{
    (void)state;
    bytes b = make_file(ALEX);
    const size_t weights = HEADER + 16,
                 heads_at = b.size - 4 * (64 + 192 + 384 + 256 + 256) - 5 * 16;
    refuse(&b, 0, "not a file of LPIPS weights");
    refuse(&b, 20, "not a file of LPIPS weights");
    refuse(&b, b.size / 2, "truncated");
    refuse(&b, b.size + 4, "write it again");
    b.data[weights + 7] ^= 1;
    refuse(&b, b.size, "checksum");
    b.data[weights + 7] ^= 1;
    float kept;
    memcpy(&kept, b.data + weights + 400, sizeof kept);
    put_float(&b, weights + 400, NAN);
    refuse(&b, b.size, "value 100 of tensor 0 is not finite");
    put_float(&b, weights + 400, INFINITY);
    refuse(&b, b.size, "value 100 of tensor 0 is not finite");
    put_float(&b, weights + 400, kept);
    memcpy(&kept, b.data + heads_at + 16, sizeof kept);
    put_float(&b, heads_at + 16, -0.5F);
    refuse(&b, b.size, "value 0 of tensor 10 is negative");
    put_float(&b, heads_at + 16, kept);
    // The last two convolutions in the wrong order: 256 inputs instead of 384.
    const size_t fourth = weights - 16 + (16 + 4 * (64 * 363 + 64)) + 16 +
                          (16 + 4 * (192 * 1600 + 192)) + 16 + (16 + 4 * (384 * 1728 + 384)) + 16;
    b.data[fourth + 4] = 0;
    b.data[fourth + 5] = 1;
    seal(&b);
    refuse(&b, b.size, "tensor 6 has the shape 256x256x3x3, expected 256x384x3x3");
    b.data[12] = VGG;
    refuse(&b, b.size, "weights of vgg have 58");
    b.data[12] = 2;
    refuse(&b, b.size, "network 2");
    b.data[8] = 2;
    refuse(&b, b.size, "version 2");
    b.data[0] = 'X';
    refuse(&b, b.size, "not a file of LPIPS weights");
    free(b.data);
    sgs_lpips *lpips;
    assert_int_equal(sgs_lpips_read("/nonexistent/weights", &lpips), SGS_STATUS_IO);
    sgs_lpips_destroy(NULL);
}

static void failed_allocations_are_reported(void **state)
{
    (void)state;
    sgs_lpips *lpips = read_network(ALEX), *other;
    sgs_image8 a = picture(48, 48, false), b = picture(48, 48, true);
    double distance;
    int failures = 0;
    for (size_t n = 1; n < 200; ++n) {
        sgsi_fail_allocation(n);
        const sgs_status status =
            sgs_lpips_distance(lpips, SGS_LPIPS_UNIT, &a, &b, NULL, &distance);
        sgsi_fail_allocation(0);
        if (!status)
            break;
        assert_int_equal(status, SGS_STATUS_OUT_OF_MEMORY);
        assert_true(isnan(distance));
        ++failures;
    }
    assert_true(failures >= 20 && failures < 199);
    for (size_t n = 1; n <= 3; ++n) {
        sgsi_fail_allocation(n);
        assert_int_equal(sgs_lpips_read(path, &other), SGS_STATUS_OUT_OF_MEMORY);
        sgsi_fail_allocation(0);
        assert_null(other);
    }
    sgs_image8_free(&a);
    sgs_image8_free(&b);
    sgs_lpips_destroy(lpips);
}

static int remove_file(void **state)
{
    (void)state;
    return unlink(path);
}

// `test_lpips vgg|alex FILE` writes the generated weights, for the tests of the program.
int main(int argc, char **argv)
{
    if (argc == 3) {
        bytes b = make_file(strcmp(argv[1], "vgg") ? ALEX : VGG);
        snprintf(path, sizeof path, "%s", argv[2]);
        write_file(b.data, b.size);
        free(b.data);
        return 0;
    }
    const char *folder = getenv("TMPDIR");
    snprintf(path, sizeof path, "%.40s/lpips.%ld", folder ? folder : "/tmp", (long)getpid());
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(distances_agree_with_pytorch),
        cmocka_unit_test(images_may_have_the_smallest_size),
        cmocka_unit_test(bits_do_not_depend_on_threads_or_bands),
        cmocka_unit_test(masked_pixels_have_no_influence),
        cmocka_unit_test(bad_files_are_refused),
        cmocka_unit_test(failed_allocations_are_reported),
    };
    return cmocka_run_group_tests(tests, NULL, remove_file);
}
