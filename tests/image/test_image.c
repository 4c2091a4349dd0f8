// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Photos: all pixel formats become 8-bit RGB or RGBA, broken and oversized files are rejected,
// area averaging is exact, and PNG files round-trip bit by bit.

#include <fcntl.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <pthread.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "image/image_oiio.h"
#include "support/bad_input.h"
#include "support/scene_support.h"

// Reads a one-pixel image and compares.
static void assert_pixel(const temp_folder *folder, const char *name, int channels,
                         const uint8_t *expected)
{
    sgs_image8 image;
    int width, height;
    if (sgs_image8_read(temp_path(folder, name), &image))
        fail_msg("%s", sgs_last_error());
    assert_int_equal(sgs_image8_probe(temp_path(folder, name), &width, &height), SGS_STATUS_OK);
    assert_true(image.width == 1 && image.height == 1 && width == 1 && height == 1);
    assert_int_equal(image.channels, channels);
    for (int c = 0; c < channels; ++c) {
        if (image.pixels[c] != expected[c])
            fail_msg("%s: channel %d is %d instead of %d", name, c, image.pixels[c], expected[c]);
    }
    sgs_image8_free(&image);
    assert_null(image.pixels);
}

static pthread_barrier_t all_start;

static void *read_misnamed(void *path)
{
    sgs_image8 image;
    pthread_barrier_wait(&all_start);
    if (sgs_image8_read(path, &image))
        return path;
    sgs_image8_free(&image);
    return NULL;
}

// The first files that a process reads, in parallel. In 1 to 4 % of the processes OpenImageIO 2.4
// had not registered all formats before the second thread looked for one.
static void misnamed_images_are_read_by_content_on_several_threads(void **state)
{
    (void)state;
    enum { PROCESSES = 120, THREADS = 3 };
    static const uint8_t png[] = {
        0x89, 0x50, 0x4E, 0x47, 0x0D, 0x0A, 0x1A, 0x0A, 0x00, 0x00, 0x00, 0x0D, 0x49, 0x48,
        0x44, 0x52, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x00, 0x01, 0x08, 0x02, 0x00, 0x00,
        0x00, 0x90, 0x77, 0x53, 0xDE, 0x00, 0x00, 0x00, 0x0C, 0x49, 0x44, 0x41, 0x54, 0x78,
        0x9C, 0x63, 0x60, 0x64, 0x62, 0x06, 0x00, 0x00, 0x0E, 0x00, 0x07, 0xD7, 0x6F, 0xE4,
        0x78, 0x00, 0x00, 0x00, 0x00, 0x49, 0x45, 0x4E, 0x44, 0xAE, 0x42, 0x60, 0x82}; // 1 x 1
    const temp_folder folder = temp_folder_make();
    char path[512];
    snprintf(path, sizeof path, "%s", temp_path(&folder, "photo.jpg"));
    file_put(path, png, sizeof png);
    for (int k = 0; k < PROCESSES; ++k) {
        const pid_t child = fork();
        assert_true(child >= 0);
        if (!child) {
            pthread_t threads[THREADS];
            bool failed = pthread_barrier_init(&all_start, NULL, THREADS) != 0;
            for (int t = 0; t < THREADS; ++t)
                failed |= pthread_create(&threads[t], NULL, read_misnamed, path) != 0;
            for (int t = 0; t < THREADS && !failed; ++t) {
                void *unread;
                pthread_join(threads[t], &unread);
                failed |= unread != NULL;
            }
            _exit(failed);
        }
        int status = -1;
        assert_int_equal(waitpid(child, &status, 0), child);
        assert_int_equal(status, 0);
    }
    temp_folder_remove(&folder);
}

// Straight alpha, encoded by OpenJPEG and libwebp (ffmpeg -c:v libopenjpeg, libwebp -lossless 1).
// OpenImageIO does not say whether it has premultiplied the colours of these formats.
static void straight_alpha_is_read_from_jpeg2000_and_webp(void **state)
{
    (void)state;
    static const uint8_t expected[4] = {200, 100, 50, 128};
    static const uint8_t jp2[] = {
        0x00, 0x00, 0x00, 0x0c, 0x6a, 0x50, 0x20, 0x20, 0x0d, 0x0a, 0x87, 0x0a, 0x00, 0x00, 0x00,
        0x14, 0x66, 0x74, 0x79, 0x70, 0x6a, 0x70, 0x32, 0x20, 0x00, 0x00, 0x00, 0x00, 0x6a, 0x70,
        0x32, 0x20, 0x00, 0x00, 0x00, 0x2d, 0x6a, 0x70, 0x32, 0x68, 0x00, 0x00, 0x00, 0x16, 0x69,
        0x68, 0x64, 0x72, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x00, 0x01, 0x00, 0x04, 0x07, 0x07,
        0x00, 0x00, 0x00, 0x00, 0x00, 0x0f, 0x63, 0x6f, 0x6c, 0x72, 0x01, 0x00, 0x00, 0x00, 0x00,
        0x00, 0x10, 0x00, 0x00, 0x00, 0x99, 0x6a, 0x70, 0x32, 0x63, 0xff, 0x4f, 0xff, 0x51, 0x00,
        0x32, 0x00, 0x00, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x00, 0x00,
        0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x00,
        0x00, 0x00, 0x00, 0x00, 0x00, 0x00, 0x04, 0x07, 0x01, 0x01, 0x07, 0x01, 0x01, 0x07, 0x01,
        0x01, 0x07, 0x01, 0x01, 0xff, 0x52, 0x00, 0x0c, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x04,
        0x04, 0x00, 0x01, 0xff, 0x5c, 0x00, 0x04, 0x40, 0x40, 0xff, 0x64, 0x00, 0x25, 0x00, 0x01,
        0x43, 0x72, 0x65, 0x61, 0x74, 0x65, 0x64, 0x20, 0x62, 0x79, 0x20, 0x4f, 0x70, 0x65, 0x6e,
        0x4a, 0x50, 0x45, 0x47, 0x20, 0x76, 0x65, 0x72, 0x73, 0x69, 0x6f, 0x6e, 0x20, 0x32, 0x2e,
        0x35, 0x2e, 0x30, 0xff, 0x90, 0x00, 0x0a, 0x00, 0x00, 0x00, 0x00, 0x00, 0x1e, 0x00, 0x01,
        0xff, 0x93, 0xcf, 0xb4, 0x08, 0x04, 0x4f, 0xc3, 0xe7, 0x04, 0x09, 0x6f, 0xcf, 0xb4, 0x08,
        0x06, 0xcf, 0x80, 0xff, 0xd9};
    static const uint8_t webp[] = {0x52, 0x49, 0x46, 0x46, 0x1e, 0x00, 0x00, 0x00, 0x57, 0x45,
                                   0x42, 0x50, 0x56, 0x50, 0x38, 0x4c, 0x11, 0x00, 0x00, 0x00,
                                   0x2f, 0x00, 0x00, 0x00, 0x10, 0x07, 0x50, 0xb2, 0x22, 0x57,
                                   0xa6, 0x80, 0x81, 0x88, 0xe8, 0x7f, 0x00, 0x00};
    const temp_folder folder = temp_folder_make();
    tree_put(&folder, "a.jp2", (const char *)jp2, sizeof jp2);
    assert_pixel(&folder, "a.jp2", 4, expected);
    // OpenImageIO premultiplies 8 bits: red is 100 / 128, rounded.
    tree_put(&folder, "a.webp", (const char *)webp, sizeof webp);
    assert_pixel(&folder, "a.webp", 4, (const uint8_t[]){199, 100, 50, 128});
    tree_put(&folder, "misnamed.png", (const char *)webp, sizeof webp);
    assert_pixel(&folder, "misnamed.png", 4, (const uint8_t[]){199, 100, 50, 128});
    tree_remove(&folder);
}

static void all_pixel_formats_become_eight_bit_rgb(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const uint8_t bytes[4] = {200, 100, 50, 128};
    const uint16_t words[4] = {200 * 257, 100 * 257 + 127, 100 * 257 + 129, 128 * 257};
    const float floats[3] = {0.5f, 0.0f, 7.0f}, odd_floats[3] = {-1.0f, 0.0021404f, 1.0f};
    tiff_put(&folder, "rgb.tif", &(tiff){1, 1, 3, 8, 2, 1, 0}, bytes, 3);
    assert_pixel(&folder, "rgb.tif", 3, bytes);
    tiff_put(&folder, "grey.tif", &(tiff){1, 1, 1, 8, 1, 1, 0}, bytes, 1);
    assert_pixel(&folder, "grey.tif", 3, (const uint8_t[]){200, 200, 200});
    tiff_put(&folder, "grey_alpha.tif", &(tiff){1, 1, 2, 8, 1, 1, 2}, bytes, 2);
    assert_pixel(&folder, "grey_alpha.tif", 4, (const uint8_t[]){200, 200, 200, 100});
    tiff_put(&folder, "straight.tif", &(tiff){1, 1, 4, 8, 2, 1, 2}, bytes, 4);
    assert_pixel(&folder, "straight.tif", 4, bytes);
    tiff_put(&folder, "associated.tif", &(tiff){1, 1, 4, 8, 2, 1, 1},
             (const uint8_t[]){100, 50, 25, 128}, 4);
    assert_pixel(&folder, "associated.tif", 4, (const uint8_t[]){199, 100, 50, 128});
    tiff_put(&folder, "rgb16.tif", &(tiff){1, 1, 3, 16, 2, 1, 0}, words, 6);
    assert_pixel(&folder, "rgb16.tif", 3, (const uint8_t[]){200, 100, 101});
    // CMYK 20 % 60 % 0 %, 50 % black.
    tiff_put(&folder, "cmyk.tif", &(tiff){1, 1, 4, 8, 5, 1, 0}, (const uint8_t[]){51, 153, 0, 128},
             4);
    assert_pixel(&folder, "cmyk.tif", 3, (const uint8_t[]){102, 51, 127});
    // Linear light is encoded as sRGB: 0.5 -> 0.7354.
    tiff_put(&folder, "float.tif", &(tiff){1, 1, 3, 32, 2, 3, 0}, floats, 12);
    assert_pixel(&folder, "float.tif", 3, (const uint8_t[]){188, 0, 255});
    tiff_put(&folder, "odd.tif", &(tiff){1, 1, 3, 32, 2, 3, 0}, odd_floats, 12);
    assert_pixel(&folder, "odd.tif", 3, (const uint8_t[]){0, 7, 255});
    tree_put(&folder, "grey.pgm", "P5\n1 1\n255\n\x42", 12);
    assert_pixel(&folder, "grey.pgm", 3, (const uint8_t[]){0x42, 0x42, 0x42});
    tree_remove(&folder);
}

// A PNG file with the gamma of sRGB in its chunk gAMA, and without a chunk sRGB, is in sRGB.
static void gamma_of_srgb_is_srgb(void **state)
{
    (void)state;
    static const uint8_t red[3] = {250, 120, 10}, chunk[] = {0, 0, 0, 1, 's', 'R', 'G', 'B'};
    const temp_folder folder = temp_folder_make();
    sgsi_image_info info;
    tree_put_picture(&folder, "a.png", 4, 3, 3, red);
    size_t size;
    unsigned char *bytes = file_get(temp_path(&folder, "a.png"), &size);
    assert_memory_equal(bytes + 33 + 4, "gAMA\0\0\xb1\x8f", 8); // 0.45455
    unsigned char *at = memmem(bytes, size, chunk, sizeof chunk);
    assert_non_null(at);
    memmove(at, at + 13, (size_t)(bytes + size - at - 13));
    file_put(temp_path(&folder, "a.png"), bytes, size - 13);
    free(bytes);
    assert_int_equal(sgsi_oiio_describe(temp_path(&folder, "a.png"), NULL, &info), SGS_STATUS_OK);
    assert_true(info.bytes && !info.linear);
    tree_remove(&folder);
}

// OpenImageIO takes "?b.png" for options of its reader.
static void names_with_question_marks_are_read(void **state)
{
    (void)state;
    static const uint8_t color[3] = {250, 120, 10};
    static const char *const names[] = {"a?b.png", "a?b=1&c=2.png", "what?/a.png", "png?",
                                        "misnamed?.jpg"};
    const temp_folder folder = temp_folder_make();
    tree_put_picture(&folder, "a.png", 1, 1, 3, color);
    size_t size;
    unsigned char *bytes = file_get(temp_path(&folder, "a.png"), &size);
    for (size_t k = 0; k < sizeof names / sizeof *names; ++k) {
        tree_put(&folder, names[k], bytes, size);
        assert_pixel(&folder, names[k], 3, color);
    }
    sgs_image8 image;
    tree_put_text(&folder, "a?.png", "no image");
    assert_int_equal(sgs_image8_read(temp_path(&folder, "a?.png"), &image), SGS_STATUS_FORMAT);
    assert_holds(sgs_last_error(), "a?.png: cannot read the image: no reader of OpenImageIO "
                                   "recognises its format");
    bad_input();
    free(bytes);
    tree_remove(&folder);
}

static void palettes_are_expanded(void **state)
{
    (void)state;
    static buffer b;
    const temp_folder folder = temp_folder_make();
    const uint32_t colors = 256, start = 14 + 40 + 4 * colors;
    b.size = 0;
    put_bytes(&b, "BM", 2);
    put_integer(&b, start + 4, 4);
    put_integer(&b, 0, 4);
    put_integer(&b, start, 4);
    const uint32_t header[10] = {40, 1, 1, 8 << 16 | 1, 0, 4, 2835, 2835, colors, 0};
    for (int i = 0; i < 10; ++i)
        put_integer(&b, header[i], 4);
    for (uint32_t i = 0; i < colors; ++i)
        put_integer(&b, i << 16 | (255 - i) << 8 | 7, 4);
    put_integer(&b, 200, 4); // the pixel and its padding
    tree_put(&folder, "palette.bmp", b.data, b.size);
    assert_pixel(&folder, "palette.bmp", 3, (const uint8_t[]){200, 55, 7});
    tree_remove(&folder);
}

static void photos_keep_rows_and_planes(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    enum { WIDTH = 37, HEIGHT = 131 }; // more than two slabs of rows
    static buffer b;
    b.size = 0;
    put_text(&b, "P6\n%d %d\n255\n", WIDTH, HEIGHT);
    for (uint64_t i = 0; i < WIDTH * HEIGHT * 3; ++i)
        put_integer(&b, sgsi_random_bits(5, i) & 255, 1);
    tree_put(&folder, "noise.ppm", b.data, b.size);
    sgs_image8 image;
    assert_int_equal(sgs_image8_read(temp_path(&folder, "noise.ppm"), &image), SGS_STATUS_OK);
    assert_true(image.width == WIDTH && image.height == HEIGHT && image.channels == 3);
    assert_int_equal((uintptr_t)image.pixels % 64, 0);
    for (uint64_t i = 0; i < WIDTH * HEIGHT; ++i) {
        for (uint64_t c = 0; c < 3; ++c)
            assert_int_equal(image.pixels[c * WIDTH * HEIGHT + i],
                             sgsi_random_bits(5, 3 * i + c) & 255);
    }
    sgs_image8_free(&image);
    tree_remove(&folder);
}

static void png_round_trips_bit_by_bit(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    static const int channel_counts[] = {1, 3, 4};
    enum { WIDTH = 19, HEIGHT = 70 };
    uint8_t pixels[4 * WIDTH * HEIGHT];
    for (uint64_t i = 0; i < sizeof pixels; ++i)
        pixels[i] = (uint8_t)sgsi_random_bits(6, i); // with alpha 0: its colour must be kept
    pixels[3 * WIDTH * HEIGHT] = 0;
    for (int k = 0; k < 3; ++k) {
        const sgs_image8 image = {WIDTH, HEIGHT, channel_counts[k], pixels};
        sgs_image8 back;
        assert_int_equal(sgs_png_write(temp_path(&folder, "a.png"), &image), SGS_STATUS_OK);
        assert_int_equal(sgs_image8_read(temp_path(&folder, "a.png"), &back), SGS_STATUS_OK);
        assert_int_equal(back.channels, channel_counts[k] == 1 ? 3 : channel_counts[k]);
        for (int c = 0; c < back.channels; ++c) {
            const size_t plane = channel_counts[k] == 1 ? 0 : (size_t)c;
            assert_memory_equal(back.pixels + c * WIDTH * HEIGHT, pixels + plane * WIDTH * HEIGHT,
                                WIDTH * HEIGHT);
        }
        sgs_image8_free(&back);
    }
    assert_int_equal(temp_folder_count(&folder), 1); // no temporary file left
    tree_remove(&folder);
}

static void png_write_failure_keeps_the_old_file(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    enum { SIDE = 120 };
    static uint8_t pixels[3 * SIDE * SIDE];
    for (uint64_t i = 0; i < sizeof pixels; ++i)
        pixels[i] = (uint8_t)sgsi_random_bits(7, i);
    const sgs_image8 image = {SIDE, SIDE, 3, pixels};
    file_put(temp_path(&folder, "a.png"), "earlier", 7);
    files_limited(1000);
    const sgs_status status = sgs_png_write(temp_path(&folder, "a.png"), &image);
    files_unlimited();
    assert_int_equal(status, SGS_STATUS_IO);
    assert_holds(sgs_last_error(), "a.png: cannot be written");
    size_t size;
    unsigned char *bytes = file_get(temp_path(&folder, "a.png"), &size);
    assert_int_equal(size, 7);
    free(bytes);
    assert_int_equal(temp_folder_count(&folder), 1);
    assert_int_equal(sgs_png_write(temp_path(&folder, "none/a.png"), &image), SGS_STATUS_IO);
    assert_holds(sgs_last_error(), "none/a.png: cannot be written");
    tree_remove(&folder);
}

static void png_rejects_unsupported_images(void **state)
{
    (void)state;
    uint8_t pixels[8] = {0};
    const sgs_image8 wrong[] = {{1, 1, 2, pixels},
                                {1, 1, 5, pixels},
                                {0, 1, 3, pixels},
                                {1, 0, 3, pixels},
                                {1, 1, 3, NULL}};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; ++i) {
        assert_int_equal(sgs_png_write("/nowhere/a.png", &wrong[i]), SGS_STATUS_INVALID_ARGUMENT);
        assert_holds(sgs_last_error(), "/nowhere/a.png: ");
        assert_holds(sgs_last_error(), "PNG");
    }
}

static void broken_files_are_rejected_by_name(void **state)
{
    (void)state;
    static const struct {
        const char *name, *content;
        sgs_status status;
        const char *message;
    } cases[] = {
        {"empty.jpg", "", SGS_STATUS_FORMAT, "empty.jpg: cannot read the image: "},
        {"text.png", "this is no picture", SGS_STATUS_FORMAT, "text.png: cannot read the image: "},
        {"text.xyz", "neither is this", SGS_STATUS_FORMAT, "text.xyz: cannot read the image: "},
        {"none", "", SGS_STATUS_FORMAT, "none: cannot read the image: "},
        {"wide.pgm", "P5\n100000 1\n255\n", SGS_STATUS_LIMIT,
         "wide.pgm: 100000 x 1 pixels exceed the limit of 65536"},
        {"many.pgm", "P5\n60000 60000\n255\n", SGS_STATUS_LIMIT,
         "many.pgm: 60000 x 60000 pixels exceed the limit of"},
    };
    const temp_folder folder = temp_folder_make();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        sgs_image8 image = {.pixels = (uint8_t *)1};
        int width, height;
        tree_put_text(&folder, cases[i].name, cases[i].content);
        assert_int_equal(sgs_image8_read(temp_path(&folder, cases[i].name), &image),
                         cases[i].status);
        assert_holds(sgs_last_error(), cases[i].message);
        bad_input();
        assert_null(strchr(sgs_last_error(), '\n'));
        assert_null(image.pixels);
        assert_int_equal(sgs_image8_probe(temp_path(&folder, cases[i].name), &width, &height),
                         cases[i].status);
    }
    sgs_image8 image;
    assert_int_equal(sgs_image8_read(temp_path(&folder, "missing.png"), &image), SGS_STATUS_IO);
    assert_holds(sgs_last_error(), "missing.png: no such file");
    bad_input();
    assert_int_equal(sgs_image8_read(folder.path, &image), SGS_STATUS_IO);
    assert_holds(sgs_last_error(), ": is not a regular file");
    bad_input();
    tree_remove(&folder);
}

// libpng prints its errors: damaged files do not reach it. A changed bit of any byte, up to the
// last chunk, is refused, except in chunks that libpng may ignore.
static void damaged_png_files_are_refused_silently(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    enum { SIDE = 12 };
    static uint8_t pixels[3 * SIDE * SIDE];
    for (uint64_t i = 0; i < sizeof pixels; ++i)
        pixels[i] = (uint8_t)sgsi_random_bits(8, i);
    char path[512];
    snprintf(path, sizeof path, "%s", temp_path(&folder, "a.png"));
    assert_int_equal(sgs_png_write(path, &(sgs_image8){SIDE, SIDE, 3, pixels}), SGS_STATUS_OK);
    size_t size, refused = 0, begin = 0;
    unsigned char *bytes = file_get(path, &size);
    const unsigned char *data = memmem(bytes, size, "IDAT", 4);
    const unsigned char *end = memmem(data, (size_t)(bytes + size - data), "IEND", 4);
    const int terminal = dup(2),
              log = open(temp_path(&folder, "log"), O_RDWR | O_CREAT | O_TRUNC, 0600);
    assert_true(terminal >= 0 && log >= 0);
    dup2(log, 2);
    for (size_t at = 4; at < (size_t)(end - bytes) - 4; ++at) {
        sgs_image8 image;
        bytes[at] ^= (unsigned char)(1 << at % 8);
        file_put(path, bytes, size);
        bytes[at] ^= (unsigned char)(1 << at % 8);
        const sgs_status status = sgs_image8_read(path, &image);
        sgs_image8_free(&image);
        begin += status == SGS_STATUS_FORMAT && at < 33; // signature and IHDR
        refused += status == SGS_STATUS_FORMAT && at >= (size_t)(data - bytes) - 4;
    }
    dup2(terminal, 2);
    assert_int_equal(lseek(log, 0, SEEK_END), 0);
    assert_int_equal(begin, 29);
    assert_int_equal(refused, end - data);
    bytes[40 + (size_t)(data - bytes)] ^= 1;
    file_put(path, bytes, size);
    sgs_image8 image;
    char message[64];
    snprintf(message, sizeof message, "a.png: byte %zu: the image file is damaged; copy it again",
             (size_t)(data - bytes) - 4);
    assert_int_equal(sgs_image8_read(path, &image), SGS_STATUS_FORMAT);
    assert_holds(sgs_last_error(), message);
    close(terminal);
    close(log);
    free(bytes);
    tree_remove(&folder);
}

// libjpeg fills the missing part of a truncated image with grey. Reading only its size fails as
// well, so that the number of usable views does not depend on whether pixels are loaded.
static void truncated_images_are_rejected(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    enum { SIDE = 40 };
    static uint8_t pixels[3 * SIDE * SIDE];
    for (uint64_t i = 0; i < sizeof pixels; ++i)
        pixels[i] = (uint8_t)sgsi_random_bits(8, i);
    assert_int_equal(
        sgs_png_write(temp_path(&folder, "whole.png"), &(sgs_image8){SIDE, SIDE, 3, pixels}),
        SGS_STATUS_OK);
    const char *const sources[] = {temp_path(&folder, "whole.png"),
                                   SGSI_TEST_DATA "/room/images/0001.jpg"};
    const char *const names[] = {"cut.png", "cut.jpg"};
    for (int k = 0; k < 2; ++k) {
        size_t size;
        unsigned char *bytes = file_get(sources[k], &size);
        for (size_t cut = 0; cut < 40; ++cut) {
            sgs_image8 image;
            file_put(temp_path(&folder, names[k]), bytes, size * cut / 40);
            int width, height;
            assert_int_equal(sgs_image8_probe(temp_path(&folder, names[k]), &width, &height),
                             SGS_STATUS_FORMAT);
            if (sgs_image8_read(temp_path(&folder, names[k]), &image) != SGS_STATUS_FORMAT)
                fail_msg("%s with %zu of 40 parts is accepted", names[k], cut);
            assert_holds(sgs_last_error(), names[k]);
        }
        sgs_image8 image;
        // Cameras append previews and videos.
        const unsigned char appended[] = {0xff, 0xd8, 1, 2, 3};
        buffer *b = calloc(1, sizeof *b);
        put_bytes(b, bytes, size);
        put_bytes(b, appended, sizeof appended);
        file_put(temp_path(&folder, names[k]), b->data, b->size);
        assert_int_equal(sgs_image8_read(temp_path(&folder, names[k]), &image), SGS_STATUS_OK);
        sgs_image8_free(&image);
        free(b);
        free(bytes);
    }
    tree_remove(&folder);
}

// ---- Area averaging -----------------------------------------------------------------------------

// The definition in double precision: integral of the piecewise constant image over each output
// rectangle.
static double area_average(const uint8_t *plane, int width, int height, int out_width,
                           int out_height, int i, int j)
{
    const double x0 = (double)i * width / out_width, x1 = (double)(i + 1) * width / out_width;
    const double y0 = (double)j * height / out_height, y1 = (double)(j + 1) * height / out_height;
    double sum = 0;
    for (int y = (int)y0; y < height && y < y1; ++y) {
        for (int x = (int)x0; x < width && x < x1; ++x)
            sum += plane[y * width + x] * (fmin(x + 1, x1) - fmax(x, x0)) *
                   (fmin(y + 1, y1) - fmax(y, y0));
    }
    return sum / ((x1 - x0) * (y1 - y0));
}

static void downscaling_is_the_area_average(void **state)
{
    (void)state;
    static const int sizes[][4] = {
        {8, 6, 4, 3},     {9, 7, 4, 3},  {31, 17, 13, 17}, {16, 9, 16, 9}, {5, 5, 1, 1},
        {40, 30, 39, 29}, {3, 50, 1, 7}, {36, 30, 12, 10}, {32, 32, 2, 2}, {34, 34, 2, 2}};
    uint8_t pixels[3 * 40 * 40];
    for (uint64_t i = 0; i < sizeof pixels; ++i)
        pixels[i] = (uint8_t)sgsi_random_bits(9, i);
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; ++k) {
        const int *s = sizes[k];
        const sgs_image8 image = {s[0], s[1], 3, pixels};
        sgs_image8 out;
        assert_int_equal(sgs_image8_downscale(&image, s[2], s[3], &out), SGS_STATUS_OK);
        assert_true(out.width == s[2] && out.height == s[3] && out.channels == 3);
        for (int i = 0; i < 3 * s[2] * s[3]; ++i) {
            const int plane = i / (s[2] * s[3]), at = i % (s[2] * s[3]);
            const double exact = area_average(pixels + plane * s[0] * s[1], s[0], s[1], s[2], s[3],
                                              at % s[2], at / s[2]);
            assert_true(fabs(out.pixels[i] - exact) <= 0.5 + 1e-9);
        }
        sgs_image8_free(&out);
    }
}

static void downscaling_keeps_a_constant_image(void **state)
{
    (void)state;
    static uint8_t pixels[4 * 61 * 47];
    memset(pixels, 255, sizeof pixels);
    const sgs_image8 image = {61, 47, 4, pixels};
    sgs_image8 out;
    assert_int_equal(sgs_image8_downscale(&image, 23, 11, &out), SGS_STATUS_OK);
    for (int i = 0; i < 4 * 23 * 11; ++i)
        assert_int_equal(out.pixels[i], 255);
    sgs_image8_free(&out);
}

static void colour_under_transparent_pixels_does_not_bleed(void **state)
{
    (void)state;
    // Left pixel opaque (200, 100, 0), right pixel transparent white; below, two transparent ones.
    uint8_t pixels[] = {200, 255, 9, 9, 100, 255, 9, 9, 0, 255, 9, 9, 255, 0, 0, 0};
    const sgs_image8 image = {2, 2, 4, pixels};
    sgs_image8 out;
    assert_int_equal(sgs_image8_downscale(&image, 1, 2, &out), SGS_STATUS_OK);
    const uint8_t expected[] = {200, 0, 100, 0, 0, 0, 128, 0};
    assert_memory_equal(out.pixels, expected, sizeof expected);
    sgs_image8_free(&out);
}

static void upscaling_is_rejected(void **state)
{
    (void)state;
    uint8_t pixels[12] = {0};
    const sgs_image8 image = {2, 2, 3, pixels};
    static const int sizes[][2] = {{3, 2}, {2, 3}, {0, 1}, {1, 0}, {-1, 1}};
    for (int i = 0; i < 5; ++i) {
        sgs_image8 out = {.pixels = (uint8_t *)1};
        assert_int_equal(sgs_image8_downscale(&image, sizes[i][0], sizes[i][1], &out),
                         SGS_STATUS_INVALID_ARGUMENT);
        assert_holds(sgs_last_error(), "cannot reduce an image of 2 x 2 pixels to");
        assert_null(out.pixels);
    }
}

static void failing_allocations_are_reported(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    const uint8_t color[3] = {1, 2, 3};
    tree_put_picture(&folder, "a.png", 8, 8, 3, color);
    sgs_image8 image, out;
    sgsi_fail_allocation(1);
    assert_int_equal(sgs_image8_read(temp_path(&folder, "a.png"), &image),
                     SGS_STATUS_OUT_OF_MEMORY);
    assert_null(image.pixels);
    assert_int_equal(sgs_image8_read(temp_path(&folder, "a.png"), &image), SGS_STATUS_OK);
    for (size_t n = 1; n <= 2; ++n) {
        sgsi_fail_allocation(n);
        assert_int_equal(sgs_image8_downscale(&image, 4, 4, &out), SGS_STATUS_OUT_OF_MEMORY);
        sgsi_fail_allocation(n);
        assert_int_equal(sgs_png_write(temp_path(&folder, "b.png"), &image),
                         SGS_STATUS_OUT_OF_MEMORY);
    }
    sgsi_fail_allocation(0);
    sgs_image8_free(&image);
    assert_int_equal(temp_folder_count(&folder), 1);
    tree_remove(&folder);
}

// IEC 61966-2-1 in double precision; outside of [0, 1], its two branches continue.
static void srgb_is_the_transfer_function_of_the_standard(void **state)
{
    (void)state;
    for (int i = -200; i <= 1200; ++i) {
        const double encoded = i * 0.00125, linear = encoded <= 0.04045
                                                         ? encoded / 12.92
                                                         : pow((encoded + 0.055) / 1.055, 2.4);
        const double scale = fabs(linear) + 1e-3;
        assert_true(fabs((double)sgs_srgb_decode((float)encoded) - linear) <= 1e-6 * scale);
        assert_true(fabs((double)sgs_srgb_encode((float)linear) - encoded) <= 2e-6);
    }
    assert_true(fabs((double)sgs_srgb_decode(0.5f) - 0.21404114048223255) < 1e-7);
    assert_true(sgs_srgb_decode(0) == 0 && sgs_srgb_decode(1) == 1);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        // first: the children need an OpenImageIO that has not been used
        cmocka_unit_test(misnamed_images_are_read_by_content_on_several_threads),
        cmocka_unit_test(all_pixel_formats_become_eight_bit_rgb),
        cmocka_unit_test(straight_alpha_is_read_from_jpeg2000_and_webp),
        cmocka_unit_test(gamma_of_srgb_is_srgb),
        cmocka_unit_test(srgb_is_the_transfer_function_of_the_standard),
        cmocka_unit_test(names_with_question_marks_are_read),
        cmocka_unit_test(palettes_are_expanded),
        cmocka_unit_test(photos_keep_rows_and_planes),
        cmocka_unit_test(png_round_trips_bit_by_bit),
        cmocka_unit_test(png_write_failure_keeps_the_old_file),
        cmocka_unit_test(png_rejects_unsupported_images),
        cmocka_unit_test(broken_files_are_rejected_by_name),
        cmocka_unit_test(truncated_images_are_rejected),
        cmocka_unit_test(damaged_png_files_are_refused_silently),
        cmocka_unit_test(downscaling_is_the_area_average),
        cmocka_unit_test(downscaling_keeps_a_constant_image),
        cmocka_unit_test(colour_under_transparent_pixels_does_not_bleed),
        cmocka_unit_test(upscaling_is_rejected),
        cmocka_unit_test(failing_allocations_are_reported),
    };
    return cmocka_run_group_tests_name("image", tests, NULL, NULL);
}
