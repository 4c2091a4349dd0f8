// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// PNG in memory is read back by OpenImageIO without a difference, JPEG with a small one.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "support/files_support.h"
#include "viewer/frame_encoder.h"

static temp_folder folder;

static sgs_image8 test_image(int width, int height, bool noisy)
{
    const size_t pixels = (size_t)width * (size_t)height;
    sgs_image8 image = {width, height, 3, malloc(3 * pixels)};
    uint32_t random = 1;
    assert_non_null(image.pixels);
    for (size_t i = 0; i < 3 * pixels; ++i) {
        random = random * 1664525 + 1013904223;
        image.pixels[i] =
            noisy ? (uint8_t)(random >> 24)
                  : (uint8_t)((i % pixels % (size_t)width + i % pixels / (size_t)width) * 255 /
                              (size_t)(width + height));
    }
    return image;
}

static sgs_image8 decode(const encoded_picture *picture, const char *name)
{
    const char *path = temp_path(&folder, name);
    sgs_image8 image;
    FILE *file = fopen(path, "wb");
    assert_non_null(file);
    assert_int_equal(fwrite(picture->bytes, 1, picture->size, file), picture->size);
    assert_int_equal(fclose(file), 0);
    assert_int_equal(sgs_image8_read(path, &image), SGS_STATUS_OK);
    return image;
}

static void png_is_lossless(void **state)
{
    (void)state;
    static const int sizes[][2] = {{1, 1}, {1, 9}, {17, 3}, {160, 120}};
    for (size_t k = 0; k < 2 * sizeof sizes / sizeof *sizes; ++k) {
        sgs_image8 image = test_image(sizes[k / 2][0], sizes[k / 2][1], k % 2);
        encoded_picture picture;
        assert_true(encode_png(&image, &picture));
        sgs_image8 read = decode(&picture, "a.png");
        assert_int_equal(read.width, image.width);
        assert_int_equal(read.height, image.height);
        assert_memory_equal(read.pixels, image.pixels,
                            3 * (size_t)image.width * (size_t)image.height);
        sgs_image8_free(&read);
        encoded_picture_free(&picture);
        free(image.pixels);
    }
}

static void jpeg_is_similar(void **state)
{
    (void)state;
    sgs_image8 image = test_image(160, 120, false);
    encoded_picture picture;
    assert_true(encode_jpeg(&image, 90, &picture));
    sgs_image8 read = decode(&picture, "a.jpg");
    assert_int_equal(read.width, 160);
    assert_int_equal(read.height, 120);
    for (size_t i = 0; i < (size_t)3 * 160 * 120; ++i)
        assert_true(abs(read.pixels[i] - image.pixels[i]) <= 12);
    sgs_image8_free(&read);
    encoded_picture_free(&picture);
    free(image.pixels);
}

static void other_images_are_refused(void **state)
{
    (void)state;
    uint8_t pixels[4] = {0};
    encoded_picture picture;
    assert_false(encode_png(&(sgs_image8){1, 1, 4, pixels}, &picture));
    assert_false(encode_jpeg(&(sgs_image8){1, 1, 1, pixels}, 90, &picture));
    assert_false(encode_jpeg(&(sgs_image8){0, 1, 3, pixels}, 90, &picture));
    assert_null(picture.bytes);
}

static int open_folder(void **state)
{
    (void)state;
    folder = temp_folder_make();
    return 0;
}

static int close_folder(void **state)
{
    (void)state;
    temp_folder_remove(&folder);
    return 0;
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(png_is_lossless),
        cmocka_unit_test(jpeg_is_similar),
        cmocka_unit_test(other_images_are_refused),
    };
    return cmocka_run_group_tests(tests, open_folder, close_folder);
}
