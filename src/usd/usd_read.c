// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Reads the prims of type ParticleField3DGaussianSplat from OpenUSD text, as one model: their five
// attributes (or the half-precision variants, which the text also writes as numbers), the static
// transforms on and above them, colorSpace:name (of the prim or the nearest one above it, as in
// UsdColorSpaceAPI), our white point, upAxis, and nothing else. No time samples.

#include "usd/usd_model.h"

#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "storage/color_marks.h"
#include "usd/usd_layer.h"
#include "usd/usd_splats.h"

enum { FIRST_CAPACITY = 16 };

typedef struct usd_model {
    bool colors_only; // skips the arrays, without warnings
    sgsi_usd_splats *prims;
    size_t prim_count, prim_capacity;
    sgs_model_colors colors; // of the first prim
} usd_model;

static void skip_numbers(sgsi_usd_text *text)
{
    const char *end = memchr(text->at, ']', (size_t)(text->end - text->at));
    text->at = end ? end + 1 : text->end;
}

// Numbers in brackets; parentheses only group them.
static sgs_status read_numbers(sgsi_usd_layer *layer, sgsi_usd_splats *prim, int kind)
{
    sgsi_usd_text *text = &layer->text;
    size_t *count = &prim->counts[kind], *capacity = &prim->capacities[kind];
    float **values = &prim->values[kind];
    *count = 0;
    for (;;) {
        sgsi_usd_skip_space(text);
        if (text->at >= text->end)
            return sgsi_usd_fail_line(layer, "the file ends inside an array");
        const char letter = *text->at;
        if (letter == ']') {
            ++text->at;
            return SGS_STATUS_OK;
        }
        if (letter == '(' || letter == ')' || letter == ',') {
            ++text->at;
            continue;
        }
        double value;
        if (!sgsi_usd_number(text, &value))
            return sgsi_usd_fail_line(layer, "an array contains something that is not a number");
        if (*count == *capacity) {
            const size_t grown = *capacity ? 2 * *capacity : FIRST_CAPACITY;
            if (!sgsi_grow((void **)values, *count, grown, sizeof **values))
                return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it",
                                 layer->path);
            *capacity = grown;
        }
        (*values)[(*count)++] = (float)value;
    }
}

static sgs_status read_attribute(void *context, sgsi_usd_layer *layer, const char *name)
{
    usd_model *model = context;
    sgsi_usd_splats *prim = &model->prims[layer->scopes[layer->depth].own];
    const char *const at = layer->text.at, *const dot = strchr(name, '.');
    if (!strcmp(name, "radiance:sphericalHarmonicsDegree"))
        prim->sh_degree = (int)strtol(at, NULL, 10);
    else if (!strcmp(name, "sparegs:whitePoint"))
        prim->white_point = sgsi_white_point_parse(at);
    for (int k = 0; k < SGSI_USD_VALUES; ++k) {
        const sgsi_usd_attribute *attribute = &sgsi_usd_attributes[k];
        const size_t length = dot ? (size_t)(dot - name) : strlen(name);
        const bool is_half =
            strlen(attribute->half) == length && !strncmp(name, attribute->half, length);
        if (!is_half &&
            (strlen(attribute->name) != length || strncmp(name, attribute->name, length)))
            continue;
        if (dot) {
            prim->animated[k] |= !strcmp(dot, ".timeSamples") || !strcmp(dot, ".spline");
            return SGS_STATUS_OK;
        }
        if (is_half && prim->counts[k]) // floats win
            return SGS_STATUS_OK;
        if (k != SGSI_USD_POSITIONS && !strncmp(at, "None", 4))
            return SGS_STATUS_OK;
        if (*at != '[')
            return sgsi_usd_fail_line(layer, "an attribute of the splats is not an array");
        ++layer->text.at;
        if (!model->colors_only)
            return read_numbers(layer, prim, k);
        skip_numbers(&layer->text);
        return SGS_STATUS_OK;
    }
    return SGS_STATUS_OK;
}

static sgs_status add_prim(void *context, sgsi_usd_layer *layer)
{
    usd_model *model = context;
    if (model->prim_count == model->prim_capacity) {
        const size_t grown = model->prim_capacity ? 2 * model->prim_capacity : 1;
        if (!sgsi_grow((void **)&model->prims, model->prim_count, grown, sizeof *model->prims))
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it",
                             layer->path);
        model->prim_capacity = grown;
    }
    sgsi_usd_splats *prim = &model->prims[model->prim_count++];
    *prim = (sgsi_usd_splats){.line = layer->text.line, .sh_degree = -1};
    sgsi_usd_identity(prim->world);
    return SGS_STATUS_OK;
}

// Transform and colour space of the innermost open prim apply to the splats in it. A prim may
// declare both after its children.
static sgs_status inherit(void *context, sgsi_usd_layer *layer)
{
    usd_model *model = context;
    const sgsi_usd_scope *scope = &layer->scopes[layer->depth];
    double matrix[4][4];
    const sgsi_usd_fault fault = sgsi_usd_transform_matrix(&scope->transform, matrix);
    for (size_t i = scope->first; i < model->prim_count; ++i) {
        sgsi_usd_splats *prim = &model->prims[i];
        if (!prim->placed && fault)
            prim->fault = fault;
        else if (!prim->placed)
            sgsi_usd_multiply(prim->world, (const double(*)[4])matrix);
        prim->placed |= scope->transform.resets;
        if (!*prim->color_space)
            memcpy(prim->color_space, scope->color_space, sizeof prim->color_space);
    }
    return SGS_STATUS_OK;
}

// The colours of the model are those of its first prim.
static void read_colors(usd_model *model, const char *path)
{
    bool mixed = false;
    for (size_t i = 0; i < model->prim_count; ++i) {
        const sgsi_usd_splats *prim = &model->prims[i];
        sgs_model_colors own = {.white_point = prim->white_point};
        if (*prim->color_space)
            sgsi_color_space_parse(i || model->colors_only ? NULL : path, prim->color_space, &own);
        model->colors = i ? model->colors : own;
        mixed |= own.space != model->colors.space;
    }
    if (mixed && !model->colors_only)
        sgsi_warn("%s: its prims have several colour spaces; that of the first is used", path);
}

// Reads the whole text. Close both also after a failure.
static sgs_status open_model(const char *path, usd_model *model, sgsi_usd_layer **layer)
{
    static const sgsi_usd_visitor visitor = {.type = "ParticleField3DGaussianSplat",
                                             .plural = "the splats are",
                                             .begin = add_prim,
                                             .value = read_attribute,
                                             .end = inherit};
    const sgs_status status = sgsi_usd_layer_read(path, &visitor, model, layer);
    if (!status)
        read_colors(model, path);
    return status;
}

static void close_model(usd_model *model, sgsi_usd_layer *layer)
{
    for (size_t i = 0; i < model->prim_count; ++i)
        for (int k = 0; k < SGSI_USD_VALUES; ++k)
            sgsi_free(model->prims[i].values[k]);
    sgsi_free(model->prims);
    sgsi_usd_layer_close(layer);
}

sgs_status sgsi_usd_read_colors(const char *path, sgs_model_colors *colors)
{
    usd_model model = {.colors_only = true};
    sgsi_usd_layer *layer;
    const sgs_status status = open_model(path, &model, &layer);
    if (!status)
        *colors = model.colors;
    close_model(&model, layer);
    return status;
}

static sgs_status decode(const usd_model *model, bool z_up, sgsi_rows *rows)
{
    sgs_status status = SGS_STATUS_OK;
    for (size_t i = 0; !status && i < model->prim_count; ++i)
        status = sgsi_usd_splats_decode(&model->prims[i], z_up, rows);
    return status;
}

sgs_status sgsi_usd_read(const char *path, const sgs_model_read_options *options,
                         sgs_gaussians **model, sgs_model_info *info)
{
    size_t total = 0;
    int sh_degree = 0;
    sgsi_rows rows = {0};
    usd_model read = {0};
    sgsi_usd_layer *layer;
    sgs_status status = open_model(path, &read, &layer);
    if (!status)
        status = sgsi_usd_splats_check(path, read.prims, read.prim_count, &total, &sh_degree);
    if (!status && !total)
        status = sgsi_fail(SGS_STATUS_FORMAT,
                           "%s: contains no ParticleField3DGaussianSplat with positions%s", path,
                           layer->is_package || layer->has_references
                               ? "; add those of other files with 'usdcat -f'"
                               : "");
    if (!status)
        status = sgsi_rows_begin(&rows, path, total, sh_degree, options->drop_zero_quaternions);
    if (!status) {
        status = decode(&read, layer->z_up, &rows);
        info->dropped = rows.dropped;
        info->colors = read.colors;
        if (status)
            sgsi_rows_abort(&rows);
        else
            status = sgsi_rows_end(&rows, model);
    }
    close_model(&read, layer);
    return status;
}
