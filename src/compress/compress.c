// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Entry points of the compression: checks of the options, the table of methods, and what every
// decoded model has to satisfy.

#include "sparegs/compress.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "compress/compress_method.h"
#include "model/finite_model.h"
#include "model/opacity.h"
#include "model/sh_degree.h"
#include "model/similarity.h"
#include "storage/color_marks.h"
#include "storage/model_rows.h"

// In the order of sgs_compress_method.
static const sgsi_compress_method *const methods[] = {
    [SGS_COMPRESS_LIGHTGAUSSIAN] = &sgsi_method_lightgaussian,
    [SGS_COMPRESS_SOG] = &sgsi_method_sog,
    [SGS_COMPRESS_MESONGS] = &sgsi_method_mesongs,
    [SGS_COMPRESS_GHAP] = &sgsi_method_ghap,
    [SGS_COMPRESS_FCGS_LIKE] = &sgsi_method_fcgs_like,
};
static const char *const names[] = {"lightgaussian", "sog", "mesongs", "ghap", "fcgs", "fcgs-like"};
enum { METHOD_COUNT = sizeof methods / sizeof *methods, NAME_COUNT = sizeof names / sizeof *names };

void sgs_compress_options_init(sgs_compress_options *options, size_t size)
{
    const sgs_compress_options defaults = {.method = SGS_COMPRESS_SOG, .preset = 1, .finetune = -1};
    sgsi_options_init(options, size, &defaults, sizeof defaults);
}

const char *sgs_compress_method_name(sgs_compress_method method)
{
    return (unsigned)method < NAME_COUNT ? names[method] : NULL;
}

const char *sgs_compress_preset_option(sgs_compress_method method)
{
    static const char *const options[NAME_COUNT] = {[SGS_COMPRESS_LIGHTGAUSSIAN] = "vq-ratio",
                                                    [SGS_COMPRESS_MESONGS] = "keep",
                                                    [SGS_COMPRESS_GHAP] = "keep",
                                                    [SGS_COMPRESS_FCGS_LIKE] = "step-scale"};
    return (unsigned)method < NAME_COUNT ? options[method] : NULL;
}

// ---- Marks ----

// Section "marks": 1 byte each for antialiased, colours named, and their space; 5 bytes of 0; the
// white point as a double. Absent if all are 0.
static const char MARKS[] = "marks";
enum { MARKS_BYTES = 16 };

static void write_marks(sgsi_packer *packer, const sgs_compress_options *options)
{
    const sgs_model_colors *colors = &options->colors;
    const bool linear = colors->space_known && colors->space == SGS_SPACE_LINEAR;
    if (!options->antialiased && !linear && !(colors->white_point > 0.0))
        return;
    uint8_t bytes[MARKS_BYTES] = {options->antialiased, colors->space_known,
                                  (uint8_t)colors->space};
    uint64_t white;
    memcpy(&white, &colors->white_point, sizeof white);
    sgsi_store_u64(bytes + 8, white);
    sgsi_packer_add(packer, MARKS, bytes, sizeof bytes, false);
}

static sgs_status read_marks(sgsi_container *container, bool *antialiased, sgs_model_colors *colors)
{
    *antialiased = false;
    *colors = (sgs_model_colors){0};
    if (!sgsi_container_has(container, MARKS))
        return SGS_STATUS_OK;
    const uint8_t *bytes;
    const sgs_status status = sgsi_container_take(container, MARKS, MARKS_BYTES, &bytes, NULL);
    if (status)
        return status;
    const uint64_t bits = sgsi_load_u64(bytes + 8);
    double white;
    memcpy(&white, &bits, sizeof white);
    *antialiased = bytes[0];
    *colors = (sgs_model_colors){
        .space_known = bytes[1], .space = (sgs_space)bytes[2], .white_point = white};
    if (bytes[0] > 1 || bytes[1] > 1 || sgsi_colors_wrong(colors))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: section '%s' has an unknown value",
                         container->path, MARKS);
    return SGS_STATUS_OK;
}

// ---- Compression ----

static sgs_status check_marks(const sgs_model_colors *colors)
{
    const char *wrong = sgsi_colors_wrong(colors);
    return wrong ? sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "option %s", wrong) : SGS_STATUS_OK;
}

static sgs_status check_ranges(const sgs_compress_options *o)
{
    const struct {
        const char *name;
        double value, low, high;
    } ranges[] = {{"preset", o->preset, 1, 3},
                  {"finetune", o->finetune, -1, 1e6},
                  {"keep", o->keep, 0, 1},
                  {"eig_min", o->eig_min, 0, 1e6},
                  {"position_bits", o->position_bits, 0, SGSI_SOG_MAX_BITS},
                  {"dc_bits", o->dc_bits, 0, SGSI_SOG_MAX_BITS},
                  {"sh_bits", o->sh_bits, 0, SGSI_SOG_MAX_BITS},
                  {"scale_bits", o->scale_bits, 0, SGSI_SOG_MAX_BITS},
                  {"rotation_bits", o->rotation_bits, 0, SGSI_SOG_MAX_BITS},
                  {"opacity_bits", o->opacity_bits, 0, SGSI_SOG_MAX_BITS},
                  {"codec", (double)o->codec, SGS_IMAGE_CODEC_JXL, SGS_IMAGE_CODEC_EXR},
                  {"vq_ratio", o->vq_ratio, 0, 1},
                  {"distill", o->distill, 0, 1e6},
                  {"codebook", o->codebook, 0, 65536},
                  {"vq_steps", o->vq_steps, 0, 1e6},
                  {"depth", o->depth, 0, 21},
                  {"blocks", o->blocks, 0, 65536},
                  {"step_scale", o->step_scale, 0, 1000}};
    for (size_t k = 0; k < sizeof ranges / sizeof *ranges; ++k)
        if (!(ranges[k].value >= ranges[k].low && ranges[k].value <= ranges[k].high))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "option %s = %g is not in [%g, %g]",
                             ranges[k].name, ranges[k].value, ranges[k].low, ranges[k].high);
    return SGS_STATUS_OK;
}

static sgs_status find_method(sgs_compress_method method, const sgsi_compress_method **found)
{
    *found = (unsigned)method < METHOD_COUNT ? methods[method] : NULL;
    if (*found)
        return SGS_STATUS_OK;
    if (method == SGS_COMPRESS_FCGS)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "FCGS requires its trained network, which sparegs does not run; use "
                         "fcgs-like, a codec of the same structure with fitted probabilities");
    return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "unknown compression method %d", (int)method);
}

// The parameters of all primitives, opacities as finite logits.
static sgs_status copy_rows(const sgs_gaussians *model, float **rows)
{
    const size_t count = model->count;
    const sgs_status status = sgsi_finite_model_check(model, NULL);
    if (status)
        return status;
    *rows = sgsi_alloc(count, SGS_PARAM_COUNT * sizeof **rows);
    if (!*rows)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "not enough memory for %zu primitives", count);
    for (size_t i = 0; i < count; ++i) {
        float *row = *rows + i * SGS_PARAM_COUNT;
        sgs_gaussians_get(model, i, row);
        row[SGS_PARAM_OPACITY] = sgsi_finite_logit(sgs_gaussians_opacity_logit(model, i));
        for (int k = SGS_PARAM_SCALE; k < SGS_PARAM_SCALE + 3; ++k)
            if (row[k] > SGSI_MAX_LOG_SCALE) // as readers of models, which omit it
                return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                                 "primitive %zu has a log scale of %g, above the limit of %g; "
                                 "remove it",
                                 i, (double)row[k], (double)SGSI_MAX_LOG_SCALE);
    }
    return SGS_STATUS_OK;
}

static sgs_status encode(const sgsi_compress_method *method, const sgs_gaussians *model,
                         const sgs_compress_options *options, sgsi_packer *packer)
{
    sgsi_compress_job job = {.options = options,
                             .render = sgs_render_options_default(),
                             .count = model->count,
                             .sh_degree = model->sh_degree,
                             .out = packer};
    if (options->scene)
        job.render.near_distance = sgs_near_distance(options->scene->extent);
    sgs_status status =
        sgsi_options_read(options->render, "sgs_render_options", &job.render, sizeof job.render);
    if (!status)
        status = copy_rows(model, &job.rows);
    snprintf(packer->header.method, sizeof packer->header.method, "%s", method->name);
    packer->header.version = method->version;
    packer->header.input = packer->header.count = model->count;
    packer->header.sh_degree = (uint32_t)model->sh_degree;
    if (!status)
        status = method->encode(&job);
    if (!status)
        write_marks(packer, options);
    sgsi_free(job.rows);
    return status;
}

sgs_status sgs_compress(const sgs_gaussians *model, const sgs_compress_options *options,
                        const char *path, sgs_compress_info *info)
{
    sgs_compress_options own = sgs_compress_options_default();
    const sgsi_compress_method *method = NULL;
    sgs_status status = sgsi_options_read(options, "sgs_compress_options", &own, sizeof own);
    if (!status)
        status = check_ranges(&own);
    if (!status)
        status = check_marks(&own.colors);
    if (!status)
        status = find_method(own.method, &method);
    if (!status && !model->count)
        status = sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "the model has no primitives");
    if (!status)
        status = sgsi_sh_degree_check(model, path);
    if (status)
        return status;
    if (method->defaults)
        method->defaults(&own);
    sgsi_packer packer = {0};
    size_t bytes = 0;
    status = encode(method, model, &own, &packer);
    if (!status)
        status = sgsi_packer_write(&packer, path, &bytes);
    sgsi_packer_free(&packer);
    if (!status && info)
        *info = (sgs_compress_info){.method = own.method,
                                    .input = model->count,
                                    .gaussians = packer.header.count,
                                    .bytes = bytes,
                                    .sh_degree = (int)packer.header.sh_degree,
                                    .antialiased = own.antialiased,
                                    .colors = own.colors};
    return status;
}

// ---- Decompression ----

// Finite values; the identity in place of a zero quaternion.
static sgs_status check_decoded(const char *path, sgs_gaussians *model)
{
    for (size_t i = 0; i < model->count; ++i) {
        float row[SGS_PARAM_COUNT];
        sgs_gaussians_get(model, i, row);
        for (int k = 0; k < SGS_PARAM_COUNT; ++k)
            if (!isfinite(row[k]))
                return sgsi_fail(SGS_STATUS_FORMAT,
                                 "%s: primitive %zu decodes to a value that is not finite", path,
                                 i);
        const float *q = row + SGS_PARAM_ROTATION;
        if (q[0] == 0 && q[1] == 0 && q[2] == 0 && q[3] == 0)
            *sgs_gaussians_at(model, i, SGS_PARAM_ROTATION) = 1;
    }
    return SGS_STATUS_OK;
}

// Fills *info, and *method with the one that decodes the file.
static sgs_status describe(sgsi_container *container, const sgsi_compress_method **method,
                           sgs_compress_info *info)
{
    const sgsi_container_header *header = &container->header;
    size_t m = 0;
    while (m < METHOD_COUNT && !(methods[m] && !strcmp(methods[m]->name, header->method)))
        ++m;
    if (m == METHOD_COUNT)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED, "%s: byte 8: unknown compression method",
                         container->path);
    const uint32_t last = methods[m]->version;
    const uint32_t first = methods[m]->oldest ? methods[m]->oldest : last;
    if (header->version < first || header->version > last) {
        char versions[32];
        snprintf(versions, sizeof versions, first < last ? "versions %u to %u" : "version %u",
                 first, last);
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: version %u of method '%s' is unknown; this program reads %s",
                         container->path, header->version, header->method, versions);
    }
    *method = methods[m];
    *info = (sgs_compress_info){.method = (sgs_compress_method)m,
                                .input = header->input,
                                .gaussians = header->count,
                                .bytes = container->size,
                                .sh_degree = (int)header->sh_degree};
    return read_marks(container, &info->antialiased, &info->colors);
}

static sgs_status decode(sgsi_container *container, sgs_gaussians **model, sgs_compress_info *info)
{
    const sgsi_compress_method *method;
    sgs_compress_info found;
    sgs_status status = describe(container, &method, &found);
    if (!status)
        status = method->decode(container, model);
    if (!status)
        status = check_decoded(container->path, *model);
    if (!status && info)
        *info = found;
    return status;
}

bool sgs_is_compressed(const char *path)
{
    sgsi_errors_suspend();
    const bool is = sgsi_container_is(path);
    sgsi_errors_resume();
    return is;
}

sgs_status sgs_compress_info_read(const char *path, sgs_compress_info *info)
{
    sgsi_container container;
    sgs_status status = sgsi_container_open(path, &container);
    if (status)
        return status;
    const sgsi_compress_method *method;
    sgs_compress_info found;
    status = describe(&container, &method, &found);
    sgsi_container_close(&container);
    if (!status)
        *info = found;
    return status;
}

sgs_status sgs_decompress(const char *path, sgs_gaussians **model, sgs_compress_info *info)
{
    *model = NULL;
    sgsi_container container;
    sgs_status status = sgsi_container_open(path, &container);
    if (status)
        return status;
    status = decode(&container, model, info);
    sgsi_container_close(&container);
    if (status) {
        sgs_gaussians_destroy(*model);
        *model = NULL;
    }
    return status;
}
