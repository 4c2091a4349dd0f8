// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// SPZ of Niantic (github.com/nianticlabs/spz): attributes as streams of bytes, in this order:
// positions, alphas, colours, scales, rotations, SH. Versions 1 to 3 are one gzip stream of a
// 16-byte header and the streams; version 4 is a 32-byte header, a table of sizes and one Zstandard
// frame per stream.
//
//     position   3 x 24 bits, fixed point with `fractional_bits` (version 1: binary16)
//     alpha      255 sigmoid(opacity)          colour  (0.15 f_dc + 0.5) 255
//     scale      16 (log scale + 10)           SH      128 v + 128, in steps of 8 and 16
//     rotation   versions 1, 2: x y z in 127.5 q + 127.5, w >= 0; versions 3, 4: the largest
//                component (2 bits) and three others with sign and 9 bits of 511 |q| sqrt(2)
//
// The specification stores x right, y up, z back. Some exporters write the axes of the PLY; the
// extension record 0xADBE0003 names the axes, also mirrored ones and those with z up. Written files
// use as many fractional bits as the largest coordinate allows, so that no position wraps.
//
// Streams of equal bytes compress to almost nothing, so the size of a file bounds its count. Per
// byte, a regular grid of 128 x 128 x 128 equal primitives has 0.6 primitives with gzip and 5 with
// Zstandard, a trained model 0.1. A model beyond the bound is written stored, or, in version 4,
// with an extension record of zeros: the frames must end with the file.

#include "formats/small_formats.h"

#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "model/similarity.h"
#include "sparegs/output_file.h"
#include "storage/model_rows.h"
#include "storage/unpack.h"

enum {
    MAGIC = 0x5053474E, // "NGSP"
    HEADER_BYTES = 16,
    HEADER_4_BYTES = 32,
    STREAM_COUNT = 6,
    FLAG_ANTIALIASED = 1,
    FLAG_EXTENSIONS = 2,
    RECORD_HEADER_BYTES = 8, // of an extension record: type and size
    AXES_RECORD_BYTES = 12,
    AXES_RDF = 6, // a value of the record
    MAX_FRACTIONAL_BITS = 30,
    FRACTIONAL_BITS_WRITTEN = 20,
    COUNT_PER_BYTE = 4, // at most, versions 1 to 3
    COUNT_PER_BYTE_4 = 16,
    COUNT_ALWAYS = 1 << 16, // accepted in a file of any size
    MAX_ROW_BYTES = 92,     // degree 4
    MAX_RECORDS = 1 << 16,
    OLD_COUNT_LIMIT = 10000000, // of readers before version 4, as in the library of that time
    GZIP_LEVEL = 6,
    ZSTD_LEVEL = 9
};

static const uint32_t AXES_RECORD = 0xADBE0003, PADDING_RECORD = 0x53504753;

// Values of the record. Minus 1, bit 0 is x right, bit 1 y up, bit 2 z front; with bit 3, y is back
// or front and z down or up. The axes of 9 (LFD), 10 (RFD), 15 (LBU) and 16 (RBU) are uncertain:
// the library of nianticlabs/spz reads others than their names say.
enum { AXES_TURNED = 8 };
static const uint8_t axes_records[SGS_SPZ_AXES_COUNT] = {
    [SGS_SPZ_AXES_LDB] = 1,  [SGS_SPZ_AXES_RDB] = 2,  [SGS_SPZ_AXES_LUB] = 3,
    [SGS_SPZ_AXES_RUB] = 4,  [SGS_SPZ_AXES_LDF] = 5,  [SGS_SPZ_AXES_RDF] = AXES_RDF,
    [SGS_SPZ_AXES_LUF] = 7,  [SGS_SPZ_AXES_RUF] = 8,  [SGS_SPZ_AXES_LFU] = 11,
    [SGS_SPZ_AXES_RFU] = 12, [SGS_SPZ_AXES_LBD] = 13, [SGS_SPZ_AXES_RBD] = 14};

static const double SQRT_HALF = 0.70710678118654752;
static const double MAX_COORDINATE = 8388607.0; // without fractional bits
static const double MIN_LOG_SCALE = -10.0, MAX_LOG_SCALE = 255.0 / 16.0 - 10.0;
static const double MAX_DC = 0.5 / 0.15; // largest coefficient of degree 0

// deflate expands at most 1032 times; a header more for empty streams.
static const size_t GZIP_RATIO = 1032;

static const char *const stream_names[STREAM_COUNT] = {"positions", "alphas",    "colours",
                                                       "scales",    "rotations", "SH"};

typedef struct spz_file {
    const char *path;
    uint32_t version, count;
    int sh_degree, sh_stored; // degree 4 is stored but not kept
    int fractional_bits, flags;
    sgs_spz_axes axes;
    const sgsi_similarity *turn; // after the change of signs, or NULL
    const uint8_t *streams[STREAM_COUNT];
    uint8_t *owned[STREAM_COUNT]; // decompressed
    uint8_t *bytes;               // the file
    size_t size;
} spz_file;

// The axes that change their signs.
static sgsi_axes axes_of(sgs_spz_axes axes)
{
    return (sgsi_axes)(((axes_records[axes] - 1) ^ (AXES_RDF - 1)) & SGSI_AXES_MAX);
}

static size_t row_bytes(const spz_file *file, int stream)
{
    const size_t sizes[STREAM_COUNT] = {file->version == 1 ? 6 : 9,
                                        1,
                                        3,
                                        3,
                                        file->version >= 3 ? 4 : 3,
                                        3 * (size_t)sgsi_rest_coefficients(file->sh_stored)};
    return sizes[stream];
}

// Primitives that a file of this many bytes can plausibly contain.
static size_t count_limit(uint32_t version, size_t size)
{
    return (version == 4 ? COUNT_PER_BYTE_4 : COUNT_PER_BYTE) * size + COUNT_ALWAYS;
}

// ---- Reading ----

// Fields that all versions share.
static sgs_status read_fields(spz_file *file, const uint8_t *header)
{
    file->version = sgsi_load_u32(header + 4);
    file->count = sgsi_load_u32(header + 8);
    file->sh_stored = header[12];
    file->sh_degree = file->sh_stored < 3 ? file->sh_stored : 3;
    file->fractional_bits = header[13];
    file->flags = header[14];
    if (sgsi_load_u32(header) != MAGIC)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: is not an SPZ file: it does not begin with NGSP",
                         file->path);
    if (file->version < 1 || file->version > 4)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED, "%s: SPZ version %u is unknown; supported: 1 to 4",
                         file->path, file->version);
    if (file->sh_stored > 4)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: byte 12: SH degree %d is not within 0 to 4",
                         file->path, file->sh_stored);
    if (file->fractional_bits > MAX_FRACTIONAL_BITS)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: byte 13: %d fractional bits are not within 0 to %d", file->path,
                         file->fractional_bits, MAX_FRACTIONAL_BITS);
    if (!file->count)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: contains no primitives", file->path);
    if (file->count > count_limit(file->version, file->size))
        return sgsi_fail(SGS_STATUS_LIMIT,
                         "%s: byte 8: %u primitives are more than a file of %zu bytes can hold",
                         file->path, file->count, file->size);
    if (file->sh_stored == 4)
        sgsi_warn("%s: SH of degree 4 are ignored", file->path);
    return SGS_STATUS_OK;
}

// Records of type, length and payload; the only known one names the axes.
static sgs_status read_records(spz_file *file, const uint8_t *at, size_t left)
{
    while (file->flags & FLAG_EXTENSIONS && left >= RECORD_HEADER_BYTES) {
        const uint32_t type = sgsi_load_u32(at), size = sgsi_load_u32(at + 4);
        if (size > left - RECORD_HEADER_BYTES)
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "%s: extension record 0x%08x has %u bytes, but only %zu are left",
                             file->path, type, size, left - RECORD_HEADER_BYTES);
        if (type == AXES_RECORD && size >= 4) {
            const uint32_t axes = sgsi_load_u32(at + RECORD_HEADER_BYTES);
            size_t known = 0;
            while (known < SGS_SPZ_AXES_COUNT && axes_records[known] != axes)
                ++known;
            if (axes && known == SGS_SPZ_AXES_COUNT)
                return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                                 "%s: coordinate system %u is not supported; export the model with "
                                 "that of the SPZ specification, RUB (4)",
                                 file->path, axes);
            if (axes)
                file->axes = (sgs_spz_axes)known;
        }
        at += RECORD_HEADER_BYTES + (size_t)size;
        left -= RECORD_HEADER_BYTES + (size_t)size;
    }
    return SGS_STATUS_OK;
}

// Header and streams of versions 1 to 3.
static sgs_status read_plain(spz_file *file, const uint8_t *data, size_t size)
{
    if (size < HEADER_BYTES)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: has %zu bytes of data; the header takes %d",
                         file->path, size, HEADER_BYTES);
    const sgs_status status = read_fields(file, data);
    if (status)
        return status;
    size_t at = HEADER_BYTES;
    for (int k = 0; k < STREAM_COUNT; ++k) {
        const size_t bytes = row_bytes(file, k) * file->count;
        if (bytes > size - at)
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "%s: %s of %u primitives take %zu bytes, but only %zu are left; the "
                             "file is truncated or its count is wrong",
                             file->path, stream_names[k], file->count, bytes, size - at);
        file->streams[k] = data + at;
        at += bytes;
    }
    return read_records(file, data + at, size - at);
}

static sgs_status read_gzip(spz_file *file, size_t size)
{
    const size_t expanded = size * GZIP_RATIO,
                 plausible = HEADER_BYTES + MAX_ROW_BYTES * count_limit(1, size) + MAX_RECORDS,
                 most = expanded < plausible ? expanded : plausible;
    size_t unpacked;
    sgs_status status = sgsi_unpack(SGSI_PACKING_GZIP, file->path, "gzip data", file->bytes, size,
                                    most, &file->owned[0], &unpacked);
    if (status)
        return status;
    if (unpacked >= HEADER_BYTES && sgsi_load_u32(file->owned[0]) == MAGIC &&
        sgsi_load_u32(file->owned[0] + 4) == 4)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: version 4 cannot be gzip data", file->path);
    return read_plain(file, file->owned[0], unpacked);
}

static sgs_status read_zstd(spz_file *file, size_t size)
{
    sgs_status status = size < HEADER_4_BYTES
                            ? sgsi_fail(SGS_STATUS_FORMAT, "%s: has %zu bytes; the header takes %d",
                                        file->path, size, HEADER_4_BYTES)
                            : read_fields(file, file->bytes);
    if (status)
        return status;
    const size_t table = sgsi_load_u32(file->bytes + 16);
    const int streams = file->bytes[15], expected = file->sh_stored ? 6 : 5;
    if (streams != expected)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: byte 15: has %d streams; SH degree %d has %d",
                         file->path, streams, file->sh_stored, expected);
    if (table < HEADER_4_BYTES || table > size || size - table < 16 * (size_t)streams)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: byte 16: the table of streams at byte %zu is outside of the file",
                         file->path, table);
    status = read_records(file, file->bytes + HEADER_4_BYTES, table - HEADER_4_BYTES);
    size_t at = table + 16 * (size_t)streams;
    for (int k = 0; !status && k < streams; ++k) {
        const uint64_t packed = sgsi_load_u64(file->bytes + table + 16 * k),
                       bytes = sgsi_load_u64(file->bytes + table + 16 * k + 8);
        const size_t needed = row_bytes(file, k) * file->count;
        size_t unpacked = 0;
        if (bytes != needed || packed > size - at)
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "%s: %s: %llu bytes, packed %llu, do not fit %u primitives and a file "
                             "of %zu bytes",
                             file->path, stream_names[k], (unsigned long long)bytes,
                             (unsigned long long)packed, file->count, size);
        status = sgsi_unpack(SGSI_PACKING_ZSTD, file->path, stream_names[k], file->bytes + at,
                             packed, needed, &file->owned[k], &unpacked);
        if (!status && unpacked != needed)
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s have %zu bytes instead of %zu", file->path,
                             stream_names[k], unpacked, needed);
        file->streams[k] = file->owned[k];
        at += packed;
    }
    return status;
}

static double load_fixed(const uint8_t *at, int fractional_bits)
{
    const int32_t value =
        (int32_t)((uint32_t)at[0] << 8 | (uint32_t)at[1] << 16 | (uint32_t)at[2] << 24) >> 8;
    return ldexp((double)value, -fractional_bits);
}

static void decode_rotation(const spz_file *file, size_t i, float params[SGS_PARAM_COUNT])
{
    double q[4], sum = 0.0; // x, y, z, w
    int largest = 3;
    if (file->version >= 3) {
        uint32_t bits = sgsi_load_u32(file->streams[4] + 4 * i);
        largest = (int)(bits >> 30);
        for (int k = 3; k >= 0; --k) {
            if (k == largest)
                continue;
            const double magnitude = SQRT_HALF * (bits & 511) / 511.0;
            q[k] = bits & 512 ? -magnitude : magnitude;
            sum += q[k] * q[k];
            bits >>= 10;
        }
    } else {
        for (int k = 0; k < 3; ++k) {
            q[k] = file->streams[4][3 * i + (size_t)k] / 127.5 - 1.0;
            sum += q[k] * q[k];
        }
    }
    q[largest] = sqrt(fmax(0.0, 1.0 - sum));
    for (int k = 0; k < 4; ++k)
        params[SGS_PARAM_ROTATION + k] = (float)q[(k + 3) % 4];
}

static void decode_row(const spz_file *file, size_t i, float params[SGS_PARAM_COUNT])
{
    memset(params, 0, SGS_PARAM_COUNT * sizeof *params);
    for (size_t k = 0; k < 3; ++k) {
        params[SGS_PARAM_MEAN + k] =
            file->version == 1
                ? sgsi_float16_to(sgsi_load_u16(file->streams[0] + 6 * i + 2 * k))
                : (float)load_fixed(file->streams[0] + 9 * i + 3 * k, file->fractional_bits);
        params[SGS_PARAM_SH_DC + k] = (float)((file->streams[2][3 * i + k] / 255.0 - 0.5) / 0.15);
        params[SGS_PARAM_SCALE + k] = (float)(file->streams[3][3 * i + k] / 16.0 - 10.0);
    }
    params[SGS_PARAM_OPACITY] = sgsi_logit(file->streams[1][i] / 255.0);
    decode_rotation(file, i, params);
    const size_t stored = row_bytes(file, 5),
                 kept = 3 * (size_t)sgsi_rest_coefficients(file->sh_degree);
    for (size_t k = 0; k < kept; ++k)
        params[SGS_PARAM_SH_REST + k] = (float)(file->streams[5][stored * i + k] - 128) / 128.0f;
    sgsi_change_axes(axes_of(file->axes), params);
    if (file->turn)
        sgsi_similarity_apply(file->turn, params);
}

sgs_status sgsi_spz_read(const char *path, const sgs_model_read_options *options,
                         sgs_gaussians **model, sgs_model_info *info)
{
    size_t size;
    sgsi_rows rows = {0};
    spz_file file = {.path = path, .axes = options->spz_axes};
    if ((unsigned)file.axes >= SGS_SPZ_AXES_COUNT)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: spz_axes %d is unknown", path,
                         (int)file.axes);
    sgs_status status = sgsi_file_read(path, 0, &file.bytes, &size);
    if (status)
        return status;
    file.size = size;
    if (size >= 2 && file.bytes[0] == 0x1F && file.bytes[1] == 0x8B)
        status = read_gzip(&file, size);
    else if (size >= 8 && sgsi_load_u32(file.bytes + 4) - 1 < 3)
        status = read_plain(&file, file.bytes, size); // not compressed
    else
        status = read_zstd(&file, size);
    // From y front and z up to y up and z back: (x, y, z) to (x, z, -y).
    const sgsi_similarity turn = sgsi_similarity_make(
        1.0, (const double[]){SQRT_HALF, -SQRT_HALF, 0.0, 0.0}, (const double[]){0.0, 0.0, 0.0});
    if (axes_records[file.axes] > AXES_TURNED)
        file.turn = &turn;
    if (!status)
        status = sgsi_rows_begin(&rows, path, file.count, file.sh_degree,
                                 options->drop_zero_quaternions);
    for (size_t i = 0; !status && i < file.count; ++i) {
        float params[SGS_PARAM_COUNT];
        decode_row(&file, i, params);
        sgsi_rows_add(&rows, params);
    }
    for (int k = 0; k < STREAM_COUNT; ++k)
        sgsi_free(file.owned[k]);
    sgsi_free(file.bytes);
    if (status)
        return status;
    info->version = (int)file.version;
    info->antialiased = file.flags & FLAG_ANTIALIASED;
    info->axes = file.axes;
    info->dropped = rows.dropped;
    return sgsi_rows_end(&rows, model);
}

// ---- Writing ----

static uint8_t clamp_byte(double value)
{
    return (uint8_t)fmin(fmax(floor(value + 0.5), 0.0), 255.0);
}

static void store_fixed(uint8_t *at, double value, int fractional_bits)
{
    const int32_t fixed =
        (int32_t)fmin(fmax(floor(ldexp(value, fractional_bits) + 0.5), -8388608.0), 8388607.0);
    at[0] = (uint8_t)fixed;
    at[1] = (uint8_t)(fixed >> 8);
    at[2] = (uint8_t)(fixed >> 16);
}

static uint32_t encode_rotation(const double rotation[4])
{
    const double q[4] = {rotation[1], rotation[2], rotation[3], rotation[0]};
    int largest = 0;
    for (int k = 1; k < 4; ++k)
        if (fabs(q[k]) > fabs(q[largest]))
            largest = k;
    uint32_t bits = (uint32_t)largest;
    for (int k = 0; k < 4; ++k) {
        if (k == largest)
            continue;
        const uint32_t magnitude =
            (uint32_t)fmin(floor(511.0 * fabs(q[k]) / SQRT_HALF + 0.5), 511.0);
        bits = bits << 10 | (uint32_t)((q[k] < 0.0) != (q[largest] < 0.0)) << 9 | magnitude;
    }
    return bits;
}

// Steps of 8 for degree 1, of 16 above.
static uint8_t encode_sh(float value, int coefficient)
{
    const double step = coefficient < 3 ? 8.0 : 16.0;
    return (uint8_t)fmin(fmax(step * floor((128.0 * (double)value + 128.0) / step + 0.5), 0.0),
                         255.0);
}

static void encode_row(const spz_file *file, const sgsi_splat *splat, size_t i,
                       uint8_t *const streams[STREAM_COUNT])
{
    for (size_t k = 0; k < 3; ++k) {
        store_fixed(streams[0] + 9 * i + 3 * k, (double)splat->mean[k], file->fractional_bits);
        streams[2][3 * i + k] = clamp_byte((0.15 * (double)splat->dc[k] + 0.5) * 255.0);
        streams[3][3 * i + k] = clamp_byte(((double)splat->log_scale[k] + 10.0) * 16.0);
    }
    streams[1][i] = sgsi_unorm8(splat->opacity);
    sgsi_store_u32(streams[4] + 4 * i, encode_rotation(splat->rotation));
    const int kept = 3 * sgsi_rest_coefficients(file->sh_degree);
    for (int k = 0; k < kept; ++k)
        streams[5][(size_t)kept * i + (size_t)k] = encode_sh(splat->rest[k], k / 3);
}

// The largest resolution at which all coordinates fit into 24 bits.
static sgs_status choose_fractional_bits(const char *path, const sgs_gaussians *model, int *bits)
{
    double largest = 0.0;
    for (size_t i = 0; i < model->count; ++i)
        for (int k = 0; k < 3; ++k)
            largest = fmax(largest, fabs((double)*sgs_gaussians_at(model, i, SGS_PARAM_MEAN + k)));
    *bits = FRACTIONAL_BITS_WRITTEN;
    while (*bits > 0 && ldexp(largest, *bits) > MAX_COORDINATE)
        --*bits;
    return largest <= MAX_COORDINATE
               ? SGS_STATUS_OK
               : sgsi_fail(SGS_STATUS_LIMIT,
                           "%s: a coordinate of %.9g exceeds the %.0f units of SPZ; move the model "
                           "towards the origin, or scale it down",
                           path, largest, MAX_COORDINATE);
}

static double largest_log_scale(const sgs_gaussians *model, size_t i)
{
    double largest = -INFINITY;
    for (int k = 0; k < 3; ++k)
        largest = fmax(largest, (double)*sgs_gaussians_at(model, i, SGS_PARAM_SCALE + k));
    return largest;
}

// A single distant primitive makes all positions coarse.
static void warn_about_positions(const char *path, const sgs_gaussians *model, int fractional_bits)
{
    const double step = ldexp(1.0, -fractional_bits);
    size_t coarse = 0;
    for (size_t i = 0; i < model->count; ++i)
        coarse += step > exp(fmax(largest_log_scale(model, i), MIN_LOG_SCALE));
    if (coarse > model->count / 100)
        sgsi_warn("%s: the farthest primitive makes the quantisation step of all positions %.3g "
                  "units, more than the size of %zu of %zu primitives; remove distant primitives",
                  path, step, coarse, model->count);
}

// Scales are clamped. Below the range only the largest scale of a primitive matters: flat ones are
// common.
static void warn_about_scales(const char *path, const sgs_gaussians *model)
{
    size_t changed = 0;
    for (size_t i = 0; i < model->count; ++i) {
        const double largest = largest_log_scale(model, i);
        changed += largest < MIN_LOG_SCALE - 1.0 / 32 || largest > MAX_LOG_SCALE + 1.0 / 32;
    }
    if (changed)
        sgsi_warn("%s: SPZ holds scales of %.2g to %.3g units; %zu of %zu primitives have others, "
                  "which are clamped to these limits; scale the model",
                  path, exp(MIN_LOG_SCALE), exp(MAX_LOG_SCALE), changed, model->count);
}

void sgsi_spz_warn_count(const char *path, int version, size_t count)
{
    if (version < 4 && count > OLD_COUNT_LIMIT)
        sgsi_warn("%s: older readers refuse SPZ files of version %d with more than %d primitives; "
                  "this one has %zu; use option spz_version 4, whose readers have no limit, or "
                  "prune the model",
                  path, version, OLD_COUNT_LIMIT, count);
}

typedef struct stream_packing {
    const uint8_t *in[STREAM_COUNT];
    size_t in_size[STREAM_COUNT], out_size[STREAM_COUNT];
    uint8_t *out[STREAM_COUNT];
    sgs_status status[STREAM_COUNT];
} stream_packing;

static void pack_stream(void *context, size_t k, int thread)
{
    (void)thread;
    stream_packing *packing = context;
    packing->status[k] = sgsi_pack(SGSI_PACKING_ZSTD, ZSTD_LEVEL, packing->in[k],
                                   packing->in_size[k], &packing->out[k], &packing->out_size[k]);
}

static void put_header(uint8_t *at, const spz_file *file)
{
    sgsi_store_u32(at, MAGIC);
    sgsi_store_u32(at + 4, file->version);
    sgsi_store_u32(at + 8, file->count);
    at[12] = (uint8_t)file->sh_degree;
    at[13] = (uint8_t)file->fractional_bits;
    at[14] = (uint8_t)file->flags;
    at[15] = 0;
}

static void put_axes_record(uint8_t *at, sgs_spz_axes axes)
{
    sgsi_store_u32(at, AXES_RECORD);
    sgsi_store_u32(at + 4, 4);
    sgsi_store_u32(at + 8, axes_records[axes]);
}

// A record of zeros, which no reader knows.
static void put_padding_record(uint8_t *at, size_t size)
{
    sgsi_store_u32(at, PADDING_RECORD);
    sgsi_store_u32(at + 4, (uint32_t)(size - RECORD_HEADER_BYTES));
}

// Bytes of the padding record in a file of `total` bytes without it.
static size_t padding_of(const spz_file *file, size_t total)
{
    if (file->count <= count_limit(4, total))
        return 0;
    const size_t missing = file->count / COUNT_PER_BYTE_4 - total;
    return missing > RECORD_HEADER_BYTES ? missing : RECORD_HEADER_BYTES;
}

// Header, records, table and frames of version 4.
static sgs_status put_version_4(const char *path, const spz_file *file,
                                const stream_packing *packing, size_t count, uint64_t *written)
{
    const size_t axes = file->flags & FLAG_EXTENSIONS ? AXES_RECORD_BYTES : 0;
    size_t total = HEADER_4_BYTES + axes + 16 * count;
    for (size_t k = 0; k < count; ++k)
        total += packing->out_size[k];
    const size_t padding = padding_of(file, total), table = HEADER_4_BYTES + axes + padding;
    uint8_t *bytes = sgsi_calloc(total + padding, 1);
    if (!bytes)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    put_header(bytes, file);
    bytes[15] = (uint8_t)count;
    sgsi_store_u32(bytes + 16, (uint32_t)table);
    if (axes)
        put_axes_record(bytes + HEADER_4_BYTES, file->axes);
    if (padding) {
        bytes[14] |= FLAG_EXTENSIONS;
        put_padding_record(bytes + HEADER_4_BYTES + axes, padding);
    }
    size_t at = table + 16 * count;
    for (size_t k = 0; k < count; ++k) {
        sgsi_store_u64(bytes + table + 16 * k, packing->out_size[k]);
        sgsi_store_u64(bytes + table + 16 * k + 8, packing->in_size[k]);
        memcpy(bytes + at, packing->out[k], packing->out_size[k]);
        at += packing->out_size[k];
    }
    const sgs_status status = sgs_output_file_write(path, bytes, at);
    *written = at;
    sgsi_free(bytes);
    return status;
}

static sgs_status write_version_4(const char *path, const spz_file *file,
                                  uint8_t *const streams[STREAM_COUNT], uint64_t *written)
{
    const size_t count = file->sh_degree ? 6 : 5;
    stream_packing packing = {0};
    sgs_status status = SGS_STATUS_OK;
    for (size_t k = 0; k < count; ++k) {
        packing.in[k] = streams[k];
        packing.in_size[k] = row_bytes(file, (int)k) * file->count;
    }
    sgsi_parallel_for(count, 1, pack_stream, &packing);
    for (size_t k = 0; k < count; ++k)
        if (!status && packing.status[k])
            status = sgsi_fail(packing.status[k], "%s: not enough memory to write it", path);
    if (!status)
        status = put_version_4(path, file, &packing, count, written);
    for (size_t k = 0; k < count; ++k)
        sgsi_free(packing.out[k]);
    return status;
}

static sgs_status write_gzip(const char *path, const uint8_t *bytes, size_t size, uint32_t count,
                             uint64_t *written)
{
    uint8_t *packed;
    size_t packed_size;
    sgs_status status =
        sgsi_pack(SGSI_PACKING_GZIP, GZIP_LEVEL, bytes, size, &packed, &packed_size);
    if (!status && count > count_limit(3, packed_size)) {
        sgsi_free(packed);
        status = sgsi_pack(SGSI_PACKING_GZIP, 0, bytes, size, &packed, &packed_size);
    }
    if (!status)
        status = sgs_output_file_write(path, packed, packed_size);
    sgsi_free(packed);
    *written = packed_size;
    return status;
}

sgs_status sgsi_spz_write(const char *path, const sgs_gaussians *model,
                          const sgs_model_write_options *options, sgs_model_written *written)
{
    const bool named = options->spz_axes != SGS_SPZ_AXES_RUB;
    spz_file file = {.path = path,
                     .axes = options->spz_axes,
                     .version = (uint32_t)options->spz_version,
                     .count = (uint32_t)model->count,
                     .sh_degree = model->sh_degree,
                     .sh_stored = model->sh_degree,
                     .flags = (options->antialiased ? FLAG_ANTIALIASED : 0) |
                              (named ? FLAG_EXTENSIONS : 0)};
    if ((unsigned)file.axes > SGS_SPZ_AXES_LUF)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "%s: spz_axes %d cannot be written; use RUB, RDF or LUF", path,
                         (int)file.axes);
    sgs_status status = choose_fractional_bits(path, model, &file.fractional_bits);
    if (status)
        return status;
    warn_about_positions(path, model, file.fractional_bits);
    warn_about_scales(path, model);
    sgsi_spz_warn_count(path, options->spz_version, model->count);
    sgsi_warn_clipped_colors(path, "SPZ", model, sgsi_color_from_dc(MAX_DC));
    sgsi_warn_clipped_harmonics(path, "SPZ", model, 1.0);
    size_t total = HEADER_BYTES + AXES_RECORD_BYTES;
    for (int k = 0; k < STREAM_COUNT; ++k)
        total += row_bytes(&file, k) * model->count;
    uint8_t *bytes = sgsi_calloc(total, 1), *streams[STREAM_COUNT];
    if (!bytes)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to write it", path);
    uint8_t *at = bytes + HEADER_BYTES;
    for (int k = 0; k < STREAM_COUNT; ++k) {
        streams[k] = at;
        at += row_bytes(&file, k) * model->count;
    }
    for (size_t i = 0; i < model->count; ++i) {
        sgsi_splat splat = sgsi_splat_get(model, i);
        sgsi_splat_change_axes(axes_of(file.axes), &splat);
        encode_row(&file, &splat, i, streams);
    }
    if (file.version == 4) {
        status = write_version_4(path, &file, streams, &written->bytes);
    } else {
        put_header(bytes, &file);
        if (named)
            put_axes_record(at, file.axes);
        status = write_gzip(path, bytes, total - (named ? 0 : AXES_RECORD_BYTES), file.count,
                            &written->bytes);
    }
    sgsi_free(bytes);
    return status;
}
