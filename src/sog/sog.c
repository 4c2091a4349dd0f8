// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Reads SOG of PlayCanvas (developer.playcanvas.com, "The SOG Format"): meta.json and lossless WebP
// textures with one pixel per primitive, row by row; as a ZIP file or a folder.
//
//     means_l, means_u  16-bit positions in sign(v) ln(1 + |v|), low and high bytes
//     quats             three components times sqrt(2), alpha 252 + index of the largest of w x y z
//     scales, sh0       indices into a codebook of 256 values; alpha of sh0 is the opacity
//     shN_labels        index of a palette entry (red low, green high byte)
//     shN_centroids     the palette, 64 entries per row, a pixel per coefficient, as codebook
//     indices
//
// Version 1 has bounds per channel instead of codebooks, and opacity logits. The mark of
// antialiasing is "antialias": true in the specification, "model": "antialiased" in files of
// splat-transform.

#include "sog/sog.h"

#include <jansson.h>
#include <string.h>

#include "base/core.h"
#include "base/threads.h"
#include "sog/sog_model.h"

// meta.json of a writer has about 15 kB, most of it codebooks.
enum { MAX_META = 1 << 20 };

static const double SQRT_2 = 1.41421356237309505;

typedef struct sog_reader {
    sgsi_sog *sog;
    const char *path;
    const char *names[SGSI_SOG_TEXTURES]; // borrowed from the JSON
    uint8_t *packed[SGSI_SOG_TEXTURES];
    size_t packed_size[SGSI_SOG_TEXTURES];
    sgs_status status[SGSI_SOG_TEXTURES];
    char *message[SGSI_SOG_TEXTURES]; // of a failed decoding
} sog_reader;

// ---- meta.json ----

static sgs_status fail_meta(const char *path, const char *what)
{
    return sgsi_fail(SGS_STATUS_FORMAT, "%s: meta.json: %s is missing or invalid", path, what);
}

// The numbers first to count - 1 of a list.
static bool read_numbers(const json_t *list, size_t first, size_t count, double *values)
{
    if (json_array_size(list) < count)
        return false;
    for (size_t k = first; k < count; ++k) {
        const json_t *value = json_array_get(list, k);
        if (!json_is_number(value) || !isfinite(json_number_value(value)))
            return false;
        values[k] = json_number_value(value);
    }
    return true;
}

// Names of the files of an attribute.
static bool read_names(sog_reader *reader, const json_t *attribute, int first, size_t count)
{
    const json_t *files = json_object_get(attribute, "files");
    for (size_t k = 0; k < count; ++k) {
        reader->names[(size_t)first + k] = json_string_value(json_array_get(files, k));
        if (!reader->names[(size_t)first + k])
            return false;
    }
    return json_array_size(files) == count;
}

static void spread(double low, double high, double table[SGSI_SOG_CODES])
{
    for (int k = 0; k < SGSI_SOG_CODES; ++k)
        table[k] = low + (high - low) * k / (SGSI_SOG_CODES - 1);
}

static bool read_tables_1(sgsi_sog *sog, const json_t *scales, const json_t *sh0,
                          const json_t *rest)
{
    double low[4], high[4];
    if (!read_numbers(json_object_get(scales, "mins"), 0, 3, low) ||
        !read_numbers(json_object_get(scales, "maxs"), 0, 3, high))
        return false;
    for (int k = 0; k < 3; ++k)
        spread(low[k], high[k], sog->scales[k]);
    if (!read_numbers(json_object_get(sh0, "mins"), 0, 4, low) ||
        !read_numbers(json_object_get(sh0, "maxs"), 0, 4, high))
        return false;
    for (int k = 0; k < 3; ++k)
        spread(low[k], high[k], sog->colors[k]);
    spread(low[3], high[3], sog->opacity);
    const json_t *least = json_object_get(rest, "mins"), *most = json_object_get(rest, "maxs");
    if (rest && (!json_is_number(least) || !json_is_number(most)))
        return false;
    spread(json_number_value(least), json_number_value(most), sog->rest);
    return true;
}

// Early writers of version 2 stored null as the first entry. PlayCanvas's engine extrapolates it
// from the others: t0 = t1 + (t1 - t255) / 255.
static bool read_codebook(const json_t *attribute, double table[SGSI_SOG_CODES])
{
    enum { LAST = SGSI_SOG_CODES - 1 };
    const json_t *list = json_object_get(attribute, "codebook");
    const bool is_null = json_is_null(json_array_get(list, 0));
    if (!read_numbers(list, is_null, SGSI_SOG_CODES, table))
        return false;
    if (is_null)
        table[0] = table[1] + (table[1] - table[LAST]) / LAST;
    return isfinite(table[0]);
}

static bool read_tables_2(sgsi_sog *sog, const json_t *scales, const json_t *sh0,
                          const json_t *rest)
{
    if (!read_codebook(scales, sog->scales[0]) || !read_codebook(sh0, sog->colors[0]) ||
        (rest && !read_codebook(rest, sog->rest)))
        return false;
    for (int k = 1; k < 3; ++k) {
        memcpy(sog->scales[k], sog->scales[0], sizeof sog->scales[0]);
        memcpy(sog->colors[k], sog->colors[0], sizeof sog->colors[0]);
    }
    for (int k = 0; k < SGSI_SOG_CODES; ++k)
        sog->opacity[k] = (double)sgsi_logit(k / 255.0);
    return true;
}

static sgs_status read_meta(sog_reader *reader, const json_t *meta)
{
    sgsi_sog *sog = reader->sog;
    const json_t *version = json_object_get(meta, "version"),
                 *means = json_object_get(meta, "means"), *scales = json_object_get(meta, "scales"),
                 *quats = json_object_get(meta, "quats"), *sh0 = json_object_get(meta, "sh0"),
                 *rest = json_object_get(meta, "shN"), *count = json_object_get(meta, "count"),
                 *kind = json_object_get(meta, "model");
    sog->version = version ? (int)json_integer_value(version) : 1;
    if (sog->version != 1 && sog->version != 2)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: meta.json: SOG version %d is unknown; supported: 1 and 2",
                         reader->path, sog->version);
    if (sog->version == 1)
        count = json_array_get(json_object_get(means, "shape"), 0);
    if (!json_is_integer(count) || json_integer_value(count) < 1)
        return fail_meta(reader->path, "the number of primitives");
    sog->count = (size_t)json_integer_value(count);
    sog->antialiased = json_is_true(json_object_get(meta, "antialias")) ||
                       (json_is_string(kind) && !strncmp(json_string_value(kind), "antialias", 9));
    if (!read_names(reader, means, SGSI_SOG_MEANS_LOW, 2) ||
        !read_numbers(json_object_get(means, "mins"), 0, 3, sog->means_low) ||
        !read_numbers(json_object_get(means, "maxs"), 0, 3, sog->means_high))
        return fail_meta(reader->path, "'means'");
    if (!read_names(reader, scales, SGSI_SOG_SCALES, 1))
        return fail_meta(reader->path, "'scales'");
    if (!read_names(reader, quats, SGSI_SOG_QUATS, 1))
        return fail_meta(reader->path, "'quats'");
    if (!read_names(reader, sh0, SGSI_SOG_SH0, 1))
        return fail_meta(reader->path, "'sh0'");
    if (rest && !read_names(reader, rest, SGSI_SOG_CENTROIDS, 2))
        return fail_meta(reader->path, "'shN'");
    if (!(sog->version == 1 ? read_tables_1 : read_tables_2)(sog, scales, sh0, rest))
        return fail_meta(reader->path, sog->version == 1 ? "a bound" : "a codebook of 256 numbers");
    if (rest && sog->version == 2) {
        const json_t *bands = json_object_get(rest, "bands"),
                     *entries = json_object_get(rest, "count");
        sog->sh_degree = (int)json_integer_value(bands);
        sog->palette_count = (size_t)json_integer_value(entries);
        if (!json_is_integer(bands) || sog->sh_degree < 1 || sog->sh_degree > 3)
            return fail_meta(reader->path, "'bands' of 'shN'");
        if (!json_is_integer(entries) || json_integer_value(entries) < 1)
            return fail_meta(reader->path, "'count' of 'shN'");
    }
    return SGS_STATUS_OK;
}

// ---- Textures ----

// Pixels that files of this many bytes can plausibly hold: a primitive takes about 10 bytes of
// barely compressible data. 65536 pixels are always accepted.
static size_t pixel_limit(size_t bytes)
{
    return bytes + (1 << 16);
}

static void decode_texture(void *context, size_t k, int thread)
{
    (void)thread;
    sog_reader *reader = context;
    if (!reader->packed[k])
        return;
    reader->status[k] =
        sgsi_webp_decode(reader->path, reader->names[k], reader->packed[k], reader->packed_size[k],
                         pixel_limit(reader->sog->bytes), &reader->sog->textures[k]);
    if (reader->status[k]) // the message belongs to this thread
        reader->message[k] = sgsi_strdup(sgs_last_error());
}

static sgs_status check_textures(const sog_reader *reader)
{
    sgsi_sog *sog = reader->sog;
    for (int k = 0; k < SGSI_SOG_TEXTURES; ++k) {
        const sgsi_webp *texture = &sog->textures[k];
        const size_t pixels = (size_t)texture->width * (size_t)texture->height;
        if (reader->names[k] && k != SGSI_SOG_CENTROIDS && pixels < sog->count)
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s has %d x %d pixels for %zu primitives",
                             reader->path, reader->names[k], texture->width, texture->height,
                             sog->count);
    }
    const sgsi_webp *palette = &sog->textures[SGSI_SOG_CENTROIDS];
    if (!palette->rgba)
        return SGS_STATUS_OK;
    const size_t rows = (size_t)palette->height;
    if (sog->version == 1) {
        for (int degree = 1; degree <= 3; ++degree)
            if (palette->width == SGSI_SOG_PALETTE_COLUMNS * sgsi_rest_coefficients(degree))
                sog->sh_degree = degree;
        sog->palette_count = SGSI_SOG_PALETTE_COLUMNS * rows;
    }
    if (!sog->sh_degree ||
        palette->width != SGSI_SOG_PALETTE_COLUMNS * sgsi_rest_coefficients(sog->sh_degree))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: %s is %d pixels wide; 64 entries take 192, 512 or 960 for 1, 2 or 3 "
                         "bands",
                         reader->path, reader->names[SGSI_SOG_CENTROIDS], palette->width);
    if (sog->palette_count > SGSI_SOG_PALETTE_COLUMNS * rows)
        sog->palette_count = SGSI_SOG_PALETTE_COLUMNS * rows;
    return SGS_STATUS_OK;
}

// Largest size of a WebP file in the archive: deflate saves little on WebP, so one in a ZIP file is
// not much larger than the ZIP file.
static size_t texture_limit(const sgsi_archive *archive)
{
    return archive->bytes ? 4 * archive->size + (1 << 16) : SIZE_MAX;
}

static sgs_status read_textures(sog_reader *reader, const sgsi_archive *archive)
{
    sgsi_sog *sog = reader->sog;
    sgs_status status = SGS_STATUS_OK;
    for (int k = 0; !status && k < SGSI_SOG_TEXTURES; ++k)
        if (reader->names[k]) {
            status = sgsi_archive_read(archive, reader->names[k], texture_limit(archive),
                                       &reader->packed[k], &reader->packed_size[k]);
            sog->bytes += reader->packed_size[k];
        }
    if (archive->bytes)
        sog->bytes = archive->size;
    if (!status && sog->count > pixel_limit(sog->bytes))
        status = sgsi_fail(SGS_STATUS_LIMIT,
                           "%s: meta.json: %zu primitives are more than %zu bytes can hold",
                           reader->path, sog->count, sog->bytes);
    if (!status)
        sgsi_parallel_for(SGSI_SOG_TEXTURES, 1, decode_texture, reader);
    for (int k = 0; k < SGSI_SOG_TEXTURES; ++k) {
        if (!status && reader->status[k])
            status = sgsi_fail(reader->status[k], "%s",
                               reader->message[k] ? reader->message[k] : reader->path);
        sgsi_free(reader->message[k]);
        sgsi_free(reader->packed[k]);
    }
    return status ? status : check_textures(reader);
}

// ---- The model ----

char *sgsi_sog_folder(const char *path)
{
    const char *slash = strrchr(path, '/'), *name = slash ? slash + 1 : path;
    if (strcmp(name, "meta.json") && strcmp(name, "lod-meta.json"))
        return sgsi_strdup(path);
    return slash ? sgsi_format("%.*s", slash == path ? 1 : (int)(slash - path), path)
                 : sgsi_strdup(".");
}

sgs_status sgsi_sog_open(sgsi_sog *sog, const char *path)
{
    sog_reader reader = {.sog = sog, .path = path};
    sgsi_archive archive = {0};
    uint8_t *text = NULL;
    size_t length;
    json_error_t error;
    json_t *meta = NULL;
    *sog = (sgsi_sog){0};
    char *folder = sgsi_sog_folder(path);
    sgs_status status =
        folder ? sgsi_archive_open(&archive, folder)
               : sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
    if (!status)
        status = sgsi_archive_read(&archive, "meta.json", MAX_META, &text, &length);
    if (!status) {
        sog->bytes = length;
        meta = json_loadb((const char *)text, length, JSON_REJECT_DUPLICATES, &error);
        status = meta ? read_meta(&reader, meta)
                      : sgsi_fail(SGS_STATUS_FORMAT, "%s: meta.json: line %d: %s", path, error.line,
                                  error.text);
    }
    if (!status)
        status = read_textures(&reader, &archive);
    json_decref(meta);
    sgsi_free(text);
    sgsi_free(folder);
    sgsi_archive_close(&archive);
    return status;
}

void sgsi_sog_close(sgsi_sog *sog)
{
    for (int k = 0; k < SGSI_SOG_TEXTURES; ++k)
        sgsi_webp_free(&sog->textures[k]);
}

static void decode_rotation(const uint8_t *pixel, float rotation[4])
{
    double q[4] = {0}, sum = 0.0;
    const int largest = pixel[3] - 252;
    for (int k = 0, at = 0; k < 4; ++k) {
        if (k == largest)
            continue;
        q[k] = largest < 0 ? 0.0 : (pixel[at++] / 255.0 * 2.0 - 1.0) / SQRT_2;
        sum += q[k] * q[k];
    }
    q[largest < 0 ? 0 : largest] = sqrt(fmax(0.0, 1.0 - sum)); // invalid: the identity
    for (int k = 0; k < 4; ++k)
        rotation[k] = (float)q[k];
}

void sgsi_sog_row(const sgsi_sog *sog, size_t i, float params[SGS_PARAM_COUNT])
{
    const uint8_t *pixel[SGSI_SOG_TEXTURES];
    for (int k = 0; k < SGSI_SOG_TEXTURES; ++k)
        pixel[k] = sog->textures[k].rgba ? sog->textures[k].rgba + 4 * i : NULL;
    memset(params, 0, SGS_PARAM_COUNT * sizeof *params);
    for (int k = 0; k < 3; ++k) {
        const int bits = pixel[SGSI_SOG_MEANS_LOW][k] | pixel[SGSI_SOG_MEANS_HIGH][k] << 8;
        const double t =
            sog->means_low[k] + (sog->means_high[k] - sog->means_low[k]) * bits / 65535.0;
        params[SGS_PARAM_MEAN + k] = (float)copysign(expm1(fabs(t)), t);
        params[SGS_PARAM_SCALE + k] = (float)sog->scales[k][pixel[SGSI_SOG_SCALES][k]];
        params[SGS_PARAM_SH_DC + k] = (float)sog->colors[k][pixel[SGSI_SOG_SH0][k]];
    }
    params[SGS_PARAM_OPACITY] = (float)sog->opacity[pixel[SGSI_SOG_SH0][3]];
    decode_rotation(pixel[SGSI_SOG_QUATS], params + SGS_PARAM_ROTATION);
    if (!sog->sh_degree)
        return;
    const size_t label = (size_t)(pixel[SGSI_SOG_LABELS][0] | pixel[SGSI_SOG_LABELS][1] << 8),
                 coefficients = (size_t)sgsi_rest_coefficients(sog->sh_degree);
    if (label >= sog->palette_count)
        return;
    const sgsi_webp *palette = &sog->textures[SGSI_SOG_CENTROIDS];
    const uint8_t *entry =
        palette->rgba + 4 * (label / SGSI_SOG_PALETTE_COLUMNS * (size_t)palette->width +
                             label % SGSI_SOG_PALETTE_COLUMNS * coefficients);
    for (size_t j = 0; j < coefficients; ++j)
        for (size_t c = 0; c < 3; ++c)
            params[SGS_PARAM_SH_REST + 3 * j + c] = (float)sog->rest[entry[4 * j + c]];
}

sgs_status sgsi_sog_read(const char *path, const sgs_model_read_options *options,
                         sgs_gaussians **model, sgs_model_info *info)
{
    sgsi_rows rows = {0};
    sgsi_sog *sog = sgsi_calloc(1, sizeof *sog);
    if (!sog)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
    sgs_status status = sgsi_sog_open(sog, path);
    if (!status)
        status = sgsi_rows_begin(&rows, path, sog->count, sog->sh_degree,
                                 options->drop_zero_quaternions);
    for (size_t i = 0; !status && i < sog->count; ++i) {
        float params[SGS_PARAM_COUNT];
        sgsi_sog_row(sog, i, params);
        sgsi_rows_add(&rows, params);
    }
    info->version = sog->version;
    info->antialiased = sog->antialiased;
    info->file_bytes = sog->bytes;
    info->dropped = rows.dropped;
    sgsi_sog_close(sog);
    sgsi_free(sog);
    return status ? status : sgsi_rows_end(&rows, model);
}
