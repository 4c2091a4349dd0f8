// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "usd/usd_layer.h"

#include <math.h>
#include <string.h>

#include "base/core.h"
#include "storage/archive.h"

sgs_status sgsi_usd_fail_line(const sgsi_usd_layer *layer, const char *what)
{
    return sgsi_fail(SGS_STATUS_FORMAT, "%s: line %d: %s", layer->path, layer->text.line, what);
}

static sgs_status fail_memory(const char *path)
{
    return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
}

// ---- Prims ----

static void announce(sgsi_usd_layer *layer, bool hidden, bool variants)
{
    memset(&layer->next, 0, sizeof layer->next);
    layer->next.is_hidden = hidden;
    layer->next.is_variants = variants;
    layer->has_prims = true;
}

// The first string after the words of a prim.
static void name_prim(sgsi_usd_layer *layer)
{
    if (layer->next.name)
        return;
    layer->next.name = layer->text.string;
    layer->next.name_length = layer->text.string_length;
}

static sgs_status open_brace(sgsi_usd_layer *layer, const sgsi_usd_visitor *visitor, void *context)
{
    if (layer->depth == SGSI_USD_DEPTH)
        return sgsi_usd_fail_line(layer, "braces are nested deeper than 64");
    const sgsi_usd_scope *above = &layer->scopes[layer->depth];
    sgsi_usd_scope *scope = &layer->scopes[++layer->depth];
    const bool of_type = layer->next.of_type;
    scope->name = layer->next.name;
    scope->name_length = layer->next.name_length;
    scope->is_hidden = above->is_hidden || layer->next.is_hidden;
    scope->is_variants = above->is_variants || layer->next.is_variants;
    scope->is_referer = above->is_referer || layer->next.is_referer;
    scope->first = layer->prim_count;
    scope->own = SGSI_USD_NONE;
    scope->color_space[0] = 0;
    sgsi_usd_transform_begin(&scope->transform, visitor->animates);
    memset(&layer->next, 0, sizeof layer->next);
    if (!of_type || scope->is_hidden)
        return SGS_STATUS_OK;
    if (scope->is_variants)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: line %d: %s in a variant; select one with 'usdcat -f %s -o X.usda'",
                         layer->path, layer->text.line, visitor->plural, layer->path);
    scope->own = layer->prim_count++;
    return visitor->begin(context, layer);
}

static sgs_status close_brace(sgsi_usd_layer *layer, const sgsi_usd_visitor *visitor, void *context)
{
    sgs_status status = SGS_STATUS_OK;
    if (!layer->depth)
        return sgsi_usd_fail_line(layer, "'}' without '{'");
    if (layer->scopes[layer->depth].first < layer->prim_count)
        status = visitor->end(context, layer);
    sgsi_usd_transform_free(&layer->scopes[layer->depth--].transform);
    return status;
}

// ---- Values ----

// A token in double quotes, of the innermost open prim.
static void read_color_space(sgsi_usd_layer *layer)
{
    char word[SGSI_USD_NAME + 1], *name = layer->scopes[layer->depth].color_space;
    sgsi_usd_text text = layer->text;
    if (*text.at != '"' || !sgsi_usd_token(&text, word))
        return;
    text.end = text.string + text.string_length;
    text.at = text.string;
    if (text.at == text.end || !sgsi_usd_token(&text, name))
        *name = 0;
}

// Metadata of the layer, in its parentheses.
static void read_layer_value(sgsi_usd_layer *layer, const char *name)
{
    const struct {
        const char *name;
        double *value;
    } numbers[] = {{"startTimeCode", &layer->times.start},
                   {"endTimeCode", &layer->times.end},
                   {"timeCodesPerSecond", &layer->times.codes_per_second},
                   {"framesPerSecond", &layer->times.frames_per_second}};
    sgsi_usd_text text = layer->text;
    double number;
    if (!strcmp(name, "upAxis"))
        layer->z_up = *text.at && text.at + 1 < text.end && text.at[1] == 'Z';
    for (size_t k = 0; k < sizeof numbers / sizeof *numbers; ++k)
        if (!strcmp(name, numbers[k].name) && sgsi_usd_number(&text, &number))
            *numbers[k].value = number;
}

static bool is_one_of(const char *name, const char *const *names)
{
    while (*names && strcmp(name, *names))
        ++names;
    return *names != NULL;
}

// After "NAME =". nested: depth of braces in the parentheses.
static sgs_status read_value(sgsi_usd_layer *layer, const sgsi_usd_visitor *visitor, void *context,
                             const char *name, int parentheses, int nested)
{
    static const char *const references[] = {"references",  "payload", "inherits",
                                             "specializes", "clips",   NULL};
    sgsi_usd_scope *scope = &layer->scopes[layer->depth];
    bool done = true;
    sgsi_usd_skip_space(&layer->text);
    if (!strcmp(name, "subLayers"))
        layer->has_references = layer->has_sublayers = true;
    else if (is_one_of(name, references))
        layer->has_references = layer->next.is_referer = true;
    else if (!strcmp(name, "active") && parentheses == 1 && !nested)
        layer->next.is_hidden |= *layer->text.at == 'f' || *layer->text.at == '0';
    else if (!layer->has_prims && !nested)
        read_layer_value(layer, name);
    else if (parentheses || !layer->depth)
        return SGS_STATUS_OK;
    else if (!strcmp(name, "xformOpOrder"))
        done = sgsi_usd_transform_order(&scope->transform, layer->text);
    else if (!strncmp(name, "xformOp:", 8))
        done = sgsi_usd_transform_set(&scope->transform, name, layer->text);
    else if (!strcmp(name, "colorSpace:name"))
        read_color_space(layer);
    else if (scope->own != SGSI_USD_NONE)
        return visitor->value(context, layer, name);
    return done ? SGS_STATUS_OK : fail_memory(layer->path);
}

static sgs_status read_layer(sgsi_usd_layer *layer, const sgsi_usd_visitor *visitor, void *context)
{
    char word[SGSI_USD_NAME + 1], previous[SGSI_USD_NAME + 1] = "";
    int parentheses = 0, nested = 0;
    sgs_status status = SGS_STATUS_OK;
    while (!status && sgsi_usd_token(&layer->text, word)) {
        if (!strcmp(word, "("))
            ++parentheses;
        else if (!strcmp(word, ")"))
            --parentheses;
        else if (parentheses > 0 && (!strcmp(word, "{") || !strcmp(word, "}")))
            nested += *word == '{' ? 1 : -1;
        else if (!strcmp(word, visitor->type) && !strcmp(previous, "def"))
            layer->next.of_type = true;
        else if (parentheses <= 0 && (!strcmp(word, "def") || !strcmp(word, "over")))
            announce(layer, false, false);
        else if (parentheses <= 0 && !strcmp(word, "class"))
            announce(layer, true, false);
        else if (parentheses <= 0 && !strcmp(word, "variantSet"))
            announce(layer, false, true);
        else if (parentheses <= 0 && (*word == '"' || *word == '\''))
            name_prim(layer);
        else if (!strcmp(word, "{"))
            status = open_brace(layer, visitor, context);
        else if (!strcmp(word, "}"))
            status = close_brace(layer, visitor, context);
        else if (!strcmp(word, "="))
            status = read_value(layer, visitor, context, previous, parentheses, nested);
        memcpy(previous, word, sizeof previous);
    }
    return !status && layer->depth ? sgsi_usd_fail_line(layer, "the file ends inside a prim")
                                   : status;
}

// ---- Files ----

static bool is_zip(const char *path)
{
    char mark[4];
    FILE *stream;
    size_t size;
    if (sgsi_file_open(path, &stream, &size))
        return false;
    const bool is = fread(mark, 1, 4, stream) == 4 && !memcmp(mark, "PK\3\4", 4);
    fclose(stream);
    return is;
}

// The first file of a package (.usdz) is its root layer.
static sgs_status read_package(const char *path, uint8_t **bytes, size_t *size)
{
    sgsi_archive archive;
    const sgsi_archive_entry *first = NULL;
    sgs_status status = sgsi_archive_open(&archive, path);
    for (size_t k = 0; !status && k < archive.entry_count; ++k)
        if (!first || archive.entries[k].offset < first->offset)
            first = &archive.entries[k];
    if (!status)
        status = first ? sgsi_archive_read(&archive, first->name, SIZE_MAX, bytes, size)
                       : sgsi_fail(SGS_STATUS_FORMAT, "%s: is an empty ZIP file", path);
    sgsi_archive_close(&archive);
    return status;
}

static sgs_status check_text(const char *path, bool package, const uint8_t *bytes, size_t size)
{
    if (size >= 8 && !memcmp(bytes, "PXR-USDC", 8))
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: %s binary OpenUSD, which is not read; convert it to text with "
                         "'usdcat%s %s -o X.usda'",
                         path, package ? "contains" : "is", package ? " -f" : "", path);
    if (size < 5 || memcmp(bytes, "#usda", 5))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s OpenUSD text: it does not begin with #usda",
                         path, package ? "its first file is not" : "is not");
    return SGS_STATUS_OK;
}

sgs_status sgsi_usd_layer_read(const char *path, const sgsi_usd_visitor *visitor, void *context,
                               sgsi_usd_layer **layer)
{
    uint8_t *bytes = NULL;
    size_t size;
    *layer = NULL;
    const bool package = is_zip(path);
    sgs_status status =
        package ? read_package(path, &bytes, &size) : sgsi_file_read(path, 0, &bytes, &size);
    if (status)
        return status;
    sgsi_usd_layer *made = *layer = sgsi_calloc(1, sizeof *made);
    if (!made) {
        sgsi_free(bytes);
        return fail_memory(path);
    }
    const char *text = (const char *)bytes;
    made->path = path;
    made->bytes = bytes;
    made->is_package = package;
    made->times = (sgsi_usd_times){NAN, NAN, NAN, NAN};
    made->text = (sgsi_usd_text){.at = text,
                                 .end = text + size,
                                 .line = 1,
                                 .c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0)};
    status = made->text.c_locale ? check_text(path, package, bytes, size) : fail_memory(path);
    return status ? status : read_layer(made, visitor, context);
}

void sgsi_usd_layer_close(sgsi_usd_layer *layer)
{
    if (!layer)
        return;
    for (int k = 0; k <= layer->depth; ++k)
        sgsi_usd_transform_free(&layer->scopes[k].transform);
    if (layer->text.c_locale)
        freelocale(layer->text.c_locale);
    sgsi_free(layer->bytes);
    sgsi_free(layer);
}
