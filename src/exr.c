// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Multi-channel images for compositors, written with OpenEXR's C library (OpenEXRCore 3.1 and later):
// one scan-line part, ZIP in chunks of 16 lines.
//
// OpenEXRCore writes through a callback into the library's own atomic file, so that an EXR appears under its
// name only when it is complete and on disk, as every other file does. Its messages are caught and end in
// sgs_last_error(); its memory comes from the library's allocator.

#include "sparegs/image.h"

#include <errno.h>
#include <openexr.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core.h"
#include "sparegs/runtime.h"

enum { MAX_CHANNELS = 1024, MAX_NAME = 255, MAX_SHORT_NAME = 31, MAX_SIDE = 65536 };

typedef struct exr_writer {
    sgsi_atomic_file file;
    exr_context_t context;
    const sgs_exr_info *info;
    const sgs_exr_channel **sorted; // by name, as the format demands
    int channel_count;
    int write_error; // errno of the first failed write
} exr_writer;

// OpenEXR's first complaint in this call. Not in the writer: asking the context for its user data inside the
// handler waits for the lock that the complaining function holds.
static _Thread_local char complaint[256];

static void *allocate(size_t bytes)
{
    return sgsi_alloc(bytes, 1);
}

static void keep_complaint(exr_const_context_t context, exr_result_t code, const char *message)
{
    (void)context;
    (void)code;
    if (complaint[0] || !message)
        return;
    const char *text = strrchr(message, ':'); // "file: text"
    text = text ? text + 1 : message;
    while (*text == ' ')
        ++text;
    snprintf(complaint, sizeof complaint, "%s", text);
}

static int64_t write_bytes(exr_const_context_t context, void *user, const void *bytes, uint64_t size, uint64_t offset,
                           exr_stream_error_func_ptr_t error)
{
    (void)context;
    (void)error;
    exr_writer *writer = user;
    uint64_t done = 0;
    while (done < size) {
        const ssize_t step = pwrite(fileno(writer->file.stream), (const char *)bytes + done, (size_t)(size - done),
                                    (off_t)(offset + done));
        if (step < 0 && errno == EINTR)
            continue;
        if (step <= 0) {
            if (!writer->write_error)
                writer->write_error = step < 0 ? errno : ENOSPC;
            return -1;
        }
        done += (uint64_t)step;
    }
    return (int64_t)done;
}

static int compare_names(const void *a, const void *b)
{
    return strcmp((*(const sgs_exr_channel *const *)a)->name, (*(const sgs_exr_channel *const *)b)->name);
}

static sgs_status check_channels(const char *path, const sgs_exr_channel *channels, int count)
{
    if (count < 1 || count > MAX_CHANNELS)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: an EXR of %d channels cannot be written; 1 to %d can", path,
                         count, MAX_CHANNELS);
    for (int k = 0; k < count; ++k) {
        const sgs_exr_channel *channel = &channels[k];
        const size_t length = channel->name ? strlen(channel->name) : 0;
        if (length < 1 || length > MAX_NAME)
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: the name of channel %d has %zu characters, not 1 to %d",
                             path, k, length, MAX_NAME);
        if (!channel->floats == !channel->uints)
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: channel '%s' needs either floats or uints", path,
                             channel->name);
        if (channel->uints && channel->half)
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: channel '%s' is of integers and cannot be half", path,
                             channel->name);
    }
    return SGS_STATUS_OK;
}

static sgs_status sort_channels(exr_writer *writer, const char *path, const sgs_exr_channel *channels, int count)
{
    writer->sorted = sgsi_alloc((size_t)count, sizeof *writer->sorted);
    if (!writer->sorted)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: no memory to write it", path);
    writer->channel_count = count;
    for (int k = 0; k < count; ++k)
        writer->sorted[k] = &channels[k];
    qsort(writer->sorted, (size_t)count, sizeof *writer->sorted, compare_names);
    for (int k = 1; k < count; ++k) {
        if (!compare_names(&writer->sorted[k - 1], &writer->sorted[k]))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: two channels are called '%s'", path,
                             writer->sorted[k]->name);
    }
    return SGS_STATUS_OK;
}

// EXR multiplies row vectors from the left, p' = p M: the transpose of the matrix for column vectors.
static exr_result_t set_matrix(exr_context_t context, const char *name, const double *matrix)
{
    if (!matrix)
        return EXR_ERR_SUCCESS;
    exr_attr_m44f_t transposed;
    for (int row = 0; row < 4; ++row) {
        for (int column = 0; column < 4; ++column)
            transposed.m[4 * row + column] = (float)matrix[4 * column + row];
    }
    return exr_attr_set_m44f(context, 0, name, &transposed);
}

static exr_result_t set_text(exr_context_t context, const char *name, const char *text)
{
    return text ? exr_attr_set_string(context, 0, name, text) : EXR_ERR_SUCCESS;
}

static exr_result_t write_header(exr_writer *writer)
{
    exr_context_t context = writer->context;
    const sgs_exr_info *info = writer->info;
    // ITU-R BT.709: primaries and the D65 white.
    const exr_attr_chromaticities_t rec709 = {.red_x = 0.64f,   .red_y = 0.33f,  .green_x = 0.30f,   .green_y = 0.60f,
                                              .blue_x = 0.15f, .blue_y = 0.06f, .white_x = 0.3127f, .white_y = 0.3290f};
    char software[64];
    snprintf(software, sizeof software, "sparegs %s", sgs_version());
    // Only when needed: readers from before 2013 refuse files with long names.
    int part, has_long_names = 0;
    for (int k = 0; k < writer->channel_count; ++k)
        has_long_names |= strlen(writer->sorted[k]->name) > MAX_SHORT_NAME;
    exr_result_t result = exr_set_longname_support(context, has_long_names);
    if (!result)
        result = exr_add_part(context, NULL, EXR_STORAGE_SCANLINE, &part);
    if (!result)
        result = exr_initialize_required_attr_simple(context, 0, info->width, info->height, EXR_COMPRESSION_ZIP);
    for (int k = 0; !result && k < writer->channel_count; ++k) {
        const sgs_exr_channel *channel = writer->sorted[k];
        const exr_pixel_type_t of_floats = channel->half ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT;
        result = exr_add_channel(context, 0, channel->name, channel->uints ? EXR_PIXEL_UINT : of_floats,
                                 EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1);
    }
    if (!result)
        result = exr_attr_set_chromaticities(context, 0, "chromaticities", &rec709);
    if (!result)
        result = set_text(context, "software", software);
    if (!result)
        result = set_text(context, "sparegs:depthDefinition", info->depth_definition);
    if (!result)
        result = set_text(context, "sparegs:view", info->view_name);
    if (!result)
        result = set_matrix(context, "worldToCamera", info->world_to_camera);
    if (!result)
        result = set_matrix(context, "worldToNDC", info->world_to_ndc);
    if (!result)
        result = exr_write_header(context);
    return result;
}

static const sgs_exr_channel *find_channel(const exr_writer *writer, const char *name)
{
    const sgs_exr_channel wanted = {.name = name}, *key = &wanted;
    return *(const sgs_exr_channel **)bsearch(&key, writer->sorted, (size_t)writer->channel_count,
                                              sizeof *writer->sorted, compare_names);
}

static void point_at_lines(const exr_writer *writer, exr_encode_pipeline_t *encoder, int y)
{
    const size_t first = (size_t)y * (size_t)writer->info->width;
    for (int k = 0; k < encoder->channel_count; ++k) {
        exr_coding_channel_info_t *coded = &encoder->channels[k];
        const sgs_exr_channel *channel = find_channel(writer, coded->channel_name);
        coded->user_data_type = channel->uints ? EXR_PIXEL_UINT : EXR_PIXEL_FLOAT; // the packer makes halves
        coded->user_bytes_per_element = 4;
        coded->user_pixel_stride = 4;
        coded->user_line_stride = 4 * writer->info->width;
        coded->encode_from_ptr = channel->uints ? (const uint8_t *)(channel->uints + first)
                                                : (const uint8_t *)(channel->floats + first);
    }
}

static exr_result_t write_pixels(exr_writer *writer)
{
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmissing-field-initializers" // OpenEXR 3.2 and later name only the first field
    exr_encode_pipeline_t encoder = EXR_ENCODE_PIPELINE_INITIALIZER;
#pragma GCC diagnostic pop
    int32_t lines = 0;
    exr_result_t result = exr_get_scanlines_per_chunk(writer->context, 0, &lines);
    for (int y = 0; !result && y < writer->info->height; y += lines) {
        exr_chunk_info_t chunk;
        result = exr_write_scanline_chunk_info(writer->context, 0, y, &chunk);
        if (!result)
            result = y ? exr_encoding_update(writer->context, 0, &chunk, &encoder)
                       : exr_encoding_initialize(writer->context, 0, &chunk, &encoder);
        if (result)
            break;
        point_at_lines(writer, &encoder, y);
        if (!y)
            result = exr_encoding_choose_default_routines(writer->context, 0, &encoder);
        if (!result)
            result = exr_encoding_run(writer->context, 0, &encoder);
    }
    exr_encoding_destroy(writer->context, &encoder);
    return result;
}

static sgs_status write_image(exr_writer *writer, const char *path)
{
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
    setup.error_handler_fn = keep_complaint;
    setup.alloc_fn = allocate;
    setup.free_fn = sgsi_free;
    setup.user_data = writer;
    setup.write_fn = write_bytes;
    complaint[0] = 0;
    exr_result_t result = exr_start_write(&writer->context, path, EXR_WRITE_FILE_DIRECTLY, &setup);
    if (!result)
        result = write_header(writer);
    if (!result)
        result = write_pixels(writer);
    const exr_result_t finished = exr_finish(&writer->context); // writes the chunk table
    if (!result)
        result = finished;
    if (!result && !writer->write_error)
        return SGS_STATUS_OK;
    if (writer->write_error)
        return sgsi_fail(SGS_STATUS_IO, "%s: cannot be written: %s", path, strerror(writer->write_error));
    if (result == EXR_ERR_OUT_OF_MEMORY)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: no memory to write it", path);
    return sgsi_fail(SGS_STATUS_INTERNAL, "%s: cannot be written: OpenEXR: %s", path,
                     complaint[0] ? complaint : exr_get_default_error_message(result));
}

sgs_status sgs_exr_write(const char *path, const sgs_exr_info *info, const sgs_exr_channel *channels, int channel_count)
{
    if (info->width < 1 || info->height < 1 || info->width > MAX_SIDE || info->height > MAX_SIDE)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: an image of %d x %d pixels cannot be written", path,
                         info->width, info->height);
    sgs_status status = check_channels(path, channels, channel_count);
    if (status)
        return status;
    exr_writer writer = {.info = info};
    status = sort_channels(&writer, path, channels, channel_count);
    if (!status)
        status = sgsi_atomic_open(&writer.file, path);
    if (!status) {
        status = write_image(&writer, path);
        if (!status)
            status = sgsi_atomic_commit(&writer.file);
    }
    sgsi_atomic_abort(&writer.file);
    sgsi_free(writer.sorted);
    return status;
}
