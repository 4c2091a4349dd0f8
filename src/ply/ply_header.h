// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The PLY container, read only: a buffered stream that tracks the remaining bytes, the header, and
// the skipping of elements. Independent of Gaussians.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "sparegs/image.h"
#include "sparegs/status.h"

typedef enum sgsi_ply_type {
    SGSI_PLY_INT8,
    SGSI_PLY_UINT8,
    SGSI_PLY_INT16,
    SGSI_PLY_UINT16,
    SGSI_PLY_INT32,
    SGSI_PLY_UINT32,
    SGSI_PLY_FLOAT,
    SGSI_PLY_DOUBLE,
    SGSI_PLY_TYPE_COUNT
} sgsi_ply_type;

typedef enum sgsi_ply_format {
    SGSI_PLY_ASCII,
    SGSI_PLY_LITTLE_ENDIAN,
    SGSI_PLY_BIG_ENDIAN
} sgsi_ply_format;

// Far above the output of any exporter; they limit the memory and time that a hostile header can
// request.
enum {
    SGSI_PLY_MAX_NAME = 63,
    SGSI_PLY_MAX_ELEMENTS = 16,
    SGSI_PLY_MAX_PROPERTIES = 512,
    SGSI_PLY_MAX_HEADER = 1 << 17
};

typedef struct sgsi_ply_property {
    char name[SGSI_PLY_MAX_NAME + 1];
    sgsi_ply_type type;
    bool is_list;
    sgsi_ply_type count_type; // for a list; an integer type
} sgsi_ply_property;

typedef struct sgsi_ply_element {
    char name[SGSI_PLY_MAX_NAME + 1];
    size_t count;
    int first_property, property_count;
} sgsi_ply_element;

typedef struct sgsi_ply_header {
    sgsi_ply_format format;
    // A comment "SplatRenderMode: mip", "antialiased 1" or "postshot.anti_aliasing=1": trained with
    // Mip-Splatting's filters.
    bool antialiased;
    sgs_model_colors colors; // of comments, see color_marks.h
    int element_count, property_count;
    sgsi_ply_element elements[SGSI_PLY_MAX_ELEMENTS];
    sgsi_ply_property properties[SGSI_PLY_MAX_PROPERTIES];
} sgsi_ply_header;

typedef struct sgsi_ply_stream {
    const char *path; // borrowed
    FILE *file;
    size_t size;     // of the file, bytes
    size_t position; // bytes consumed
    uint8_t *buffer;
    size_t begin, end; // unread part of the buffer
} sgsi_ply_stream;

// Opens a regular file; fails with IO or OUT_OF_MEMORY. Close it after a failure too.
sgs_status sgsi_ply_open(const char *path, sgsi_ply_stream *stream);
void sgsi_ply_close(sgsi_ply_stream *stream);

// Consumes the next n bytes (n <= 64 KiB); NULL when fewer remain. Valid until the next call.
const uint8_t *sgsi_ply_take(sgsi_ply_stream *stream, size_t n);

// The next word of an ascii body; false at the end of the file or for a word of more than 63
// characters.
bool sgsi_ply_word(sgsi_ply_stream *stream, char word[SGSI_PLY_MAX_NAME + 1]);

static inline size_t sgsi_ply_left(const sgsi_ply_stream *stream)
{
    return stream->size - stream->position;
}

// Reads up to and including end_header. Errors name the line.
sgs_status sgsi_ply_read_header(sgsi_ply_stream *stream, sgsi_ply_header *header);

// Bytes of one binary value, and of one binary row without the items of its lists.
size_t sgsi_ply_type_size(sgsi_ply_type type);
size_t sgsi_ply_row_size(const sgsi_ply_header *header, const sgsi_ply_element *element);

// Decodes one binary value.
double sgsi_ply_decode(const uint8_t *bytes, sgsi_ply_type type, bool big_endian);

// Checks that the declared rows of `element` fit into the remaining bytes (lists count as empty).
sgs_status sgsi_ply_check_count(const sgsi_ply_stream *stream, const sgsi_ply_header *header,
                                const sgsi_ply_element *element);

// Skips all rows of an element, including lists.
sgs_status sgsi_ply_skip(sgsi_ply_stream *stream, const sgsi_ply_header *header,
                         const sgsi_ply_element *element);
