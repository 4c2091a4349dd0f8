// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Reads a ParticleField3DGaussianSplat from OpenUSD text: the first one in the layer, its five
// attributes (or their half-precision variants, which the text also writes as numbers),
// colorSpace:name (its own or that of the nearest prim above it, as in UsdColorSpaceAPI), our white
// point, upAxis, and nothing else. No composition, no time samples; transforms above the prim are
// refused, because they would have to rotate SH. Many programs write every prim with identity
// operations; these are accepted.

#include "formats/model_format.h"

#include <locale.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "formats/color_marks.h"
#include "formats/model_rows.h"
#include "model/similarity.h"

enum { MOST_WORD = 63, MOST_DEPTH = 64 };

typedef enum usd_values {
    USD_POSITIONS,
    USD_ORIENTATIONS,
    USD_SCALES,
    USD_OPACITIES,
    USD_SH,
    USD_VALUES
} usd_values;

static const struct {
    const char *name, *half;
    size_t components;
} attributes[USD_VALUES] = {
    {"positions", "positionsh", 3},
    {"orientations", "orientationsh", 4},
    {"scales", "scalesh", 3},
    {"opacities", "opacitiesh", 1},
    {"radiance:sphericalHarmonicsCoefficients", "radiance:sphericalHarmonicsCoefficientsh", 3},
};

typedef struct usd_reader {
    const char *path;
    uint8_t *bytes;       // the text
    const char *at, *end; // of the text, which ends with NUL
    int line, depth;      // depth of braces
    int prim_depth;       // depth inside of the splats, 0 before
    int above;            // after the splats: number of prims around them that are still open
    bool finished;        // after the splats
    struct {
        bool transformed;
        char color_space[MOST_WORD + 1]; // "" if it has none
    } open[MOST_DEPTH + 1];              // by depth: the open prims
    bool moved;                          // the splats or a prim above them have a transform
    char color_space[MOST_WORD + 1];     // of the splats, "" if no prim has one
    bool z_up;
    bool colors_only; // skips the arrays, without warnings
    sgs_model_colors colors;
    int sh_degree; // -1: not given
    float *values[USD_VALUES];
    size_t counts[USD_VALUES], capacities[USD_VALUES];
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

// Continues behind the next `mark`, or at the end of the text.
static void skip_past(usd_reader *reader, const char *mark)
{
    const size_t length = strlen(mark);
    for (; reader->at < reader->end && strncmp(reader->at, mark, length); ++reader->at)
        reader->line += *reader->at == '\n';
    reader->at += reader->at < reader->end ? length : 0;
}

// Behind its first '@'.
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
static bool next_token(usd_reader *reader, char word[MOST_WORD + 1])
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
        if (length < MOST_WORD)
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
static sgs_status read_numbers(usd_reader *reader, usd_values kind)
{
    size_t *count = &reader->counts[kind], *capacity = &reader->capacities[kind];
    float **values = &reader->values[kind];
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
            const size_t grown = *capacity ? 2 * *capacity : 1024;
            if (!sgsi_grow((void **)values, *count, grown, sizeof **values))
                return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it",
                                 reader->path);
            *capacity = grown;
        }
        (*values)[(*count)++] = (float)value;
    }
}

// Whether the transform operation is the identity. Does not consume its value.
static bool is_identity(const usd_reader *reader, const char *operation)
{
    enum { MOST = 16 };
    const bool matrix = !strncmp(operation, "transform", 9),
               scales = !strncmp(operation, "scale", 5), orient = !strncmp(operation, "orient", 6),
               zeros = !strncmp(operation, "translate", 9) || !strncmp(operation, "rotate", 6);
    const char *at = reader->at + strspn(reader->at, " \t\r\n");
    const bool scalar = *at != '(';
    size_t count = 0;
    for (; count < (scalar ? 1 : MOST); ++count) {
        char *end;
        at += strspn(at, " \t\r\n(),");
        const double value = strtod_l(at, &end, reader->c_locale);
        if (end == at)
            break;
        const double expected = matrix   ? (double)(count % 5 == 0)
                                : orient ? (double)(count == 0)
                                         : (double)scales;
        if (!(value == expected))
            return false;
        at = end;
    }
    return matrix ? count == 16 : orient ? count == 4 : (scales || zeros) && count > 0;
}

// A token in double quotes, of the innermost open prim.
static void read_color_space(usd_reader *reader)
{
    char *name = reader->open[reader->depth].color_space;
    size_t length = 0;
    skip_space(reader);
    if (*reader->at != '"')
        return;
    for (const char *at = reader->at + 1; is_word(*at) && length < MOST_WORD; ++at)
        name[length++] = *at;
    name[length] = 0;
}

// After "NAME =" inside of the splats.
static sgs_status read_attribute(usd_reader *reader, const char *name)
{
    skip_space(reader);
    if (!strcmp(name, "radiance:sphericalHarmonicsDegree")) {
        reader->sh_degree = (int)strtol(reader->at, NULL, 10);
        return SGS_STATUS_OK;
    }
    if (!strcmp(name, "sparegs:whitePoint")) {
        reader->colors.white_point = sgsi_white_point_parse(reader->at);
        return SGS_STATUS_OK;
    }
    for (int k = 0; k < USD_VALUES; ++k) {
        const bool is_half = !strcmp(name, attributes[k].half);
        if (strcmp(name, attributes[k].name) && !is_half)
            continue;
        if (is_half && reader->counts[k]) // floats win
            return SGS_STATUS_OK;
        if (*reader->at != '[')
            return fail_line(reader, "an attribute of the splats is not an array");
        ++reader->at;
        if (!reader->colors_only)
            return read_numbers(reader, (usd_values)k);
        skip_numbers(reader);
        return SGS_STATUS_OK;
    }
    return SGS_STATUS_OK;
}

static sgs_status open_brace(usd_reader *reader, bool is_splats)
{
    if (reader->depth == MOST_DEPTH)
        return fail_line(reader, "braces are nested deeper than 64");
    ++reader->depth;
    reader->open[reader->depth].transformed = false;
    reader->open[reader->depth].color_space[0] = 0;
    if (is_splats && reader->finished && !reader->colors_only)
        sgsi_warn("%s: line %d: only the first ParticleField3DGaussianSplat is read", reader->path,
                  reader->line);
    if (is_splats && !reader->prim_depth && !reader->finished)
        reader->prim_depth = reader->depth;
    return SGS_STATUS_OK;
}

// The innermost open prim is that of the splats or one above it.
static void inherit(usd_reader *reader)
{
    reader->moved |= reader->open[reader->depth].transformed;
    if (!*reader->color_space)
        memcpy(reader->color_space, reader->open[reader->depth].color_space,
               sizeof reader->color_space);
    reader->above = reader->depth - 1;
}

static sgs_status close_brace(usd_reader *reader)
{
    if (!reader->depth)
        return fail_line(reader, "'}' without '{'");
    if (reader->depth == reader->prim_depth) {
        reader->prim_depth = 0;
        reader->finished = true;
        inherit(reader);
    } else if (reader->finished && reader->depth == reader->above) {
        inherit(reader);
    }
    --reader->depth;
    return SGS_STATUS_OK;
}

static sgs_status read_layer(usd_reader *reader)
{
    char word[MOST_WORD + 1], previous[MOST_WORD + 1] = "";
    bool is_splats = false; // after the type name, before its brace
    int parentheses = 0;
    sgs_status status = SGS_STATUS_OK;
    while (!status && next_token(reader, word)) {
        if (!strcmp(word, "(")) {
            ++parentheses;
        } else if (!strcmp(word, ")")) {
            --parentheses;
        } else if (!strcmp(word, "ParticleField3DGaussianSplat") && !strcmp(previous, "def")) {
            is_splats = true;
        } else if (!strcmp(word, "{") && parentheses <= 0) {
            status = open_brace(reader, is_splats);
            is_splats = false;
        } else if (!strcmp(word, "}") && parentheses <= 0) {
            status = close_brace(reader);
        } else if (!strcmp(word, "=")) {
            if (!strcmp(previous, "upAxis") && !reader->depth) {
                skip_space(reader);
                reader->z_up = reader->at + 1 < reader->end && reader->at[1] == 'Z';
            } else if (!strncmp(previous, "xformOp:", 8)) {
                reader->open[reader->depth].transformed |= !is_identity(reader, previous + 8);
            } else if (!strcmp(previous, "colorSpace:name") && !parentheses) {
                read_color_space(reader);
            } else if (reader->prim_depth && reader->depth == reader->prim_depth && !parentheses) {
                status = read_attribute(reader, previous);
            }
        }
        memcpy(previous, word, sizeof previous);
    }
    if (!status && reader->depth)
        return fail_line(reader, "the file ends inside a prim");
    // A prim may declare its transform after its children.
    if (!status && reader->moved)
        return sgsi_fail(
            SGS_STATUS_UNSUPPORTED,
            "%s: the splats or a prim above them have a transform; export without transforms",
            reader->path);
    if (!status && *reader->color_space)
        sgsi_color_space_parse(reader->colors_only ? NULL : reader->path, reader->color_space,
                               &reader->colors);
    return status;
}

static sgs_status check_counts(usd_reader *reader, size_t *count)
{
    *count = reader->counts[USD_POSITIONS] / 3;
    if (!reader->finished || !*count)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: contains no ParticleField3DGaussianSplat with positions",
                         reader->path);
    for (int k = 0; k < USD_SH; ++k)
        if (reader->counts[k] != *count * attributes[k].components)
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: '%s' has %zu numbers for %zu positions",
                             reader->path, attributes[k].name, reader->counts[k], *count);
    if (reader->sh_degree < 0)
        reader->sh_degree = 3; // the fallback of the schema
    const size_t coefficients =
        reader->sh_degree <= 3 ? (size_t)sgsi_rest_coefficients(reader->sh_degree) + 1 : 0;
    if (!coefficients)
        return sgsi_fail(SGS_STATUS_UNSUPPORTED, "%s: SH degree %d is not within 0 to 3",
                         reader->path, reader->sh_degree);
    if (reader->counts[USD_SH] != *count * coefficients * 3)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: SH degree %d of %zu positions takes %zu numbers; the file has %zu",
                         reader->path, reader->sh_degree, *count, *count * coefficients * 3,
                         reader->counts[USD_SH]);
    return SGS_STATUS_OK;
}

static void decode_rows(const usd_reader *reader, sgsi_rows *rows)
{
    const int coefficients = sgsi_rest_coefficients(reader->sh_degree) + 1;
    const double none[3] = {0}, upright[4] = {0.70710678118654752, -0.70710678118654752, 0, 0};
    const sgsi_similarity from_z_up = sgsi_similarity_make(1.0, upright, none);
    for (size_t i = 0; i < rows->total; ++i) {
        float params[SGS_PARAM_COUNT] = {0};
        for (size_t k = 0; k < 3; ++k) {
            params[SGS_PARAM_MEAN + k] = reader->values[USD_POSITIONS][3 * i + k];
            params[SGS_PARAM_SCALE + k] =
                sgsi_log_scale((double)reader->values[USD_SCALES][3 * i + k]);
        }
        memcpy(params + SGS_PARAM_ROTATION, reader->values[USD_ORIENTATIONS] + 4 * i,
               4 * sizeof(float));
        params[SGS_PARAM_OPACITY] = sgsi_logit((double)reader->values[USD_OPACITIES][i]);
        memcpy(params + SGS_PARAM_SH_DC, reader->values[USD_SH] + 3 * (size_t)coefficients * i,
               3 * (size_t)coefficients * sizeof(float));
        if (reader->z_up)
            sgsi_similarity_apply(&from_z_up, params);
        sgsi_change_axes(SGSI_AXES_RUB, params);
        sgsi_rows_add(rows, params);
    }
}

// Reads the whole text. Close the reader also after a failure.
static sgs_status open_reader(const char *path, bool colors_only, usd_reader **made)
{
    uint8_t *bytes;
    size_t size;
    *made = NULL;
    const sgs_status status = sgsi_file_read(path, 0, &bytes, &size);
    if (status)
        return status;
    usd_reader *reader = *made = sgsi_calloc(1, sizeof *reader);
    if (!reader) {
        sgsi_free(bytes);
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
    }
    *reader = (usd_reader){.path = path,
                           .bytes = bytes,
                           .at = (const char *)bytes,
                           .end = (const char *)bytes + size,
                           .line = 1,
                           .colors_only = colors_only,
                           .sh_degree = -1,
                           .c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0)};
    if (!reader->c_locale)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
    if (size < 5 || memcmp(bytes, "#usda", 5))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: is not OpenUSD text: it does not begin with #usda",
                         path);
    return read_layer(reader);
}

static void close_reader(usd_reader *reader)
{
    if (!reader)
        return;
    for (int k = 0; k < USD_VALUES; ++k)
        sgsi_free(reader->values[k]);
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

sgs_status sgsi_usd_read(const char *path, const sgs_model_read_options *options,
                         sgs_gaussians **model, sgs_model_info *info)
{
    size_t count = 0;
    sgsi_rows rows = {0};
    usd_reader *reader;
    sgs_status status = open_reader(path, false, &reader);
    if (!status)
        status = check_counts(reader, &count);
    if (!status)
        status = sgsi_rows_begin(&rows, path, count, reader->sh_degree, options->drop_unrotated);
    if (!status) {
        decode_rows(reader, &rows);
        info->dropped = rows.dropped;
        info->colors = reader->colors;
        status = sgsi_rows_end(&rows, model);
    }
    close_reader(reader);
    return status;
}
