// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Images of integers as OpenEXR: one scan-line part with ZIP compression and channels of 32-bit
// integers, R, G and B or Y. The format has no integers of 16 bits.
//
// OpenEXR writes and reads the file, except for two things:
//
// - Chunks are deflated and inflated by exr_zip.c. OpenEXR 3.1 to 3.4.0 deflates a chunk even if
//   its size stays the same, which readers take for an uncompressed one; OpenEXR 3.3 and 3.4.0
//   accept a chunk that inflates to too few bytes.
// - Attributes must be exactly those that the encoder writes, in any order. They are compared
//   before OpenEXR reads the file, so that it never parses others.

#include "compress/image_codec_exr.h"

#include <stdlib.h>
#include <string.h>

#include "image/exr_writer.h"
#include "image/exr_zip.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "files have the byte order of memory");

enum {
    LINES = 16, // of a chunk
    LEVEL = 12, // the highest; 3 to 5 % smaller than 9
    ATTRIBUTES = 10,
    CHANNEL_BYTES = 18, // of a channel in the header
    LEADER_BYTES = 8    // before the data of a chunk: its first line and size
};

// Without a name OpenEXR 3.3 writes an empty one, other versions none.
static const char part_name[] = "image";
static const char *const channel_names[2][4] = {{"Y"}, {"B", "G", "R"}}; // sorted, then NULL

static const char *const *names_of(const sgsi_image16 *image)
{
    return channel_names[image->channels == 3];
}

// ---- Chunks ----

static size_t values_per_line(const sgsi_image16 *image)
{
    return (size_t)image->width * (size_t)image->channels;
}

static int lines_at(const sgsi_image16 *image, int y)
{
    return image->height - y < LINES ? image->height - y : LINES;
}

static size_t largest_chunk(const sgsi_image16 *image)
{
    return sizeof(uint32_t) * values_per_line(image) * (size_t)lines_at(image, 0);
}

// Index in a chunk of the value of a pixel: channels in the order of their names.
static size_t index_in_chunk(const sgsi_image16 *image, size_t line, size_t x, size_t channel)
{
    const size_t channels = (size_t)image->channels;
    return (line * channels + channels - 1 - channel) * (size_t)image->width + x;
}

static void fill_chunk(const sgsi_image16 *image, int y, int lines, uint32_t *chunk)
{
    const uint16_t *pixel = image->pixels + (size_t)y * values_per_line(image);
    for (size_t line = 0; line < (size_t)lines; ++line)
        for (size_t x = 0; x < (size_t)image->width; ++x)
            for (size_t c = 0; c < (size_t)image->channels; ++c)
                chunk[index_in_chunk(image, line, x, c)] = *pixel++;
}

// False if a value is too large.
static bool take_chunk(const sgsi_image16 *image, int y, int lines, const uint32_t *chunk)
{
    uint16_t *pixel = image->pixels + (size_t)y * values_per_line(image);
    uint32_t bits = 0;
    for (size_t line = 0; line < (size_t)lines; ++line)
        for (size_t x = 0; x < (size_t)image->width; ++x)
            for (size_t c = 0; c < (size_t)image->channels; ++c) {
                const uint32_t value = chunk[index_in_chunk(image, line, x, c)];
                bits |= value;
                *pixel++ = (uint16_t)value;
            }
    return bits <= (image->wide ? UINT16_MAX : UINT8_MAX);
}

// ---- The header, as the encoder writes it ----

typedef struct exr_attribute {
    uint8_t bytes[80];
    size_t size;
} exr_attribute;

static exr_attribute attribute_of(const char *name, const char *type, const void *value,
                                  uint32_t size)
{
    exr_attribute attribute = {0};
    uint8_t *at = attribute.bytes;
    at = (uint8_t *)stpcpy((char *)at, name) + 1;
    at = (uint8_t *)stpcpy((char *)at, type) + 1;
    memcpy(at, &size, sizeof size);
    memcpy(at + sizeof size, value, size);
    attribute.size = (size_t)(at - attribute.bytes) + sizeof size + size;
    return attribute;
}

static void list_attributes(const sgsi_image16 *image, exr_attribute attributes[ATTRIBUTES])
{
    static const char type[] = "scanlineimage";
    const uint8_t zip = EXR_COMPRESSION_ZIP, order = EXR_LINEORDER_INCREASING_Y;
    const int32_t window[4] = {0, 0, image->width - 1, image->height - 1};
    const float one = 1, center[2] = {0, 0};
    // Per channel: name (2 bytes), type UINT = 0 (4), zeros (4), sampling 1 and 1 (4, 4).
    uint8_t channels[3 * CHANNEL_BYTES + 1] = {0};
    uint32_t at = 0;
    for (const char *const *name = names_of(image); *name; ++name, at += CHANNEL_BYTES) {
        channels[at] = (uint8_t)(*name)[0];
        channels[at + 10] = channels[at + 14] = 1;
    }
    const exr_attribute list[ATTRIBUTES] = {
        attribute_of("type", "string", type, sizeof type - 1),
        attribute_of("name", "string", part_name, sizeof part_name - 1),
        attribute_of("compression", "compression", &zip, sizeof zip),
        attribute_of("dataWindow", "box2i", window, sizeof window),
        attribute_of("displayWindow", "box2i", window, sizeof window),
        attribute_of("lineOrder", "lineOrder", &order, sizeof order),
        attribute_of("pixelAspectRatio", "float", &one, sizeof one),
        attribute_of("screenWindowCenter", "v2f", center, sizeof center),
        attribute_of("screenWindowWidth", "float", &one, sizeof one),
        attribute_of("channels", "chlist", channels, at + 1)};
    memcpy(attributes, list, sizeof list);
}

// Size of the header, 0 if it is not that of the image.
static size_t header_bytes(const sgsi_image16 *image, const uint8_t *bytes, size_t size)
{
    static const uint8_t start[8] = {0x76, 0x2f, 0x31, 0x01, 2}; // magic; version 2, no flags
    exr_attribute attributes[ATTRIBUTES];
    list_attributes(image, attributes);
    size_t total = sizeof start + 1, at = sizeof start;
    for (int a = 0; a < ATTRIBUTES; ++a)
        total += attributes[a].size;
    if (size < total || memcmp(bytes, start, sizeof start) || bytes[total - 1])
        return 0;
    for (int count = 0; count < ATTRIBUTES; ++count) {
        int a = 0;
        while (a < ATTRIBUTES &&
               (!attributes[a].size || memcmp(bytes + at, attributes[a].bytes, attributes[a].size)))
            ++a;
        if (a == ATTRIBUTES)
            return 0;
        at += attributes[a].size;
        attributes[a].size = 0;
    }
    return total;
}

// The start of the chunks, 0 if the header is not that of the image or a chunk is outside of the
// file; OpenEXR would search the file for such a chunk.
static size_t chunks_at(const sgsi_image16 *image, const uint8_t *bytes, size_t size)
{
    const size_t table = header_bytes(image, bytes, size);
    const size_t count = ((size_t)image->height + LINES - 1) / LINES;
    if (!table || (size - table) / sizeof(uint64_t) < count)
        return 0;
    const size_t begin = table + count * sizeof(uint64_t);
    for (size_t k = 0; k < count; ++k) {
        uint64_t offset;
        memcpy(&offset, bytes + table + k * sizeof offset, sizeof offset);
        if (offset < begin || offset >= size)
            return 0;
    }
    return begin;
}

// ---- Encoding ----

typedef struct exr_output {
    uint8_t *bytes; // from malloc
    size_t size, room;
    bool failed; // out of memory
} exr_output;

static int64_t write_bytes(exr_const_context_t context, void *user, const void *bytes,
                           uint64_t size, uint64_t offset, exr_stream_error_func_ptr_t error)
{
    (void)context;
    (void)error;
    exr_output *output = user;
    const size_t end = (size_t)(offset + size);
    if (end > output->room) {
        uint8_t *grown = realloc(output->bytes, 2 * end);
        output->failed = output->failed || !grown;
        if (!grown)
            return -1;
        output->bytes = grown;
        output->room = 2 * end;
    }
    memcpy(output->bytes + offset, bytes, (size_t)size);
    output->size = end > output->size ? end : output->size;
    return (int64_t)size;
}

static exr_result_t write_header(exr_context_t context, const sgsi_image16 *image)
{
    int part;
    exr_result_t result = exr_set_longname_support(context, 0);
    if (!result)
        result = exr_add_part(context, part_name, EXR_STORAGE_SCANLINE, &part);
    if (!result)
        result = exr_initialize_required_attr_simple(context, 0, image->width, image->height,
                                                     EXR_COMPRESSION_ZIP);
    for (const char *const *name = names_of(image); !result && *name; ++name)
        result =
            exr_add_channel(context, 0, *name, EXR_PIXEL_UINT, EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1);
    return result ? result : exr_write_header(context);
}

static exr_result_t write_chunks(exr_context_t context, const sgsi_image16 *image)
{
    const size_t largest = largest_chunk(image);
    sgsi_exr_zip *zip = sgsi_exr_zip_create(1, LEVEL, largest);
    uint32_t *chunk = sgsi_alloc(largest, 1);
    uint8_t *packed = sgsi_alloc(largest, 1);
    exr_result_t result = zip && chunk && packed ? EXR_ERR_SUCCESS : EXR_ERR_OUT_OF_MEMORY;
    for (int y = 0; !result && y < image->height; y += LINES) {
        const int lines = lines_at(image, y);
        const size_t bytes = sizeof *chunk * values_per_line(image) * (size_t)lines;
        fill_chunk(image, y, lines, chunk);
        const size_t stored = sgsi_exr_zip_pack(zip, 0, (const uint8_t *)chunk, bytes, packed);
        result = exr_write_scanline_chunk(context, 0, y, stored ? packed : (const uint8_t *)chunk,
                                          stored ? stored : bytes);
    }
    sgsi_free(chunk);
    sgsi_free(packed);
    sgsi_exr_zip_destroy(zip);
    return result;
}

static sgs_status status_of(exr_result_t result)
{
    return !result                           ? SGS_STATUS_OK
           : result == EXR_ERR_OUT_OF_MEMORY ? SGS_STATUS_OUT_OF_MEMORY
                                             : SGS_STATUS_INTERNAL;
}

sgs_status sgsi_exr_image_encode(const sgsi_image16 *image, uint8_t **bytes, size_t *size)
{
    exr_output output = {0};
    exr_context_t context;
    exr_context_initializer_t setup = sgsi_exr_setup(&output);
    setup.write_fn = write_bytes;
    exr_result_t result = exr_start_write(&context, part_name, EXR_WRITE_FILE_DIRECTLY, &setup);
    if (result)
        return status_of(result);
    result = write_header(context, image);
    if (!result)
        result = write_chunks(context, image);
    const exr_result_t finished = exr_finish(&context);
    *bytes = output.bytes;
    *size = output.size;
    if (output.failed)
        result = EXR_ERR_OUT_OF_MEMORY;
    if (!result)
        result = finished;
    if (!result && !chunks_at(image, *bytes, *size))
        result = EXR_ERR_UNKNOWN;
    return status_of(result);
}

// ---- Decoding ----

typedef struct exr_input {
    const uint8_t *bytes;
    size_t size;
} exr_input;

static int64_t read_bytes(exr_const_context_t context, void *user, void *buffer, uint64_t size,
                          uint64_t offset, exr_stream_error_func_ptr_t error)
{
    (void)context;
    (void)error;
    const exr_input *input = user;
    const uint64_t left = offset < input->size ? input->size - offset : 0;
    const size_t count = (size_t)(size < left ? size : left);
    if (count)
        memcpy(buffer, input->bytes + offset, count);
    return (int64_t)count;
}

static int64_t input_size(exr_const_context_t context, void *user)
{
    (void)context;
    return (int64_t)((const exr_input *)user)->size;
}

// Chunks must follow each other without gaps from `at` to the end.
static bool read_chunks(exr_context_t context, const sgsi_image16 *image, size_t at, size_t end)
{
    const size_t largest = largest_chunk(image);
    uint32_t *chunk = sgsi_alloc(largest, 1);
    uint8_t *packed = sgsi_alloc(largest, 1), *scratch = sgsi_alloc(largest, 1);
    bool done = chunk && packed && scratch;
    for (int y = 0; done && y < image->height; y += LINES) {
        const int lines = lines_at(image, y);
        const size_t bytes = sizeof *chunk * values_per_line(image) * (size_t)lines;
        exr_chunk_info_t info;
        done = !exr_read_scanline_chunk_info(context, 0, y, &info) &&
               info.data_offset == at + LEADER_BYTES && info.packed_size <= bytes;
        if (done && info.packed_size == bytes)
            done = !exr_read_chunk(context, 0, &info, chunk);
        else if (done)
            done = !exr_read_chunk(context, 0, &info, packed) &&
                   sgsi_exr_zip_unpack(packed, (size_t)info.packed_size, scratch, (uint8_t *)chunk,
                                       bytes);
        done = done && take_chunk(image, y, lines, chunk);
        at = done ? (size_t)(info.data_offset + info.packed_size) : at;
    }
    sgsi_free(chunk);
    sgsi_free(packed);
    sgsi_free(scratch);
    return done && at == end;
}

bool sgsi_exr_image_decode(const uint8_t *bytes, size_t size, const sgsi_image16 *image)
{
    const size_t at = chunks_at(image, bytes, size);
    if (!at)
        return false;
    exr_input input = {bytes, size};
    exr_context_t context;
    exr_context_initializer_t setup = sgsi_exr_setup(&input);
    setup.read_fn = read_bytes;
    setup.size_fn = input_size;
    if (exr_start_read(&context, part_name, &setup))
        return false;
    const bool done = read_chunks(context, image, at, size);
    exr_finish(&context);
    return done;
}
