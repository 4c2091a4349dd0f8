// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// SOG with levels of detail: lod-meta.json and a folder with a SOG model per unit. The tree of
// lod-meta.json divides space; a leaf names, for each level, a range of rows of a unit. Level 0 is
// the finest. An environment, a SOG model of the sky or distant objects, belongs to every level.
//
// Written levels are nested: level k holds the most important half of the primitives of level k
// - 1. Nodes are split at the median of their longest side while they have more than 512 k
// primitives of level 0, or are longer than 16 units with more than 8 k.

#include "sog/sog_model.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/core.h"
#include "base/keyed_rows.h"
#include "sog/sog.h"
#include "sparegs/version.h"
#include "storage/row_order.h"

enum {
    MAX_LEVELS = 16,
    MAX_DEPTH = 256,
    UNIT_COUNT = 512 * 1024,
    SMALL_COUNT = 8 * 1024,
    JSON_DIGITS = 9
};

static const double LONG_SIDE = 16.0;
static const char manifest_name[] = "lod-meta.json";

// ---- Reading ----

typedef struct lod_range {
    size_t number; // in the order of the tree
    size_t file, offset, count;
} lod_range;

typedef struct lod_reader {
    const char *path;
    json_t *root;
    char *folder;
    lod_range *ranges;
    size_t range_count, range_capacity;
    size_t total; // rows of all ranges, as the manifest has them
    int level;
} lod_reader;

static sgs_status fail_lod(const lod_reader *reader, const char *what)
{
    return sgsi_fail(SGS_STATUS_FORMAT, "%s: lod-meta.json: %s is missing or invalid", reader->path,
                     what);
}

static bool read_index(const json_t *object, const char *name, size_t *value)
{
    const json_t *number = json_object_get(object, name);
    *value = (size_t)json_integer_value(number);
    return json_is_integer(number) && json_integer_value(number) >= 0 &&
           json_integer_value(number) <= INT32_MAX;
}

static sgs_status visit_node(lod_reader *reader, const json_t *node, int depth)
{
    char level[16];
    size_t k;
    const json_t *child;
    snprintf(level, sizeof level, "%d", reader->level);
    const json_t *range = json_object_get(json_object_get(node, "lods"), level);
    if (!json_is_object(node) || depth > MAX_DEPTH)
        return fail_lod(reader, "a node of 'tree'");
    if (range) {
        lod_range found = {.number = reader->range_count};
        if (!read_index(range, "file", &found.file) ||
            !read_index(range, "offset", &found.offset) ||
            !read_index(range, "count", &found.count))
            return fail_lod(reader, "a range of 'tree'");
        if (reader->range_count == reader->range_capacity) {
            const size_t capacity = 2 * reader->range_capacity + 64;
            if (!sgsi_grow((void **)&reader->ranges, reader->range_count, capacity,
                           sizeof *reader->ranges))
                return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it",
                                 reader->path);
            reader->range_capacity = capacity;
        }
        reader->ranges[reader->range_count++] = found;
    }
    sgs_status status = SGS_STATUS_OK;
    json_array_foreach(json_object_get(node, "children"), k, child)
    {
        if (!status)
            status = visit_node(reader, child, depth + 1);
    }
    return status;
}

static sgs_status read_manifest(lod_reader *reader, int *levels)
{
    uint8_t *text;
    size_t size;
    json_error_t error;
    char *path = sgsi_format("%s/lod-meta.json", reader->folder);
    sgs_status status = path ? sgsi_file_read(path, 0, &text, &size)
                             : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                         "%s: not enough memory to read it", reader->path);
    sgsi_free(path);
    if (status)
        return status;
    reader->root = json_loadb((const char *)text, size, JSON_REJECT_DUPLICATES, &error);
    sgsi_free(text);
    if (!reader->root)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: lod-meta.json: line %d: %s", reader->path,
                         error.line, error.text);
    const json_t *version = json_object_get(reader->root, "version"),
                 *count = json_object_get(reader->root, "lodLevels");
    if (version && json_integer_value(version) != 1)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: lod-meta.json: version %lld is unknown; supported: 1", reader->path,
                         (long long)json_integer_value(version));
    *levels = (int)json_integer_value(count);
    if (!json_is_integer(count) || json_integer_value(count) < 1 || json_integer_value(count) > 256)
        return fail_lod(reader, "'lodLevels'");
    if (!json_is_array(json_object_get(reader->root, "filenames")))
        return fail_lod(reader, "'filenames'");
    if (reader->level < 0 || reader->level >= *levels)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: has no level of detail %d; it has %d",
                         reader->path, reader->level, *levels);
    const json_t *environment = json_object_get(reader->root, "environment");
    if (environment && !json_is_null(environment) && !json_is_string(environment))
        return fail_lod(reader, "'environment'");
    return visit_node(reader, json_object_get(reader->root, "tree"), 0);
}

static int compare_ranges(const void *a, const void *b)
{
    const lod_range *first = a, *second = b;
    if (first->file != second->file)
        return first->file < second->file ? -1 : 1;
    return first->number < second->number ? -1 : first->number > second->number;
}

// Sorts the ranges by unit; those of one unit keep the order of the tree.
static void sort_ranges(lod_reader *reader)
{
    if (reader->range_count)
        qsort(reader->ranges, reader->range_count, sizeof *reader->ranges, compare_ranges);
}

// Number of ranges of the unit of range `first`, and of their rows.
static size_t group_size(const lod_reader *reader, size_t first, size_t *rows)
{
    size_t end = first;
    *rows = 0;
    while (end < reader->range_count && reader->ranges[end].file == reader->ranges[first].file)
        *rows += reader->ranges[end++].count;
    return end - first;
}

static bool leaves_folder(const char *name)
{
    return *name == '/' || strstr(name, "..") || strchr(name, '\\') || strchr(name, '\n');
}

static sgs_status path_of(const lod_reader *reader, const char *name, char **path)
{
    *path = sgsi_format("%s/%s", reader->folder, name);
    return *path ? SGS_STATUS_OK
                 : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it",
                             reader->path);
}

static sgs_status unit_path(const lod_reader *reader, size_t file, char **path)
{
    const char *name =
        json_string_value(json_array_get(json_object_get(reader->root, "filenames"), file));
    *path = NULL;
    if (!name || leaves_folder(name))
        return sgsi_fail(
            SGS_STATUS_FORMAT,
            "%s: lod-meta.json: the name of SOG file %zu is missing or leaves the folder",
            reader->path, file);
    return path_of(reader, name, path);
}

// ---- Units that are one file ----

typedef struct lod_unit {
    dev_t device;
    ino_t inode;
    size_t file, same; // `same`: first unit with this file
} lod_unit;

static int compare_inodes(const void *a, const void *b)
{
    const lod_unit *first = a, *second = b;
    if (first->device != second->device)
        return first->device < second->device ? -1 : 1;
    if (first->inode != second->inode)
        return first->inode < second->inode ? -1 : 1;
    return first->file < second->file ? -1 : first->file > second->file;
}

static int compare_units(const void *a, const void *b)
{
    const lod_unit *first = a, *second = b;
    return first->file < second->file ? -1 : first->file > second->file;
}

// The units that have rows, by number. Missing files are left to the reader of a unit.
static sgs_status find_units(const lod_reader *reader, lod_unit *units, size_t *count)
{
    sgs_status status = SGS_STATUS_OK;
    *count = 0;
    for (size_t k = 0, rows; !status && k < reader->range_count;) {
        const size_t file = reader->ranges[k].file;
        struct stat info;
        char *path = NULL;
        k += group_size(reader, k, &rows);
        if (!rows)
            continue;
        status = unit_path(reader, file, &path);
        if (!status && !stat(path, &info))
            units[(*count)++] = (lod_unit){info.st_dev, info.st_ino, file, file};
        sgsi_free(path);
    }
    return status;
}

// A file that several units name is read once, with the ranges of all of them. Otherwise a small
// file could be repeated without limit.
static sgs_status merge_units(lod_reader *reader)
{
    size_t count = 0, at = 0;
    lod_unit *units = sgsi_alloc(reader->range_count + 1, sizeof *units);
    if (!units)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it",
                         reader->path);
    const sgs_status status = find_units(reader, units, &count);
    if (!status && count) {
        qsort(units, count, sizeof *units, compare_inodes);
        for (size_t k = 1; k < count; ++k)
            if (units[k].device == units[k - 1].device && units[k].inode == units[k - 1].inode)
                units[k].same = units[k - 1].same;
        qsort(units, count, sizeof *units, compare_units);
        for (size_t k = 0; k < reader->range_count; ++k) {
            while (at + 1 < count && units[at].file < reader->ranges[k].file)
                ++at;
            if (units[at].file == reader->ranges[k].file)
                reader->ranges[k].file = units[at].same;
        }
        sort_ranges(reader);
    }
    sgsi_free(units);
    return status;
}

// ---- Rows ----

static sgs_status add_range(const lod_reader *reader, const lod_range *range, const sgsi_sog *sog,
                            sgsi_rows *rows)
{
    if (range->offset > sog->count - range->count)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: lod-meta.json: rows %zu to %zu exceed SOG file %zu of %zu primitives",
                         reader->path, range->offset, range->offset + range->count, range->file,
                         sog->count);
    for (size_t i = 0; i < range->count; ++i) {
        float params[SGS_PARAM_COUNT];
        sgsi_sog_row(sog, range->offset + i, params);
        sgsi_rows_add(rows, params);
    }
    return SGS_STATUS_OK;
}

// Rows that units of this many bytes can plausibly hold. sog.c accepts 65536 rows in a unit of any
// size; this is for all units together.
static size_t row_limit(size_t bytes)
{
    return 4 * bytes + (1 << 16);
}

// Opens a unit of `needed` rows, or of any number if that is SIZE_MAX, and makes room for them.
static sgs_status open_unit(const lod_reader *reader, const char *path, size_t file, size_t *needed,
                            sgsi_sog *sog, sgsi_rows *rows, const sgs_model_info *info)
{
    const sgs_status status = sgsi_sog_open(sog, path);
    if (status)
        return status;
    if (*needed == SIZE_MAX)
        *needed = sog->count;
    if (*needed > sog->count)
        return sgsi_fail(
            SGS_STATUS_FORMAT,
            "%s: lod-meta.json: the tree names %zu primitives of SOG file %zu, which has %zu",
            reader->path, *needed, file, sog->count);
    const size_t total = rows->total + *needed, bytes = info->file_bytes + sog->bytes;
    if (total > row_limit(bytes))
        return sgsi_fail(
            SGS_STATUS_LIMIT,
            "%s: lod-meta.json: %zu primitives are more than %zu bytes of SOG files can hold",
            reader->path, total, bytes);
    return sgsi_rows_expect(rows, *needed, total > reader->total ? total : reader->total);
}

// Adds the rows of `count` ranges, in the order of the tree, `needed` together. Without ranges: all
// rows.
static sgs_status read_unit(const lod_reader *reader, const char *path, const lod_range *ranges,
                            size_t count, size_t needed, sgsi_rows *rows, sgs_model_info *info)
{
    sgsi_sog *sog = sgsi_calloc(1, sizeof *sog);
    if (!sog)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it",
                         reader->path);
    sgs_status status =
        open_unit(reader, path, ranges ? ranges->file : 0, &needed, sog, rows, info);
    const lod_range whole = {.count = needed};
    for (size_t k = 0; !status && k < (ranges ? count : 1); ++k)
        status = add_range(reader, ranges ? &ranges[k] : &whole, sog, rows);
    if (!status) {
        rows->model->sh_degree =
            sog->sh_degree > rows->model->sh_degree ? sog->sh_degree : rows->model->sh_degree;
        info->antialiased = info->antialiased || sog->antialiased;
        info->version = sog->version;
        info->file_bytes += sog->bytes;
    }
    sgsi_sog_close(sog);
    sgsi_free(sog);
    return status;
}

// Rows of all units, by number.
static sgs_status read_units(lod_reader *reader, sgsi_rows *rows, sgs_model_info *info)
{
    const size_t units = json_array_size(json_object_get(reader->root, "filenames"));
    for (size_t k = 0; k < reader->range_count; ++k) {
        if (reader->ranges[k].file >= units)
            return fail_lod(reader, "a file number of 'tree'");
        reader->total += reader->ranges[k].count;
    }
    sort_ranges(reader);
    sgs_status status = merge_units(reader);
    for (size_t k = 0, count, needed; !status && k < reader->range_count; k += count) {
        char *path = NULL;
        count = group_size(reader, k, &needed);
        if (needed)
            status = unit_path(reader, reader->ranges[k].file, &path);
        if (path)
            status = read_unit(reader, path, reader->ranges + k, count, needed, rows, info);
        sgsi_free(path);
    }
    return status;
}

// Viewers show the environment with every level.
static sgs_status read_environment(const lod_reader *reader, sgsi_rows *rows, sgs_model_info *info)
{
    const char *name = json_string_value(json_object_get(reader->root, "environment"));
    char *path;
    if (!name || !*name)
        return SGS_STATUS_OK;
    if (leaves_folder(name))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: lod-meta.json: the name of 'environment' leaves the folder",
                         reader->path);
    sgs_status status = path_of(reader, name, &path);
    if (!status)
        status = read_unit(reader, path, NULL, 0, SIZE_MAX, rows, info);
    sgsi_free(path);
    return status;
}

sgs_status sgsi_lod_sog_read(const char *path, const sgs_model_read_options *options,
                             sgs_gaussians **model, sgs_model_info *info)
{
    lod_reader reader = {.path = path, .level = options->lod, .folder = sgsi_sog_folder(path)};
    sgsi_rows rows = {0};
    sgs_status status = reader.folder ? read_manifest(&reader, &info->lod_count)
                                      : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY,
                                                  "%s: not enough memory to read it", path);
    if (!status)
        status = sgsi_rows_begin(&rows, path, 0, 0, options->drop_zero_quaternions);
    if (!status)
        status = read_units(&reader, &rows, info);
    if (!status)
        status = read_environment(&reader, &rows, info);
    info->dropped = rows.dropped;
    json_decref(reader.root);
    sgsi_free(reader.ranges);
    sgsi_free(reader.folder);
    if (status) {
        sgsi_rows_abort(&rows);
        return status;
    }
    return sgsi_rows_end(&rows, model);
}

// ---- Writing ----

typedef struct lod_writer {
    const sgs_gaussians *model;
    const sgs_model_write_options *options;
    sgsi_model_folder folder;
    uint32_t *rows; // Morton order, then grouped by leaf
    uint8_t *last;  // [count] coarsest level of each row
    sgsi_progress *progress;
    json_t *names;
    uint64_t bytes;
    int levels;
    // Per level: rows of the open unit, and the number of closed ones.
    uint32_t *open[MAX_LEVELS];
    size_t open_count[MAX_LEVELS], closed[MAX_LEVELS], counts[MAX_LEVELS];
    size_t file_number[MAX_LEVELS]; // of the open unit, in `names`
} lod_writer;

static sgs_status close_unit(lod_writer *writer, int level)
{
    sgsi_archive_file files[SGSI_SOG_FILES] = {0};
    size_t file_count = 0;
    char unit[32];
    snprintf(unit, sizeof unit, "%d_%zu/", level, writer->closed[level]);
    sgs_status status =
        sgsi_sog_encode(writer->model, writer->open[level], writer->open_count[level],
                        writer->options, writer->progress, files, &file_count);
    if (!status)
        status = sgsi_sog_put(&writer->folder, unit, files, file_count, &writer->bytes);
    sgsi_sog_files_free(files);
    writer->open_count[level] = 0;
    ++writer->closed[level];
    return status;
}

// Adds the rows of a leaf to the open unit of each level.
static sgs_status write_leaf(lod_writer *writer, const uint32_t *rows, size_t count, json_t *node)
{
    json_t *lods = json_object();
    sgs_status status = SGS_STATUS_OK;
    for (int level = 0; !status && level < writer->levels; ++level) {
        const size_t offset = writer->open_count[level];
        size_t added = 0;
        char key[16];
        for (size_t i = 0; i < count; ++i)
            if (writer->last[rows[i]] >= level)
                writer->open[level][offset + added++] = rows[i];
        if (!added)
            continue;
        if (!offset) {
            char name[48];
            snprintf(name, sizeof name, "%d_%zu/meta.json", level, writer->closed[level]);
            writer->file_number[level] = json_array_size(writer->names);
            json_array_append_new(writer->names, json_string(name));
        }
        snprintf(key, sizeof key, "%d", level);
        json_object_set_new(lods, key,
                            json_pack("{s:I,s:I,s:I}", "file",
                                      (json_int_t)writer->file_number[level], "offset",
                                      (json_int_t)offset, "count", (json_int_t)added));
        writer->open_count[level] += added;
        writer->counts[level] += added;
        if (writer->open_count[level] > UNIT_COUNT)
            status = close_unit(writer, level);
    }
    json_object_set_new(node, "lods", lods);
    return status;
}

// Box of the primitives at one standard deviation.
static void find_bound(const lod_writer *writer, const uint32_t *rows, size_t count, double low[3],
                       double high[3])
{
    for (int j = 0; j < 3; ++j) {
        low[j] = INFINITY;
        high[j] = -INFINITY;
    }
    for (size_t i = 0; i < count; ++i) {
        const sgsi_splat splat = sgsi_splat_get(writer->model, rows[i]);
        double deviation[3];
        sgsi_splat_deviation(&splat, deviation);
        for (int j = 0; j < 3; ++j) {
            low[j] = fmin(low[j], (double)splat.mean[j] - deviation[j]);
            high[j] = fmax(high[j], (double)splat.mean[j] + deviation[j]);
        }
    }
}

static uint64_t key_of(float value)
{
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits & 0x80000000 ? (uint32_t)~bits : bits | 0x80000000;
}

// Sorts rows along an axis.
static sgs_status sort_along(const lod_writer *writer, uint32_t *rows, size_t count, int axis)
{
    sgsi_keyed_row *keyed = sgsi_alloc(count, sizeof *keyed),
                   *spare = sgsi_alloc(count, sizeof *spare);
    for (size_t i = 0; keyed && spare && i < count; ++i)
        keyed[i] = (sgsi_keyed_row){
            key_of(*sgs_gaussians_at(writer->model, rows[i], SGS_PARAM_MEAN + axis)), rows[i]};
    if (keyed && spare)
        sgsi_sort_rows(keyed, spare, count);
    for (size_t i = 0; keyed && spare && i < count; ++i)
        rows[i] = keyed[i].row;
    const bool sorted = keyed && spare;
    sgsi_free(keyed);
    sgsi_free(spare);
    return sorted ? SGS_STATUS_OK
                  : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to sort %zu primitives",
                              count);
}

static json_t *vector(const double values[3])
{
    return json_pack("[f,f,f]", values[0], values[1], values[2]);
}

static sgs_status write_node(lod_writer *writer, uint32_t *rows, size_t count, int depth,
                             json_t *node)
{
    double low[3], high[3];
    float from[3] = {INFINITY, INFINITY, INFINITY}, to[3] = {-INFINITY, -INFINITY, -INFINITY};
    int axis = 0;
    find_bound(writer, rows, count, low, high);
    for (size_t i = 0; i < count; ++i)
        for (int k = 0; k < 3; ++k) {
            const float value = *sgs_gaussians_at(writer->model, rows[i], SGS_PARAM_MEAN + k);
            from[k] = fminf(from[k], value);
            to[k] = fmaxf(to[k], value);
        }
    for (int k = 1; k < 3; ++k)
        if (to[k] - from[k] > to[axis] - from[axis])
            axis = k;
    json_object_set_new(node, "bound",
                        json_pack("{s:o,s:o}", "min", vector(low), "max", vector(high)));
    const double side = (double)to[axis] - (double)from[axis];
    if (count <= SMALL_COUNT || (count <= UNIT_COUNT && side <= LONG_SIDE) || depth >= 64 ||
        !(side > 0.0))
        return write_leaf(writer, rows, count, node);
    sgs_status status = sort_along(writer, rows, count, axis);
    json_t *first = json_object(), *second = json_object();
    if (!status)
        status = write_node(writer, rows, count / 2, depth + 1, first);
    if (!status)
        status = write_node(writer, rows + count / 2, count - count / 2, depth + 1, second);
    json_object_set_new(node, "children", json_pack("[o,o]", first, second));
    return status;
}

// Coarsest level of each row: level k has the first count / 2^k rows by importance.
static sgs_status rank_rows(lod_writer *writer)
{
    uint32_t *order;
    const sgs_status status =
        sgsi_order_by_importance(writer->model, writer->options->importance, &order);
    for (size_t i = 0; !status && i < writer->model->count; ++i) {
        int level = 0;
        while (level + 1 < writer->levels && i < writer->model->count >> (level + 1))
            ++level;
        writer->last[order[i]] = (uint8_t)level;
    }
    if (!status)
        sgsi_free(order);
    return status;
}

static sgs_status write_manifest(lod_writer *writer, json_t *tree)
{
    json_t *counts = json_array();
    size_t total = 0;
    for (int level = 0; level < writer->levels; ++level) {
        json_array_append_new(counts, json_integer((json_int_t)writer->counts[level]));
        total += writer->counts[level];
    }
    json_t *root =
        json_pack("{s:i,s:{s:s},s:I,s:O,s:i,s:O,s:O}", "version", 1, "asset", "generator",
                  "sparegs " SGS_VERSION, "count", (json_int_t)total, "counts", counts, "lodLevels",
                  writer->levels, "filenames", writer->names, "tree", tree);
    json_decref(counts);
    char *text = json_dumps(root, JSON_COMPACT | JSON_REAL_PRECISION(JSON_DIGITS));
    json_decref(root);
    const sgs_status status =
        text ? sgsi_model_folder_put(&writer->folder, manifest_name, (const uint8_t *)text,
                                     strlen(text))
             : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it",
                         writer->folder.path);
    writer->bytes += text ? strlen(text) : 0;
    free(text);
    return status;
}

// Marks the units of an earlier model in the folder for removal: those that its manifest names and
// that have the names of written units. A manifest that cannot be read marks none.
static sgs_status drop_units(lod_writer *writer)
{
    uint8_t *text = NULL;
    size_t size = 0, k;
    const json_t *entry;
    sgs_status status = SGS_STATUS_OK;
    char *path = sgsi_format("%s/%s", writer->folder.path, manifest_name);
    json_t *root = path && !sgsi_file_read(path, 0, &text, &size)
                       ? json_loadb((const char *)text, size, JSON_REJECT_DUPLICATES, NULL)
                       : NULL;
    json_array_foreach(json_object_get(root, "filenames"), k, entry)
    {
        const char *name = json_string_value(entry) ? json_string_value(entry) : "";
        int level = -1;
        size_t number = 0;
        char unit[32], meta[48];
        if (sscanf(name, "%2d_%8zu/", &level, &number) != 2)
            continue;
        snprintf(unit, sizeof unit, "%d_%zu/", level, number);
        snprintf(meta, sizeof meta, "%smeta.json", unit);
        if (!status && !strcmp(name, meta))
            status = sgsi_sog_drop(&writer->folder, unit);
    }
    json_decref(root);
    sgsi_free(text);
    sgsi_free(path);
    return status;
}

static sgs_status write_levels(lod_writer *writer)
{
    const size_t count = writer->model->count;
    sgs_status status = sgsi_order_by_position(writer->model, &writer->rows);
    writer->last = status ? NULL : sgsi_calloc(count, 1);
    bool room = writer->last != NULL;
    for (int level = 0; level < writer->levels; ++level) {
        writer->open[level] = sgsi_alloc(count, sizeof *writer->open[level]);
        room = room && writer->open[level];
    }
    if (!status && !room)
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it",
                           writer->folder.path);
    if (!status)
        status = rank_rows(writer);
    json_t *tree = json_object();
    if (!status)
        status = write_node(writer, writer->rows, count, 0, tree);
    for (int level = 0; !status && level < writer->levels; ++level)
        if (writer->open_count[level])
            status = close_unit(writer, level);
    if (!status)
        status = write_manifest(writer, tree);
    if (!status)
        status = drop_units(writer);
    json_decref(tree);
    return status;
}

sgs_status sgsi_lod_sog_write(const char *path, const sgs_gaussians *model,
                              const sgs_model_write_options *options, sgs_model_written *written)
{
    sgsi_progress progress;
    char *folder = sgsi_sog_folder(path);
    lod_writer writer = {.model = model,
                         .options = options,
                         .progress = &progress,
                         .names = json_array(),
                         .levels = options->lod_levels};
    while (writer.levels > 1 && !(model->count >> (writer.levels - 1)))
        --writer.levels; // the coarsest level has a primitive
    sgsi_progress_begin(&progress, options->progress, options->progress_user,
                        (size_t)writer.levels * sgsi_sog_steps(model, options));
    sgs_status status =
        folder ? sgsi_model_folder_open(&writer.folder, folder, manifest_name)
               : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    if (!status)
        status = write_levels(&writer);
    if (!status)
        status = sgsi_model_folder_commit(&writer.folder);
    sgsi_model_folder_close(&writer.folder);
    sgsi_progress_end(&progress);
    for (int level = 0; level < MAX_LEVELS; ++level)
        sgsi_free(writer.open[level]);
    sgsi_free(writer.rows);
    sgsi_free(writer.last);
    json_decref(writer.names);
    sgsi_free(folder);
    written->bytes = writer.bytes;
    written->order = SGS_ROWS_MORTON;
    return status;
}
