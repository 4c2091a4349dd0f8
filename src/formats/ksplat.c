// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// KSPLAT of GaussianSplats3D (github.com/mkkellogg/GaussianSplats3D): a 4096-byte header, 1024-byte
// headers of sections, and per section
//     uint32 lengths of the partial buckets, float centres of the buckets, primitives by bucket.
// Level 0 stores floats. Level 1 stores positions as 16 bits relative to the centre of a bucket (a
// cell of 5 units with at most 256 primitives) and the rest as binary16; level 2 stores SH as
// bytes. Scales are linear, rotations w x y z, colours and opacities bytes. SH are ordered by
// degree, then channel. The original supports degrees 0 to 2; other readers accept 3 too, but 2 are
// written.

#include "formats/small_formats.h"

#include <string.h>

#include "base/core.h"
#include "base/keyed_rows.h"
#include "sparegs/output_file.h"
#include "storage/model_rows.h"

enum {
    HEADER_BYTES = 4096,
    SECTION_BYTES = 1024,
    BUCKET_SIZE = 256,
    BUCKET_BYTES = 12,
    SCALE_RANGE = 32767,
    DEGREE_WRITTEN = 2,
    MAX_REST = 45
};

static const float BUCKET_SIDE = 5.0f;
static const float MAX_FLOAT16 = 65504.0f;

typedef struct level_layout {
    size_t scale, rotation, rest; // bytes of one value
    size_t scale_at, rotation_at, color_at, rest_at;
} level_layout;

static const level_layout layouts[3] = {
    {4, 4, 4, 12, 24, 40, 44}, {2, 2, 2, 6, 12, 20, 24}, {2, 2, 1, 6, 12, 20, 24}};

static size_t row_bytes(int level, int sh_degree)
{
    return layouts[level].rest_at +
           3 * (size_t)sgsi_rest_coefficients(sh_degree) * layouts[level].rest;
}

// Parameter of the k-th SH value: degree by degree, each channel by channel.
static int rest_param(int k)
{
    int first = 0; // coefficients before the degree
    for (int size = 3; k >= 3 * size; size += 2) {
        k -= 3 * size;
        first += size;
    }
    const int size = first == 0 ? 3 : first == 3 ? 5 : 7;
    return SGS_PARAM_SH_REST + 3 * (first + k % size) + k / size;
}

// ---- Reading ----

typedef struct ksplat_section {
    const uint8_t *lengths, *centers, *rows; // in the file
    size_t count, capacity, full_buckets, partial_buckets, bucket_size, row_size, bytes;
    double position_step, position_zero;
    int sh_degree;
} ksplat_section;

typedef struct ksplat_file {
    const char *path;
    uint8_t *bytes;
    size_t size, section_count, data; // data: first byte after the section headers
    int level;
    double sh_low, sh_high;
} ksplat_file;

static sgs_status read_header(ksplat_file *file)
{
    const uint8_t *at = file->bytes;
    if (file->size < HEADER_BYTES)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: has %zu bytes; the header takes %d", file->path,
                         file->size, HEADER_BYTES);
    if (at[0] != 0 || at[1] < 1)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: KSPLAT version %d.%d is unknown; supported: 0.1", file->path, at[0],
                         at[1]);
    file->section_count = sgsi_load_u32(at + 4);
    file->level = sgsi_load_u16(at + 20);
    file->sh_low = (double)sgsi_load_float(at + 36);
    file->sh_high = (double)sgsi_load_float(at + 40);
    if (file->sh_low == 0.0)
        file->sh_low = -1.5;
    if (file->sh_high == 0.0)
        file->sh_high = 1.5;
    if (file->level > 2)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: byte 20: compression level %d is not within 0 to 2", file->path,
                         file->level);
    if (file->section_count > (file->size - HEADER_BYTES) / SECTION_BYTES)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: byte 4: %zu section headers do not fit into %zu bytes", file->path,
                         file->section_count, file->size);
    file->data = HEADER_BYTES + file->section_count * SECTION_BYTES;
    return SGS_STATUS_OK;
}

// Layout of section `number`, whose data begins at byte `data`.
static sgs_status read_section(const ksplat_file *file, size_t number, size_t data,
                               ksplat_section *section)
{
    const uint8_t *at = file->bytes + HEADER_BYTES + number * SECTION_BYTES;
    const size_t buckets = sgsi_load_u32(at + 12), bucket_bytes = sgsi_load_u16(at + 20);
    const uint32_t range = sgsi_load_u32(at + 24);
    *section = (ksplat_section){.count = sgsi_load_u32(at),
                                .capacity = sgsi_load_u32(at + 4),
                                .bucket_size = sgsi_load_u32(at + 8),
                                .full_buckets = sgsi_load_u32(at + 32),
                                .partial_buckets = sgsi_load_u32(at + 36),
                                .sh_degree = sgsi_load_u16(at + 40)};
    if (section->sh_degree > 3)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: section %zu: SH degree %d is not within 0 to 3",
                         file->path, number, section->sh_degree);
    if (section->count > section->capacity)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: section %zu: has %zu primitives, but room for %zu",
                         file->path, number, section->count, section->capacity);
    section->position_zero = range ? (double)range : (double)SCALE_RANGE;
    section->position_step = (double)sgsi_load_float(at + 16) / 2.0 / section->position_zero;
    section->row_size = row_bytes(file->level, section->sh_degree);
    // All factors are below 2^32 and 2^8, so the sums cannot overflow.
    const size_t lengths = 4 * section->partial_buckets, centers = bucket_bytes * buckets,
                 rows = section->row_size * section->capacity, left = file->size - data;
    section->bytes = lengths + centers + rows;
    if (section->bytes > left)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: section %zu: %zu primitives and %zu buckets take %zu bytes, but only "
                         "%zu are left; the file is truncated or its counts are wrong",
                         file->path, number, section->capacity, buckets, section->bytes, left);
    if (file->level && section->count &&
        (bucket_bytes != BUCKET_BYTES ||
         section->full_buckets + section->partial_buckets > buckets))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: section %zu: %zu full and %zu partial buckets, but %zu centres of "
                         "%zu bytes",
                         file->path, number, section->full_buckets, section->partial_buckets,
                         buckets, bucket_bytes);
    section->lengths = file->bytes + data;
    section->centers = section->lengths + lengths;
    section->rows = section->centers + centers;
    return SGS_STATUS_OK;
}

static double load_value(const uint8_t *at, size_t bytes)
{
    return bytes == 4 ? (double)sgsi_load_float(at) : (double)sgsi_float16_to(sgsi_load_u16(at));
}

static void decode_row(const ksplat_file *file, const ksplat_section *section, const uint8_t *row,
                       const uint8_t *center, float params[SGS_PARAM_COUNT])
{
    const level_layout *layout = &layouts[file->level];
    memset(params, 0, SGS_PARAM_COUNT * sizeof *params);
    for (size_t k = 0; k < 3; ++k) {
        params[SGS_PARAM_MEAN + k] =
            center ? (float)(((double)sgsi_load_u16(row + 2 * k) - section->position_zero) *
                                 section->position_step +
                             (double)sgsi_load_float(center + 4 * k))
                   : sgsi_load_float(row + 4 * k);
        params[SGS_PARAM_SCALE + k] =
            sgsi_log_scale(load_value(row + layout->scale_at + layout->scale * k, layout->scale));
        params[SGS_PARAM_SH_DC + k] = (float)sgsi_dc_from_color(row[layout->color_at + k] / 255.0);
    }
    params[SGS_PARAM_OPACITY] = sgsi_logit(row[layout->color_at + 3] / 255.0);
    for (size_t k = 0; k < 4; ++k)
        params[SGS_PARAM_ROTATION + k] =
            (float)load_value(row + layout->rotation_at + layout->rotation * k, layout->rotation);
    const int rest = 3 * sgsi_rest_coefficients(section->sh_degree);
    for (int k = 0; k < rest; ++k) {
        const uint8_t *at = row + layout->rest_at + layout->rest * (size_t)k;
        params[rest_param(k)] =
            layout->rest == 1
                ? (float)(file->sh_low + (file->sh_high - file->sh_low) * at[0] / 255.0)
                : (float)load_value(at, layout->rest);
    }
}

static sgs_status decode_section(const ksplat_file *file, size_t number,
                                 const ksplat_section *section, sgsi_rows *rows)
{
    size_t bucket = 0, bucket_end = 0; // bucket of a primitive is bucket - 1
    for (size_t i = 0; i < section->count; ++i) {
        while (file->level && i >= bucket_end) { // the next bucket that is not empty
            if (bucket >= section->full_buckets + section->partial_buckets)
                return sgsi_fail(SGS_STATUS_FORMAT,
                                 "%s: section %zu: primitive %zu is in no bucket", file->path,
                                 number, i);
            bucket_end +=
                bucket < section->full_buckets
                    ? section->bucket_size
                    : sgsi_load_u32(section->lengths + 4 * (bucket - section->full_buckets));
            ++bucket;
        }
        float params[SGS_PARAM_COUNT];
        decode_row(file, section, section->rows + i * section->row_size,
                   file->level ? section->centers + BUCKET_BYTES * (bucket - 1) : NULL, params);
        sgsi_rows_add(rows, params);
    }
    return SGS_STATUS_OK;
}

sgs_status sgsi_ksplat_read(const char *path, const sgs_model_read_options *options,
                            sgs_gaussians **model, sgs_model_info *info)
{
    ksplat_file file = {.path = path};
    ksplat_section section;
    sgsi_rows rows = {0};
    size_t total = 0, at;
    int sh_degree = 0;
    sgs_status status = sgsi_file_read(path, 0, &file.bytes, &file.size);
    if (status)
        return status;
    status = read_header(&file);
    at = file.data;
    for (size_t k = 0; !status && k < file.section_count; ++k, at += section.bytes) {
        status = read_section(&file, k, at, &section);
        total += status ? 0 : section.count;
        sh_degree = !status && section.sh_degree > sh_degree ? section.sh_degree : sh_degree;
    }
    if (!status && !total)
        status = sgsi_fail(SGS_STATUS_FORMAT, "%s: contains no primitives", path);
    if (!status)
        status = sgsi_rows_begin(&rows, path, total, sh_degree, options->drop_zero_quaternions);
    at = file.data;
    for (size_t k = 0; !status && k < file.section_count; ++k, at += section.bytes) {
        status = read_section(&file, k, at, &section);
        if (!status)
            status = decode_section(&file, k, &section, &rows);
    }
    info->version = file.bytes[1];
    sgsi_free(file.bytes);
    if (status) {
        sgsi_rows_abort(&rows);
        return status;
    }
    info->dropped = rows.dropped;
    return sgsi_rows_end(&rows, model);
}

// ---- Writing ----

typedef struct bucket_list {
    uint32_t *order; // rows, bucket by bucket, full ones first
    float *centers;  // [buckets][3]
    uint32_t *sizes; // [buckets]
    uint32_t *ranks; // bucket of order[i]
    size_t count, full;
} bucket_list;

// Cell of each row as a key. Cells beyond 2^21 per axis share the outermost one; their positions
// would be clamped, so such models are refused before.
static sgs_status make_buckets(const sgs_gaussians *model, bucket_list *list)
{
    float low[3] = {INFINITY, INFINITY, INFINITY};
    const size_t count = model->count;
    for (size_t i = 0; i < count; ++i)
        for (int k = 0; k < 3; ++k)
            low[k] = fminf(low[k], *sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k));
    sgsi_keyed_row *rows = sgsi_alloc(count + 1, sizeof *rows),
                   *spare = sgsi_alloc(count + 1, sizeof *spare);
    list->order = sgsi_alloc(count + 1, sizeof *list->order);
    list->ranks = sgsi_alloc(count + 1, sizeof *list->ranks);
    list->sizes = sgsi_calloc(count + 1, sizeof *list->sizes);
    list->centers = sgsi_alloc(count + 1, 3 * sizeof *list->centers);
    if (!rows || !spare || !list->order || !list->ranks || !list->sizes || !list->centers) {
        sgsi_free(rows);
        sgsi_free(spare);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory to sort %zu primitives",
                         count);
    }
    bool fits = true;
    for (size_t i = 0; i < count; ++i) {
        uint64_t key = 0;
        for (int k = 0; k < 3; ++k) {
            const double cell =
                floor(((double)*sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k) - (double)low[k]) /
                      (double)BUCKET_SIDE);
            fits = fits && cell < 0x1p21;
            key = key << 21 | (uint64_t)fmin(cell, 0x1p21 - 1.0);
        }
        rows[i] = (sgsi_keyed_row){key, (uint32_t)i};
    }
    sgsi_sort_rows(rows, spare, count);
    // Two passes over the runs of a cell: its full buckets, then its rest.
    size_t written = 0;
    for (int partial = 0; partial < 2; ++partial) {
        for (size_t begin = 0, end; begin < count; begin = end) {
            for (end = begin + 1; end < count && rows[end].key == rows[begin].key;)
                ++end;
            const size_t whole = (end - begin) / BUCKET_SIZE * BUCKET_SIZE;
            const size_t first = partial ? begin + whole : begin,
                         last = partial ? end : begin + whole;
            for (size_t i = first; i < last; ++i) {
                if ((i - first) % BUCKET_SIZE == 0) {
                    float *center = list->centers + 3 * list->count++;
                    for (int k = 0; k < 3; ++k)
                        center[k] =
                            low[k] +
                            BUCKET_SIDE * ((float)(rows[i].key >> (42 - 21 * k) & 0x1FFFFF) + 0.5f);
                }
                list->sizes[list->count - 1]++;
                list->ranks[written] = (uint32_t)(list->count - 1);
                list->order[written++] = rows[i].row;
            }
        }
        if (!partial)
            list->full = list->count;
    }
    sgsi_free(rows);
    sgsi_free(spare);
    return fits ? SGS_STATUS_OK
                : sgsi_fail(SGS_STATUS_LIMIT,
                            "the model is larger than 10 million units; use level 0 of KSPLAT");
}

static void free_buckets(bucket_list *list)
{
    sgsi_free(list->order);
    sgsi_free(list->centers);
    sgsi_free(list->sizes);
    sgsi_free(list->ranks);
}

static void store_value(uint8_t *at, size_t bytes, float value)
{
    if (bytes == 4)
        sgsi_store_float(at, value);
    else
        sgsi_store_u16(at, sgsi_float16_from(fminf(fmaxf(value, -MAX_FLOAT16), MAX_FLOAT16)));
}

static void warn_about_scales(const char *path, const sgs_gaussians *model)
{
    size_t changed = 0;
    for (size_t i = 0; i < model->count; ++i) {
        bool large = false;
        for (int k = 0; k < 3; ++k)
            large = large || exp((double)*sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k)) >
                                 (double)MAX_FLOAT16;
        changed += large;
    }
    if (changed)
        sgsi_warn("%s: this level of KSPLAT holds scales of up to %.0f units; %zu of %zu "
                  "primitives have larger ones, which are clamped; use level 0",
                  path, (double)MAX_FLOAT16, changed, model->count);
}

static void encode_row(int level, int sh_degree, const sgsi_splat *splat, const float *center,
                       const float sh_range[2], uint8_t *row)
{
    const level_layout *layout = &layouts[level];
    for (size_t k = 0; k < 3; ++k) {
        if (center)
            sgsi_store_u16(row + 2 * k,
                           (uint32_t)fmin(fmax(floor(((double)splat->mean[k] - (double)center[k]) *
                                                         (2.0 * SCALE_RANGE / (double)BUCKET_SIDE) +
                                                     SCALE_RANGE + 0.5),
                                               0.0),
                                          65535.0));
        else
            sgsi_store_float(row + 4 * k, splat->mean[k]);
        store_value(row + layout->scale_at + layout->scale * k, layout->scale,
                    (float)exp((double)splat->log_scale[k]));
        row[layout->color_at + k] = sgsi_unorm8(sgsi_color_from_dc((double)splat->dc[k]));
    }
    row[layout->color_at + 3] = sgsi_unorm8(splat->opacity);
    for (size_t k = 0; k < 4; ++k)
        store_value(row + layout->rotation_at + layout->rotation * k, layout->rotation,
                    (float)splat->rotation[k]);
    const int rest = 3 * sgsi_rest_coefficients(sh_degree);
    for (int k = 0; k < rest; ++k) {
        const float value = splat->rest[rest_param(k) - SGS_PARAM_SH_REST];
        uint8_t *at = row + layout->rest_at + layout->rest * (size_t)k;
        if (layout->rest == 1)
            *at = sgsi_unorm8(((double)value - (double)sh_range[0]) /
                              ((double)sh_range[1] - (double)sh_range[0]));
        else
            store_value(at, layout->rest, value);
    }
}

// Range of the SH values; 0 would mean the default of the readers.
static void find_sh_range(const sgs_gaussians *model, int sh_degree, float range[2])
{
    range[0] = -1e-3f;
    range[1] = 1e-3f;
    for (size_t i = 0; i < model->count; ++i)
        for (int k = 0; k < 3 * sgsi_rest_coefficients(sh_degree); ++k) {
            const float value = *sgs_gaussians_at(model, i, SGS_PARAM_SH_REST + k);
            range[0] = fminf(range[0], value);
            range[1] = fmaxf(range[1], value);
        }
}

static void put_headers(uint8_t *bytes, const sgs_gaussians *model, int level, int sh_degree,
                        const float sh_range[2], const bucket_list *buckets, size_t data_size)
{
    const uint32_t count = (uint32_t)model->count;
    uint8_t *section = bytes + HEADER_BYTES;
    bytes[1] = 1; // version 0.1
    sgsi_store_u32(bytes + 4, 1);
    sgsi_store_u32(bytes + 8, 1);
    sgsi_store_u32(bytes + 12, count);
    sgsi_store_u32(bytes + 16, count);
    sgsi_store_u16(bytes + 20, (uint32_t)level);
    sgsi_store_float(bytes + 36, sh_range[0]);
    sgsi_store_float(bytes + 40, sh_range[1]);
    sgsi_store_u32(section, count);
    sgsi_store_u32(section + 4, count);
    if (level) {
        sgsi_store_u32(section + 8, BUCKET_SIZE);
        sgsi_store_u32(section + 12, (uint32_t)buckets->count);
        sgsi_store_float(section + 16, BUCKET_SIDE);
        sgsi_store_u16(section + 20, BUCKET_BYTES);
        sgsi_store_u32(section + 32, (uint32_t)buckets->full);
        sgsi_store_u32(section + 36, (uint32_t)(buckets->count - buckets->full));
    }
    sgsi_store_u32(section + 24, level ? SCALE_RANGE : 1);
    sgsi_store_u32(section + 28, (uint32_t)data_size);
    sgsi_store_u16(section + 40, (uint32_t)sh_degree);
}

sgs_status sgsi_ksplat_write(const char *path, const sgs_gaussians *model,
                             const sgs_model_write_options *options, sgs_model_written *written)
{
    const int level = options->ksplat_level,
              sh_degree = model->sh_degree < DEGREE_WRITTEN ? model->sh_degree : DEGREE_WRITTEN;
    const size_t count = model->count, row_size = row_bytes(level, sh_degree);
    bucket_list buckets = {0};
    float sh_range[2];
    if (model->sh_degree > DEGREE_WRITTEN)
        sgsi_warn("%s: KSPLAT holds SH of degree %d at most; higher degrees are omitted", path,
                  DEGREE_WRITTEN);
    if (level)
        warn_about_scales(path, model);
    sgsi_warn_clipped_colors(path, "KSPLAT", model, 1.0);
    sgs_status status = level ? make_buckets(model, &buckets) : SGS_STATUS_OK;
    const size_t partial = buckets.count - buckets.full,
                 rows_at = 4 * partial + BUCKET_BYTES * buckets.count,
                 data_size = rows_at + row_size * count,
                 size = HEADER_BYTES + SECTION_BYTES + data_size;
    if (!status && data_size > UINT32_MAX)
        status = sgsi_fail(SGS_STATUS_LIMIT, "%s: %zu bytes exceed the 4 GiB of a KSPLAT section",
                           path, data_size);
    uint8_t *bytes = status ? NULL : sgsi_calloc(size, 1);
    if (!status && !bytes)
        status = sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    if (!status) {
        uint8_t *data = bytes + HEADER_BYTES + SECTION_BYTES;
        find_sh_range(model, sh_degree, sh_range);
        put_headers(bytes, model, level, sh_degree, sh_range, &buckets, data_size);
        for (size_t k = 0; k < partial; ++k)
            sgsi_store_u32(data + 4 * k, buckets.sizes[buckets.full + k]);
        for (size_t k = 0; k < 3 * buckets.count; ++k)
            sgsi_store_float(data + 4 * partial + 4 * k, buckets.centers[k]);
        for (size_t i = 0; i < count; ++i) {
            const sgsi_splat splat = sgsi_splat_get(model, level ? buckets.order[i] : i);
            encode_row(level, sh_degree, &splat,
                       level ? buckets.centers + 3 * (size_t)buckets.ranks[i] : NULL, sh_range,
                       data + rows_at + row_size * i);
        }
        status = sgs_output_file_write(path, bytes, size);
    }
    written->bytes = size;
    written->order = level ? SGS_ROWS_BUCKETS : SGS_ROWS_KEPT;
    free_buckets(&buckets);
    sgsi_free(bytes);
    return status;
}
