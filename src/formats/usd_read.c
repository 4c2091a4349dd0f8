// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Reads the prims of type ParticleField3DGaussianSplat from OpenUSD text, as one model: their five
// attributes (or the half-precision variants, which the text also writes as numbers), the static
// transforms on and above them, colorSpace:name (of the prim or the nearest one above it, as in
// UsdColorSpaceAPI), our white point, upAxis, and nothing else. No composition, no time samples.
// Prims below a class and inactive ones are not part of the scene.

#include "formats/model_format.h"

#include <locale.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "formats/archive.h"
#include "formats/color_marks.h"
#include "formats/usd_splats.h"

enum { MAX_WORD = SGSI_USD_NAME, MAX_DEPTH = 64, FIRST_CAPACITY = 16 };
static const size_t NO_SPLATS = SIZE_MAX;

// What the words before a brace say about its prim.
typedef struct usd_announced {
    bool is_splats, is_hidden, is_variants;
} usd_announced;

typedef struct usd_reader {
    const char *path;
    uint8_t *bytes;       // the text
    const char *at, *end; // of the text, which ends with NUL
    int line, depth;      // depth of braces
    usd_announced next;
    struct {
        sgsi_usd_transform transform;
        size_t first;                   // prim with splats since its brace
        size_t splats;                  // index if it has splats, else NO_SPLATS
        bool is_hidden, is_variants;    // or one above is
        char color_space[MAX_WORD + 1]; // "" if it has none
    } open[MAX_DEPTH + 1];              // by depth: the open prims
    bool z_up;
    bool colors_only; // skips the arrays, without warnings
    bool composed;    // names other layers, or its package may contain some
    sgsi_usd_splats *prims;
    size_t prim_count, prim_capacity;
    sgs_model_colors colors; // of the first prim
    locale_t c_locale;
} usd_reader;

static sgs_status fail_line(const usd_reader *reader, const char *what)
{
    return sgsi_fail(SGS_STATUS_FORMAT, "%s: line %d: %s", reader->path, reader->line, what);
}

static void skip_string(usd_reader *reader, char quote)
{
    const bool triple = reader->at[0] == quote && reader->at[1] == quote;
    reader->at += triple ? 2 : 0;
    while (reader->at < reader->end) {
        if (*reader->at == '\n')
            ++reader->line;
        if (*reader->at == '\\' && reader->at + 1 < reader->end) {
            reader->at += 2;
            continue;
        }
        if (*reader->at == quote &&
            (!triple || (reader->at[1] == quote && reader->at[2] == quote))) {
            reader->at += triple ? 3 : 1;
            return;
        }
        ++reader->at;
    }
}

// Continues after the next `mark`, or at the end of the text.
static void skip_past(usd_reader *reader, const char *mark)
{
    const size_t length = strlen(mark);
    for (; reader->at < reader->end && strncmp(reader->at, mark, length); ++reader->at)
        reader->line += *reader->at == '\n';
    reader->at += reader->at < reader->end ? length : 0;
}

// After its first '@'.
static void skip_asset(usd_reader *reader)
{
    const bool triple = reader->at[0] == '@' && reader->at[1] == '@';
    reader->at += triple ? 2 : 0;
    skip_past(reader, triple ? "@@@" : "@");
}

static void skip_space(usd_reader *reader)
{
    while (reader->at < reader->end) {
        if (*reader->at == '#' || (*reader->at == '/' && reader->at[1] == '/')) {
            while (reader->at < reader->end && *reader->at != '\n')
                ++reader->at;
        } else if (*reader->at == '/' && reader->at[1] == '*') {
            reader->at += 2;
            skip_past(reader, "*/");
        } else if (*reader->at == '\n') {
            ++reader->line;
            ++reader->at;
        } else if (*reader->at == ' ' || *reader->at == '\t' || *reader->at == '\r') {
            ++reader->at;
        } else {
            return;
        }
    }
}

static bool is_word(char letter)
{
    return (letter >= 'a' && letter <= 'z') || (letter >= 'A' && letter <= 'Z') ||
           (letter >= '0' && letter <= '9') || letter == '_' || letter == ':' || letter == '.';
}

// The next word, or a single other character. False at the end of the text.
static bool next_token(usd_reader *reader, char word[MAX_WORD + 1])
{
    size_t length = 0;
    skip_space(reader);
    if (reader->at >= reader->end)
        return false;
    if (!is_word(*reader->at)) {
        word[0] = *reader->at++;
        word[1] = 0;
        if (*word == '"' || *word == '\'')
            skip_string(reader, *word);
        else if (*word == '@')
            skip_asset(reader);
        else if (*word == '<')
            skip_past(reader, ">"); // a path
        return true;
    }
    for (; reader->at < reader->end && is_word(*reader->at); ++reader->at)
        if (length < MAX_WORD)
            word[length++] = *reader->at;
    word[length] = 0;
    return true;
}

static void skip_numbers(usd_reader *reader)
{
    const char *end = memchr(reader->at, ']', (size_t)(reader->end - reader->at));
    reader->at = end ? end + 1 : reader->end;
}

// Numbers in brackets; parentheses only group them.
static sgs_status read_numbers(usd_reader *reader, sgsi_usd_splats *prim, int kind)
{
    size_t *count = &prim->counts[kind], *capacity = &prim->capacities[kind];
    float **values = &prim->values[kind];
    *count = 0;
    for (;;) {
        skip_space(reader);
        if (reader->at >= reader->end)
            return fail_line(reader, "the file ends inside an array");
        const char letter = *reader->at;
        if (letter == ']') {
            ++reader->at;
            return SGS_STATUS_OK;
        }
        if (letter == '(' || letter == ')' || letter == ',') {
            ++reader->at;
            continue;
        }
        char *end;
        const double value = strtod_l(reader->at, &end, reader->c_locale);
        if (end == reader->at)
            return fail_line(reader, "an array contains something that is not a number");
        reader->at = end;
        if (*count == *capacity) {
            const size_t grown = *capacity ? 2 * *capacity : FIRST_CAPACITY;
            if (!sgsi_grow((void **)values, *count, grown, sizeof **values))
                return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it",
                                 reader->path);
            *capacity = grown;
        }
        (*values)[(*count)++] = (float)value;
    }
}

// A token in double quotes, of the innermost open prim.
static void read_color_space(usd_reader *reader)
{
    char *name = reader->open[reader->depth].color_space;
    size_t length = 0;
    skip_space(reader);
    if (*reader->at != '"')
        return;
    for (const char *at = reader->at + 1; is_word(*at) && length < MAX_WORD; ++at)
        name[length++] = *at;
    name[length] = 0;
}

// After "NAME =" inside of a prim with splats.
static sgs_status read_attribute(usd_reader *reader, sgsi_usd_splats *prim, const char *name)
{
    const char *const dot = strchr(name, '.');
    if (!strcmp(name, "radiance:sphericalHarmonicsDegree"))
        prim->sh_degree = (int)strtol(reader->at, NULL, 10);
    else if (!strcmp(name, "sparegs:whitePoint"))
        prim->white_point = sgsi_white_point_parse(reader->at);
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
        if (k != SGSI_USD_POSITIONS && !strncmp(reader->at, "None", 4))
            return SGS_STATUS_OK;
        if (*reader->at != '[')
            return fail_line(reader, "an attribute of the splats is not an array");
        ++reader->at;
        if (!reader->colors_only)
            return read_numbers(reader, prim, k);
        skip_numbers(reader);
        return SGS_STATUS_OK;
    }
    return SGS_STATUS_OK;
}

static sgs_status add_prim(usd_reader *reader)
{
    if (reader->prim_count == reader->prim_capacity) {
        const size_t grown = reader->prim_capacity ? 2 * reader->prim_capacity : 1;
        if (!sgsi_grow((void **)&reader->prims, reader->prim_count, grown, sizeof *reader->prims))
            return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it",
                             reader->path);
        reader->prim_capacity = grown;
    }
    sgsi_usd_splats *prim = &reader->prims[reader->prim_count++];
    *prim = (sgsi_usd_splats){.line = reader->line, .sh_degree = -1};
    sgsi_usd_identity(prim->world);
    return SGS_STATUS_OK;
}

static sgs_status open_brace(usd_reader *reader)
{
    const usd_announced next = reader->next;
    reader->next = (usd_announced){0};
    if (reader->depth == MAX_DEPTH)
        return fail_line(reader, "braces are nested deeper than 64");
    const bool hidden = reader->open[reader->depth].is_hidden || next.is_hidden,
               variants = reader->open[reader->depth].is_variants || next.is_variants;
    ++reader->depth;
    sgsi_usd_transform_begin(&reader->open[reader->depth].transform);
    reader->open[reader->depth].first = reader->prim_count;
    reader->open[reader->depth].splats = NO_SPLATS;
    reader->open[reader->depth].is_hidden = hidden;
    reader->open[reader->depth].is_variants = variants;
    reader->open[reader->depth].color_space[0] = 0;
    if (!next.is_splats || hidden)
        return SGS_STATUS_OK;
    if (variants)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: line %d: the splats are in a variant; select one with 'usdcat -f "
                         "%s -o X.usda'",
                         reader->path, reader->line, reader->path);
    reader->open[reader->depth].splats = reader->prim_count;
    return add_prim(reader);
}

// Transform and colour space of the innermost open prim apply to the splats in it. A prim may
// declare both after its children.
static void inherit(usd_reader *reader)
{
    const sgsi_usd_transform *transform = &reader->open[reader->depth].transform;
    double matrix[4][4];
    const sgsi_usd_fault fault = sgsi_usd_transform_matrix(transform, matrix);
    for (size_t i = reader->open[reader->depth].first; i < reader->prim_count; ++i) {
        sgsi_usd_splats *prim = &reader->prims[i];
        if (!prim->placed && fault)
            prim->fault = fault;
        else if (!prim->placed)
            sgsi_usd_multiply(prim->world, (const double(*)[4])matrix);
        prim->placed |= transform->resets;
        if (!*prim->color_space)
            memcpy(prim->color_space, reader->open[reader->depth].color_space,
                   sizeof prim->color_space);
    }
}

static sgs_status close_brace(usd_reader *reader)
{
    if (!reader->depth)
        return fail_line(reader, "'}' without '{'");
    if (reader->open[reader->depth].first < reader->prim_count)
        inherit(reader);
    --reader->depth;
    return SGS_STATUS_OK;
}

// After "NAME =". nested: depth of braces in the parentheses.
static sgs_status read_value(usd_reader *reader, const char *name, int parentheses, int nested)
{
    const size_t splats = reader->open[reader->depth].splats;
    sgsi_usd_transform *transform = &reader->open[reader->depth].transform;
    skip_space(reader);
    if (!strcmp(name, "references") || !strcmp(name, "payload") || !strcmp(name, "subLayers"))
        reader->composed = true;
    else if (!strcmp(name, "active") && parentheses == 1 && !nested)
        reader->next.is_hidden |= *reader->at == 'f' || *reader->at == '0';
    else if (!reader->depth)
        reader->z_up = strcmp(name, "upAxis")
                           ? reader->z_up
                           : *reader->at && reader->at + 1 < reader->end && reader->at[1] == 'Z';
    else if (parentheses)
        return SGS_STATUS_OK;
    else if (!strcmp(name, "xformOpOrder"))
        sgsi_usd_transform_order(transform, reader->at);
    else if (!strncmp(name, "xformOp:", 8))
        sgsi_usd_transform_set(transform, name, reader->at, reader->c_locale);
    else if (!strcmp(name, "colorSpace:name"))
        read_color_space(reader);
    else if (splats != NO_SPLATS)
        return read_attribute(reader, &reader->prims[splats], name);
    return SGS_STATUS_OK;
}

// The colours of the model are those of its first prim.
static void read_colors(usd_reader *reader)
{
    bool mixed = false;
    for (size_t i = 0; i < reader->prim_count; ++i) {
        const sgsi_usd_splats *prim = &reader->prims[i];
        sgs_model_colors own = {.white_point = prim->white_point};
        if (*prim->color_space)
            sgsi_color_space_parse(i || reader->colors_only ? NULL : reader->path,
                                   prim->color_space, &own);
        reader->colors = i ? reader->colors : own;
        mixed |= own.space != reader->colors.space;
    }
    if (mixed && !reader->colors_only)
        sgsi_warn("%s: its prims have several colour spaces; that of the first is used",
                  reader->path);
}

static sgs_status read_layer(usd_reader *reader)
{
    char word[MAX_WORD + 1], previous[MAX_WORD + 1] = "";
    int parentheses = 0, nested = 0;
    sgs_status status = SGS_STATUS_OK;
    while (!status && next_token(reader, word)) {
        if (!strcmp(word, "("))
            ++parentheses;
        else if (!strcmp(word, ")"))
            --parentheses;
        else if (parentheses > 0 && (!strcmp(word, "{") || !strcmp(word, "}")))
            nested += *word == '{' ? 1 : -1;
        else if (!strcmp(word, "ParticleField3DGaussianSplat") && !strcmp(previous, "def"))
            reader->next.is_splats = true;
        else if (parentheses <= 0 && (!strcmp(word, "def") || !strcmp(word, "over")))
            reader->next = (usd_announced){0};
        else if (parentheses <= 0 && !strcmp(word, "class"))
            reader->next = (usd_announced){.is_hidden = true};
        else if (parentheses <= 0 && !strcmp(word, "variantSet"))
            reader->next = (usd_announced){.is_variants = true};
        else if (!strcmp(word, "{"))
            status = open_brace(reader);
        else if (!strcmp(word, "}"))
            status = close_brace(reader);
        else if (!strcmp(word, "="))
            status = read_value(reader, previous, parentheses, nested);
        memcpy(previous, word, sizeof previous);
    }
    if (!status && reader->depth)
        return fail_line(reader, "the file ends inside a prim");
    if (!status)
        read_colors(reader);
    return status;
}

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

// Reads the whole text. Close the reader also after a failure.
static sgs_status open_reader(const char *path, bool colors_only, usd_reader **made)
{
    uint8_t *bytes = NULL;
    size_t size;
    *made = NULL;
    const bool package = is_zip(path);
    const sgs_status status =
        package ? read_package(path, &bytes, &size) : sgsi_file_read(path, 0, &bytes, &size);
    if (status)
        return status;
    usd_reader *reader = *made = sgsi_calloc(1, sizeof *reader);
    if (!reader) {
        sgsi_free(bytes);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
    }
    reader->path = path;
    reader->bytes = bytes;
    reader->at = (const char *)bytes;
    reader->end = (const char *)bytes + size;
    reader->line = 1;
    reader->colors_only = colors_only;
    reader->c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    if (!reader->c_locale)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
    if (size >= 8 && !memcmp(bytes, "PXR-USDC", 8))
        return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                         "%s: %s binary OpenUSD, which is not read; convert it to text with "
                         "'usdcat%s %s -o X.usda'",
                         path, package ? "contains" : "is", package ? " -f" : "", path);
    if (size < 5 || memcmp(bytes, "#usda", 5))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: %s OpenUSD text: it does not begin with #usda",
                         path, package ? "its first file is not" : "is not");
    reader->composed = package;
    return read_layer(reader);
}

static void close_reader(usd_reader *reader)
{
    if (!reader)
        return;
    for (size_t i = 0; i < reader->prim_count; ++i)
        for (int k = 0; k < SGSI_USD_VALUES; ++k)
            sgsi_free(reader->prims[i].values[k]);
    sgsi_free(reader->prims);
    if (reader->c_locale)
        freelocale(reader->c_locale);
    sgsi_free(reader->bytes);
    sgsi_free(reader);
}

sgs_status sgsi_usd_read_colors(const char *path, sgs_model_colors *colors)
{
    usd_reader *reader;
    const sgs_status status = open_reader(path, true, &reader);
    if (!status)
        *colors = reader->colors;
    close_reader(reader);
    return status;
}

static sgs_status decode(usd_reader *reader, sgsi_rows *rows)
{
    sgs_status status = SGS_STATUS_OK;
    for (size_t i = 0; !status && i < reader->prim_count; ++i)
        status = sgsi_usd_splats_decode(&reader->prims[i], reader->z_up, rows);
    return status;
}

sgs_status sgsi_usd_read(const char *path, const sgs_model_read_options *options,
                         sgs_gaussians **model, sgs_model_info *info)
{
    size_t total = 0;
    int sh_degree = 0;
    sgsi_rows rows = {0};
    usd_reader *reader;
    sgs_status status = open_reader(path, false, &reader);
    if (!status)
        status = sgsi_usd_splats_check(path, reader->prims, reader->prim_count, &total, &sh_degree);
    if (!status && !total)
        status = sgsi_fail(SGS_STATUS_FORMAT,
                           "%s: contains no ParticleField3DGaussianSplat with positions%s", path,
                           reader->composed ? "; add those of other files with 'usdcat -f'" : "");
    if (!status)
        status = sgsi_rows_begin(&rows, path, total, sh_degree, options->drop_zero_quaternions);
    if (!status) {
        status = decode(reader, &rows);
        info->dropped = rows.dropped;
        info->colors = reader->colors;
        if (status)
            sgsi_rows_abort(&rows);
        else
            status = sgsi_rows_end(&rows, model);
    }
    close_reader(reader);
    return status;
}
