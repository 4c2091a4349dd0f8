// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Writes an HTML page that shows the model offline: web_page.html with its style and script, and
// the model as SOG in base64, in a JSON object. The page needs WebGL 2. It is not read back.

#include <jansson.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "sog/sog.h"
#include "sparegs/output_file.h"
#include "storage/row_order.h"
#include "web_page/web_page.h"

extern const char sgsi_web_page[]; // generated from web_page.html, .css and .js

enum { BASE64_BLOCK = 3 * 4096, MAX_CAMERAS = 1000 };

static const char placeholder[] = "<!-- model -->";

static void write_base64(FILE *stream, const uint8_t *bytes, size_t size)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    char text[BASE64_BLOCK / 3 * 4] = {0};
    for (size_t begin = 0; begin < size; begin += BASE64_BLOCK) {
        const size_t end = begin + BASE64_BLOCK < size ? begin + BASE64_BLOCK : size;
        char *to = text;
        for (size_t i = begin; i < end; i += 3) {
            const uint32_t second = i + 1 < end ? bytes[i + 1] : 0,
                           third = i + 2 < end ? bytes[i + 2] : 0,
                           bits = (uint32_t)bytes[i] << 16 | second << 8 | third;
            *to++ = digits[bits >> 18];
            *to++ = digits[bits >> 12 & 63];
            *to++ = (char)(i + 1 < end ? digits[bits >> 6 & 63] : '=');
            *to++ = (char)(i + 2 < end ? digits[bits & 63] : '=');
        }
        fwrite(text, 1, (size_t)(to - text), stream);
    }
}

static json_t *real_list(const double *values, size_t count)
{
    json_t *list = json_array();
    for (size_t k = 0; k < count; ++k)
        json_array_append_new(list, json_real(values[k]));
    return list;
}

// Axes are the rows of the rotation: right, down, front. At most MAX_CAMERAS, evenly chosen.
static json_t *camera_list(const sgs_model_write_options *options)
{
    json_t *list = json_array();
    const size_t step = (options->camera_count + MAX_CAMERAS - 1) / MAX_CAMERAS;
    for (size_t c = 0; c < options->camera_count; c += step) {
        const sgs_model_camera *camera = &options->cameras[c];
        const double *r = camera->rotation, *t = camera->translation;
        json_t *object = json_object(), *axes = json_array();
        double eye[3];
        for (size_t k = 0; k < 3; ++k) {
            eye[k] = -(r[k] * t[0] + r[3 + k] * t[1] + r[6 + k] * t[2]);
            json_array_append_new(axes, real_list(r + 3 * k, 3));
        }
        json_object_set_new(object, "name", json_string(camera->name));
        json_object_set_new(object, "width", json_integer(camera->width));
        json_object_set_new(object, "height", json_integer(camera->height));
        json_object_set_new(object, "fx", json_real(camera->fx));
        json_object_set_new(object, "fy", json_real(camera->fy));
        json_object_set_new(object, "cx", json_real(camera->cx));
        json_object_set_new(object, "cy", json_real(camera->cy));
        json_object_set_new(object, "eye", real_list(eye, 3));
        json_object_set_new(object, "axes", axes);
        json_array_append_new(list, object);
    }
    return list;
}

// `"key": value` with the escapes that JSON in a script element needs. False when out of memory.
static bool write_value(FILE *stream, const char *key, json_t *value)
{
    char *text = value ? json_dumps(value, JSON_COMPACT | JSON_ENCODE_ANY | JSON_ESCAPE_SLASH |
                                               JSON_ENSURE_ASCII | JSON_REAL_PRECISION(9))
                       : NULL;
    if (text)
        fprintf(stream, "\"%s\":", key);
    for (const char *c = text; c && *c; ++c) // "<!--<script" would extend the script element
        fputs(*c == '<' ? "\\u003c" : (const char[]){*c, 0}, stream);
    if (text)
        fputs(",\n", stream);
    free(text);
    json_decref(value);
    return text != NULL;
}

static bool write_page(FILE *stream, const char *name, const sgs_model_write_options *options,
                       const sgsi_archive_file *files, size_t file_count)
{
    const char *middle = strstr(sgsi_web_page, placeholder);
    const sgsi_archive_file *meta = &files[file_count - 1];
    fwrite(sgsi_web_page, 1, (size_t)(middle - sgsi_web_page), stream);
    fputs("{", stream);
    json_t *title = json_string(name); // NULL if it is not UTF-8
    const bool done =
        write_value(stream, "name", title ? title : json_string("model")) &&
        write_value(stream, "meta", json_loadb((const char *)meta->bytes, meta->size, 0, NULL)) &&
        write_value(stream, "cameras", camera_list(options)) &&
        write_value(stream, "up", real_list(options->up, 3));
    fprintf(stream, "\"linear\":%s,\n",
            options->colors.space == SGS_SPACE_LINEAR ? "true" : "false");
    fputs("\"files\":{", stream);
    for (size_t k = 0; k + 1 < file_count; ++k) {
        fprintf(stream, "%s\"%s\":\"", k ? ",\n" : "", files[k].name);
        write_base64(stream, files[k].bytes, files[k].size);
        fputc('"', stream);
    }
    fputs("}}", stream);
    fputs(middle + strlen(placeholder), stream);
    return done;
}

sgs_status sgsi_web_page_write(const char *path, const sgs_gaussians *model,
                               const sgs_model_write_options *options, sgs_model_written *written)
{
    sgsi_archive_file files[SGSI_SOG_FILES] = {0};
    sgs_output_file file;
    size_t file_count = 0;
    if (!model->count)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s: a page needs at least one primitive",
                         path);
    sgs_status status = sgsi_sog_encode_model(model, options, files, &file_count);
    if (!status)
        status = sgs_output_file_open(&file, path);
    if (!status) {
        const char *slash = strrchr(path, '/');
        if (!write_page(file.stream, slash ? slash + 1 : path, options, files, file_count)) {
            sgs_output_file_abort(&file);
            status =
                sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for the page", path);
        } else {
            written->bytes = (uint64_t)ftell(file.stream);
            status = sgs_output_file_commit(&file);
        }
    }
    written->order = SGS_ROWS_MORTON;
    sgsi_sog_files_free(files);
    return status;
}
