// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// compressed.ply of PlayCanvas SuperSplat: a binary PLY with the elements
//     chunk   floats per 256 primitives: bounds of position, log scale and (since 2024) colour
//     vertex  four words: position and scale in 11, 10, 11 bits, rotation in 2 + 3 x 10, colour in
//     4 x 8 sh      optional, one byte per f_rest: floor((v / 8 + 1/2) 256)
// Values are relative to the bounds of the chunk. The rotation omits its largest component, whose
// index among (w, x, y, z) is in the upper two bits. Primitives are in Morton order.

#include "ply/ply_model.h"

#include <string.h>

#include "base/core.h"
#include "ply/ply_header.h"
#include "sparegs/output_file.h"
#include "storage/color_marks.h"
#include "storage/model_rows.h"
#include "storage/row_order.h"

enum { CHUNK_SIZE = 256, BOUND_COUNT = 18, OLD_BOUND_COUNT = 12, WORD_COUNT = 4, MAX_REST = 45 };

static const double SQRT_2 = 1.41421356237309505;
static const float MAX_STORED_LOG = 20.0f; // log scales are clamped to this magnitude

static const char *const bound_names[BOUND_COUNT] = {
    "min_x",       "min_y",       "min_z",       "max_x",       "max_y",       "max_z",
    "min_scale_x", "min_scale_y", "min_scale_z", "max_scale_x", "max_scale_y", "max_scale_z",
    "min_r",       "min_g",       "min_b",       "max_r",       "max_g",       "max_b"};
static const char *const word_names[WORD_COUNT] = {"packed_position", "packed_rotation",
                                                   "packed_scale", "packed_color"};

// ---- Reading ----

typedef struct compressed_reader {
    sgsi_ply_stream stream;
    sgsi_ply_header header;
    const sgsi_ply_element *chunk, *vertex, *sh;
    bool has_color_bounds;
    int rest;
    float *bounds;   // [chunks][BOUND_COUNT]
    uint32_t *words; // [vertices][WORD_COUNT]
    uint8_t *sh_bytes;
} compressed_reader;

// Offset of a property of the type in a row; -1 if it is missing or has another type.
static int property_offset(const compressed_reader *reader, const sgsi_ply_element *element,
                           const char *name, sgsi_ply_type type)
{
    int offset = 0;
    for (int k = 0; k < element->property_count; ++k) {
        const sgsi_ply_property *property = &reader->header.properties[element->first_property + k];
        if (!strcmp(property->name, name))
            return property->type == type && !property->is_list ? offset : -1;
        offset += (int)sgsi_ply_type_size(property->type);
    }
    return -1;
}

static sgs_status find_elements(compressed_reader *reader)
{
    const char *path = reader->stream.path;
    for (int k = 0; k < reader->header.element_count; ++k) {
        const sgsi_ply_element *element = &reader->header.elements[k];
        if (!strcmp(element->name, "chunk"))
            reader->chunk = element;
        else if (!strcmp(element->name, "vertex"))
            reader->vertex = element;
        else if (!strcmp(element->name, "sh"))
            reader->sh = element;
        for (int j = 0; j < element->property_count; ++j)
            if (reader->header.properties[element->first_property + j].is_list)
                return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                                 "%s: element '%s' has a list; a compressed model has none", path,
                                 element->name);
    }
    if (!reader->chunk || !reader->vertex)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: has no element '%s'; this is not a compressed model", path,
                         reader->chunk ? "vertex" : "chunk");
    if (reader->header.format != SGSI_PLY_LITTLE_ENDIAN)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: a compressed model must be binary_little_endian", path);
    const size_t chunks =
        reader->vertex->count / CHUNK_SIZE + (reader->vertex->count % CHUNK_SIZE != 0);
    if (reader->chunk->count < chunks)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: %zu primitives have %zu chunks; the file has %zu",
                         path, reader->vertex->count, chunks, reader->chunk->count);
    if (reader->sh && reader->sh->count != reader->vertex->count)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: has SH of %zu primitives, but %zu primitives",
                         path, reader->sh->count, reader->vertex->count);
    if (reader->sh && reader->sh < reader->vertex)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED, "%s: element 'sh' precedes 'vertex'", path);
    reader->rest = reader->sh ? reader->sh->property_count : 0;
    if (reader->rest != 0 && reader->rest != 9 && reader->rest != 24 && reader->rest != 45)
        return sgsi_fail(
            SGS_STATUS_UNSUPPORTED,
            "%s: has %d f_rest properties; supported: 0, 9, 24 or 45 (SH degree 0 to 3)", path,
            reader->rest);
    return SGS_STATUS_OK;
}

// Copies `count` values of each row. offsets: of the values in a row.
static sgs_status read_element(compressed_reader *reader, const sgsi_ply_element *element,
                               const int *offsets, int count, size_t value_size, void *out)
{
    const size_t row_size = sgsi_ply_row_size(&reader->header, element);
    uint8_t *to = out;
    for (size_t row = 0; row < element->count; ++row) {
        const uint8_t *bytes = sgsi_ply_take(&reader->stream, row_size);
        if (!bytes)
            return sgsi_fail(SGS_STATUS_IO, "%s: byte %zu: read error", reader->stream.path,
                             reader->stream.position);
        for (int k = 0; k < count; ++k, to += value_size)
            memcpy(to, bytes + offsets[k], value_size);
    }
    return SGS_STATUS_OK;
}

static sgs_status read_values(compressed_reader *reader, const sgsi_ply_element *element)
{
    int offsets[MAX_REST], count = 0;
    const char *path = reader->stream.path;
    sgs_status status = sgsi_ply_check_count(&reader->stream, &reader->header, element);
    if (status)
        return status;
    if (element == reader->chunk) {
        reader->has_color_bounds = property_offset(reader, element, "min_r", SGSI_PLY_FLOAT) >= 0;
        const int needed = reader->has_color_bounds ? BOUND_COUNT : OLD_BOUND_COUNT;
        for (; count < needed; ++count)
            if ((offsets[count] =
                     property_offset(reader, element, bound_names[count], SGSI_PLY_FLOAT)) < 0)
                return sgsi_fail(SGS_STATUS_FORMAT, "%s: float property '%s' is missing", path,
                                 bound_names[count]);
        reader->bounds = sgsi_calloc(element->count + 1, (size_t)needed * sizeof(float));
        return reader->bounds
                   ? read_element(reader, element, offsets, count, 4, reader->bounds)
                   : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
    }
    if (element == reader->vertex) {
        for (; count < WORD_COUNT; ++count)
            if ((offsets[count] =
                     property_offset(reader, element, word_names[count], SGSI_PLY_UINT32)) < 0)
                return sgsi_fail(SGS_STATUS_FORMAT, "%s: uint property '%s' is missing", path,
                                 word_names[count]);
        reader->words = sgsi_calloc(element->count + 1, WORD_COUNT * sizeof(uint32_t));
        return reader->words
                   ? read_element(reader, element, offsets, count, 4, reader->words)
                   : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
    }
    for (; count < reader->rest; ++count) {
        char name[32];
        snprintf(name, sizeof name, "f_rest_%d", count);
        if ((offsets[count] = property_offset(reader, element, name, SGSI_PLY_UINT8)) < 0)
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: uchar property '%s' is missing", path, name);
    }
    reader->sh_bytes = sgsi_calloc(element->count + 1, (size_t)reader->rest + 1);
    return reader->sh_bytes
               ? read_element(reader, element, offsets, count, 1, reader->sh_bytes)
               : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
}

static double mix(const float *bounds, int k, double unit)
{
    return (double)bounds[k] + ((double)bounds[k + 3] - (double)bounds[k]) * unit;
}

static void decode_row(const compressed_reader *reader, size_t i, float params[SGS_PARAM_COUNT])
{
    static const int shifts[3] = {21, 11, 0}, bits[3] = {11, 10, 11};
    const int stride = reader->has_color_bounds ? BOUND_COUNT : OLD_BOUND_COUNT;
    const float *bounds = reader->bounds + i / CHUNK_SIZE * (size_t)stride;
    const uint32_t *words = reader->words + WORD_COUNT * i;
    memset(params, 0, SGS_PARAM_COUNT * sizeof *params);
    for (int k = 0; k < 3; ++k) {
        const uint32_t mask = (1u << bits[k]) - 1;
        params[SGS_PARAM_MEAN + k] =
            (float)mix(bounds, k, (double)(words[0] >> shifts[k] & mask) / mask);
        params[SGS_PARAM_SCALE + k] =
            (float)mix(bounds + 6, k, (double)(words[2] >> shifts[k] & mask) / mask);
        const double unit = (double)(words[3] >> (24 - 8 * k) & 255) / 255.0;
        params[SGS_PARAM_SH_DC + k] =
            (float)sgsi_dc_from_color(reader->has_color_bounds ? mix(bounds + 12, k, unit) : unit);
    }
    params[SGS_PARAM_OPACITY] = sgsi_logit((double)(words[3] & 255) / 255.0);
    const uint32_t largest = words[1] >> 30;
    double sum = 0.0;
    for (uint32_t k = 0, at = 20; k < 4; ++k) {
        if (k == largest)
            continue;
        const double part = ((double)(words[1] >> at & 1023) / 1023.0 - 0.5) * SQRT_2;
        params[SGS_PARAM_ROTATION + k] = (float)part;
        sum += part * part;
        at -= 10;
    }
    params[SGS_PARAM_ROTATION + largest] = (float)sqrt(fmax(0.0, 1.0 - sum));
    const int per_channel = reader->rest / 3;
    for (int k = 0; k < reader->rest; ++k) {
        const uint8_t byte = reader->sh_bytes[i * (size_t)reader->rest + (size_t)k];
        const double unit = byte == 0 ? 0.0 : byte == 255 ? 1.0 : (byte + 0.5) / 256.0;
        params[SGS_PARAM_SH_REST + 3 * (k % per_channel) + k / per_channel] =
            (float)((unit - 0.5) * 8.0);
    }
}

static sgs_status read_elements(compressed_reader *reader)
{
    sgs_status status = sgsi_ply_read_header(&reader->stream, &reader->header);
    if (!status)
        status = find_elements(reader);
    const sgsi_ply_element *element = reader->header.elements;
    for (int k = 0; !status && k < reader->header.element_count; ++k, ++element)
        status = element == reader->chunk || element == reader->vertex || element == reader->sh
                     ? read_values(reader, element)
                     : sgsi_ply_skip(&reader->stream, &reader->header, element);
    return status;
}

sgs_status sgsi_compressed_ply_read(const char *path, const sgs_model_read_options *options,
                                    sgs_gaussians **model, sgs_model_info *info)
{
    static const int degrees[] = {[0] = 0, [9] = 1, [24] = 2, [45] = 3};
    compressed_reader *reader = sgsi_calloc(1, sizeof *reader);
    sgsi_rows rows = {0};
    if (!reader)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
    sgs_status status = sgsi_ply_open(path, &reader->stream);
    if (!status)
        status = read_elements(reader);
    if (!status)
        status = sgsi_rows_begin(&rows, path, reader->vertex->count, degrees[reader->rest],
                                 options->drop_zero_quaternions);
    for (size_t i = 0; !status && i < reader->vertex->count; ++i) {
        float params[SGS_PARAM_COUNT];
        decode_row(reader, i, params);
        sgsi_rows_add(&rows, params);
    }
    info->antialiased = reader->header.antialiased;
    info->colors = reader->header.colors;
    info->dropped = rows.dropped;
    sgsi_ply_close(&reader->stream);
    sgsi_free(reader->bounds);
    sgsi_free(reader->words);
    sgsi_free(reader->sh_bytes);
    sgsi_free(reader);
    return status ? status : sgsi_rows_end(&rows, model);
}

// ---- Writing ----

static uint32_t unorm(double value, int bits)
{
    const double most = (double)((1u << bits) - 1);
    return (uint32_t)fmin(fmax(floor(value * most + 0.5), 0.0), most);
}

// Position of a value between two bounds, 0 for an empty range.
static double unmix(const float *bounds, int k, double value)
{
    const double size = (double)bounds[k + 3] - (double)bounds[k];
    return size > 0.0 ? (value - (double)bounds[k]) / size : 0.0;
}

static float stored_log(float log_scale)
{
    return fminf(fmaxf(log_scale, -MAX_STORED_LOG), MAX_STORED_LOG);
}

static uint32_t pack_rotation(const double q[4])
{
    uint32_t largest = 0;
    for (uint32_t k = 1; k < 4; ++k)
        if (fabs(q[k]) > fabs(q[largest]))
            largest = k;
    const double sign = q[largest] < 0.0 ? -1.0 : 1.0;
    uint32_t word = largest;
    for (uint32_t k = 0; k < 4; ++k)
        if (k != largest)
            word = word << 10 | unorm(sign * q[k] / SQRT_2 + 0.5, 10);
    return word;
}

static void widen(float *bounds, int k, float value)
{
    bounds[k] = fminf(bounds[k], value);
    bounds[k + 3] = fmaxf(bounds[k + 3], value);
}

static float color_of(const sgsi_splat *splat, int k)
{
    return (float)sgsi_color_from_dc((double)splat->dc[k]);
}

// Bounds and words of the splats of one chunk.
static void encode_chunk(const sgsi_splat *splats, size_t count, uint8_t *bounds_at,
                         uint8_t *words_at)
{
    float bounds[BOUND_COUNT];
    for (int k = 0; k < BOUND_COUNT; ++k)
        bounds[k] = k % 6 < 3 ? INFINITY : -INFINITY;
    for (size_t i = 0; i < count; ++i)
        for (int k = 0; k < 3; ++k) {
            widen(bounds, k, splats[i].mean[k]);
            widen(bounds + 6, k, stored_log(splats[i].log_scale[k]));
            widen(bounds + 12, k, color_of(&splats[i], k));
        }
    for (int k = 0; k < BOUND_COUNT; ++k)
        sgsi_store_float(bounds_at + 4 * k, bounds[k]);
    for (size_t i = 0; i < count; ++i, words_at += 4 * WORD_COUNT) {
        static const int bits[3] = {11, 10, 11};
        uint32_t position = 0, scale = 0, color = 0;
        for (int k = 0; k < 3; ++k) {
            const sgsi_splat *splat = &splats[i];
            position =
                position << bits[k] | unorm(unmix(bounds, k, (double)splat->mean[k]), bits[k]);
            scale = scale << bits[k] |
                    unorm(unmix(bounds + 6, k, (double)stored_log(splat->log_scale[k])), bits[k]);
            color = color << 8 | unorm(unmix(bounds + 12, k, (double)color_of(splat, k)), 8);
        }
        sgsi_store_u32(words_at, position);
        sgsi_store_u32(words_at + 4, pack_rotation(splats[i].rotation));
        sgsi_store_u32(words_at + 8, scale);
        sgsi_store_u32(words_at + 12, color << 8 | sgsi_unorm8(splats[i].opacity));
    }
}

static void encode_sh(const sgsi_splat *splat, int rest, uint8_t *at)
{
    const int per_channel = rest / 3;
    for (int k = 0; k < rest; ++k) {
        const double value = (double)splat->rest[3 * (k % per_channel) + k / per_channel];
        at[k] = (uint8_t)fmin(fmax(floor((value / 8.0 + 0.5) * 256.0), 0.0), 255.0);
    }
}

static void write_header(FILE *stream, size_t count, size_t chunks, int rest,
                         const sgs_model_write_options *options)
{
    fprintf(stream, "ply\nformat binary_little_endian 1.0\n%s",
            options->antialiased ? "comment SplatRenderMode: mip\n" : "");
    sgsi_color_comments_write(stream, &options->colors);
    fprintf(stream, "element chunk %zu\n", chunks);
    for (int k = 0; k < BOUND_COUNT; ++k)
        fprintf(stream, "property float %s\n", bound_names[k]);
    fprintf(stream, "element vertex %zu\n", count);
    for (int k = 0; k < WORD_COUNT; ++k)
        fprintf(stream, "property uint %s\n", word_names[k]);
    if (rest)
        fprintf(stream, "element sh %zu\n", count);
    for (int k = 0; k < rest; ++k)
        fprintf(stream, "property uchar f_rest_%d\n", k);
    fputs("end_header\n", stream);
}

sgs_status sgsi_compressed_ply_write(const char *path, const sgs_gaussians *model,
                                     const sgs_model_write_options *options,
                                     sgs_model_written *written)
{
    const size_t count = model->count, chunks = count / CHUNK_SIZE + (count % CHUNK_SIZE != 0);
    const int rest = 3 * sgsi_rest_coefficients(model->sh_degree);
    const size_t words_at = 4 * BOUND_COUNT * chunks, sh_at = words_at + 4 * WORD_COUNT * count,
                 size = sh_at + (size_t)rest * count;
    sgsi_warn_clipped_harmonics(path, ".compressed.ply", model, 4.0);
    uint32_t *order = NULL;
    sgs_status status = sgsi_order_by_position(model, &order);
    uint8_t *bytes = status ? NULL : sgsi_alloc(size + 1, 1);
    sgsi_splat *splats = bytes ? sgsi_alloc(CHUNK_SIZE, sizeof *splats) : NULL;
    sgs_output_file file = {0};
    if (!status && !splats)
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    for (size_t chunk = 0; !status && chunk < chunks; ++chunk) {
        const size_t begin = chunk * CHUNK_SIZE,
                     members = count - begin < CHUNK_SIZE ? count - begin : CHUNK_SIZE;
        for (size_t i = 0; i < members; ++i) {
            splats[i] = sgsi_splat_get(model, order[begin + i]);
            encode_sh(&splats[i], rest, bytes + sh_at + (begin + i) * (size_t)rest);
        }
        encode_chunk(splats, members, bytes + 4 * BOUND_COUNT * chunk,
                     bytes + words_at + 4 * WORD_COUNT * begin);
    }
    if (!status)
        status = sgs_output_file_open(&file, path);
    if (!status) {
        write_header(file.stream, count, chunks, rest, options);
        fwrite(bytes, 1, size, file.stream); // an error stays with the stream and fails the commit
        written->bytes = (uint64_t)ftell(file.stream);
        status = sgs_output_file_commit(&file);
    }
    written->order = SGS_ROWS_MORTON;
    sgsi_free(order);
    sgsi_free(bytes);
    sgsi_free(splats);
    return status;
}
