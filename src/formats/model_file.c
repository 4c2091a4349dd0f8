// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The table of model formats: names, first bytes, reader and writer of each. A file has the format
// that its name selects if its first bytes agree, else the format that its first bytes indicate.

#include "sparegs/model_file.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>

#include "base/base_name.h"
#include "base/core.h"
#include "formats/small_formats.h"
#include "model/finite_model.h"
#include "model/sh_degree.h"
#include "ply/ply_model.h"
#include "sog/sog_model.h"
#include "storage/color_marks.h"
#include "storage/model_format.h"
#include "storage/model_rows.h"
#include "usd/usd_model.h"
#include "web_page/web_page.h"

enum { PROBE_BYTES = 8192 };

typedef struct format_row {
    const char *name, *ending;                          // of file names
    bool (*matches)(const uint8_t *bytes, size_t size); // NULL: the format has no signature
    sgsi_model_read_fn read;                            // NULL: written only
    sgsi_model_write_fn write;
    bool marks_filter;
    sgsi_model_colors_fn read_colors;                          // NULL: not recorded
    sgs_status (*read_count)(const char *path, size_t *count); // NULL: by `read`
} format_row;

static bool begins(const uint8_t *bytes, size_t size, const char *mark, size_t length)
{
    return size >= length && !memcmp(bytes, mark, length);
}

static bool is_compressed_ply(const uint8_t *bytes, size_t size)
{
    return begins(bytes, size, "ply", 3) && memmem(bytes, size, "packed_position", 15);
}

static bool is_ply(const uint8_t *bytes, size_t size)
{
    return begins(bytes, size, "ply", 3) && !is_compressed_ply(bytes, size);
}

static bool is_gzip(const uint8_t *bytes, size_t size)
{
    return begins(bytes, size, "\x1f\x8b", 2);
}

static bool is_spz(const uint8_t *bytes, size_t size)
{
    return begins(bytes, size, "NGSP", 4) || is_gzip(bytes, size);
}

static bool is_glb(const uint8_t *bytes, size_t size)
{
    return begins(bytes, size, "glTF", 4);
}

static bool is_lod(const uint8_t *bytes, size_t size)
{
    return begins(bytes, size, "{", 1) && memmem(bytes, size, "\"lodLevels\"", 11);
}

static bool is_zip(const uint8_t *bytes, size_t size)
{
    return begins(bytes, size, "PK\3\4", 4);
}

// A package of OpenUSD: a ZIP file whose first file is a layer.
static bool is_usdz(const uint8_t *bytes, size_t size)
{
    enum { HEADER = 30, NAME_LENGTH = 26 };
    if (!is_zip(bytes, size) || size < HEADER)
        return false;
    const size_t length = sgsi_load_u16(bytes + NAME_LENGTH);
    const char *end = (const char *)bytes + HEADER + length;
    return length >= 5 && length <= size - HEADER &&
           (!strncasecmp(end - 4, ".usd", 4) || !strncasecmp(end - 5, ".usda", 5) ||
            !strncasecmp(end - 5, ".usdc", 5));
}

static bool is_sog(const uint8_t *bytes, size_t size)
{
    return (is_zip(bytes, size) && !is_usdz(bytes, size)) ||
           (begins(bytes, size, "{", 1) && memmem(bytes, size, "means_", 6));
}

// Text, or other files of OpenUSD, which the reader opens or names.
static bool is_usd(const uint8_t *bytes, size_t size)
{
    return begins(bytes, size, "#usda", 5) || begins(bytes, size, "PXR-USDC", 8) ||
           is_usdz(bytes, size);
}

// A page of sgsi_web_page_write.
static bool is_html(const uint8_t *bytes, size_t size)
{
    static const char mark[] = "<meta name=\"generator\" content=\"sparegs model page\">";
    return begins(bytes, size, "<!doctype html>", 15) && memmem(bytes, size, mark, sizeof mark - 1);
}

// Longer endings precede those that they contain.
static const format_row table[SGS_MODEL_FORMAT_COUNT] = {
    [SGS_MODEL_PLY] = {"ply", ".ply", is_ply, sgsi_ply_model_read, sgsi_ply_model_write, true,
                       sgsi_ply_read_colors, sgsi_ply_read_count},
    [SGS_MODEL_COMPRESSED_PLY] = {"compressed.ply", ".compressed.ply", is_compressed_ply,
                                  sgsi_compressed_ply_read, sgsi_compressed_ply_write, true,
                                  sgsi_ply_read_colors, sgsi_ply_read_count},
    [SGS_MODEL_SPLAT] = {"splat", ".splat", NULL, sgsi_splat_read, sgsi_splat_write, false, NULL,
                         NULL},
    [SGS_MODEL_SPZ] = {"spz", ".spz", is_spz, sgsi_spz_read, sgsi_spz_write, true, NULL, NULL},
    [SGS_MODEL_KSPLAT] = {"ksplat", ".ksplat", NULL, sgsi_ksplat_read, sgsi_ksplat_write, false,
                          NULL, NULL},
    [SGS_MODEL_GLB] = {"glb", ".glb", is_glb, sgsi_glb_read, sgsi_glb_write, false,
                       sgsi_glb_read_colors, NULL},
    [SGS_MODEL_SOG] = {"sog", ".sog", is_sog, sgsi_sog_read, sgsi_sog_write, true, NULL, NULL},
    [SGS_MODEL_LOD_SOG] = {"lod-meta.json", "lod-meta.json", is_lod, sgsi_lod_sog_read,
                           sgsi_lod_sog_write, true, NULL, NULL},
    [SGS_MODEL_USDA] = {"usda", ".usda", is_usd, sgsi_usd_read, sgsi_usd_write, false,
                        sgsi_usd_read_colors, NULL},
    [SGS_MODEL_HTML] = {"html", ".html", is_html, NULL, sgsi_web_page_write, true, NULL, NULL},
};

static const char readable_names[] =
    ".ply, .compressed.ply, .splat, .spz, .ksplat, .glb, .sog, meta.json, lod-meta.json and .usda";

const char *sgs_model_format_name(sgs_model_format format)
{
    return (unsigned)format < SGS_MODEL_FORMAT_COUNT ? table[format].name : "unknown";
}

bool sgs_model_format_marks_filter(sgs_model_format format)
{
    return (unsigned)format < SGS_MODEL_FORMAT_COUNT && table[format].marks_filter;
}

bool sgs_model_format_marks_colors(sgs_model_format format)
{
    return (unsigned)format < SGS_MODEL_FORMAT_COUNT && table[format].read_colors;
}

static bool ends_with(const char *path, const char *ending)
{
    const size_t length = strlen(path), size = strlen(ending);
    return length >= size && !strcasecmp(path + length - size, ending);
}

// The file that stands for a folder. Readers of the format look for exactly this name.
static const char *manifest_name(sgs_model_format format)
{
    return format == SGS_MODEL_SOG       ? "meta.json"
           : format == SGS_MODEL_LOD_SOG ? table[format].ending
                                         : NULL;
}

bool sgs_model_format_of_name(const char *path, sgs_model_format *format)
{
    const char *name = sgsi_base_name(path);
    size_t longest = 0;
    for (int k = 0; k < SGS_MODEL_FORMAT_COUNT; ++k)
        if (manifest_name((sgs_model_format)k) &&
            !strcmp(name, manifest_name((sgs_model_format)k))) {
            *format = (sgs_model_format)k;
            return true;
        }
    for (int k = 0; k < SGS_MODEL_FORMAT_COUNT; ++k)
        if (*table[k].ending == '.' && ends_with(name, table[k].ending) &&
            strlen(table[k].ending) > longest) {
            longest = strlen(table[k].ending);
            *format = (sgs_model_format)k;
        }
    return longest > 0;
}

// Format of a file by name and first bytes; a status with a message if it is none.
static sgs_status find_format(const char *path, sgs_model_format *format)
{
    uint8_t bytes[PROBE_BYTES];
    size_t size = 0;
    if (sgsi_is_folder(path)) {
        char *lod = sgsi_format("%s/lod-meta.json", path),
             *meta = sgsi_format("%s/meta.json", path);
        const bool has_lod = lod && sgsi_is_file(lod), has_meta = meta && sgsi_is_file(meta);
        sgsi_free(lod);
        sgsi_free(meta);
        *format = has_lod ? SGS_MODEL_LOD_SOG : SGS_MODEL_SOG;
        return has_lod || has_meta
                   ? SGS_STATUS_OK
                   : sgsi_fail(SGS_STATUS_IO, "%s: is a folder without meta.json or lod-meta.json",
                               path);
    }
    FILE *stream;
    size_t file_bytes;
    const sgs_status opened = sgsi_file_open(path, &stream, &file_bytes);
    if (!opened) {
        size = fread(bytes, 1, sizeof bytes, stream);
        fclose(stream);
    }
    if (begins(bytes, size, "SGSPACK1", 8)) // for any name: .splat and .ksplat have no signature
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: is a compressed model; write it as PLY with 'sparegs decompress'",
                         path);
    if (is_zip(bytes, size) && ends_with(path, ".usdz")) {
        *format = SGS_MODEL_USDA;
        return SGS_STATUS_OK;
    }
    const bool named = sgs_model_format_of_name(path, format) && table[*format].read,
               has_mark = !named || table[*format].matches;
    if (named && (opened || !size || (has_mark && table[*format].matches(bytes, size))))
        return SGS_STATUS_OK; // the reader reports what is wrong
    if (opened)
        return opened;
    // Files without a signature may begin with the two bytes of gzip data.
    for (int k = 0; k < SGS_MODEL_FORMAT_COUNT && (has_mark || !is_gzip(bytes, size)); ++k)
        if (table[k].matches && table[k].matches(bytes, size)) {
            *format = (sgs_model_format)k;
            return *bytes != '{' ? SGS_STATUS_OK
                                 : sgsi_fail(SGS_STATUS_UNSUPPORTED,
                                             "%s: is the %s of a SOG model; give it this name",
                                             path, manifest_name(*format));
        }
    return named ? SGS_STATUS_OK
                 : sgsi_fail(SGS_STATUS_UNSUPPORTED,
                             "%s: is not a model in a known format; supported: %s", path,
                             readable_names);
}

bool sgs_model_format_detect(const char *path, sgs_model_format *format)
{
    sgsi_errors_suspend();
    const bool known = (sgsi_is_file(path) || sgsi_is_folder(path)) && !find_format(path, format);
    sgsi_errors_resume();
    return known;
}

void sgs_model_read_options_init(sgs_model_read_options *options, size_t size)
{
    const sgs_model_read_options defaults = {0};
    sgsi_options_init(options, size, &defaults, sizeof defaults);
}

void sgs_model_write_options_init(sgs_model_write_options *options, size_t size)
{
    const sgs_model_write_options defaults = {
        .spz_version = 3, .ksplat_level = 1, .palette_iterations = 10, .lod_levels = 4};
    sgsi_options_init(options, size, &defaults, sizeof defaults);
}

sgs_status sgs_model_read(const char *path, const sgs_model_read_options *options,
                          sgs_gaussians **model, sgs_model_info *info)
{
    sgs_model_read_options own = sgs_model_read_options_default();
    sgs_model_info found = {.lod_count = 1};
    struct stat file;
    *model = NULL;
    sgs_status status = sgsi_options_read(options, "sgs_model_read_options", &own, sizeof own);
    if (!status)
        status = find_format(path, &found.format);
    if (!status && own.lod && found.format != SGS_MODEL_LOD_SOG)
        status =
            sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: has no level of detail %d", path, own.lod);
    if (!status && !table[found.format].read)
        status = sgsi_fail(SGS_STATUS_UNSUPPORTED,
                           "%s: is a page that shows a model and cannot be read; supported: %s",
                           path, readable_names);
    if (!status)
        status = table[found.format].read(path, &own, model, &found);
    if (!status && !found.file_bytes && !stat(path, &file))
        found.file_bytes = (size_t)file.st_size;
    if (info)
        *info = found;
    return status;
}

sgs_status sgs_model_read_colors(const char *path, sgs_model_colors *colors)
{
    sgs_model_format format;
    *colors = (sgs_model_colors){0};
    sgs_status status = find_format(path, &format);
    if (!status && table[format].read_colors)
        status = table[format].read_colors(path, colors);
    if (status)
        *colors = (sgs_model_colors){0};
    return status;
}

sgs_status sgs_model_read_count(const char *path, size_t *count)
{
    sgs_model_format format;
    sgs_gaussians *model;
    *count = 0;
    sgs_status status = find_format(path, &format);
    if (status || table[format].read_count)
        return status ? status : table[format].read_count(path, count);
    status = sgs_model_read(path, NULL, &model, NULL);
    *count = status ? 0 : model->count;
    sgs_gaussians_destroy(model);
    return status;
}

// Whether the last error begins with the file or, for a model of several files, its folder.
static bool error_names(const char *path)
{
    const char *error = sgs_last_error(), *slash = strrchr(path, '/');
    const size_t length = slash ? (size_t)(slash - path) : strlen(path);
    if (!slash && !strncmp(error, "./", 2)) // lod-meta.json in the working directory
        return true;
    return !strncmp(error, path, length) && (error[length] == '/' || error[length] == ':');
}

static sgs_status check_write_options(const char *path, const sgs_model_write_options *options)
{
    const char *wrong = NULL;
    if (options->spz_version != 3 && options->spz_version != 4)
        wrong = "spz_version is not 3 or 4";
    else if (options->ksplat_level < 0 || options->ksplat_level > 2)
        wrong = "ksplat_level is not within 0 to 2";
    else if (options->sh_palette < 0 || options->sh_palette > 65536)
        wrong = "sh_palette is not within 0 to 65536";
    else if (options->palette_iterations < 1)
        wrong = "palette_iterations is not positive";
    else if (options->lod_levels < 1 || options->lod_levels > 16)
        wrong = "lod_levels is not within 1 to 16";
    else if (options->camera_count && !options->cameras)
        wrong = "camera_count is not 0, but cameras is NULL";
    else if (!isfinite(options->up[0]) || !isfinite(options->up[1]) || !isfinite(options->up[2]))
        wrong = "up is not finite";
    else
        wrong = sgsi_colors_wrong(&options->colors);
    return wrong ? sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: %s", path, wrong) : SGS_STATUS_OK;
}

// What formats other than PLY, whose values are stored as they are, cannot hold. Formats with
// ranges per chunk or per file would lose other primitives, and many viewers the whole file.
static sgs_status check_model(const char *path, sgs_model_format format, const sgs_gaussians *model)
{
    const sgs_status status = sgsi_sh_degree_check(model, path);
    if (status || format == SGS_MODEL_PLY)
        return status;
    if (!model->count && format != SGS_MODEL_COMPRESSED_PLY)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: a file of this format cannot be empty",
                         path);
    return sgsi_finite_model_check(model, path);
}

sgs_status sgs_model_write(const char *path, const sgs_gaussians *model,
                           const sgs_model_write_options *options, sgs_model_written *written)
{
    sgs_model_write_options own = sgs_model_write_options_default();
    sgs_model_written result = {.count = model->count, .order = SGS_ROWS_KEPT};
    sgs_model_format format;
    struct stat file;
    sgs_status status = sgsi_options_read(options, "sgs_model_write_options", &own, sizeof own);
    if (!status && !sgs_model_format_of_name(path, &format))
        status = sgsi_fail(SGS_STATUS_UNSUPPORTED,
                           "%s: the name has no known extension; supported: .html, %s", path,
                           readable_names);
    if (!status)
        status = check_write_options(path, &own);
    if (!status)
        status = check_model(path, format, model);
    if (!status)
        status = table[format].write(path, model, &own, &result);
    if (status == SGS_STATUS_CANCELLED)
        status = sgsi_fail(status, "%s: writing was cancelled", path);
    else if (status && !error_names(path))
        status = sgsi_fail(status, "%s: %s", path, sgs_last_error());
    if (!status && !result.bytes && !stat(path, &file))
        result.bytes = (uint64_t)file.st_size;
    if (written)
        *written = result;
    return status;
}
