// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Writes EXR files with OpenEXR's C library (OpenEXRCore 3.1 and later).
//
// OpenEXRCore writes through a callback to an atomic file, so an EXR appears under its name only
// when it is complete and on disk, like all other outputs. Its error messages are captured for
// sgs_last_error(), and it uses the library's allocator.
//
// Chunks are encoded in parallel, a band of them at a time, because compression dominates the time.
// They are written in order: the bytes of a file do not depend on the number of threads.
//
// Flat files are not written by OpenImageIO, because it uses one compression for all chunks of a
// file, and with OpenEXR 3.1 it deflates by zlib (see exr_zip.c). Floats with noise in their low
// bits barely shrink, yet deflating them takes several times as long as tracing them. The format
// permits uncompressed chunks, so SGS_EXR_AUTO compresses a sample of lines of each band and
// compresses the band only if this saves a third.

#include "image/exr_writer.h"

#include <errno.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "image/exr_zip.h"
#include "image/primaries.h"
#include "sparegs/output_file.h"
#include "sparegs/runtime.h"
#include "base/threads.h"

enum { MAX_SHORT_NAME = 31, BAND_CHUNKS = 16, SAMPLES = 4 };

// First error message of OpenEXR in this call. Not stored in the writer: asking the context for its
// user data inside the handler would deadlock on a lock held by the caller.
static _Thread_local char last_message[256];

static void *allocate(size_t bytes)
{
    return sgsi_alloc(bytes, 1);
}

static void keep_message(exr_const_context_t context, exr_result_t code, const char *message)
{
    (void)context;
    (void)code;
    if (last_message[0] || !message)
        return;
    const char *text = strrchr(message, ':'); // "file: text"
    text = text ? text + 1 : message;
    while (*text == ' ')
        ++text;
    snprintf(last_message, sizeof last_message, "%s", text);
}

static int64_t write_bytes(exr_const_context_t context, void *user, const void *bytes,
                           uint64_t size, uint64_t offset, exr_stream_error_func_ptr_t error)
{
    (void)context;
    (void)error;
    sgsi_exr_writer *writer = user;
    uint64_t done = 0;
    while (done < size) {
        const ssize_t step = pwrite(fileno(writer->file.stream), (const char *)bytes + done,
                                    (size_t)(size - done), (off_t)(offset + done));
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

exr_context_initializer_t sgsi_exr_setup(void *user)
{
    exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
    setup.error_handler_fn = keep_message;
    setup.alloc_fn = allocate;
    setup.free_fn = sgsi_free;
    setup.user_data = user;
    return setup;
}

// ---- The header ----

// EXR uses row vectors, p' = p M: the transpose of the matrix for column vectors.
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

double sgs_pixel_aspect(double fx, double fy, int width, int height)
{
    const double aspect = fy / fx, least = fmax(0.01, 1.0 / fmin(width, height));
    return fabs(aspect - 1) <= least ? 1 : aspect;
}

// Focal length and film back (names of OpenEXR's standard attributes), or the kind of a panorama.
static exr_result_t set_camera(exr_context_t context, const sgs_exr_info *info)
{
    if (info->is_latlong)
        return exr_attr_set_envmap(context, 0, "envmap", EXR_ENVMAP_LATLONG);
    if (!info->intrinsics)
        return EXR_ERR_SUCCESS;
    const double *k = info->intrinsics;
    const int width = info->width - 2 * info->overscan, height = info->height - 2 * info->overscan;
    const double film_width = 36.0, focal = k[0] / width * film_width; // mm
    const exr_attr_v2f_t size = {.x = (float)film_width, .y = (float)(height / k[1] * focal)};
    // Of the image plane at distance 1, y up.
    const exr_attr_v2f_t center = {.x = (float)((0.5 * width - k[2]) / k[0]),
                                   .y = (float)((k[3] - 0.5 * height) / k[1])};
    exr_result_t result = exr_attr_set_float(context, 0, "pinholeFocalLength", (float)focal);
    if (!result)
        result = exr_attr_set_v2f(context, 0, "sensorOverallDimensions", &size);
    if (!result)
        result = exr_set_pixel_aspect_ratio(context, 0,
                                            (float)sgs_pixel_aspect(k[0], k[1], width, height));
    if (!result)
        result = exr_set_screen_window_center(context, 0, &center);
    return result ? result : exr_set_screen_window_width(context, 0, (float)(width / k[0]));
}

bool sgs_frame_rate(double rate, int *numerator, int *denominator)
{
    if (!(rate >= 0.001 && rate <= 1e6))
        return false;
    const double next = ceil(rate);
    *numerator = (int)lround(1000 * rate);
    *denominator = 1000;
    if (*numerator % 1000 == 0) {
        *numerator /= 1000;
        *denominator = 1;
    } else if (next >= 24 && fabs(rate - next / 1.001) < 0.002) {
        *numerator = (int)(1000 * next);
        *denominator = 1001;
    }
    return true;
}

static exr_result_t set_frame_rate(exr_context_t context, double rate)
{
    int numerator, denominator;
    if (!sgs_frame_rate(rate, &numerator, &denominator)) // 0: none
        return EXR_ERR_SUCCESS;
    const exr_attr_rational_t rational = {.num = numerator, .denom = (uint32_t)denominator};
    return exr_attr_set_rational(context, 0, "framesPerSecond", &rational);
}

// Samples of a pixel are sorted and do not overlap. OpenEXR's C library has no type for this
// attribute; its C++ library stores one byte.
static exr_result_t set_deep_state(exr_context_t context)
{
    static const char name[] = "deepImageState";
    const unsigned char tidy = 3;
    exr_attribute_t *attribute;
    // OpenEXR 3.1 crashes where exr_attr_set_user has not enough memory for a new attribute.
    const exr_result_t result = exr_attr_declare_by_type(context, 0, name, name, &attribute);
    return result ? result : exr_attr_set_user(context, 0, name, name, 1, &tidy);
}

static exr_result_t set_attributes(exr_context_t context, const sgs_exr_info *info)
{
    const float *const p = sgsi_rec709;
    const exr_attr_chromaticities_t rec709 = {p[0], p[1], p[2], p[3], p[4], p[5], p[6], p[7]};
    char software[64];
    snprintf(software, sizeof software, "sparegs %s", sgs_version());
    exr_result_t result = exr_attr_set_chromaticities(context, 0, "chromaticities", &rec709);
    if (!result)
        result = set_text(context, "software", software);
    if (!result)
        result = set_text(context, "colorInteropID", info->color_space);
    if (!result)
        result = set_text(context, "sparegs:depthDefinition", info->depth_definition);
    if (!result)
        result = set_text(context, "sparegs:view", info->view_name);
    if (!result)
        result = set_matrix(context, "worldToCamera", info->world_to_camera);
    if (!result)
        result = set_matrix(context, "worldToNDC", info->world_to_ndc);
    if (!result)
        result = set_frame_rate(context, info->frame_rate);
    return result ? result : set_camera(context, info);
}

static exr_result_t set_windows(exr_context_t context, const sgs_exr_info *info)
{
    const int over = info->overscan;
    const exr_attr_box2i_t data = {.min = {.x = -over, .y = -over},
                                   .max = {.x = info->width - over - 1,
                                           .y = info->height - over - 1}},
                           display = {.min = {.x = 0, .y = 0},
                                      .max = {.x = info->width - 2 * over - 1,
                                              .y = info->height - 2 * over - 1}};
    const exr_result_t result = exr_set_data_window(context, 0, &data);
    return result ? result : exr_set_display_window(context, 0, &display);
}

static int compare_columns(const void *a, const void *b)
{
    return strcmp(((const sgsi_exr_column *)a)->name, ((const sgsi_exr_column *)b)->name);
}

static exr_result_t write_header(exr_context_t context, const sgs_exr_info *info,
                                 exr_storage_t storage, exr_compression_t compression,
                                 int max_samples, const sgsi_exr_column *columns, int count)
{
    // Only if required: readers from before 2013 reject files with long names.
    int part, has_long_names = 0;
    for (int k = 0; k < count; ++k)
        has_long_names |= strlen(columns[k].name) > MAX_SHORT_NAME;
    exr_result_t result = exr_set_longname_support(context, has_long_names);
    const bool deep = storage == EXR_STORAGE_DEEP_SCANLINE;
    if (!result)
        result = exr_add_part(context, deep ? "deep" : NULL, storage, &part);
    if (!result)
        result =
            exr_initialize_required_attr_simple(context, 0, info->width, info->height, compression);
    if (!result)
        result = set_windows(context, info);
    for (int k = 0; !result && k < count; ++k)
        result = exr_add_channel(context, 0, columns[k].name, columns[k].type,
                                 EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1);
    if (!result)
        result = set_attributes(context, info);
    if (!result && deep) // version of the deep format
        result = exr_set_version(context, 0, 1);
    if (!result && deep)
        result = exr_attr_set_int(context, 0, "maxSamplesPerPixel", max_samples);
    if (!result && deep)
        result = set_deep_state(context);
    return result ? result : exr_write_header(context);
}

static sgs_status check_size(const char *path, const sgs_exr_info *info)
{
    const int shorter = info->width < info->height ? info->width : info->height;
    if (info->width < 1 || info->height < 1 || info->width > SGSI_EXR_MAX_SIDE ||
        info->height > SGSI_EXR_MAX_SIDE)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: invalid image size %d x %d", path,
                         info->width, info->height);
    if (info->overscan < 0 || info->overscan > (shorter - 1) / 2)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "%s: invalid overscan of %d pixels, the image has %d x %d", path,
                         info->overscan, info->width, info->height);
    return SGS_STATUS_OK;
}

// The ranges of the attributes, which OpenEXR refuses without naming them.
static sgs_status check_intrinsics(const char *path, const sgs_exr_info *info)
{
    const double *k = info->intrinsics;
    for (int i = 0; i < 4; ++i)
        if (!isfinite(k[i]) || (i < 2 && !(k[i] > 0)))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: intrinsics[%d] = %g is not %s", path,
                             i, k[i], i < 2 ? "a positive focal length" : "finite");
    const double aspect = k[1] / k[0], largest = (double)FLT_MAX;
    if (!(aspect >= 1e-6 && aspect <= 1e6) || !(36 * info->width / k[0] <= largest) ||
        !(36 * k[0] <= largest) || !(36 * k[0] * info->height / k[1] <= largest) ||
        !(fabs(info->width - k[2]) / k[0] <= largest) ||
        !(fabs(k[3] - info->height) / k[1] <= largest))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "%s: intrinsics %g, %g, %g, %g are out of range", path, k[0], k[1], k[2],
                         k[3]);
    return SGS_STATUS_OK;
}

sgs_status sgsi_exr_check_info(const char *path, const sgs_exr_info *info)
{
    int numerator, denominator;
    const sgs_status status = check_size(path, info);
    if (status)
        return status;
    if (info->frame_rate != 0 && !sgs_frame_rate(info->frame_rate, &numerator, &denominator))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "%s: frame_rate %g is neither 0 nor in [0.001, 1e6]", path,
                         info->frame_rate);
    return info->intrinsics && !info->is_latlong ? check_intrinsics(path, info) : SGS_STATUS_OK;
}

sgs_status sgsi_exr_open(sgsi_exr_writer *writer, const char *path, const sgs_exr_info *info,
                         exr_storage_t storage, exr_compression_t compression, int max_samples,
                         const sgsi_exr_column *columns, int column_count)
{
    *writer = (sgsi_exr_writer){.path = path, .first_line = -info->overscan};
    sgsi_exr_column *sorted = sgsi_alloc((size_t)column_count, sizeof *sorted);
    if (!sorted)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    memcpy(sorted, columns, (size_t)column_count * sizeof *sorted);
    qsort(sorted, (size_t)column_count, sizeof *sorted, compare_columns);
    sgs_status status = sgs_output_file_open(&writer->file, path);
    if (!status) {
        exr_context_initializer_t setup = sgsi_exr_setup(writer);
        setup.write_fn = write_bytes;
        last_message[0] = 0;
        exr_result_t result =
            exr_start_write(&writer->context, path, EXR_WRITE_FILE_DIRECTLY, &setup);
        if (!result)
            result = write_header(writer->context, info, storage, compression, max_samples, sorted,
                                  column_count);
        if (result)
            status = sgsi_exr_close(writer, result);
    }
    sgsi_free(sorted);
    return status;
}

sgs_status sgsi_exr_check(const sgsi_exr_writer *writer, exr_result_t result)
{
    if (writer->write_error)
        return sgsi_fail(SGS_STATUS_IO, "%s: cannot be written: %s", writer->path,
                         strerror(writer->write_error));
    if (result == EXR_ERR_OUT_OF_MEMORY)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it",
                         writer->path);
    if (result)
        return sgsi_fail(SGS_STATUS_INTERNAL, "%s: cannot be written: OpenEXR: %s", writer->path,
                         last_message[0] ? last_message : exr_get_default_error_message(result));
    return SGS_STATUS_OK;
}

sgs_status sgsi_exr_close(sgsi_exr_writer *writer, exr_result_t result)
{
    const exr_result_t finished = exr_finish(&writer->context); // writes the chunk table
    sgs_status status = sgsi_exr_check(writer, result ? result : finished);
    if (!status)
        status = sgs_output_file_commit(&writer->file);
    sgs_output_file_abort(&writer->file);
    return status;
}

// ---- Chunks ----

typedef struct chunk_band {
    sgsi_exr_writer *writer;
    sgsi_exr_fill_fn fill;
    const void *context;
    int begin, count, lines, height; // first line; chunks; lines per chunk; height of the image
    sgsi_exr_zip *zip;               // for ZIP, ZIPS and AUTO
    uint8_t *zipped;                 // [BAND_CHUNKS][capacity]
    size_t capacity;
    exr_encode_pipeline_t encoders[BAND_CHUNKS];
    exr_result_t results[BAND_CHUNKS];
    size_t bytes[BAND_CHUNKS]; // in `zipped`; 0: store the chunk as encoded
    size_t sampled[SAMPLES], shrunk[SAMPLES];
} chunk_band;

// Replaces the encoder's write: chunks are written later, in order.
static exr_result_t hold_chunk(exr_encode_pipeline_t *encoder)
{
    (void)encoder;
    return EXR_ERR_SUCCESS;
}

static int lines_of(const chunk_band *band, size_t item)
{
    const int y = band->begin + (int)item * band->lines;
    return y + band->lines < band->height ? band->lines : band->height - y;
}

static void encode_chunk(void *context, size_t item, int thread)
{
    (void)thread;
    chunk_band *band = context;
    exr_encode_pipeline_t *encoder = &band->encoders[item];
    if (band->results[item])
        return;
    band->fill(band->context, encoder, band->begin + (int)item * band->lines, lines_of(band, item));
    band->results[item] = exr_encoding_choose_default_routines(band->writer->context, 0, encoder);
    if (band->zip)
        encoder->compress_fn = NULL;
    encoder->write_fn = hold_chunk;
    encoder->yield_until_ready_fn = hold_chunk;
    if (!band->results[item])
        band->results[item] = exr_encoding_run(band->writer->context, 0, encoder);
}

static void zip_chunk(void *context, size_t item, int thread)
{
    chunk_band *band = context;
    const exr_encode_pipeline_t *encoder = &band->encoders[item];
    if (!band->results[item])
        band->bytes[item] =
            sgsi_exr_zip_pack(band->zip, thread, encoder->compressed_buffer,
                              encoder->compressed_bytes, band->zipped + item * band->capacity);
}

// Compresses one line of a chunk of the band.
static void sample_line(void *context, size_t item, int thread)
{
    chunk_band *band = context;
    const size_t chunk = item * (size_t)band->count / SAMPLES;
    const exr_encode_pipeline_t *encoder = &band->encoders[chunk];
    if (band->results[chunk])
        return;
    const size_t bytes = encoder->compressed_bytes / (size_t)lines_of(band, chunk);
    const size_t packed = sgsi_exr_zip_pack(band->zip, thread, encoder->compressed_buffer, bytes,
                                            band->zipped + item * band->capacity);
    band->sampled[item] = bytes;
    band->shrunk[item] = packed ? packed : bytes;
}

static bool zipping_pays(chunk_band *band)
{
    sgsi_parallel_for(SAMPLES, 1, sample_line, band);
    size_t sampled = 0, shrunk = 0;
    for (int k = 0; k < SAMPLES; ++k) {
        sampled += band->sampled[k];
        shrunk += band->shrunk[k];
    }
    return 3 * shrunk <= 2 * sampled;
}

static exr_result_t write_chunk(const chunk_band *band, size_t item)
{
    const exr_encode_pipeline_t *encoder = &band->encoders[item];
    const int y = band->writer->first_line + band->begin + (int)item * band->lines;
    if (band->results[item])
        return band->results[item];
    if (band->bytes[item])
        return exr_write_scanline_chunk(band->writer->context, 0, y,
                                        band->zipped + item * band->capacity, band->bytes[item]);
    return exr_write_scanline_chunk(band->writer->context, 0, y, encoder->compressed_buffer,
                                    encoder->compressed_bytes);
}

static bool prepare_zip(chunk_band *band, size_t largest)
{
    if (!band->capacity) {
        band->capacity = largest;
        band->zip = sgsi_exr_zip_create(sgsi_threads(), SGSI_EXR_FLOAT_LEVEL, largest);
        band->zipped = sgsi_alloc(BAND_CHUNKS * largest, 1);
    }
    return band->zip && band->zipped;
}

// The first chunk is the largest; others have at most as many lines.
static exr_result_t begin_chunks(chunk_band *band, bool zips)
{
    exr_result_t result = EXR_ERR_SUCCESS;
    band->count = 0;
    for (int y = band->begin; y < band->height && band->count < BAND_CHUNKS;
         y += band->lines, ++band->count) {
        exr_chunk_info_t chunk;
        exr_result_t *own = &band->results[band->count];
        *own = exr_write_scanline_chunk_info(band->writer->context, 0, band->writer->first_line + y,
                                             &chunk);
        if (!*own && zips && !prepare_zip(band, (size_t)chunk.unpacked_size))
            result = EXR_ERR_OUT_OF_MEMORY;
        if (!*own)
            *own = exr_encoding_initialize(band->writer->context, 0, &chunk,
                                           &band->encoders[band->count]);
    }
    return result;
}

static exr_result_t write_band(chunk_band *band, sgs_exr_compression compression)
{
    const bool zips =
        compression == SGS_EXR_AUTO || compression == SGS_EXR_ZIP || compression == SGS_EXR_ZIPS;
    exr_result_t result = begin_chunks(band, zips);
    memset(band->bytes, 0, sizeof band->bytes);
    if (!result)
        sgsi_parallel_for((size_t)band->count, 1, encode_chunk, band);
    if (!result && zips && (compression != SGS_EXR_AUTO || zipping_pays(band)))
        sgsi_parallel_for((size_t)band->count, 1, zip_chunk, band);
    for (int k = 0; k < band->count; ++k) {
        if (!result)
            result = write_chunk(band, (size_t)k);
        exr_encoding_destroy(band->writer->context, &band->encoders[k]);
    }
    band->begin += band->count * band->lines;
    return result;
}

exr_result_t sgsi_exr_write_lines(sgsi_exr_writer *writer, int height,
                                  sgs_exr_compression compression, sgsi_exr_fill_fn fill,
                                  const void *context)
{
    chunk_band *band = sgsi_calloc(1, sizeof *band);
    if (!band)
        return EXR_ERR_OUT_OF_MEMORY;
    band->writer = writer;
    band->fill = fill;
    band->context = context;
    band->height = height;
    exr_result_t result = exr_get_scanlines_per_chunk(writer->context, 0, &band->lines);
    while (!result && band->begin < height)
        result = write_band(band, compression);
    sgsi_exr_zip_destroy(band->zip);
    sgsi_free(band->zipped);
    sgsi_free(band);
    return result;
}
