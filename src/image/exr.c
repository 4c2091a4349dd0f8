// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Flat multi-channel EXR: one scan-line part, written by exr_writer.c (see there for the reasons).
//
// OpenEXRCore 3.1 does not compress with DWAA. OpenImageIO encodes such an image in memory, and its
// chunks are copied to the file. A DWA chunk states which channel names are lossy, among those of
// the encoded image. So a channel that OpenImageIO encodes under another name, as lossless, is
// lossless under its own name, too. OpenImageIO encodes an image of one channel with ZIP, and so
// does this file.

#include "image/exr_writer.h"

#include <stdlib.h>
#include <string.h>

#include "image/image_oiio.h"

enum { MAX_CHANNELS = 1024, MAX_NAME = 254 }; // of 255, one for DWAA

typedef struct flat_image {
    int width;
    const sgs_exr_channel **sorted; // sorted by name
    int channel_count;
} flat_image;

static int compare_names(const void *a, const void *b)
{
    return strcmp((*(const sgs_exr_channel *const *)a)->name,
                  (*(const sgs_exr_channel *const *)b)->name);
}

static sgs_status check_channels(const char *path, const sgs_exr_channel *channels, int count)
{
    if (count < 1 || count > MAX_CHANNELS)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "%s: %d channels are not supported in an EXR; 1 to %d are", path, count,
                         MAX_CHANNELS);
    for (int k = 0; k < count; ++k) {
        const sgs_exr_channel *channel = &channels[k];
        const size_t length = channel->name ? strlen(channel->name) : 0;
        if (length < 1 || length > MAX_NAME)
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                             "%s: the name of channel %d has %zu characters; 1 to %d are allowed",
                             path, k, length, MAX_NAME);
        if (!channel->floats == !channel->uints)
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                             "%s: channel '%s' requires either floats or uints", path,
                             channel->name);
        if (channel->uints && channel->half)
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                             "%s: integer channel '%s' cannot be stored as half", path,
                             channel->name);
    }
    return SGS_STATUS_OK;
}

static sgs_status sort_channels(flat_image *image, const char *path,
                                const sgs_exr_channel *channels, int count)
{
    image->sorted = sgsi_alloc((size_t)count, sizeof *image->sorted);
    if (!image->sorted)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    image->channel_count = count;
    for (int k = 0; k < count; ++k)
        image->sorted[k] = &channels[k];
    qsort(image->sorted, (size_t)count, sizeof *image->sorted, compare_names);
    for (int k = 1; k < count; ++k) {
        if (!compare_names(&image->sorted[k - 1], &image->sorted[k]))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: duplicate channel '%s'", path,
                             image->sorted[k]->name);
    }
    return SGS_STATUS_OK;
}

static const sgs_exr_channel *find_channel(const flat_image *image, const char *name)
{
    const sgs_exr_channel wanted = {.name = name}, *key = &wanted;
    return *(const sgs_exr_channel **)bsearch(&key, image->sorted, (size_t)image->channel_count,
                                              sizeof *image->sorted, compare_names);
}

static void point_at_lines(const void *context, exr_encode_pipeline_t *encoder, int y, int lines)
{
    (void)lines;
    const flat_image *image = context;
    const size_t first = (size_t)y * (size_t)image->width;
    for (int k = 0; k < encoder->channel_count; ++k) {
        exr_coding_channel_info_t *coded = &encoder->channels[k];
        const sgs_exr_channel *channel = find_channel(image, coded->channel_name);
        // The encoder converts to half.
        coded->user_data_type = channel->uints ? EXR_PIXEL_UINT : EXR_PIXEL_FLOAT;
        coded->user_bytes_per_element = 4;
        coded->user_pixel_stride = 4;
        coded->user_line_stride = 4 * image->width;
        coded->encode_from_ptr = channel->uints ? (const uint8_t *)(channel->uints + first)
                                                : (const uint8_t *)(channel->floats + first);
    }
}

// An EXR file in memory.
typedef struct memory_file {
    uint8_t *bytes;
    size_t size;
} memory_file;

static int64_t read_bytes(exr_const_context_t context, void *user, void *buffer, uint64_t size,
                          uint64_t offset, exr_stream_error_func_ptr_t error)
{
    (void)context;
    (void)error;
    const memory_file *file = user;
    if (offset > file->size)
        return -1;
    const uint64_t left = file->size - offset, count = size < left ? size : left;
    memcpy(buffer, file->bytes + offset, (size_t)count);
    return (int64_t)count;
}

static int64_t count_bytes(exr_const_context_t context, void *user)
{
    (void)context;
    const memory_file *file = user;
    return (int64_t)file->size;
}

// Copies the chunks of `from`, which has the size, types and order of channels of the writer.
static exr_result_t copy_chunks(sgsi_exr_writer *writer, int height, memory_file *from)
{
    exr_context_initializer_t setup = sgsi_exr_setup(from);
    setup.read_fn = read_bytes;
    setup.size_fn = count_bytes;
    exr_context_t reader;
    exr_compression_t compression = EXR_COMPRESSION_NONE;
    int lines;
    exr_result_t result = exr_start_read(&reader, writer->path, &setup);
    if (result)
        return result;
    result = exr_get_compression(reader, 0, &compression);
    if (!result && compression != EXR_COMPRESSION_DWAA)
        result = EXR_ERR_FEATURE_NOT_IMPLEMENTED;
    if (!result)
        result = exr_get_scanlines_per_chunk(reader, 0, &lines);
    for (int y = 0; !result && y < height; y += lines) {
        exr_chunk_info_t chunk;
        result = exr_read_scanline_chunk_info(reader, 0, y, &chunk);
        if (!result)
            result = exr_write_scanline_chunk(writer->context, 0, writer->first_line + y,
                                              from->bytes + chunk.data_offset, chunk.packed_size);
    }
    const exr_result_t finished = exr_finish(&reader);
    return result ? result : finished;
}

// `encoded`: the image with DWAA compression; NULL for the other compressions.
static sgs_status write_image(const flat_image *image, const char *path, const sgs_exr_info *info,
                              memory_file *encoded)
{
    static const exr_compression_t compressions[] = {
        [SGS_EXR_AUTO] = EXR_COMPRESSION_ZIP,  [SGS_EXR_ZIP] = EXR_COMPRESSION_ZIP,
        [SGS_EXR_ZIPS] = EXR_COMPRESSION_ZIPS, [SGS_EXR_PIZ] = EXR_COMPRESSION_PIZ,
        [SGS_EXR_NONE] = EXR_COMPRESSION_NONE, [SGS_EXR_DWAA] = EXR_COMPRESSION_DWAA};
    sgsi_exr_column columns[MAX_CHANNELS];
    for (int k = 0; k < image->channel_count; ++k) {
        const sgs_exr_channel *channel = image->sorted[k];
        const exr_pixel_type_t of_floats = channel->half ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT;
        columns[k] = (sgsi_exr_column){channel->name, channel->uints ? EXR_PIXEL_UINT : of_floats};
    }
    sgsi_exr_writer writer;
    const sgs_status status =
        sgsi_exr_open(&writer, path, info, EXR_STORAGE_SCANLINE, compressions[info->compression], 0,
                      columns, image->channel_count);
    if (status)
        return status;
    return sgsi_exr_close(&writer,
                          encoded ? copy_chunks(&writer, info->height, encoded)
                                  : sgsi_exr_write_lines(&writer, info->height, info->compression,
                                                         point_at_lines, image));
}

static sgs_status write_dwaa(const flat_image *image, const char *path, const sgs_exr_info *info)
{
    sgs_exr_channel channels[MAX_CHANNELS];
    for (int k = 0; k < image->channel_count; ++k)
        channels[k] = *image->sorted[k];
    memory_file encoded;
    sgs_status status = sgsi_oiio_dwaa_encode(path, info, channels, image->channel_count,
                                              &encoded.bytes, &encoded.size);
    if (status)
        return status;
    status = write_image(image, path, info, &encoded);
    sgsi_free(encoded.bytes);
    return status;
}

sgs_status sgs_exr_write(const char *path, const sgs_exr_info *info,
                         const sgs_exr_channel *channels, int channel_count)
{
    sgs_status status = sgsi_exr_check_info(path, info);
    if (status)
        return status;
    if (info->compression < 0 || info->compression >= SGS_EXR_COMPRESSION_COUNT)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: unknown EXR compression %d", path,
                         (int)info->compression);
    status = check_channels(path, channels, channel_count);
    if (status)
        return status;
    sgs_exr_info own = *info;
    if (channel_count == 1 && own.compression == SGS_EXR_DWAA)
        own.compression = SGS_EXR_ZIP;
    flat_image image = {.width = info->width};
    status = sort_channels(&image, path, channels, channel_count);
    if (!status)
        status = own.compression == SGS_EXR_DWAA ? write_dwaa(&image, path, &own)
                                                 : write_image(&image, path, &own, NULL);
    sgsi_free(image.sorted);
    return status;
}
