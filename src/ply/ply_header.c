// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The container of Greg Turk's "The PLY Polygon File Format", 1994: a header of text lines, then
// the rows of each element, as text or binary. Robust against hostile input: the file is streamed,
// every count is validated against the remaining bytes before memory is allocated or rows are read,
// and the size of the header is limited.
//
// Stricter than the original: a non-printable byte in the header, an unknown keyword or a duplicate
// name is an error, because it indicates a corrupt file.

#include "ply/ply_header.h"

#include <string.h>
#include <strings.h>

#include "base/core.h"
#include "storage/color_marks.h"

enum { BUFFER_BYTES = 1 << 18, MAX_TAKEN = 1 << 16, MAX_LINE = 1024, MAX_WORDS = 6 };

sgs_status sgsi_ply_open(const char *path, sgsi_ply_stream *stream)
{
    *stream = (sgsi_ply_stream){.path = path};
    const sgs_status status = sgsi_file_open(path, &stream->file, &stream->size);
    if (status)
        return status;
    stream->buffer = sgsi_alloc(BUFFER_BYTES, 1);
    if (!stream->buffer)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
    return SGS_STATUS_OK;
}

void sgsi_ply_close(sgsi_ply_stream *stream)
{
    if (stream->file)
        fclose(stream->file);
    sgsi_free(stream->buffer);
    *stream = (sgsi_ply_stream){0};
}

const uint8_t *sgsi_ply_take(sgsi_ply_stream *stream, size_t n)
{
    if (n > MAX_TAKEN || n > sgsi_ply_left(stream))
        return NULL;
    if (stream->end - stream->begin < n) {
        stream->end -= stream->begin;
        // NOLINTNEXTLINE(clang-analyzer-core.NonNullParamChecker): an open stream has its buffer
        memmove(stream->buffer, stream->buffer + stream->begin, stream->end);
        stream->begin = 0;
        stream->end +=
            fread(stream->buffer + stream->end, 1, BUFFER_BYTES - stream->end, stream->file);
        if (stream->end < n)
            return NULL; // the file shrank or a read failed
    }
    const uint8_t *bytes = stream->buffer + stream->begin;
    stream->begin += n;
    stream->position += n;
    return bytes;
}

static bool skip_bytes(sgsi_ply_stream *stream, size_t n)
{
    if (n > sgsi_ply_left(stream))
        return false;
    while (n) {
        const size_t step = n < MAX_TAKEN ? n : MAX_TAKEN;
        if (!sgsi_ply_take(stream, step))
            return false;
        n -= step;
    }
    return true;
}

static bool is_space(uint8_t byte)
{
    return byte == ' ' || (byte >= '\t' && byte <= '\r');
}

bool sgsi_ply_word(sgsi_ply_stream *stream, char word[SGSI_PLY_MAX_NAME + 1])
{
    size_t length = 0;
    for (;;) {
        const uint8_t *byte = sgsi_ply_take(stream, 1);
        if (byte && !is_space(*byte)) {
            if (length == SGSI_PLY_MAX_NAME)
                return false;
            word[length++] =
                (char)(*byte >= 32 && *byte < 127 ? *byte : '?'); // may appear in an error message
            continue;
        }
        if (length || !byte)
            break;
    }
    word[length] = 0;
    return length > 0;
}

size_t sgsi_ply_type_size(sgsi_ply_type type)
{
    static const uint8_t sizes[SGSI_PLY_TYPE_COUNT] = {1, 1, 2, 2, 4, 4, 4, 8};
    return sizes[type];
}

size_t sgsi_ply_row_size(const sgsi_ply_header *header, const sgsi_ply_element *element)
{
    size_t size = 0;
    for (int k = 0; k < element->property_count; ++k) {
        const sgsi_ply_property *property = &header->properties[element->first_property + k];
        size += sgsi_ply_type_size(property->is_list ? property->count_type : property->type);
    }
    return size;
}

double sgsi_ply_decode(const uint8_t *bytes, sgsi_ply_type type, bool big_endian)
{
    const size_t size = sgsi_ply_type_size(type);
    uint64_t bits = 0;
    for (size_t k = 0; k < size; ++k)
        bits |= (uint64_t)bytes[big_endian ? size - 1 - k : k] << (8 * k);
    float single;
    double value;
    const uint32_t low = (uint32_t)bits;
    switch (type) {
    case SGSI_PLY_INT8:
        return (double)(int8_t)bits;
    case SGSI_PLY_INT16:
        return (double)(int16_t)bits;
    case SGSI_PLY_INT32:
        return (double)(int32_t)low;
    case SGSI_PLY_FLOAT:
        memcpy(&single, &low, sizeof single);
        return (double)single;
    case SGSI_PLY_DOUBLE:
        memcpy(&value, &bits, sizeof value);
        return value;
    default:
        return (double)bits;
    }
}

// ---- Header ----

typedef struct header_line {
    int number; // from 1
    char text[MAX_LINE + 1];
    char *words[MAX_WORDS]; // into text
    int word_count;         // at most MAX_WORDS are split
    bool is_comment;
} header_line;

static void split_words(header_line *line)
{
    line->word_count = 0;
    char *at = line->text;
    while (line->word_count < MAX_WORDS) {
        while (*at == ' ' || *at == '\t')
            *at++ = 0;
        if (!*at)
            return;
        line->words[line->word_count++] = at;
        while (*at && *at != ' ' && *at != '\t')
            ++at;
    }
}

static bool begins_with(const char *text, const char *word)
{
    while (*word && *text == *word) {
        ++text;
        ++word;
    }
    return !*word;
}

static bool is_comment(const char *line)
{
    return begins_with(line, "comment") || begins_with(line, "obj_info");
}

static sgs_status read_line(sgsi_ply_stream *stream, header_line *line)
{
    size_t length = 0;
    ++line->number;
    for (;;) {
        if (stream->position >= SGSI_PLY_MAX_HEADER)
            return sgsi_fail(SGS_STATUS_LIMIT, "%s: the header has no end_header within %d bytes",
                             stream->path, SGSI_PLY_MAX_HEADER);
        const uint8_t *byte = sgsi_ply_take(stream, 1);
        if (!byte)
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: line %d: file ends inside the header",
                             stream->path, line->number);
        if (*byte == '\n')
            break;
        if (length == MAX_LINE && is_comment(line->text))
            continue; // its end is of no use
        if (length == MAX_LINE)
            return sgsi_fail(SGS_STATUS_LIMIT, "%s: line %d: longer than %d characters",
                             stream->path, line->number, MAX_LINE);
        line->text[length++] = (char)*byte;
    }
    if (length && line->text[length - 1] == '\r')
        --length;
    line->text[length] = 0;
    line->is_comment = is_comment(line->text);
    for (size_t k = 0; k < length && !line->is_comment; ++k) {
        const unsigned char byte = (unsigned char)line->text[k];
        if ((byte < 32 && byte != '\t') || byte > 126)
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "%s: line %d: byte 0x%02x is not text; the header is corrupt",
                             stream->path, line->number, byte);
    }
    if (!line->is_comment)
        split_words(line);
    else
        line->word_count = 0;
    return SGS_STATUS_OK;
}

static bool parse_type(const char *word, sgsi_ply_type *type)
{
    static const char *const names[][2] = {
        {"char", "int8"}, {"uchar", "uint8"}, {"short", "int16"},   {"ushort", "uint16"},
        {"int", "int32"}, {"uint", "uint32"}, {"float", "float32"}, {"double", "float64"}};
    for (int k = 0; k < SGSI_PLY_TYPE_COUNT; ++k) {
        if (!strcmp(word, names[k][0]) || !strcmp(word, names[k][1])) {
            *type = (sgsi_ply_type)k;
            return true;
        }
    }
    return false;
}

static bool parse_count(const char *word, size_t *count)
{
    size_t value = 0;
    for (const char *at = word; *at; ++at) {
        if (*at < '0' || *at > '9' || __builtin_mul_overflow(value, 10, &value) ||
            __builtin_add_overflow(value, (size_t)(*at - '0'), &value))
            return false;
    }
    *count = value;
    return *word != 0;
}

static sgs_status parse_format(const char *path, const header_line *line, sgsi_ply_header *header)
{
    static const char *const names[] = {"ascii", "binary_little_endian", "binary_big_endian"};
    if (line->word_count != 3 || strcmp(line->words[0], "format"))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: line %d: expected 'format' after 'ply'", path,
                         line->number);
    for (int k = 0; k < 3; ++k) {
        if (strcmp(line->words[1], names[k]))
            continue;
        if (strcmp(line->words[2], "1.0"))
            return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                             "%s: line %d: unknown PLY version %.63s; only 1.0 is supported", path,
                             line->number, line->words[2]);
        header->format = (sgsi_ply_format)k;
        return SGS_STATUS_OK;
    }
    return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                     "%s: line %d: unknown format '%.63s'; supported: ascii, "
                     "binary_little_endian and binary_big_endian",
                     path, line->number, line->words[1]);
}

static sgs_status check_name(const char *path, int number, const char *name)
{
    if (strlen(name) > SGSI_PLY_MAX_NAME)
        return sgsi_fail(SGS_STATUS_LIMIT, "%s: line %d: name longer than %d characters", path,
                         number, SGSI_PLY_MAX_NAME);
    return SGS_STATUS_OK;
}

static sgs_status parse_element(const char *path, const header_line *line, sgsi_ply_header *header)
{
    size_t count;
    if (line->word_count != 3)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: line %d: expected 'element NAME COUNT'", path,
                         line->number);
    const char *name = line->words[1];
    if (check_name(path, line->number, name))
        return SGS_STATUS_LIMIT;
    if (!parse_count(line->words[2], &count))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: line %d: count '%.63s' of element '%s' is not a number", path,
                         line->number, line->words[2], name);
    for (int k = 0; k < header->element_count; ++k) {
        if (!strcmp(header->elements[k].name, name))
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: line %d: duplicate element '%s'", path,
                             line->number, name);
    }
    if (header->element_count == SGSI_PLY_MAX_ELEMENTS)
        return sgsi_fail(SGS_STATUS_LIMIT, "%s: line %d: more than %d elements", path, line->number,
                         SGSI_PLY_MAX_ELEMENTS);
    sgsi_ply_element *element = &header->elements[header->element_count++];
    *element = (sgsi_ply_element){.count = count, .first_property = header->property_count};
    memcpy(element->name, name, strlen(name) + 1);
    return SGS_STATUS_OK;
}

static sgs_status parse_property(const char *path, const header_line *line, sgsi_ply_header *header)
{
    const bool is_list = line->word_count > 1 && !strcmp(line->words[1], "list");
    if (line->word_count != (is_list ? 5 : 3))
        return sgsi_fail(
            SGS_STATUS_FORMAT,
            "%s: line %d: expected 'property TYPE NAME' or 'property list COUNT-TYPE TYPE NAME'",
            path, line->number);
    if (!header->element_count)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: line %d: property before the first element", path,
                         line->number);
    if (header->property_count == SGSI_PLY_MAX_PROPERTIES)
        return sgsi_fail(SGS_STATUS_LIMIT, "%s: line %d: more than %d properties", path,
                         line->number, SGSI_PLY_MAX_PROPERTIES);
    sgsi_ply_element *element = &header->elements[header->element_count - 1];
    sgsi_ply_property property = {.is_list = is_list, .count_type = SGSI_PLY_UINT8};
    const char *type = line->words[is_list ? 3 : 1], *name = line->words[is_list ? 4 : 2];
    if (check_name(path, line->number, name))
        return SGS_STATUS_LIMIT;
    if (!parse_type(type, &property.type))
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: line %d: property '%s' has unknown type '%.63s'",
                         path, line->number, name, type);
    if (is_list && (!parse_type(line->words[2], &property.count_type) ||
                    property.count_type >= SGSI_PLY_FLOAT))
        return sgsi_fail(
            SGS_STATUS_FORMAT,
            "%s: line %d: list '%s' has count type '%.63s', which is not an integer type", path,
            line->number, name, line->words[2]);
    for (int k = 0; k < element->property_count; ++k) {
        if (!strcmp(header->properties[element->first_property + k].name, name))
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: line %d: duplicate property '%s'", path,
                             line->number, name);
    }
    memcpy(property.name, name, strlen(name) + 1);
    header->properties[header->property_count++] = property;
    ++element->property_count;
    return SGS_STATUS_OK;
}

// Comments that mark a model as antialiased, in three spellings, or describe its colours; the last
// one counts. Brush writes SplatRenderMode, Postshot the two others, that with = since version 1.
static void parse_comment(const char *text, sgsi_ply_header *header)
{
    char key[32], value[32];
    if (sscanf(text, "comment postshot.anti_aliasing=%31s", value) == 1) {
        header->antialiased = !strcmp(value, "1");
        return;
    }
    if (sscanf(text, "comment %31s %31s", key, value) != 2)
        return;
    if (!strcasecmp(key, "SplatRenderMode:"))
        header->antialiased = !strcasecmp(value, "mip");
    else if (!strcasecmp(key, "antialiased"))
        header->antialiased = !strcmp(value, "1");
    else
        sgsi_color_comment_parse(key, value, &header->colors);
}

sgs_status sgsi_ply_read_header(sgsi_ply_stream *stream, sgsi_ply_header *header)
{
    header->element_count = header->property_count = 0;
    header->antialiased = false;
    header->colors = (sgs_model_colors){0};
    const uint8_t *magic = sgsi_ply_take(stream, 4);
    if (!magic || memcmp(magic, "ply", 3) || (magic[3] != '\n' && magic[3] != '\r'))
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: not a PLY file: it does not begin with 'ply'; specify another file, "
                         "or rename this one with the extension of its format",
                         stream->path);
    if (magic[3] == '\r') {
        const uint8_t *feed = sgsi_ply_take(stream, 1);
        if (!feed || *feed != '\n')
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: line 1: missing line feed", stream->path);
    }
    header_line line = {.number = 1};
    bool have_format = false;
    for (;;) {
        sgs_status status = read_line(stream, &line);
        if (status)
            return status;
        if (line.is_comment)
            parse_comment(line.text, header);
        if (!line.word_count)
            continue; // a comment or an empty line
        if (!have_format) {
            status = parse_format(stream->path, &line, header);
            have_format = true;
        } else if (!strcmp(line.words[0], "element")) {
            status = parse_element(stream->path, &line, header);
        } else if (!strcmp(line.words[0], "property")) {
            status = parse_property(stream->path, &line, header);
        } else if (!strcmp(line.words[0], "end_header") && line.word_count == 1) {
            return SGS_STATUS_OK;
        } else {
            status = sgsi_fail(SGS_STATUS_FORMAT, "%s: line %d: '%.63s' is not a PLY keyword",
                               stream->path, line.number, line.words[0]);
        }
        if (status)
            return status;
    }
}

// ---- Body ----

sgs_status sgsi_ply_check_count(const sgsi_ply_stream *stream, const sgsi_ply_header *header,
                                const sgsi_ply_element *element)
{
    // A value of an ascii body takes a character and a separator; the last separator is optional.
    const bool ascii = header->format == SGSI_PLY_ASCII;
    const size_t row =
        ascii ? 2 * (size_t)element->property_count : sgsi_ply_row_size(header, element);
    const size_t left = sgsi_ply_left(stream);
    if (row && element->count > (left + ascii) / row)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: byte %zu: %zu rows of element '%s' take at least %zu bytes each, but "
                         "only %zu bytes "
                         "are left; the file is truncated or its count is wrong",
                         stream->path, stream->position, element->count, element->name, row, left);
    return SGS_STATUS_OK;
}

static bool skip_ascii_row(sgsi_ply_stream *stream, const sgsi_ply_property *properties, int count)
{
    char word[SGSI_PLY_MAX_NAME + 1];
    for (int k = 0; k < count; ++k) {
        size_t items = 1;
        if (properties[k].is_list && (!sgsi_ply_word(stream, word) || !parse_count(word, &items) ||
                                      items > sgsi_ply_left(stream)))
            return false;
        for (size_t item = 0; item < items; ++item) {
            if (!sgsi_ply_word(stream, word))
                return false;
        }
    }
    return true;
}

static bool skip_binary_row(sgsi_ply_stream *stream, const sgsi_ply_property *properties, int count,
                            bool big_endian)
{
    for (int k = 0; k < count; ++k) {
        size_t items = 1;
        if (properties[k].is_list) {
            const uint8_t *bytes =
                sgsi_ply_take(stream, sgsi_ply_type_size(properties[k].count_type));
            const double value =
                bytes ? sgsi_ply_decode(bytes, properties[k].count_type, big_endian) : -1.0;
            if (value < 0.0)
                return false;
            items = (size_t)value; // below 2^32
        }
        if (!skip_bytes(stream, items * sgsi_ply_type_size(properties[k].type)))
            return false;
    }
    return true;
}

sgs_status sgsi_ply_skip(sgsi_ply_stream *stream, const sgsi_ply_header *header,
                         const sgsi_ply_element *element)
{
    const sgs_status status = sgsi_ply_check_count(stream, header, element);
    if (status || !element->property_count)
        return status;
    const sgsi_ply_property *properties = &header->properties[element->first_property];
    for (size_t row = 0; row < element->count; ++row) {
        const size_t place = stream->position;
        const bool skipped = header->format == SGSI_PLY_ASCII
                                 ? skip_ascii_row(stream, properties, element->property_count)
                                 : skip_binary_row(stream, properties, element->property_count,
                                                   header->format == SGSI_PLY_BIG_ENDIAN);
        if (!skipped)
            return sgsi_fail(SGS_STATUS_FORMAT,
                             "%s: byte %zu: row %zu of element '%s' is corrupt or truncated",
                             stream->path, place, row, element->name);
    }
    return SGS_STATUS_OK;
}
