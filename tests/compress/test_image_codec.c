// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The image codecs of the compression: round trips, files of other images, damaged files. OpenEXR
// files are also read by OpenEXR alone.

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <openexr.h>

#include "base/core.h"
#include "compress/image_codec.h"
#include "support/files_support.h"
#include "sparegs/image.h"

enum { CODECS = 3, MAX_SIDE = 37, MAX_VALUES = MAX_SIDE * MAX_SIDE * 3 };

static const int sizes[][2] = {{1, 1}, {MAX_SIDE, MAX_SIDE}, {1, 17}, {33, 16}, {16, 15}};
enum { SIZES = sizeof sizes / sizeof *sizes };

// content 0: zeros; 1: smooth; 2: noise.
static void fill(const sgsi_image16 *image, int content)
{
    const uint64_t count =
        (uint64_t)image->width * (uint64_t)image->height * (uint64_t)image->channels;
    for (uint64_t i = 0; i < count; ++i) {
        const uint64_t value = content == 2 ? sgsi_random_bits(4, i) : i / 7;
        image->pixels[i] = (uint16_t)(content ? value % (image->wide ? 65536 : 256) : 0);
    }
    if (content)
        image->pixels[count - 1] = image->wide ? UINT16_MAX : UINT8_MAX;
}

// An encoded image. pixels: as encoded.
typedef struct encoded_image {
    sgs_image_codec codec;
    sgsi_image16 image;
    uint16_t pixels[MAX_VALUES];
    uint8_t *bytes;
    size_t size;
} encoded_image;

static encoded_image *encode(int codec, int size, int channels, bool wide, int content)
{
    encoded_image *made = calloc(1, sizeof *made);
    assert_non_null(made);
    made->codec = (sgs_image_codec)codec;
    made->image = (sgsi_image16){sizes[size][0], sizes[size][1], channels, wide, made->pixels};
    fill(&made->image, content);
    assert_int_equal(sgsi_image_encode(made->codec, &made->image, &made->bytes, &made->size),
                     SGS_STATUS_OK);
    return made;
}

static void release(encoded_image *made)
{
    free(made->bytes);
    free(made);
}

// Decodes to pixels of exactly the image's size, so that the address sanitizer sees writes outside.
static bool decodes(const encoded_image *made, sgsi_image16 image, const uint8_t *bytes,
                    size_t size, bool *same)
{
    const size_t room = (size_t)image.width * (size_t)image.height * (size_t)image.channels * 2;
    image.pixels = calloc(room, 1);
    assert_non_null(image.pixels);
    const bool done = sgsi_image_decode(made->codec, bytes, size, &image);
    if (same)
        *same = done && !memcmp(image.pixels, made->pixels, room);
    free(image.pixels);
    return done;
}

static void images_are_stored_without_loss(void **state)
{
    (void)state;
    for (int codec = 0; codec < CODECS; ++codec)
        for (int size = 0; size < SIZES; ++size)
            for (int kind = 0; kind < 12; ++kind) { // channels, depth, content
                encoded_image *made = encode(codec, size, 1 + 2 * (kind & 1), kind & 2, kind >> 2);
                bool same;
                if (!decodes(made, made->image, made->bytes, made->size, &same) || !same)
                    fail_msg("codec %d, %d x %d, kind %d", codec, made->image.width,
                             made->image.height, kind);
                release(made);
            }
}

static void other_images_are_rejected(void **state)
{
    (void)state;
    for (int codec = 0; codec < CODECS; ++codec)
        for (int size = 0; size < SIZES; ++size)
            for (int kind = 0; kind < 4; ++kind) {
                encoded_image *made = encode(codec, size, 1 + 2 * (kind & 1), kind & 2, 2);
                sgsi_image16 other[6];
                for (int k = 0; k < 6; ++k)
                    other[k] = made->image;
                ++other[0].width;
                ++other[1].height;
                --other[2].width;
                --other[3].height;
                other[4].channels = 4 - made->image.channels;
                other[5].wide = !made->image.wide;
                for (int k = 0; k < 6; ++k) {
                    // Neither WebP nor OpenEXR stores the depth of a file with small values. WebP
                    // always has three channels.
                    const bool may = (k == 4 && codec == SGS_IMAGE_CODEC_WEBP) ||
                                     (k == 5 && codec == SGS_IMAGE_CODEC_EXR && other[k].wide);
                    if (!other[k].width || !other[k].height || may)
                        continue;
                    if (decodes(made, other[k], made->bytes, made->size, NULL))
                        fail_msg("codec %d, size %d, kind %d, other %d", codec, size, kind, k);
                }
                for (int k = 0; k < CODECS; ++k) {
                    made->codec = (sgs_image_codec)k;
                    if (k != codec)
                        assert_false(decodes(made, made->image, made->bytes, made->size, NULL));
                }
                release(made);
            }
}

// Calls run(codec). Returns the size of what it writes to stderr, which is not shown.
static long printed_by(void (*run)(int codec), int codec)
{
    const temp_folder folder = temp_folder_make();
    fflush(stderr);
    const int file = open(temp_path(&folder, "stderr"), O_RDWR | O_CREAT, 0600);
    const int before = dup(STDERR_FILENO);
    assert_true(file >= 0 && before >= 0 && dup2(file, STDERR_FILENO) >= 0);
    run(codec);
    fflush(stderr);
    assert_true(dup2(before, STDERR_FILENO) >= 0);
    const long size = (long)lseek(file, 0, SEEK_END);
    close(before);
    close(file);
    temp_folder_remove(&folder);
    return size;
}

static void decode_damaged(int codec)
{
    for (int kind = 0; kind < 8; ++kind) {
        encoded_image *made = encode(codec, 3, 1 + 2 * (kind & 1), kind & 2, 1 + (kind >> 2));
        assert_false(decodes(made, made->image, made->bytes, made->size / 2, NULL));
        for (size_t k = 0; k < 200; ++k) {
            uint8_t *altered = malloc(made->size);
            assert_non_null(altered);
            memcpy(altered, made->bytes, made->size);
            altered[sgsi_random_bits(k, 1) % made->size] ^=
                (uint8_t)(1 + sgsi_random_bits(k, 2) % 255);
            decodes(made, made->image, altered, made->size, NULL);
            free(altered);
        }
        release(made);
    }
}

static void damaged_images_are_decoded_or_rejected(void **state)
{
    (void)state;
    printed_by(decode_damaged, SGS_IMAGE_CODEC_JXL); // libjxl may print messages
    assert_int_equal(printed_by(decode_damaged, SGS_IMAGE_CODEC_WEBP), 0);
    assert_int_equal(printed_by(decode_damaged, SGS_IMAGE_CODEC_EXR), 0);
}

// ---- OpenEXR ----

static size_t exr_name_end(const uint8_t *bytes, size_t at)
{
    return at + strlen((const char *)bytes + at) + 1;
}

// Behind the attribute at `at`.
static size_t exr_attribute_end(const uint8_t *bytes, size_t at)
{
    uint32_t size;
    at = exr_name_end(bytes, exr_name_end(bytes, at));
    memcpy(&size, bytes + at, sizeof size);
    return at + sizeof size + size;
}

// Behind the zero after the last attribute: the table of chunks.
static size_t exr_header_end(const uint8_t *bytes)
{
    size_t at = 8;
    while (bytes[at])
        at = exr_attribute_end(bytes, at);
    return at + 1;
}

static void check_with_openexr(const encoded_image *made, const char *path)
{
    exr_context_t context;
    file_put(path, made->bytes, made->size);
    assert_int_equal(exr_start_read(&context, path, NULL), 0);
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmissing-field-initializers"
    exr_decode_pipeline_t decoder = EXR_DECODE_PIPELINE_INITIALIZER;
#pragma GCC diagnostic pop
    static uint32_t lines[3][16 * MAX_SIDE];
    const char *const names = made->image.channels == 1 ? "Y" : "RGB";
    const size_t width = (size_t)made->image.width, channels = (size_t)made->image.channels;
    for (int y = 0; y < made->image.height; y += 16) {
        exr_chunk_info_t chunk;
        assert_int_equal(exr_read_scanline_chunk_info(context, 0, y, &chunk), 0);
        assert_int_equal(y ? exr_decoding_update(context, 0, &chunk, &decoder)
                           : exr_decoding_initialize(context, 0, &chunk, &decoder),
                         0);
        assert_int_equal(decoder.channel_count, channels);
        for (size_t c = 0; c < channels; ++c) {
            exr_coding_channel_info_t *channel = &decoder.channels[c];
            const char *found = strchr(names, channel->channel_name[0]);
            assert_non_null(found);
            assert_int_equal(channel->data_type, EXR_PIXEL_UINT);
            channel->decode_to_ptr = (uint8_t *)lines[found - names];
            channel->user_pixel_stride = 4;
            channel->user_line_stride = (int32_t)(4 * width);
        }
        if (!y)
            assert_int_equal(exr_decoding_choose_default_routines(context, 0, &decoder), 0);
        assert_int_equal(exr_decoding_run(context, 0, &decoder), 0);
        for (size_t i = 0; i < width * (size_t)chunk.height; ++i)
            for (size_t c = 0; c < channels; ++c)
                assert_int_equal(lines[c][i], made->pixels[((size_t)y * width + i) * channels + c]);
    }
    exr_decoding_destroy(context, &decoder);
    exr_finish(&context);
}

static void openexr_reads_the_same_values(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    for (int size = 0; size < SIZES; ++size)
        for (int kind = 0; kind < 12; ++kind) {
            encoded_image *made =
                encode(SGS_IMAGE_CODEC_EXR, size, 1 + 2 * (kind & 1), kind & 2, kind >> 2);
            check_with_openexr(made, temp_path(&folder, "image.exr"));
            release(made);
        }
    temp_folder_remove(&folder);
}

static void exr_attributes_may_have_any_order_but_not_repeat(void **state)
{
    (void)state;
    encoded_image *made = encode(SGS_IMAGE_CODEC_EXR, 1, 3, true, 1);
    const size_t end = exr_header_end(made->bytes) - 1;
    for (int k = 0; k < 12; ++k) { // the first attribute becomes the last one
        uint8_t first[128];
        const size_t next = exr_attribute_end(made->bytes, 8);
        assert_true(next - 8 <= sizeof first);
        memcpy(first, made->bytes + 8, next - 8);
        memmove(made->bytes + 8, made->bytes + next, end - next);
        memcpy(made->bytes + 8 + end - next, first, next - 8);
        bool same;
        assert_true(decodes(made, made->image, made->bytes, made->size, &same));
        assert_true(same);
    }
    // "type" twice, no "compression"; both have the same size.
    size_t type = 8, compression = 8;
    while (strcmp((const char *)made->bytes + type, "type"))
        type = exr_attribute_end(made->bytes, type);
    while (strcmp((const char *)made->bytes + compression, "compression"))
        compression = exr_attribute_end(made->bytes, compression);
    const size_t size = exr_attribute_end(made->bytes, type) - type;
    assert_int_equal(exr_attribute_end(made->bytes, compression) - compression, size);
    memcpy(made->bytes + compression, made->bytes + type, size);
    assert_false(decodes(made, made->image, made->bytes, made->size, NULL));
    release(made);
}

// All files that are cut or have one altered byte before the pixels, or bytes after them.
static void damaged_exr_layouts_are_rejected(void **state)
{
    (void)state;
    for (int content = 1; content <= 2; ++content) {
        encoded_image *made = encode(SGS_IMAGE_CODEC_EXR, 3, 3, true, content);
        const size_t table = exr_header_end(made->bytes), chunk = table + 8;
        uint8_t *altered = malloc(made->size + 1);
        assert_non_null(altered);
        for (size_t size = 0; size < made->size; ++size) {
            memcpy(altered, made->bytes, made->size);
            uint8_t *cut = malloc(size + 1); // for the address sanitizer
            assert_non_null(cut);
            memcpy(cut, made->bytes, size);
            assert_false(decodes(made, made->image, cut, size, NULL));
            free(cut);
        }
        for (size_t at = 0; at < chunk + 8; ++at)
            for (unsigned bit = 0; bit < 8; ++bit) {
                memcpy(altered, made->bytes, made->size);
                altered[at] ^= (uint8_t)(1u << bit);
                if (decodes(made, made->image, altered, made->size, NULL))
                    fail_msg("byte %zu, bit %u", at, bit);
            }
        memcpy(altered, made->bytes, made->size);
        altered[made->size] = 0;
        assert_false(decodes(made, made->image, altered, made->size + 1, NULL));
        free(altered);
        release(made);
    }
}

// The file with `count` bytes of `value` inserted at `at`.
static uint8_t *with_inserted(const encoded_image *made, size_t at, size_t count, uint8_t value)
{
    uint8_t *bytes = malloc(made->size + count);
    assert_non_null(bytes);
    memcpy(bytes, made->bytes, at);
    memset(bytes + at, value, count);
    memcpy(bytes + at + count, made->bytes + at, made->size - at);
    return bytes;
}

static void exr_chunks_with_gaps_are_rejected(void **state)
{
    (void)state;
    encoded_image *made = encode(SGS_IMAGE_CODEC_EXR, 1, 3, true, 1); // three chunks
    const size_t table = exr_header_end(made->bytes);
    for (size_t k = 0; k < 3; ++k) {
        uint64_t offset;
        memcpy(&offset, made->bytes + table + 8 * k, sizeof offset);
        uint8_t *bytes = with_inserted(made, offset, 4, 0);
        for (size_t later = k; later < 3; ++later) {
            memcpy(&offset, bytes + table + 8 * later, sizeof offset);
            offset += 4;
            memcpy(bytes + table + 8 * later, &offset, sizeof offset);
        }
        assert_false(decodes(made, made->image, bytes, made->size + 4, NULL));
        free(bytes);
    }
    release(made);
}

// Images of one chunk: its size grows with the file. A chunk of 16 lines would be large enough for
// the larger size.
static void exr_chunks_with_further_bytes_are_rejected(void **state)
{
    (void)state;
    for (int content = 0; content < 3; ++content) {
        encoded_image *made = encode(SGS_IMAGE_CODEC_EXR, 4, 3, true, content); // 15 lines
        const size_t leader = exr_header_end(made->bytes) + 8;
        uint32_t size;
        memcpy(&size, made->bytes + leader + 4, sizeof size);
        assert_int_equal(leader + 8 + size, made->size);
        assert_true(size <= 16 * 15 * 12);
        for (int k = 0; k < 2; ++k) {
            const uint32_t more = k ? 16 * 16 * 12 - size : 1, larger = size + more;
            uint8_t *bytes = with_inserted(made, made->size, more, 0);
            memcpy(bytes + leader + 4, &larger, sizeof larger);
            assert_false(decodes(made, made->image, bytes, made->size + more, NULL));
            free(bytes);
        }
        release(made);
    }
}

// The chunk of one pixel is not compressed: its value is the end of the file.
static void exr_values_beyond_the_depth_are_rejected(void **state)
{
    (void)state;
    for (int wide = 0; wide < 2; ++wide) {
        encoded_image *made = encode(SGS_IMAGE_CODEC_EXR, 0, 1, wide, 0);
        uint8_t *value = made->bytes + made->size - 4;
        assert_true(decodes(made, made->image, made->bytes, made->size, NULL));
        for (int byte = 0; byte < 4; ++byte) {
            value[byte] = 255;
            assert_int_equal(decodes(made, made->image, made->bytes, made->size, NULL),
                             byte <= wide);
            value[byte] = 0;
        }
        release(made);
    }
}

// EXR files of sparegs with the same size and channels, but with further attributes, another type
// or another compression.
static void other_exr_files_are_rejected(void **state)
{
    (void)state;
    const temp_folder folder = temp_folder_make();
    static const float floats[MAX_SIDE * MAX_SIDE];
    static const uint32_t uints[MAX_SIDE * MAX_SIDE];
    encoded_image *made = encode(SGS_IMAGE_CODEC_EXR, 1, 1, true, 0);
    for (int k = 0; k < 5; ++k) {
        const sgs_exr_channel channel = {.name = "Y",
                                         .uints = k < 3 ? uints : NULL,
                                         .floats = k < 3 ? NULL : floats,
                                         .half = k == 4};
        const sgs_exr_info info = {.width = MAX_SIDE,
                                   .height = MAX_SIDE,
                                   .compression = k == 1   ? SGS_EXR_ZIPS
                                                  : k == 2 ? SGS_EXR_NONE
                                                           : SGS_EXR_ZIP};
        size_t size;
        assert_int_equal(sgs_exr_write(temp_path(&folder, "image.exr"), &info, &channel, 1), 0);
        unsigned char *bytes = file_get(temp_path(&folder, "image.exr"), &size);
        assert_false(decodes(made, made->image, bytes, size, NULL));
        free(bytes);
    }
    release(made);
    temp_folder_remove(&folder);
}

// OpenEXR works without some of its allocations.
static void failed_exr_allocations_do_no_harm(void **state)
{
    (void)state;
    encoded_image *made = encode(SGS_IMAGE_CODEC_EXR, 1, 3, true, 1);
    for (int decoding = 0; decoding < 2; ++decoding) {
        size_t failures = 0;
        bool reached = true;
        for (size_t n = 1; reached; ++n) {
            const size_t before = sgsi_allocation_count();
            uint8_t *bytes = NULL;
            size_t size = 0;
            bool same = false;
            sgsi_fail_allocation(n);
            sgs_status status = SGS_STATUS_OK;
            bool done;
            if (decoding) {
                done = decodes(made, made->image, made->bytes, made->size, &same);
            } else {
                status = sgsi_image_encode(SGS_IMAGE_CODEC_EXR, &made->image, &bytes, &size);
                done = status == SGS_STATUS_OK;
            }
            sgsi_fail_allocation(0);
            reached = sgsi_allocation_count() - before >= n;
            if (!done && !decoding)
                assert_int_equal(status, SGS_STATUS_OUT_OF_MEMORY);
            failures += !done;
            if (done && !decoding)
                assert_true(size == made->size && !memcmp(bytes, made->bytes, size));
            if (done && decoding)
                assert_true(same);
            free(bytes);
        }
        assert_true(failures > 4);
    }
    release(made);
}

// Sizes that the formats do not have: not for lack of memory.
static void failures_of_an_encoder_are_no_lack_of_memory(void **state)
{
    (void)state;
    uint16_t *pixels = calloc(20000, sizeof *pixels);
    assert_non_null(pixels);
    const struct {
        sgs_image_codec codec;
        int width; // of one row
    } cases[] = {{SGS_IMAGE_CODEC_JXL, 0}, {SGS_IMAGE_CODEC_WEBP, 16384}, {SGS_IMAGE_CODEC_EXR, 0}};
    for (size_t c = 0; c < sizeof cases / sizeof *cases; ++c) {
        const sgsi_image16 image = {cases[c].width, 1, 1, true, pixels};
        uint8_t *bytes;
        size_t size;
        assert_int_equal(sgsi_image_encode(cases[c].codec, &image, &bytes, &size),
                         SGS_STATUS_INTERNAL);
        free(bytes);
    }
    free(pixels);
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(images_are_stored_without_loss),
        cmocka_unit_test(other_images_are_rejected),
        cmocka_unit_test(damaged_images_are_decoded_or_rejected),
        cmocka_unit_test(openexr_reads_the_same_values),
        cmocka_unit_test(exr_attributes_may_have_any_order_but_not_repeat),
        cmocka_unit_test(damaged_exr_layouts_are_rejected),
        cmocka_unit_test(exr_chunks_with_gaps_are_rejected),
        cmocka_unit_test(exr_chunks_with_further_bytes_are_rejected),
        cmocka_unit_test(exr_values_beyond_the_depth_are_rejected),
        cmocka_unit_test(other_exr_files_are_rejected),
        cmocka_unit_test(failed_exr_allocations_do_no_harm),
        cmocka_unit_test(failures_of_an_encoder_are_no_lack_of_memory),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
