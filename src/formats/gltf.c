// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// GLB with KHR_gaussian_splatting: a primitive of points whose attributes are Gaussians.
// Quaternions are x y z w, scales and opacities linear, SH the coefficients of 3DGS. glTF has x
// left, y up, z front seen along the view, so x and y change their signs.
//
// Read: all primitives of the default scene with the extension, with the transforms of their nodes.
// Values may be float, or normalised bytes and shorts. Other contents of the scene may have any
// transform.

#include "formats/small_formats.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "model/affine.h"
#include "sparegs/output_file.h"
#include "sparegs/version.h"
#include "storage/color_marks.h"
#include "storage/model_rows.h"

enum {
    HEADER_BYTES = 12,
    CHUNK_HEADER_BYTES = 8,
    MAX_VISITS = 4096, // of nodes, unless the file has more: a tree visits each node once
    MAX_DEPTH = 64,
    MAX_PRIMITIVES = 1 << 20, // visited, with the instances of a mesh
    COMPONENT_BYTE = 5120,
    COMPONENT_UBYTE = 5121,
    COMPONENT_SHORT = 5122,
    COMPONENT_USHORT = 5123,
    COMPONENT_FLOAT = 5126,
    ARRAY_BUFFER = 34962,
    MODE_POINTS = 0,
    MIN_ROW_BYTES = 20, // position, and one byte for all other values
    JSON_DIGITS = 9
};

static const uint32_t GLB_MAGIC = 0x46546C67, JSON_CHUNK = 0x4E4F534A, BIN_CHUNK = 0x004E4942;
static const char extension[] = "KHR_gaussian_splatting";
static const char white_point_name[] = "sparegs:whitePoint"; // of the extras of a primitive

// ---- Reading ----

typedef struct glb_file {
    const char *path;
    uint8_t *bytes;
    size_t size;
    const uint8_t *bin;
    size_t bin_size;
    json_t *root;
    sgsi_rows rows;
    size_t total, visits, primitives; // visits of nodes and primitives by this traversal
    int sh_degree;
    bool decoding;           // the second traversal; the first one counts
    sgs_model_colors colors; // of the first primitive
    bool quiet, mixed;       // no warnings; primitives differ in their colour space
    bool other_kernel;       // one has another kernel than "ellipse"
} glb_file;

typedef struct glb_transform {
    double matrix[3][3], translation[3]; // x -> matrix x + translation
} glb_transform;

typedef struct glb_accessor {
    const uint8_t *data;
    size_t count, stride, value_bytes;
    int component, components;
    bool normalized;
} glb_accessor;

static json_t *element(const glb_file *file, const char *list, const json_t *index)
{
    return json_is_integer(index) && json_integer_value(index) >= 0
               ? json_array_get(json_object_get(file->root, list),
                                (size_t)json_integer_value(index))
               : NULL;
}

// A non-negative integer below 2^32; `absent` if it is missing. False for other values.
static bool read_size(const json_t *value, size_t absent, size_t *size)
{
    *size = value ? (size_t)json_integer_value(value) : absent;
    return !value || (json_is_integer(value) && json_integer_value(value) >= 0 &&
                      json_integer_value(value) <= (json_int_t)UINT32_MAX);
}

static sgs_status open_accessor(const glb_file *file, const json_t *index, const char *name,
                                int components, glb_accessor *out)
{
    static const char *const types[] = {[1] = "SCALAR", [3] = "VEC3", [4] = "VEC4"};
    const json_t *accessor = element(file, "accessors", index),
                 *view = element(file, "bufferViews", json_object_get(accessor, "bufferView")),
                 *buffer = element(file, "buffers", json_object_get(view, "buffer"));
    const char *type = json_string_value(json_object_get(accessor, "type"));
    size_t offset, view_offset, view_size;
    *out = (glb_accessor){.components = components};
    if (!accessor || !type || strcmp(type, types[components]))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: attribute '%s' has no accessor of type %s",
                         file->path, name, types[components]);
    // The binary chunk is the first buffer. Another one without data is that of compressed views.
    if (json_object_get(accessor, "sparse") || !view || !buffer || json_object_get(buffer, "uri") ||
        json_integer_value(json_object_get(view, "buffer")))
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: attribute '%s' is sparse or not in the binary chunk", file->path,
                         name);
    out->component = (int)json_integer_value(json_object_get(accessor, "componentType"));
    out->normalized = json_is_true(json_object_get(accessor, "normalized"));
    out->value_bytes = out->component == COMPONENT_FLOAT ? 4
                       : out->component == COMPONENT_SHORT || out->component == COMPONENT_USHORT
                           ? 2
                           : 1;
    if (out->component != COMPONENT_FLOAT &&
        (out->component < COMPONENT_BYTE || out->component > COMPONENT_USHORT))
        return sgsi_fail(SGS_STATUS_UNSUPPORTED, "%s: attribute '%s' has component type %d",
                         file->path, name, out->component);
    const size_t row = out->value_bytes * (size_t)components;
    if (!read_size(json_object_get(accessor, "count"), 0, &out->count) ||
        !read_size(json_object_get(accessor, "byteOffset"), 0, &offset) ||
        !read_size(json_object_get(view, "byteOffset"), 0, &view_offset) ||
        !read_size(json_object_get(view, "byteLength"), 0, &view_size) ||
        !read_size(json_object_get(view, "byteStride"), row, &out->stride) || out->stride < row)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: attribute '%s': a size of its accessor or buffer view is invalid",
                         file->path, name);
    if (view_offset > file->bin_size || view_size > file->bin_size - view_offset ||
        offset > view_size ||
        (out->count &&
         (view_size - offset < row || out->count - 1 > (view_size - offset - row) / out->stride)))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: attribute '%s': %zu values of %zu bytes exceed the binary chunk of "
                         "%zu bytes",
                         file->path, name, out->count, row, file->bin_size);
    out->data = file->bin + view_offset + offset;
    return SGS_STATUS_OK;
}

static double load_value(const glb_accessor *accessor, size_t i, int k)
{
    const uint8_t *at = accessor->data + i * accessor->stride + accessor->value_bytes * (size_t)k;
    const double scale = accessor->normalized ? 1.0 : 0.0;
    switch (accessor->component) {
    case COMPONENT_FLOAT:
        return (double)sgsi_load_float(at);
    case COMPONENT_BYTE:
        return scale > 0.0 ? fmax((int8_t)at[0] / 127.0, -1.0) : (int8_t)at[0];
    case COMPONENT_UBYTE:
        return scale > 0.0 ? at[0] / 255.0 : at[0];
    case COMPONENT_SHORT:
        return scale > 0.0 ? fmax((int16_t)sgsi_load_u16(at) / 32767.0, -1.0)
                           : (int16_t)sgsi_load_u16(at);
    default:
        return scale > 0.0 ? sgsi_load_u16(at) / 65535.0 : sgsi_load_u16(at);
    }
}

typedef struct glb_primitive {
    glb_accessor mean, rotation, scale, opacity, sh[1 + SGSI_REST_COEFFICIENTS];
    int sh_degree;
} glb_primitive;

static sgs_status open_attribute(const glb_file *file, const json_t *attributes, const char *suffix,
                                 int components, size_t count, glb_accessor *out)
{
    char name[128];
    snprintf(name, sizeof name, "%s%s%s", *suffix == 'P' ? "" : extension,
             *suffix == 'P' ? "" : ":", suffix);
    const sgs_status status =
        open_accessor(file, json_object_get(attributes, name), name, components, out);
    if (!status && out->count != count && count != SIZE_MAX)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: attribute '%s' has %zu values for %zu positions",
                         file->path, name, out->count, count);
    return status;
}

static sgs_status open_primitive(const glb_file *file, const json_t *primitive, glb_primitive *out)
{
    const json_t *attributes = json_object_get(primitive, "attributes");
    *out = (glb_primitive){0};
    sgs_status status = open_attribute(file, attributes, "POSITION", 3, SIZE_MAX, &out->mean);
    const size_t count = out->mean.count;
    if (!status)
        status = open_attribute(file, attributes, "ROTATION", 4, count, &out->rotation);
    if (!status)
        status = open_attribute(file, attributes, "SCALE", 3, count, &out->scale);
    if (!status)
        status = open_attribute(file, attributes, "OPACITY", 1, count, &out->opacity);
    for (int degree = 0, k = 0; !status && degree <= 3; ++degree) {
        char suffix[64];
        snprintf(suffix, sizeof suffix, "%s:SH_DEGREE_%d_COEF_0", extension, degree);
        if (degree && !json_object_get(attributes, suffix))
            break;
        out->sh_degree = degree;
        for (int n = 0; !status && n <= 2 * degree; ++n, ++k) {
            snprintf(suffix, sizeof suffix, "SH_DEGREE_%d_COEF_%d", degree, n);
            status = open_attribute(file, attributes, suffix, 3, count, &out->sh[k]);
        }
    }
    return status;
}

static void decode_primitive(glb_file *file, const glb_primitive *primitive,
                             const sgsi_affine *transform)
{
    const int coefficients = 1 + sgsi_rest_coefficients(primitive->sh_degree);
    for (size_t i = 0; i < primitive->mean.count; ++i) {
        float params[SGS_PARAM_COUNT] = {0};
        for (int k = 0; k < 3; ++k) {
            params[SGS_PARAM_MEAN + k] = (float)load_value(&primitive->mean, i, k);
            params[SGS_PARAM_SCALE + k] = sgsi_log_scale(load_value(&primitive->scale, i, k));
            for (int j = 0; j < coefficients; ++j)
                params[SGS_PARAM_SH_DC + 3 * j + k] = (float)load_value(&primitive->sh[j], i, k);
        }
        for (int k = 0; k < 4; ++k)
            params[SGS_PARAM_ROTATION + k] =
                (float)load_value(&primitive->rotation, i, (k + 3) % 4);
        params[SGS_PARAM_OPACITY] = sgsi_logit(load_value(&primitive->opacity, i, 0));
        sgsi_affine_apply(transform, params);
        sgsi_change_axes(SGSI_AXES_LUF, params);
        sgsi_rows_add(&file->rows, params);
    }
}

// The colour space of the model is that of its first primitive.
static void read_colors(glb_file *file, const json_t *primitive, const json_t *splatting)
{
    const char *name = json_string_value(json_object_get(splatting, "colorSpace"));
    const double white =
        json_number_value(json_object_get(json_object_get(primitive, "extras"), white_point_name));
    sgs_model_colors own = {.white_point = sgsi_white_point_checked(white)};
    if (name)
        sgsi_color_space_parse(file->total || file->quiet ? NULL : file->path, name, &own);
    if (!file->total)
        file->colors = own;
    else if (own.space != file->colors.space && !file->mixed && !file->quiet)
        sgsi_warn("%s: its primitives have several colour spaces; that of the first is used",
                  file->path);
    file->mixed = file->mixed || own.space != file->colors.space;
}

// The extension says that programs that do not know a kernel fall back to ellipses.
static void check_kernel(glb_file *file, const json_t *splatting)
{
    const char *kernel = json_string_value(json_object_get(splatting, "kernel"));
    char shown[64];
    if (!kernel || !strcmp(kernel, "ellipse") || file->other_kernel)
        return;
    file->other_kernel = true;
    snprintf(shown, sizeof shown, "%s", kernel);
    for (char *at = shown; *at; ++at) // of an untrusted file
        if ((unsigned char)*at < 32 || (unsigned char)*at > 126)
            *at = '?';
    if (!file->quiet)
        sgsi_warn("%s: kernel '%s' is unknown; its splats are read as ellipsoids", file->path,
                  shown);
}

// KHR_gaussian_splatting_compression_spz_2 and its relatives.
static bool is_compressed(const json_t *splatting)
{
    static const char prefix[] = "KHR_gaussian_splatting_compression";
    const char *name;
    json_t *value;
    json_object_foreach(json_object_get(splatting, "extensions"), name, value)
    {
        if (!strncmp(name, prefix, sizeof prefix - 1))
            return true;
    }
    return false;
}

// transform: NULL if it is invalid.
static sgs_status visit_mesh(glb_file *file, const json_t *mesh, const glb_transform *transform)
{
    const json_t *primitive;
    sgsi_affine affine;
    bool made = false;
    size_t k;
    json_array_foreach(json_object_get(mesh, "primitives"), k, primitive)
    {
        if (++file->primitives > MAX_PRIMITIVES)
            return sgsi_fail(SGS_STATUS_LIMIT,
                             "%s: the nodes of its scene have more than %d primitives", file->path,
                             MAX_PRIMITIVES);
        const json_t *splatting =
            json_object_get(json_object_get(primitive, "extensions"), extension);
        if (!splatting)
            continue;
        if (is_compressed(splatting))
            return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                             "%s: its Gaussians are compressed; export them without "
                             "KHR_gaussian_splatting_compression",
                             file->path);
        made = made ||
               (transform && sgsi_affine_make(transform->matrix, transform->translation, &affine));
        if (!made)
            return sgsi_fail(
                SGS_STATUS_UNSUPPORTED,
                "%s: the transform of a node with Gaussians is singular, projective or "
                "has invalid values",
                file->path);
        glb_primitive opened;
        const sgs_status status = open_primitive(file, primitive, &opened);
        if (status)
            return status;
        if (file->decoding) {
            decode_primitive(file, &opened, &affine);
            continue;
        }
        read_colors(file, primitive, splatting);
        check_kernel(file, splatting);
        file->total += opened.mean.count;
        file->sh_degree = opened.sh_degree > file->sh_degree ? opened.sh_degree : file->sh_degree;
        if (file->total > file->size / MIN_ROW_BYTES)
            return sgsi_fail(SGS_STATUS_LIMIT,
                             "%s: its nodes repeat primitives: %zu primitives in %zu bytes; export "
                             "it without instances",
                             file->path, file->total, file->size);
    }
    return SGS_STATUS_OK;
}

// ---- Nodes ----

static bool read_numbers(const json_t *list, size_t count, double *values)
{
    for (size_t k = 0; list && k < count; ++k) {
        const json_t *value = json_array_get(list, k);
        if (!json_is_number(value))
            return false;
        values[k] = json_number_value(value);
    }
    return !list || json_array_size(list) == count;
}

// The transform of a node within its parent; false if it is projective or has values of other
// types.
static bool read_transform(const json_t *node, glb_transform *own)
{
    double matrix[16] = {0}, scales[3] = {1, 1, 1}, rotation[4] = {0, 0, 0, 1}, norm = 0.0, unit[4];
    *own = (glb_transform){0};
    const json_t *given = json_object_get(node, "matrix");
    bool valid = read_numbers(given, 16, matrix) &&
                 read_numbers(json_object_get(node, "scale"), 3, scales) &&
                 read_numbers(json_object_get(node, "rotation"), 4, rotation) &&
                 read_numbers(json_object_get(node, "translation"), 3, own->translation);
    for (int k = 0; given && k < 4; ++k) // the last row
        valid = valid && fabs(matrix[4 * k + 3] - (k == 3)) < 1e-6;
    for (int k = 0; k < 4; ++k)
        norm += rotation[k] * rotation[k];
    norm = sqrt(norm);
    if (!valid || !(norm > 1e-6 && isfinite(norm)))
        return false;
    for (int k = 0; k < 4; ++k)
        unit[k] = rotation[(k + 3) % 4] / norm;
    sgsi_rotation_matrix(unit, own->matrix);
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j)
            own->matrix[i][j] = given ? matrix[4 * j + i] : own->matrix[i][j] * scales[j];
        own->translation[i] = given ? matrix[12 + i] : own->translation[i];
    }
    return true;
}

// The transform of a node in the scene.
static glb_transform combine(const glb_transform *parent, const glb_transform *own)
{
    glb_transform combined = {0};
    for (int i = 0; i < 3; ++i) {
        combined.translation[i] = parent->translation[i];
        for (int k = 0; k < 3; ++k) {
            combined.translation[i] += parent->matrix[i][k] * own->translation[k];
            for (int j = 0; j < 3; ++j)
                combined.matrix[i][j] += parent->matrix[i][k] * own->matrix[k][j];
        }
    }
    return combined;
}

// parent: NULL if its transform is invalid, and then so is that of the node.
static sgs_status visit_node(glb_file *file, const json_t *index, const glb_transform *parent,
                             int depth)
{
    const json_t *node = element(file, "nodes", index), *child;
    const size_t nodes = json_array_size(json_object_get(file->root, "nodes")),
                 most = nodes > MAX_VISITS ? nodes : MAX_VISITS;
    glb_transform own, combined, *transform = NULL;
    size_t k;
    if (!node)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: a node of the scene does not exist", file->path);
    if (depth > MAX_DEPTH || ++file->visits > most)
        return sgsi_fail(SGS_STATUS_LIMIT, "%s: more than %zu nodes, or nested deeper than %d",
                         file->path, most, MAX_DEPTH);
    if (parent && read_transform(node, &own)) {
        combined = combine(parent, &own);
        transform = &combined;
    }
    sgs_status status =
        visit_mesh(file, element(file, "meshes", json_object_get(node, "mesh")), transform);
    json_array_foreach(json_object_get(node, "children"), k, child)
    {
        if (!status)
            status = visit_node(file, child, transform, depth + 1);
    }
    return status;
}

static sgs_status visit_scene(glb_file *file)
{
    const glb_transform identity = {{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {0}};
    const json_t *index = json_object_get(file->root, "scene"),
                 *scenes = json_object_get(file->root, "scenes"),
                 *scene = index ? element(file, "scenes", index) : json_array_get(scenes, 0),
                 *entry;
    size_t k;
    sgs_status status = SGS_STATUS_OK;
    file->visits = 0;
    file->primitives = 0;
    if (scene) {
        json_array_foreach(json_object_get(scene, "nodes"), k, entry)
        {
            if (!status)
                status = visit_node(file, entry, &identity, 0);
        }
        return status;
    }
    json_array_foreach(json_object_get(file->root, "meshes"), k, entry)
    {
        if (!status)
            status = visit_mesh(file, entry, &identity);
    }
    return status;
}

static sgs_status read_chunks(glb_file *file)
{
    json_error_t error;
    const uint8_t *json = NULL;
    size_t json_size = 0;
    if (file->size < HEADER_BYTES || sgsi_load_u32(file->bytes) != GLB_MAGIC)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: is not a GLB file: it does not begin with glTF",
                         file->path);
    if (sgsi_load_u32(file->bytes + 4) != 2)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED, "%s: glTF version %u is not supported; only 2 is",
                         file->path, sgsi_load_u32(file->bytes + 4));
    for (size_t at = HEADER_BYTES; file->size - at >= CHUNK_HEADER_BYTES;) {
        const size_t size = sgsi_load_u32(file->bytes + at);
        const uint32_t type = sgsi_load_u32(file->bytes + at + 4);
        at += CHUNK_HEADER_BYTES;
        if (size > file->size - at)
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "%s: byte %zu: a chunk has %zu bytes, but only %zu are left; the file "
                             "is truncated",
                             file->path, at, size, file->size - at);
        if (type == JSON_CHUNK && !json) {
            json = file->bytes + at;
            json_size = size;
        } else if (type == BIN_CHUNK && !file->bin) {
            file->bin = file->bytes + at;
            file->bin_size = size;
        }
        at += size;
    }
    if (!json)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: has no JSON chunk", file->path);
    while (json_size && (json[json_size - 1] == ' ' || !json[json_size - 1]))
        --json_size; // padding
    file->root = json_loadb((const char *)json, json_size, JSON_REJECT_DUPLICATES, &error);
    return file->root ? SGS_STATUS_OK
                      : sgsi_fail(SGS_STATUS_FORMAT, "%s: JSON: line %d: %s", file->path,
                                  error.line, error.text);
}

// Reads the file and counts its primitives. Close it also after a failure.
static sgs_status open_file(glb_file *file)
{
    sgs_status status = sgsi_file_read(file->path, 0, &file->bytes, &file->size);
    if (!status)
        status = read_chunks(file);
    return status ? status : visit_scene(file);
}

static void close_file(glb_file *file)
{
    json_decref(file->root);
    sgsi_free(file->bytes);
}

sgs_status sgsi_glb_read(const char *path, const sgs_model_read_options *options,
                         sgs_gaussians **model, sgs_model_info *info)
{
    glb_file file = {.path = path};
    sgs_status status = open_file(&file);
    if (!status && !file.total)
        status = sgsi_fail(SGS_STATUS_FORMAT, "%s: contains no primitive with %s", path, extension);
    if (!status)
        status = sgsi_rows_begin(&file.rows, path, file.total, file.sh_degree,
                                 options->drop_zero_quaternions);
    file.decoding = true;
    if (!status)
        status = visit_scene(&file);
    info->dropped = file.rows.dropped;
    info->colors = file.colors;
    close_file(&file);
    if (status) {
        sgsi_rows_abort(&file.rows);
        return status;
    }
    return sgsi_rows_end(&file.rows, model);
}

sgs_status sgsi_glb_read_colors(const char *path, sgs_model_colors *colors)
{
    glb_file file = {.path = path, .quiet = true};
    const sgs_status status = open_file(&file);
    if (!status)
        *colors = file.colors;
    close_file(&file);
    return status;
}

// ---- Writing ----

typedef struct glb_writer {
    const sgs_gaussians *model;
    const sgs_model_colors *colors;
    uint8_t *bin;
    size_t bin_size;
    json_t *accessors, *views, *attributes;
} glb_writer;

static float linear_scale(const sgsi_splat *splat, int k)
{
    return (float)exp((double)splat->log_scale[k]);
}

// One column of floats: the offset of its first byte, after adding its view and accessor.
static size_t add_column(glb_writer *writer, const char *name, int components, bool bytes)
{
    static const char *const types[] = {[1] = "SCALAR", [3] = "VEC3", [4] = "VEC4"};
    const size_t size = writer->model->count * (size_t)components * (bytes ? 1 : 4),
                 offset = writer->bin_size;
    const json_int_t index = (json_int_t)json_array_size(writer->accessors);
    json_array_append_new(writer->views, json_pack("{s:i,s:I,s:I,s:i}", "buffer", 0, "byteOffset",
                                                   (json_int_t)offset, "byteLength",
                                                   (json_int_t)size, "target", ARRAY_BUFFER));
    json_t *accessor = json_pack("{s:I,s:i,s:I,s:s}", "bufferView", index, "componentType",
                                 bytes ? COMPONENT_UBYTE : COMPONENT_FLOAT, "count",
                                 (json_int_t)writer->model->count, "type", types[components]);
    if (bytes)
        json_object_set_new(accessor, "normalized", json_true());
    json_array_append_new(writer->accessors, accessor);
    json_object_set_new(writer->attributes, name, json_integer(index));
    writer->bin_size += (size + 3) / 4 * 4;
    return offset;
}

static void add_bounds(const glb_writer *writer)
{
    json_t *low = json_array(), *high = json_array();
    static const float sign[3] = {-1.0f, -1.0f, 1.0f};
    for (int k = 0; k < 3; ++k) {
        float least = INFINITY, most = -INFINITY;
        for (size_t i = 0; i < writer->model->count; ++i) {
            const float value = sign[k] * *sgs_gaussians_at(writer->model, i, SGS_PARAM_MEAN + k);
            least = fminf(least, value);
            most = fmaxf(most, value);
        }
        json_array_append_new(low, json_real((double)least));
        json_array_append_new(high, json_real((double)most));
    }
    json_object_set_new(json_array_get(writer->accessors, 0), "min", low);
    json_object_set_new(json_array_get(writer->accessors, 0), "max", high);
}

// COLOR_0 is linear light.
static double linear_color(const sgs_model_colors *colors, double value)
{
    if (colors->space == SGS_SPACE_LINEAR)
        return value;
    return value <= 0.04045 ? value / 12.92 : pow((value + 0.055) / 1.055, 2.4);
}

static void fill_columns(const glb_writer *writer, const size_t offsets[4 + 16 + 1])
{
    const int coefficients = 1 + sgsi_rest_coefficients(writer->model->sh_degree);
    for (size_t i = 0; i < writer->model->count; ++i) {
        sgsi_splat splat = sgsi_splat_get(writer->model, i);
        sgsi_splat_change_axes(SGSI_AXES_LUF, &splat);
        uint8_t *color = writer->bin + offsets[4 + coefficients] + 4 * i;
        for (int k = 0; k < 3; ++k) {
            const size_t at = 12 * i + 4 * (size_t)k;
            sgsi_store_float(writer->bin + offsets[0] + at, splat.mean[k]);
            sgsi_store_float(writer->bin + offsets[2] + at, linear_scale(&splat, k));
            sgsi_store_float(writer->bin + offsets[4] + at, splat.dc[k]);
            for (int j = 1; j < coefficients; ++j)
                sgsi_store_float(writer->bin + offsets[4 + j] + at, splat.rest[3 * (j - 1) + k]);
            const double shown = fmin(fmax(sgsi_color_from_dc((double)splat.dc[k]), 0.0), 1.0);
            color[k] = sgsi_unorm8(linear_color(writer->colors, shown));
        }
        for (size_t k = 0; k < 4; ++k)
            sgsi_store_float(writer->bin + offsets[1] + 16 * i + 4 * k,
                             (float)splat.rotation[(k + 1) % 4]);
        sgsi_store_float(writer->bin + offsets[3] + 4 * i, (float)splat.opacity);
        color[3] = sgsi_unorm8(splat.opacity);
    }
}

// The JSON of the file. Steals the references of the writer.
static char *make_json(glb_writer *writer)
{
    json_t *splatting = json_pack("{s:s,s:s,s:s,s:s}", "kernel", "ellipse", "colorSpace",
                                  writer->colors->space == SGS_SPACE_LINEAR ? "lin_rec709_display"
                                                                            : "srgb_rec709_display",
                                  "projection", "perspective", "sortingMethod", "cameraDistance");
    json_t *primitive = json_pack("{s:o,s:i,s:{s:o}}", "attributes", writer->attributes, "mode",
                                  MODE_POINTS, "extensions", extension, splatting);
    if (writer->colors->white_point > 0.0)
        json_object_set_new(primitive, "extras",
                            json_pack("{s:f}", white_point_name, writer->colors->white_point));
    json_t *root =
        json_pack("{s:{s:s,s:s},s:[s],s:i,s:[{s:[i]}],s:[{s:i}],s:[{s:[o]}],s:o,s:o,s:[{s:I}]}",
                  "asset", "version", "2.0", "generator", "sparegs " SGS_VERSION, "extensionsUsed",
                  extension, "scene", 0, "scenes", "nodes", 0, "nodes", "mesh", 0, "meshes",
                  "primitives", primitive, "accessors", writer->accessors, "bufferViews",
                  writer->views, "buffers", "byteLength", (json_int_t)writer->bin_size);
    char *text = json_dumps(root, JSON_COMPACT | JSON_REAL_PRECISION(JSON_DIGITS));
    json_decref(root);
    return text;
}

sgs_status sgsi_glb_write(const char *path, const sgs_gaussians *model,
                          const sgs_model_write_options *options, sgs_model_written *written)
{
    glb_writer writer = {.model = model,
                         .colors = &options->colors,
                         .accessors = json_array(),
                         .views = json_array(),
                         .attributes = json_object()};
    size_t offsets[4 + 16 + 1], used = 0;
    char name[64];
    static const char *const geometry[] = {"ROTATION", "SCALE", "OPACITY"};
    static const int sizes[] = {4, 3, 1};
    offsets[used++] = add_column(&writer, "POSITION", 3, false);
    for (int k = 0; k < 3; ++k) {
        snprintf(name, sizeof name, "%s:%s", extension, geometry[k]);
        offsets[used++] = add_column(&writer, name, sizes[k], false);
    }
    for (int degree = 0; degree <= model->sh_degree; ++degree)
        for (int n = 0; n <= 2 * degree; ++n) {
            snprintf(name, sizeof name, "%s:SH_DEGREE_%d_COEF_%d", extension, degree, n);
            offsets[used++] = add_column(&writer, name, 3, false);
        }
    offsets[used] = add_column(&writer, "COLOR_0", 4, true);
    add_bounds(&writer);
    char *json = make_json(&writer);
    const size_t json_size = json ? (strlen(json) + 3) / 4 * 4 : 0,
                 bin_at = HEADER_BYTES + 2 * CHUNK_HEADER_BYTES + json_size,
                 total = bin_at + writer.bin_size;
    sgs_status status = SGS_STATUS_OK;
    uint8_t *bytes = NULL;
    if (total > UINT32_MAX)
        status = sgsi_fail(SGS_STATUS_LIMIT, "%s: %zu bytes exceed the 4 GiB of a GLB file", path,
                           total);
    else
        bytes = json ? sgsi_calloc(total, 1) : NULL;
    if (bytes) {
        sgsi_store_u32(bytes, GLB_MAGIC);
        sgsi_store_u32(bytes + 4, 2);
        sgsi_store_u32(bytes + 8, (uint32_t)total);
        sgsi_store_u32(bytes + 12, (uint32_t)json_size);
        sgsi_store_u32(bytes + 16, JSON_CHUNK);
        memset(bytes + 20, ' ', json_size);
        memcpy(bytes + 20, json, strlen(json));
        sgsi_store_u32(bytes + bin_at - 8, (uint32_t)writer.bin_size);
        sgsi_store_u32(bytes + bin_at - 4, BIN_CHUNK);
        writer.bin = bytes + bin_at;
        fill_columns(&writer, offsets);
        status = sgs_output_file_write(path, bytes, total);
        written->bytes = total;
    } else if (!status) {
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    }
    sgsi_free(bytes);
    free(json);
    return status;
}
