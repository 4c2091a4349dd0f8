// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Writes SOG version 2; sog.c describes the format. Positions are rounded to the nearest of 65536
// steps, codebooks are least-squares fits of the values, and SH of degrees 1 to 3 share a palette.

#include "sog/sog.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "sog/palette.h"
#include "sog/sog_model.h"
#include "sparegs/version.h"
#include "storage/row_order.h"

enum { MAX_PALETTE = 65536, JSON_DIGITS = 9 };

static const double SQRT_2 = 1.41421356237309505;
static const char *const texture_names[SGSI_SOG_TEXTURES] = {
    "means_l.webp", "means_u.webp",       "scales.webp",    "quats.webp",
    "sh0.webp",     "shN_centroids.webp", "shN_labels.webp"};
static const char meta_name[] = "meta.json";

typedef struct sog_writer {
    const sgs_gaussians *model;
    const uint32_t *order;
    size_t count, palette_size;
    int sh_degree, rest; // rest: SH values per primitive
    bool antialiased;
    float means_low[3], means_high[3];
    float scales[SGSI_CODES], colors[SGSI_CODES], rests[SGSI_CODES];
    sgsi_palette palette;
    sgsi_webp textures[SGSI_SOG_TEXTURES];
    sgsi_archive_file *files; // [SGSI_SOG_TEXTURES]
    sgs_status status[SGSI_SOG_TEXTURES];
    sgsi_progress *progress;
} sog_writer;

// Entries for a model of this size: the largest power of two up to the count, from 1 k to 64 k.
static size_t default_palette(size_t count)
{
    size_t size = 1024;
    while (size < MAX_PALETTE && 2 * size <= count)
        size *= 2;
    return size;
}

size_t sgsi_sog_steps(const sgs_gaussians *model, const sgs_model_write_options *options)
{
    (void)options;
    return SGSI_SOG_TEXTURES + (model->sh_degree ? SGSI_PALETTE_STEPS : 0);
}

static double log_position(double value)
{
    return copysign(log1p(fabs(value)), value);
}

static sgs_status fit_codebook(const sog_writer *writer, int param, float codebook[SGSI_CODES])
{
    float *values = sgsi_alloc(3 * writer->count + 1, sizeof *values);
    if (!values)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to quantise %zu primitives",
                         writer->count);
    for (size_t i = 0; i < writer->count; ++i)
        for (int k = 0; k < 3; ++k)
            values[3 * i + (size_t)k] =
                *sgs_gaussians_at(writer->model, writer->order[i], param + k);
    sgsi_codebook_fit(values, 3 * writer->count, codebook);
    sgsi_free(values);
    return SGS_STATUS_OK;
}

// The palette of SH, channel-major vectors, and its codebook.
static sgs_status train_palette(sog_writer *writer, int iterations)
{
    const size_t rest = (size_t)writer->rest;
    float *vectors = sgsi_alloc(writer->count + 1, rest * sizeof *vectors);
    sgs_status status =
        vectors ? SGS_STATUS_OK
                : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                            "not enough memory to quantise %zu primitives", writer->count);
    for (size_t i = 0; vectors && i < writer->count; ++i)
        for (size_t k = 0; k < rest; ++k)
            vectors[i * rest + k] =
                *sgs_gaussians_at(writer->model, writer->order[i], SGS_PARAM_SH_REST + (int)k);
    if (!status)
        status = sgsi_palette_train(vectors, writer->count, writer->rest, writer->palette_size,
                                    iterations, writer->progress, &writer->palette);
    sgsi_free(vectors);
    if (status)
        return status;
    float *values = sgsi_alloc(writer->palette.size + 1, rest * sizeof *values);
    if (!values)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to quantise %zu primitives",
                         writer->count);
    memcpy(values, writer->palette.entries, writer->palette.size * rest * sizeof *values);
    sgsi_codebook_fit(values, writer->palette.size * rest, writer->rests);
    sgsi_free(values);
    return SGS_STATUS_OK;
}

static void find_bounds(sog_writer *writer)
{
    for (int k = 0; k < 3; ++k) {
        double low = INFINITY, high = -INFINITY;
        for (size_t i = 0; i < writer->count; ++i) {
            const double t = log_position(
                (double)*sgs_gaussians_at(writer->model, writer->order[i], SGS_PARAM_MEAN + k));
            low = fmin(low, t);
            high = fmax(high, t);
        }
        writer->means_low[k] = (float)low;
        writer->means_high[k] = (float)high;
    }
}

// Width and height of the textures with a pixel per primitive.
static sgs_status make_textures(sog_writer *writer)
{
    const size_t width = ((size_t)ceil(sqrt((double)writer->count)) + 3) / 4 * 4,
                 rows = (writer->count + width - 1) / width, height = (rows + 3) / 4 * 4,
                 entries = writer->palette.size;
    for (int k = 0; k < SGSI_SOG_TEXTURES; ++k) {
        sgsi_webp *texture = &writer->textures[k];
        if (!writer->rest && k >= SGSI_SOG_CENTROIDS)
            break;
        texture->width = (int)width;
        texture->height = (int)height;
        if (k == SGSI_SOG_CENTROIDS) {
            texture->width = SGSI_SOG_PALETTE_COLUMNS * writer->rest / 3;
            texture->height =
                (int)((entries + SGSI_SOG_PALETTE_COLUMNS - 1) / SGSI_SOG_PALETTE_COLUMNS);
        }
        texture->rgba = sgsi_calloc((size_t)texture->width * (size_t)texture->height, 4);
        if (!texture->rgba)
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                             "not enough memory for textures of %zu primitives", writer->count);
    }
    return SGS_STATUS_OK;
}

static void encode_rotation(const double q[4], uint8_t *pixel)
{
    int largest = 0;
    for (int k = 1; k < 4; ++k)
        if (fabs(q[k]) > fabs(q[largest]))
            largest = k;
    const double sign = q[largest] < 0.0 ? -1.0 : 1.0;
    for (int k = 0, at = 0; k < 4; ++k)
        if (k != largest)
            pixel[at++] = sgsi_unorm8(0.5 * sign * SQRT_2 * q[k] + 0.5);
    pixel[3] = (uint8_t)(252 + largest);
}

static void encode_pixels(void *context, size_t begin, size_t end, int thread)
{
    (void)thread;
    sog_writer *writer = context;
    for (size_t i = begin; i < end; ++i) {
        const sgsi_splat splat = sgsi_splat_get(writer->model, writer->order[i]);
        uint8_t *pixel[SGSI_SOG_TEXTURES];
        for (int k = 0; k < SGSI_SOG_TEXTURES; ++k)
            pixel[k] = writer->textures[k].rgba && k != SGSI_SOG_CENTROIDS
                           ? writer->textures[k].rgba + 4 * i
                           : NULL;
        for (int k = 0; k < 3; ++k) {
            const double low = (double)writer->means_low[k],
                         size = (double)writer->means_high[k] - low,
                         unit =
                             size > 0.0 ? (log_position((double)splat.mean[k]) - low) / size : 0.0;
            const uint32_t bits = (uint32_t)fmin(fmax(floor(65535.0 * unit + 0.5), 0.0), 65535.0);
            pixel[SGSI_SOG_MEANS_LOW][k] = (uint8_t)bits;
            pixel[SGSI_SOG_MEANS_HIGH][k] = (uint8_t)(bits >> 8);
            pixel[SGSI_SOG_SCALES][k] = sgsi_codebook_index(writer->scales, splat.log_scale[k]);
            pixel[SGSI_SOG_SH0][k] = sgsi_codebook_index(writer->colors, splat.dc[k]);
        }
        pixel[SGSI_SOG_MEANS_LOW][3] = pixel[SGSI_SOG_MEANS_HIGH][3] = 255;
        pixel[SGSI_SOG_SCALES][3] = 255;
        pixel[SGSI_SOG_SH0][3] = sgsi_unorm8(splat.opacity);
        encode_rotation(splat.rotation, pixel[SGSI_SOG_QUATS]);
        if (writer->rest) {
            sgsi_store_u16(pixel[SGSI_SOG_LABELS], writer->palette.labels[i]);
            pixel[SGSI_SOG_LABELS][3] = 255;
        }
    }
}

static void encode_palette(const sog_writer *writer)
{
    const sgsi_webp *texture = &writer->textures[SGSI_SOG_CENTROIDS];
    const size_t coefficients = (size_t)writer->rest / 3;
    for (size_t k = 0; k < writer->palette.size; ++k)
        for (size_t j = 0; j < coefficients; ++j) {
            uint8_t *pixel =
                texture->rgba + 4 * (k / SGSI_SOG_PALETTE_COLUMNS * (size_t)texture->width +
                                     k % SGSI_SOG_PALETTE_COLUMNS * coefficients + j);
            for (size_t c = 0; c < 3; ++c)
                pixel[c] = sgsi_codebook_index(
                    writer->rests, writer->palette.entries[3 * (k * coefficients + j) + c]);
            pixel[3] = 255;
        }
}

static void compress_texture(void *context, size_t k, int thread)
{
    (void)thread;
    sog_writer *writer = context;
    if (writer->textures[k].rgba && !sgsi_progress_cancelled(writer->progress))
        writer->status[k] =
            sgsi_webp_encode(&writer->textures[k], &writer->files[k].bytes, &writer->files[k].size);
    sgsi_webp_free(&writer->textures[k]);
    sgsi_progress_advance(writer->progress);
}

// ---- meta.json ----

static json_t *numbers(const float *values, size_t count)
{
    json_t *list = json_array();
    for (size_t k = 0; k < count; ++k)
        json_array_append_new(list, json_real((double)values[k]));
    return list;
}

static json_t *attribute(const char *codebook_name, const float *codebook, int first, int count)
{
    json_t *object = json_object(), *files = json_array();
    if (codebook)
        json_object_set_new(object, codebook_name, numbers(codebook, SGSI_CODES));
    for (int k = 0; k < count; ++k)
        json_array_append_new(files, json_string(texture_names[first + k]));
    json_object_set_new(object, "files", files);
    return object;
}

static sgs_status write_meta(const sog_writer *writer, sgsi_archive_file *file)
{
    json_t *meta = json_object(), *means = attribute(NULL, NULL, SGSI_SOG_MEANS_LOW, 2);
    json_object_set_new(meta, "version", json_integer(2));
    json_object_set_new(meta, "asset", json_pack("{s:s}", "generator", "sparegs " SGS_VERSION));
    json_object_set_new(meta, "count", json_integer((json_int_t)writer->count));
    if (writer->antialiased) { // of the specification, and of splat-transform
        json_object_set_new(meta, "antialias", json_true());
        json_object_set_new(meta, "model", json_string("antialiased"));
    }
    json_object_set_new(means, "mins", numbers(writer->means_low, 3));
    json_object_set_new(means, "maxs", numbers(writer->means_high, 3));
    json_object_set_new(meta, "means", means);
    json_object_set_new(meta, "scales", attribute("codebook", writer->scales, SGSI_SOG_SCALES, 1));
    json_object_set_new(meta, "quats", attribute(NULL, NULL, SGSI_SOG_QUATS, 1));
    json_object_set_new(meta, "sh0", attribute("codebook", writer->colors, SGSI_SOG_SH0, 1));
    if (writer->rest) {
        json_t *rest = attribute("codebook", writer->rests, SGSI_SOG_CENTROIDS, 2);
        json_object_set_new(rest, "count", json_integer((json_int_t)writer->palette.size));
        json_object_set_new(rest, "bands", json_integer(writer->sh_degree));
        json_object_set_new(meta, "shN", rest);
    }
    char *text = json_dumps(meta, JSON_COMPACT | JSON_REAL_PRECISION(JSON_DIGITS));
    json_decref(meta);
    file->size = text ? strlen(text) : 0;
    file->bytes = text ? sgsi_alloc(file->size + 1, 1) : NULL;
    if (file->bytes)
        memcpy(file->bytes, text, file->size);
    free(text);
    snprintf(file->name, sizeof file->name, "%s", meta_name);
    return file->bytes ? SGS_STATUS_OK
                       : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for meta.json");
}

sgs_status sgsi_sog_encode(const sgs_gaussians *model, const uint32_t *order, size_t count,
                           const sgs_model_write_options *options, sgsi_progress *progress,
                           sgsi_archive_file files[SGSI_SOG_FILES], size_t *file_count)
{
    memset(files, 0, SGSI_SOG_FILES * sizeof *files);
    *file_count = 0;
    sog_writer *writer = sgsi_calloc(1, sizeof *writer);
    if (!writer)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to encode %zu primitives",
                         count);
    *writer = (sog_writer){.model = model,
                           .order = order,
                           .count = count,
                           .palette_size = options->sh_palette ? (size_t)options->sh_palette
                                                               : default_palette(count),
                           .sh_degree = model->sh_degree,
                           .rest = 3 * sgsi_rest_coefficients(model->sh_degree),
                           .antialiased = options->antialiased,
                           .files = files,
                           .progress = progress};
    find_bounds(writer);
    sgs_status status = fit_codebook(writer, SGS_PARAM_SCALE, writer->scales);
    if (!status)
        status = fit_codebook(writer, SGS_PARAM_SH_DC, writer->colors);
    if (!status && writer->rest)
        status = train_palette(writer, options->palette_iterations);
    if (!status)
        status = make_textures(writer);
    if (!status) {
        sgsi_parallel_ranges(count, 4096, encode_pixels, writer);
        if (writer->rest)
            encode_palette(writer);
        status = write_meta(writer, &files[SGSI_SOG_TEXTURES]);
    }
    for (int k = 0; k < SGSI_SOG_TEXTURES; ++k)
        snprintf(files[k].name, sizeof files[k].name, "%s", texture_names[k]);
    if (!status)
        sgsi_parallel_for(SGSI_SOG_TEXTURES, 1, compress_texture, writer);
    for (int k = 0; k < SGSI_SOG_TEXTURES; ++k) {
        if (!status && writer->status[k])
            status = sgsi_fail(writer->status[k],
                               "the textures of %zu primitives cannot be encoded", count);
        sgsi_webp_free(&writer->textures[k]);
    }
    if (!status && sgsi_progress_cancelled(progress))
        status = sgsi_fail(SGS_STATUS_CANCELLED, "cancelled");
    sgsi_palette_free(&writer->palette);
    // The files in use come first, meta.json last.
    for (int k = 0; k < SGSI_SOG_FILES; ++k)
        if (files[k].bytes) {
            const sgsi_archive_file moved = files[k];
            files[k].bytes = NULL;
            files[(*file_count)++] = moved;
        }
    sgsi_free(writer);
    return status;
}

sgs_status sgsi_sog_encode_model(const sgs_gaussians *model, const sgs_model_write_options *options,
                                 sgsi_archive_file files[SGSI_SOG_FILES], size_t *file_count)
{
    sgsi_progress progress;
    uint32_t *order = NULL;
    sgs_status status = sgsi_order_by_position(model, &order);
    sgsi_progress_begin(&progress, options->progress, options->progress_user,
                        sgsi_sog_steps(model, options));
    if (!status)
        status = sgsi_sog_encode(model, order, model->count, options, &progress, files, file_count);
    sgsi_progress_end(&progress);
    sgsi_free(order);
    return status;
}

void sgsi_sog_files_free(sgsi_archive_file files[SGSI_SOG_FILES])
{
    for (int k = 0; k < SGSI_SOG_FILES; ++k) {
        sgsi_free(files[k].bytes);
        files[k].bytes = NULL;
    }
}

sgs_status sgsi_sog_put(sgsi_model_folder *folder, const char *unit, const sgsi_archive_file *files,
                        size_t count, uint64_t *written)
{
    sgs_status status = SGS_STATUS_OK;
    for (size_t k = 0; k < count && !status; ++k) {
        char name[96];
        snprintf(name, sizeof name, "%s%.63s", unit, files[k].name);
        status = sgsi_model_folder_put(folder, name, files[k].bytes, files[k].size);
        *written += files[k].size;
    }
    return status;
}

sgs_status sgsi_sog_drop(sgsi_model_folder *folder, const char *unit)
{
    char *meta = sgsi_format("%s/%s%s", folder->path, unit, meta_name);
    const bool is_model = meta && sgsi_is_file(meta);
    sgsi_free(meta);
    sgs_status status = SGS_STATUS_OK;
    for (int k = 0; is_model && k < SGSI_SOG_FILES && !status; ++k) {
        char name[96];
        snprintf(name, sizeof name, "%s%s", unit,
                 k < SGSI_SOG_TEXTURES ? texture_names[k] : meta_name);
        status = sgsi_model_folder_drop(folder, name);
    }
    return status;
}

static sgs_status write_folder(const char *path, const sgsi_archive_file *files, size_t count,
                               uint64_t *written)
{
    sgsi_model_folder folder;
    sgs_status status = sgsi_model_folder_open(&folder, path, meta_name);
    if (!status)
        status = sgsi_sog_put(&folder, "", files, count, written);
    if (!status)
        status = sgsi_sog_drop(&folder, "");
    if (!status)
        status = sgsi_model_folder_commit(&folder);
    sgsi_model_folder_close(&folder);
    return status;
}

sgs_status sgsi_sog_write(const char *path, const sgs_gaussians *model,
                          const sgs_model_write_options *options, sgs_model_written *written)
{
    sgsi_archive_file files[SGSI_SOG_FILES] = {0};
    size_t file_count = 0;
    char *folder = sgsi_sog_folder(path);
    sgs_status status = folder ? sgsi_sog_encode_model(model, options, files, &file_count)
                               : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory", path);
    if (!status)
        status = strcmp(folder, path)
                     ? write_folder(folder, files, file_count, &written->bytes)
                     : sgsi_archive_write(path, files, file_count, &written->bytes);
    written->order = SGS_ROWS_MORTON;
    sgsi_sog_files_free(files);
    sgsi_free(folder);
    return status;
}
