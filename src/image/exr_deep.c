// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Deep scan-line EXR files. OpenEXRCore 3.1 can write deep chunks but does not compress their
// sample count tables, so the chunks are encoded here, after "OpenEXR File Layout", in bands of
// lines as they are rendered. A chunk is one line. Its table holds the running sum of samples per
// pixel; its data holds the samples of all pixels, channel by channel in the order of the channel
// names. Both are little-endian and ZIP-compressed; data that does not shrink is stored
// uncompressed.
//
// Half floats. Colours and alpha round independently of each other, in each sample by itself: an
// alpha that corrected the errors in front of it would keep the sum of the pixel closer, but behind
// an almost opaque sample it would be another alpha, and samples are also used alone.

#include <string.h>

#include "image/exr_writer.h"
#include "image/exr_zip.h"
#include "image/half.h"
#include "base/threads.h"

enum { CHANNELS = 6, DISPLAYED = 4, BAND_LINES = 32 }; // A, B, G and R are displayed, not Z, ZBack

// An encoded line, before it is written.
typedef struct deep_line {
    uint8_t *bytes; // [capacity]: see reserve_line
    size_t capacity;
    uint8_t *table, *data; // as written to the file
    size_t table_bytes, data_bytes, unpacked_bytes;
    bool failed; // out of memory
} deep_line;

struct sgs_exr_deep {
    sgsi_exr_writer writer;
    char *path;
    int width, height, next_row, max_samples;
    size_t sample_bytes;
    bool half;           // of colours and alpha
    sgsi_exr_zip *zip;   // NULL: uncompressed
    exr_result_t result; // first failure
    deep_line lines[BAND_LINES];
};

static void put_word(uint8_t *out, const void *word)
{
    uint32_t bits;
    memcpy(&bits, word, sizeof bits);
    for (int k = 0; k < 4; ++k)
        out[k] = (uint8_t)(bits >> 8 * k);
}

static void put_half(uint8_t *out, uint16_t bits)
{
    out[0] = (uint8_t)bits;
    out[1] = (uint8_t)(bits >> 8);
}

// A sample that lost its alpha would add its colour to what is behind it. Bits are compared because
// alphas below FLT_MIN count as 0 in the floating-point mode of loops.
static uint16_t half_alpha(float alpha)
{
    const uint16_t half = sgsi_half_nearest(alpha);
    uint32_t bits;
    memcpy(&bits, &alpha, sizeof bits);
    return bits && !half ? 1 : half;
}

typedef struct pack_job {
    sgs_exr_deep *deep;
    const uint32_t *counts;
    const sgs_deep_sample *samples;
    size_t first_sample[BAND_LINES + 1];
} pack_job;

// Table, data and their compressed copies, in one buffer.
static bool reserve_line(deep_line *line, size_t table_bytes, size_t data_bytes)
{
    const size_t required = 2 * (table_bytes + data_bytes);
    if (required <= line->capacity)
        return true;
    sgsi_free(line->bytes);
    line->capacity = required + required / 4;
    line->bytes = sgsi_alloc(line->capacity, 1);
    if (!line->bytes)
        line->capacity = 0;
    return line->bytes != NULL;
}

// Compresses `count` bytes of `raw` if they shrink. Returns the bytes to store and their size in
// *stored.
static uint8_t *zipped_or_raw(sgsi_exr_zip *zip, int thread, uint8_t *raw, size_t count,
                              uint8_t *out, size_t *stored)
{
    const size_t size = sgsi_exr_zip_pack(zip, thread, raw, count, out);
    *stored = size ? size : count;
    return size ? out : raw;
}

// The samples of a line, channel by channel.
static void put_samples(uint8_t *out, const sgs_deep_sample *samples, size_t count, bool half)
{
    uint8_t *const depths = out + (half ? 2 : 4) * DISPLAYED * count;
    for (size_t i = 0; i < count; ++i) {
        const sgs_deep_sample *s = &samples[i];
        const float displayed[DISPLAYED] = {s->alpha, s->color[2], s->color[1], s->color[0]};
        for (size_t k = 0; k < DISPLAYED; ++k) {
            const size_t at = k * count + i;
            if (half)
                put_half(out + 2 * at,
                         k ? sgsi_half_nearest(displayed[k]) : half_alpha(displayed[k]));
            else
                put_word(out + 4 * at, &displayed[k]);
        }
        put_word(depths + 4 * i, &s->z);
        put_word(depths + 4 * (count + i), &s->z_back);
    }
}

static void pack_line(void *context, size_t item, int thread)
{
    const pack_job *job = context;
    const size_t width = (size_t)job->deep->width;
    deep_line *line = &job->deep->lines[item];
    const uint32_t *counts = job->counts + item * width;
    const sgs_deep_sample *samples = job->samples + job->first_sample[item];
    const size_t total = job->first_sample[item + 1] - job->first_sample[item];
    const size_t table_bytes = 4 * width, data_bytes = job->deep->sample_bytes * total;
    line->failed = !reserve_line(line, table_bytes, data_bytes);
    if (line->failed)
        return;
    uint8_t *table = line->bytes, *data = table + table_bytes, *zipped_table = data + data_bytes;
    uint8_t *zipped_data = zipped_table + table_bytes;
    uint32_t sum = 0;
    for (size_t x = 0; x < width; ++x) {
        sum += counts[x];
        put_word(table + 4 * x, &sum);
    }
    put_samples(data, samples, total, job->deep->half);
    line->table = table, line->table_bytes = table_bytes;
    line->data = data, line->data_bytes = line->unpacked_bytes = data_bytes;
    sgsi_exr_zip *zip = job->deep->zip;
    if (!zip)
        return;
    line->table = zipped_or_raw(zip, thread, table, table_bytes, zipped_table, &line->table_bytes);
    line->data = zipped_or_raw(zip, thread, data, data_bytes, zipped_data, &line->data_bytes);
}

static void free_deep(sgs_exr_deep *deep)
{
    for (int k = 0; k < BAND_LINES; ++k)
        sgsi_free(deep->lines[k].bytes);
    sgsi_exr_zip_destroy(deep->zip);
    sgsi_free(deep->path);
    sgsi_free(deep);
}

sgs_status sgs_exr_deep_open(const char *path, const sgs_exr_info *info, int max_samples,
                             sgs_exr_deep **deep)
{
    *deep = NULL;
    sgs_status status = sgsi_exr_check_info(path, info);
    if (!status && max_samples < 1)
        status = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: max_samples %d is below 1", path,
                           max_samples);
    if (status)
        return status;
    sgs_exr_deep *made = sgsi_calloc(1, sizeof *made);
    if (made)
        made->path = sgsi_strdup(path);
    if (!made || !made->path) {
        sgsi_free(made);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    }
    made->width = info->width;
    made->height = info->height;
    made->max_samples = max_samples;
    made->half = info->deep_half;
    made->sample_bytes = DISPLAYED * (made->half ? 2 : 4) + 4 * (CHANNELS - DISPLAYED);
    const exr_pixel_type_t displayed = made->half ? EXR_PIXEL_HALF : EXR_PIXEL_FLOAT;
    const sgsi_exr_column columns[CHANNELS] = {{"A", displayed},       {"B", displayed},
                                               {"G", displayed},       {"R", displayed},
                                               {"Z", EXR_PIXEL_FLOAT}, {"ZBack", EXR_PIXEL_FLOAT}};
    const bool zips = info->compression != SGS_EXR_NONE;
    if (zips)
        made->zip =
            sgsi_exr_zip_create(sgsi_threads(), SGSI_EXR_FLOAT_LEVEL, 4 * (size_t)info->width);
    status = zips && !made->zip
                 ? sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path)
                 : sgsi_exr_open(&made->writer, made->path, info, EXR_STORAGE_DEEP_SCANLINE,
                                 zips ? EXR_COMPRESSION_ZIPS : EXR_COMPRESSION_NONE, max_samples,
                                 columns, CHANNELS);
    if (status) {
        free_deep(made);
        return status;
    }
    *deep = made;
    return SGS_STATUS_OK;
}

static exr_result_t write_band(sgs_exr_deep *deep, int rows, pack_job *job)
{
    size_t max_samples = 0;
    job->deep = deep;
    for (size_t row = 0; row < (size_t)rows; ++row) {
        job->first_sample[row + 1] = job->first_sample[row];
        for (size_t x = 0; x < (size_t)deep->width; ++x)
            job->first_sample[row + 1] += job->counts[row * (size_t)deep->width + x];
        const size_t own = job->first_sample[row + 1] - job->first_sample[row];
        max_samples = own > max_samples ? own : max_samples;
    }
    // The number of threads may have grown since the file was opened.
    if (deep->zip &&
        !sgsi_exr_zip_reserve(deep->zip, sgsi_threads(), deep->sample_bytes * max_samples))
        return EXR_ERR_OUT_OF_MEMORY;
    sgsi_parallel_for((size_t)rows, 1, pack_line, job);
    exr_result_t result = EXR_ERR_SUCCESS;
    for (int row = 0; row < rows && !result; ++row) {
        const deep_line *line = &deep->lines[row];
        result = line->failed
                     ? EXR_ERR_OUT_OF_MEMORY
                     : exr_write_deep_scanline_chunk(
                           deep->writer.context, 0, deep->writer.first_line + deep->next_row + row,
                           line->data, line->data_bytes, line->unpacked_bytes, line->table,
                           line->table_bytes);
    }
    return result;
}

// The header, which precedes the pixels, states the largest count.
static sgs_status check_counts(const sgs_exr_deep *deep, int rows, const uint32_t *counts)
{
    const size_t width = (size_t)deep->width;
    for (size_t i = 0; i < (size_t)rows * width; ++i)
        if (counts[i] > (uint32_t)deep->max_samples)
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                             "%s: pixel %zu of row %zu has %u samples, max_samples is %d",
                             deep->path, i % width, (size_t)deep->next_row + i / width, counts[i],
                             deep->max_samples);
    return SGS_STATUS_OK;
}

sgs_status sgs_exr_deep_write(sgs_exr_deep *deep, int rows, const uint32_t *counts,
                              const sgs_deep_sample *samples)
{
    if (rows < 0 || rows > deep->height - deep->next_row)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: more rows than the image has",
                         deep->path);
    const sgs_status status = check_counts(deep, rows, counts);
    if (status)
        return status;
    while (rows && !deep->result) {
        const int band = rows < BAND_LINES ? rows : BAND_LINES;
        pack_job job = {.counts = counts, .samples = samples};
        deep->result = write_band(deep, band, &job);
        deep->next_row += band;
        counts += (size_t)band * (size_t)deep->width;
        samples += job.first_sample[band];
        rows -= band;
    }
    return sgsi_exr_check(&deep->writer, deep->result);
}

sgs_status sgs_exr_deep_close(sgs_exr_deep *deep)
{
    const bool whole = deep->next_row == deep->height;
    sgs_status status =
        sgsi_exr_close(&deep->writer, whole || deep->result ? deep->result : EXR_ERR_UNKNOWN);
    if (status && !whole && !deep->result)
        status = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: only %d of its %d rows were written",
                           deep->path, deep->next_row, deep->height);
    free_deep(deep);
    return status;
}

void sgs_exr_deep_abort(sgs_exr_deep *deep)
{
    if (!deep)
        return;
    sgsi_exr_close(&deep->writer, EXR_ERR_UNKNOWN);
    free_deep(deep);
}
