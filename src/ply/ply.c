// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The model file: the PLY written by the code of Kerbl et al., "3D Gaussian Splatting for Real-Time
// Radiance Field Rendering", 2023, which every viewer reads: 62 little-endian floats per primitive
// for SH degree 3. f_rest is channel-major in the file (all of red, then green, then blue) and
// coefficient-major in memory, so that lower degrees come first.
//
// Properties are read by name, because other trainers use other orders and types; unknown ones are
// ignored. Values are kept as stored: quaternions are not normalised, unless their norm is outside
// of the range of float arithmetic.

#include "sparegs/gaussians.h"

#include <errno.h>
#include <float.h>
#include <locale.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "model/filter_3d.h"
#include "model/sh_degree.h"
#include "ply/ply_header.h"
#include "ply/ply_model.h"
#include "ply/ply_parts.h"
#include "sparegs/output_file.h"
#include "storage/color_marks.h"
#include "storage/model_rows.h"

enum {
    REST_PER_CHANNEL = 15,
    MAX_REST = 3 * REST_PER_CHANNEL,
    MAX_DEGREE_READ = 4, // kept: up to 3
    CHUNK_ROWS = 256,
    PARAM_FILTER_3D = SGS_PARAM_COUNT, // Mip-Splatting's filter_3D, in rows only
    ROW_COUNT,
    MAX_COLUMNS = ROW_COUNT + 4
};

// ---- Names ----

typedef struct named_param {
    const char *name;
    int param;
} named_param;

static const named_param required[] = {
    {"x", SGS_PARAM_MEAN},
    {"y", SGS_PARAM_MEAN + 1},
    {"z", SGS_PARAM_MEAN + 2},
    {"f_dc_0", SGS_PARAM_SH_DC},
    {"f_dc_1", SGS_PARAM_SH_DC + 1},
    {"f_dc_2", SGS_PARAM_SH_DC + 2},
    {"opacity", SGS_PARAM_OPACITY},
    {"scale_0", SGS_PARAM_SCALE},
    {"scale_1", SGS_PARAM_SCALE + 1},
    {"scale_2", SGS_PARAM_SCALE + 2},
    {"rot_0", SGS_PARAM_ROTATION},
    {"rot_1", SGS_PARAM_ROTATION + 1},
    {"rot_2", SGS_PARAM_ROTATION + 2},
    {"rot_3", SGS_PARAM_ROTATION + 3},
};
enum { REQUIRED_COUNT = sizeof required / sizeof *required };

static int rest_count(int sh_degree)
{
    return 3 * ((sh_degree + 1) * (sh_degree + 1) - 1);
}

// Parameter of f_rest_k in a file with `count` of these properties.
static int rest_param(int k, int count)
{
    const int per_channel = count / 3;
    return SGS_PARAM_SH_REST + 3 * (k % per_channel) + k / per_channel;
}

// ---- Reading ----

typedef struct column {
    int property; // index in the vertex element
    int param;
    size_t offset; // in a binary row
    sgsi_ply_type type;
} column;

typedef struct ply_reader {
    sgsi_ply_stream stream;
    sgsi_ply_header header;
    const sgsi_ply_element *vertex;
    column columns[MAX_COLUMNS];
    int column_count;
    int sh_degree;
    locale_t c_locale; // decimal point of ascii bodies, independent of the locale
    bool fuse_filter, has_filter;
    bool is_flat; // a model of 2DGS, without scale_2
    sgsi_rows rows;
} ply_reader;

static int find_property(const ply_reader *reader, const char *name)
{
    for (int k = 0; k < reader->vertex->property_count; ++k) {
        if (!strcmp(reader->header.properties[reader->vertex->first_property + k].name, name))
            return k;
    }
    return -1;
}

static sgs_status add_column(ply_reader *reader, const char *name, int param)
{
    const int found = find_property(reader, name);
    if (found < 0) {
        const char *hint = "this is not a 3DGS model";
        if (find_property(reader, "packed_position") >= 0)
            hint = "this is a compressed model; export it as an uncompressed PLY";
        else if (find_property(reader, "red") >= 0)
            hint = "this is a point cloud and not a 3DGS model";
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: property '%s' is missing; %s", reader->stream.path,
                         name, hint);
    }
    column *added = &reader->columns[reader->column_count++];
    *added = (column){.property = found, .param = param};
    for (int k = 0; k < found; ++k)
        added->offset +=
            sgsi_ply_type_size(reader->header.properties[reader->vertex->first_property + k].type);
    added->type = reader->header.properties[reader->vertex->first_property + found].type;
    return SGS_STATUS_OK;
}

// `rest`: number of f_rest properties.
static sgs_status map_rest(ply_reader *reader, int rest)
{
    int degree = 0;
    while (degree <= MAX_DEGREE_READ && rest_count(degree) != rest)
        ++degree;
    if (degree > MAX_DEGREE_READ)
        return sgsi_fail(
            SGS_STATUS_UNSUPPORTED,
            "%s: has %d f_rest properties; supported: 0, 9, 24, 45 or 72 (SH degree 0 to 4)",
            reader->stream.path, rest);
    for (int k = 0; k < rest; ++k) {
        char name[32];
        if (k % (rest / 3) >= REST_PER_CHANNEL)
            continue; // of degree 4
        snprintf(name, sizeof name, "f_rest_%d", k);
        const sgs_status status = add_column(reader, name, rest_param(k, rest));
        if (status)
            return status;
    }
    if (degree > 3)
        sgsi_warn("%s: SH of degree 4 are ignored", reader->stream.path);
    reader->sh_degree = degree < 3 ? degree : 3;
    return SGS_STATUS_OK;
}

static sgs_status map_columns(ply_reader *reader)
{
    int rest = 0;
    for (int k = 0; k < reader->vertex->property_count; ++k) {
        const sgsi_ply_property *property =
            &reader->header.properties[reader->vertex->first_property + k];
        if (property->is_list)
            return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                             "%s: property '%s' of a vertex is a list; a 3DGS model has none",
                             reader->stream.path, property->name);
        rest += !strncmp(property->name, "f_rest_", 7);
    }
    reader->is_flat = find_property(reader, "scale_1") >= 0 && find_property(reader, "scale_2") < 0;
    for (int k = 0; k < REQUIRED_COUNT; ++k) {
        if (reader->is_flat && required[k].param == SGS_PARAM_SCALE + 2)
            continue;
        const sgs_status status = add_column(reader, required[k].name, required[k].param);
        if (status)
            return status;
    }
    const sgs_status status = map_rest(reader, rest);
    if (status)
        return status;
    if (reader->is_flat)
        sgsi_warn("%s: has no property 'scale_2', like models of 2DGS; its primitives are read as "
                  "flat discs",
                  reader->stream.path);
    reader->has_filter = reader->fuse_filter && find_property(reader, "filter_3D") >= 0;
    return reader->has_filter ? add_column(reader, "filter_3D", PARAM_FILTER_3D) : SGS_STATUS_OK;
}

static float to_float(double value)
{
    if (fabs(value) > FLT_MAX)
        return value > 0.0 ? INFINITY : -INFINITY;
    return (float)value;
}

// Parses one row's words into all properties' values; only the mapped ones are kept.
static sgs_status read_ascii_row(ply_reader *reader, size_t row, float params[ROW_COUNT])
{
    double values[SGSI_PLY_MAX_PROPERTIES];
    for (int k = 0; k < reader->vertex->property_count; ++k) {
        char word[SGSI_PLY_MAX_NAME + 1], *end;
        const char *name = reader->header.properties[reader->vertex->first_property + k].name;
        const size_t place = reader->stream.position;
        if (!sgsi_ply_word(&reader->stream, word))
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "%s: byte %zu: vertex %zu: property '%s' is missing; the file is "
                             "truncated or corrupt",
                             reader->stream.path, place, row, name);
        values[k] = strtod_l(word, &end, reader->c_locale);
        if (end == word || *end)
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "%s: byte %zu: vertex %zu: property '%s': '%s' is not a number",
                             reader->stream.path, place, row, name, word);
    }
    for (int k = 0; k < reader->column_count; ++k)
        params[reader->columns[k].param] = to_float(values[reader->columns[k].property]);
    return SGS_STATUS_OK;
}

static sgs_status read_binary_row(ply_reader *reader, size_t row_size, float params[ROW_COUNT])
{
    const uint8_t *bytes = sgsi_ply_take(&reader->stream, row_size);
    if (!bytes)
        return sgsi_fail(SGS_STATUS_IO, "%s: byte %zu: read error", reader->stream.path,
                         reader->stream.position);
    const bool big_endian = reader->header.format == SGSI_PLY_BIG_ENDIAN;
    for (int k = 0; k < reader->column_count; ++k) {
        const column *c = &reader->columns[k];
        params[c->param] = to_float(sgsi_ply_decode(bytes + c->offset, c->type, big_endian));
    }
    return SGS_STATUS_OK;
}

// Adds the rows [first, last) of the file.
static sgs_status read_rows(ply_reader *reader, size_t first, size_t last)
{
    const size_t row_size = sgsi_ply_row_size(&reader->header, reader->vertex);
    for (size_t row = first; row < last; ++row) {
        float params[ROW_COUNT] = {0};
        const sgs_status status = reader->header.format == SGSI_PLY_ASCII
                                      ? read_ascii_row(reader, row, params)
                                      : read_binary_row(reader, row_size, params);
        if (status)
            return status;
        if (reader->is_flat)
            params[SGS_PARAM_SCALE + 2] = -INFINITY;
        if (reader->has_filter)
            sgsi_filter_3d_fuse(params, (double)params[PARAM_FILTER_3D]);
        sgsi_rows_add(&reader->rows, params);
    }
    return SGS_STATUS_OK;
}

static void warn_about_rest(const ply_reader *reader)
{
    const bool is_last =
        reader->vertex == &reader->header.elements[reader->header.element_count - 1];
    if (is_last && reader->header.format != SGSI_PLY_ASCII && sgsi_ply_left(&reader->stream))
        sgsi_warn("%s: byte %zu: %zu bytes after the last vertex were ignored", reader->stream.path,
                  reader->stream.position, sgsi_ply_left(&reader->stream));
}

static sgs_status read_header(ply_reader *reader)
{
    const sgs_status status = sgsi_ply_read_header(&reader->stream, &reader->header);
    if (status)
        return status;
    const sgsi_ply_element *end = reader->header.elements + reader->header.element_count;
    const sgsi_ply_element *vertex = reader->header.elements;
    while (vertex < end && strcmp(vertex->name, "vertex"))
        ++vertex;
    if (vertex == end)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: has no element 'vertex'; this is not a 3DGS model",
                         reader->stream.path);
    reader->vertex = vertex;
    return SGS_STATUS_OK;
}

// Reads from the end of the header up to the first vertex.
static sgs_status skip_to_vertices(ply_reader *reader)
{
    sgs_status status = SGS_STATUS_OK;
    for (const sgsi_ply_element *before = reader->header.elements;
         !status && before < reader->vertex; ++before)
        status = sgsi_ply_skip(&reader->stream, &reader->header, before);
    return status ? status : sgsi_ply_check_count(&reader->stream, &reader->header, reader->vertex);
}

// Reads up to the first vertex.
static sgs_status find_vertices(ply_reader *reader)
{
    sgs_status status = read_header(reader);
    if (!status)
        status = map_columns(reader);
    return status ? status : skip_to_vertices(reader);
}

static sgs_status read_model(ply_reader *reader, bool drop_zero_quaternions, sgs_gaussians **model)
{
    sgs_status status = find_vertices(reader);
    if (!status)
        status = sgsi_rows_begin(&reader->rows, reader->stream.path, reader->vertex->count,
                                 reader->sh_degree, drop_zero_quaternions);
    if (status)
        return status;
    status = read_rows(reader, 0, reader->vertex->count);
    if (status) {
        sgsi_rows_abort(&reader->rows);
        return status;
    }
    status = sgsi_rows_end(&reader->rows, model);
    if (!status)
        warn_about_rest(reader);
    return status;
}

// Close the reader also after a failure.
static sgs_status open_reader(const char *path, ply_reader **made)
{
    ply_reader *reader = *made = sgsi_calloc(1, sizeof *reader);
    if (!reader)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
    const sgs_status status = sgsi_ply_open(path, &reader->stream);
    if (status)
        return status;
    reader->c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    return reader->c_locale
               ? SGS_STATUS_OK
               : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
}

static void close_reader(ply_reader *reader)
{
    if (!reader)
        return;
    if (reader->c_locale)
        freelocale(reader->c_locale);
    sgsi_ply_close(&reader->stream);
    sgsi_free(reader);
}

// options and info may be NULL: then filter_3D is ignored.
static sgs_status read_file(const char *path, const sgs_model_read_options *options,
                            sgs_gaussians **model, sgs_model_info *info)
{
    *model = NULL;
    ply_reader *reader;
    sgs_status status = open_reader(path, &reader);
    if (!status) {
        reader->fuse_filter = info != NULL;
        status = read_model(reader, options && options->drop_zero_quaternions, model);
    }
    if (!status && info) {
        info->fused_filter = reader->has_filter;
        info->antialiased = reader->has_filter || reader->header.antialiased;
        info->colors = reader->header.colors;
        info->dropped = reader->rows.dropped;
    }
    close_reader(reader);
    return status;
}

sgs_status sgs_ply_read(const char *path, sgs_gaussians **model)
{
    return read_file(path, NULL, model, NULL);
}

sgs_status sgsi_ply_model_read(const char *path, const sgs_model_read_options *options,
                               sgs_gaussians **model, sgs_model_info *info)
{
    return read_file(path, options, model, info);
}

sgs_status sgsi_ply_read_colors(const char *path, sgs_model_colors *colors)
{
    ply_reader *reader;
    sgs_status status = open_reader(path, &reader);
    if (!status)
        status = sgsi_ply_read_header(&reader->stream, &reader->header);
    if (!status)
        *colors = reader->header.colors;
    close_reader(reader);
    return status;
}

sgs_status sgsi_ply_read_count(const char *path, size_t *count)
{
    ply_reader *reader;
    sgs_status status = open_reader(path, &reader);
    if (!status)
        status = read_header(reader);
    if (!status)
        status = skip_to_vertices(reader);
    if (!status)
        *count = reader->vertex->count;
    close_reader(reader);
    return status;
}

// ---- Reading in parts ----

struct sgsi_ply_source {
    ply_reader *reader;
    size_t next; // row
    sgs_status status;
};

sgs_status sgsi_ply_source_open(const char *path, sgsi_ply_source **source, size_t *count,
                                int *sh_degree)
{
    ply_reader *reader;
    sgsi_ply_source *made = sgsi_calloc(1, sizeof *made);
    sgs_status status = open_reader(path, &reader);
    if (!status && !made)
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
    if (!status)
        status = find_vertices(reader);
    *source = NULL;
    if (status) {
        close_reader(reader);
        sgsi_free(made);
        return status;
    }
    reader->rows = (sgsi_rows){.path = path, .total = reader->vertex->count};
    made->reader = reader;
    *count = reader->vertex->count;
    *sh_degree = reader->sh_degree;
    *source = made;
    return SGS_STATUS_OK;
}

void sgsi_ply_source_next(sgsi_ply_source *source, sgs_gaussians *rows)
{
    ply_reader *reader = source->reader;
    const size_t left = reader->vertex->count - source->next;
    const size_t last = source->next + (rows->count < left ? rows->count : left);
    reader->rows.model = rows;
    reader->rows.kept = 0;
    if (!source->status)
        source->status = read_rows(reader, source->next, last);
    source->next = last;
}

sgs_status sgsi_ply_source_close(sgsi_ply_source *source)
{
    const sgs_status status = source->status;
    if (!status)
        sgsi_rows_warn(&source->reader->rows);
    close_reader(source->reader);
    sgsi_free(source);
    return status;
}

// ---- Writing ----

static uint8_t *put_float(uint8_t *at, float value)
{
    sgsi_store_float(at, value);
    return at + sizeof value;
}

// Fails early if the disk is full.
static sgs_status put_chunk(const sgs_output_file *file, const uint8_t *bytes, size_t size)
{
    errno = 0;
    if (fwrite(bytes, 1, size, file->stream) == size)
        return SGS_STATUS_OK;
    const int code = errno;
    return sgsi_fail(SGS_STATUS_IO, "%s: cannot be written: %s", file->path,
                     code ? strerror(code) : "disk full?");
}

typedef struct row_writer {
    const sgs_gaussians *model; // or:
    const float *points;
    const unsigned char *colors;
    size_t count;
    bool base_colors;        // of the model, only centres and base colours
    const float *filter_3d;  // the last column, or NULL
    int params[MAX_COLUMNS]; // parameter of each column, -1 for a normal's 0
    int column_count;
} row_writer;

// The colour of degree 0 as 8 bits.
static uint8_t base_color(const sgs_gaussians *model, size_t row, int channel)
{
    const float coefficient = *sgs_gaussians_at(model, row, SGS_PARAM_SH_DC + channel);
    return sgsi_unorm8(sgsi_color_from_dc((double)coefficient));
}

static uint8_t *put_point(const row_writer *writer, size_t row, uint8_t *at)
{
    const sgs_gaussians *model = writer->model;
    for (size_t k = 0; k < 6; ++k)
        at = put_float(at, k >= 3  ? 0.0f
                           : model ? *sgs_gaussians_at(model, row, SGS_PARAM_MEAN + (int)k)
                                   : writer->points[3 * row + k]);
    for (size_t k = 0; k < 3; ++k)
        *at++ = model ? base_color(model, row, (int)k) : writer->colors[3 * row + k];
    return at;
}

static uint8_t *put_row(const row_writer *writer, size_t row, uint8_t *at)
{
    if (writer->model && !writer->base_colors) {
        for (int k = 0; k < writer->column_count; ++k)
            at = put_float(at, writer->params[k] < 0 ? 0.0f
                               : writer->params[k] == SGS_PARAM_OPACITY
                                   ? sgs_gaussians_opacity_logit(writer->model, row)
                                   : *sgs_gaussians_at(writer->model, row, writer->params[k]));
        return writer->filter_3d ? put_float(at, writer->filter_3d[row]) : at;
    }
    return put_point(writer, row, at);
}

static sgs_status write_rows(const row_writer *writer, const sgs_output_file *file)
{
    uint8_t chunk[CHUNK_ROWS * MAX_COLUMNS * sizeof(float)];
    for (size_t begin = 0; begin < writer->count; begin += CHUNK_ROWS) {
        const size_t end = begin + CHUNK_ROWS < writer->count ? begin + CHUNK_ROWS : writer->count;
        uint8_t *at = chunk;
        for (size_t row = begin; row < end; ++row)
            at = put_row(writer, row, at);
        const sgs_status status = put_chunk(file, chunk, (size_t)(at - chunk));
        if (status)
            return status;
    }
    return SGS_STATUS_OK;
}

// Takes ownership of `file`: commits or removes it.
static sgs_status write_file(const row_writer *writer, sgs_output_file *file)
{
    const sgs_status status = write_rows(writer, file);
    if (!status)
        return sgs_output_file_commit(file);
    sgs_output_file_abort(file);
    return status;
}

// A negative number means none.
static void add_written(row_writer *writer, FILE *stream, const char *prefix, int number, int param)
{
    if (number < 0)
        fprintf(stream, "property float %s\n", prefix);
    else
        fprintf(stream, "property float %s%d\n", prefix, number);
    writer->params[writer->column_count++] = param;
}

static void write_points_header(FILE *stream, size_t count)
{
    fprintf(stream, "ply\nformat binary_little_endian 1.0\nelement vertex %zu\n", count);
    fputs("property float x\nproperty float y\nproperty float z\n"
          "property float nx\nproperty float ny\nproperty float nz\n"
          "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
          stream);
}

// Opens the file and writes the header for `count` rows of models like this one.
static sgs_status begin_model(const char *path, const sgs_gaussians *model, size_t count,
                              const sgsi_ply_contents *contents, row_writer *writer,
                              sgs_output_file *file)
{
    sgs_status status = sgsi_sh_degree_check(model, path);
    if (!status)
        status = sgs_output_file_open(file, path);
    if (status)
        return status;
    *writer = (row_writer){
        .model = model, .count = model->count, .base_colors = contents->kind == SGSI_PLY_POINTS};
    if (writer->base_colors) {
        write_points_header(file->stream, count);
        return SGS_STATUS_OK;
    }
    fprintf(file->stream, "ply\nformat binary_little_endian 1.0\n%s",
            contents->kind == SGSI_PLY_ANTIALIASED ? "comment SplatRenderMode: mip\n" : "");
    sgsi_color_comments_write(file->stream, &contents->colors);
    fprintf(file->stream, "element vertex %zu\n", count);
    static const char *const lead[] = {"x", "y", "z", "nx", "ny", "nz"};
    for (int k = 0; k < 6; ++k)
        add_written(writer, file->stream, lead[k], -1, k < 3 ? SGS_PARAM_MEAN + k : -1);
    for (int k = 0; k < 3; ++k)
        add_written(writer, file->stream, "f_dc_", k, SGS_PARAM_SH_DC + k);
    const int rest = rest_count(model->sh_degree);
    for (int k = 0; k < rest; ++k)
        add_written(writer, file->stream, "f_rest_", k, rest_param(k, rest));
    add_written(writer, file->stream, "opacity", -1, SGS_PARAM_OPACITY);
    for (int k = 0; k < 3; ++k)
        add_written(writer, file->stream, "scale_", k, SGS_PARAM_SCALE + k);
    for (int k = 0; k < 4; ++k)
        add_written(writer, file->stream, "rot_", k, SGS_PARAM_ROTATION + k);
    fputs(contents->kind == SGSI_PLY_FILTER_3D ? "property float filter_3D\nend_header\n"
                                               : "end_header\n",
          file->stream);
    return SGS_STATUS_OK;
}

static sgs_status write_model(const char *path, const sgs_gaussians *model,
                              const sgsi_ply_contents *contents, const float *filter_3d)
{
    sgs_output_file file;
    row_writer writer;
    const sgs_status status = begin_model(path, model, model->count, contents, &writer, &file);
    writer.filter_3d = filter_3d;
    return status ? status : write_file(&writer, &file);
}

// ---- A model that arrives in parts ----

struct sgsi_ply_parts {
    row_writer writer;
    sgs_output_file file;
    sgs_status status;
};

sgs_status sgsi_ply_parts_begin(const char *path, const sgs_gaussians *like, size_t count,
                                const sgsi_ply_contents *contents, sgsi_ply_parts **parts)
{
    *parts = sgsi_calloc(1, sizeof **parts);
    if (!*parts)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    const sgs_status status =
        begin_model(path, like, count, contents, &(*parts)->writer, &(*parts)->file);
    if (status) {
        sgsi_free(*parts);
        *parts = NULL;
    }
    return status;
}

void sgsi_ply_parts_add(sgsi_ply_parts *parts, const sgs_gaussians *rows, const float *filter_3d)
{
    parts->writer.filter_3d = filter_3d;
    parts->writer.model = rows;
    parts->writer.count = rows->count;
    if (!parts->status)
        parts->status = write_rows(&parts->writer, &parts->file);
}

sgs_status sgsi_ply_parts_end(sgsi_ply_parts *parts, bool complete)
{
    sgs_status status = parts->status;
    if (status || !complete)
        sgs_output_file_abort(&parts->file);
    else
        status = sgs_output_file_commit(&parts->file);
    sgsi_free(parts);
    return status;
}

sgs_status sgs_ply_write(const char *path, const sgs_gaussians *model)
{
    return write_model(path, model, &(sgsi_ply_contents){.kind = SGSI_PLY_PLAIN}, NULL);
}

sgs_status sgs_ply_write_filter_3d(const char *path, const sgs_gaussians *model,
                                   const float *filter_3d)
{
    return write_model(path, model, &(sgsi_ply_contents){.kind = SGSI_PLY_FILTER_3D}, filter_3d);
}

sgs_status sgsi_ply_model_write(const char *path, const sgs_gaussians *model,
                                const sgs_model_write_options *options, sgs_model_written *written)
{
    (void)written;
    const sgsi_ply_contents contents = {.kind = options->antialiased ? SGSI_PLY_ANTIALIASED
                                                                     : SGSI_PLY_PLAIN,
                                        .colors = options->colors};
    return write_model(path, model, &contents, NULL);
}

sgs_status sgs_ply_write_points(const char *path, const float *points, const unsigned char *colors,
                                size_t n)
{
    sgs_output_file file;
    const sgs_status status = sgs_output_file_open(&file, path);
    if (status)
        return status;
    const row_writer writer = {.points = points, .colors = colors, .count = n};
    write_points_header(file.stream, n);
    return write_file(&writer, &file);
}
