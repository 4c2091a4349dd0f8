// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Point clouds from PLY: x y z of any number type; red green blue as 8-bit integers, or as
// fractions if they are floating point.

#include "ply/point_cloud.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "base/plain_numbers.h"
#include "ply/ply_header.h"

enum { X, Y, Z, RED, GREEN, BLUE, FIELD_COUNT };

static const char *const field_names[FIELD_COUNT] = {"x", "y", "z", "red", "green", "blue"};

typedef struct cloud {
    sgsi_ply_stream stream;
    sgsi_ply_header header;
    const sgsi_ply_element *element;
    int field_of[SGSI_PLY_MAX_PROPERTIES]; // field of each property of the element, -1 = none
    bool fraction, colored;
} cloud;

static sgs_status find_fields(cloud *c)
{
    bool present[FIELD_COUNT] = {false};
    for (int i = 0; i < c->element->property_count; ++i) {
        const sgsi_ply_property *property = &c->header.properties[c->element->first_property + i];
        c->field_of[i] = -1;
        if (property->is_list)
            return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                             "%s: vertex property '%s' is a list; export a plain point cloud",
                             c->stream.path, property->name);
        for (int f = 0; f < FIELD_COUNT; ++f) {
            if (strcmp(property->name, field_names[f]))
                continue;
            c->field_of[i] = f;
            present[f] = true;
            if (f == RED)
                c->fraction = property->type == SGSI_PLY_FLOAT || property->type == SGSI_PLY_DOUBLE;
        }
    }
    if (!present[X] || !present[Y] || !present[Z])
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: vertices lack x, y, z; export a point cloud",
                         c->stream.path);
    c->colored = present[RED] && present[GREEN] && present[BLUE];
    return SGS_STATUS_OK;
}

static sgs_status find_vertices(cloud *c)
{
    for (int i = 0; i < c->header.element_count; ++i) {
        c->element = &c->header.elements[i];
        if (!strcmp(c->element->name, "vertex")) {
            const sgs_status status = sgsi_ply_check_count(&c->stream, &c->header, c->element);
            return status ? status : find_fields(c);
        }
        const sgs_status status = sgsi_ply_skip(&c->stream, &c->header, c->element);
        if (status)
            return status;
    }
    return sgsi_fail(SGS_STATUS_FORMAT, "%s: has no vertices; export a point cloud",
                     c->stream.path);
}

// Reads one row; false at the end of the file.
static bool read_row(cloud *c, double fields[FIELD_COUNT])
{
    const sgsi_ply_property *properties = c->header.properties + c->element->first_property;
    for (int i = 0; i < c->element->property_count; ++i) {
        double value;
        if (c->header.format == SGSI_PLY_ASCII) {
            char word[SGSI_PLY_MAX_NAME + 1], *end;
            if (!sgsi_ply_word(&c->stream, word))
                return false;
            value = strtod(word, &end);
            if (*end)
                return false;
        } else {
            const uint8_t *bytes =
                sgsi_ply_take(&c->stream, sgsi_ply_type_size(properties[i].type));
            if (!bytes)
                return false;
            value =
                sgsi_ply_decode(bytes, properties[i].type, c->header.format == SGSI_PLY_BIG_ENDIAN);
        }
        if (c->field_of[i] >= 0)
            fields[c->field_of[i]] = value;
    }
    return true;
}

static uint8_t color_byte(const cloud *c, double value)
{
    if (!c->colored)
        return 128;
    value = c->fraction ? value * 255 : value;
    return value > 0 ? (uint8_t)(fmin(value, 255) + 0.5) : 0; // NaN becomes 0
}

void sgsi_point_cloud_warn_dropped(const char *path, const char *unit, unsigned long long place,
                                   size_t count)
{
    if (count)
        sgsi_warn("%s: %s %llu: dropped %zu non-finite point(s), the first one here; export the "
                  "points again to keep them",
                  path, unit, place, count);
}

static sgs_status read_rows(cloud *c, size_t *count, float *points, uint8_t *colors)
{
    size_t dropped = 0, first_dropped = 0;
    for (size_t row = 0; row < c->element->count; ++row) {
        double fields[FIELD_COUNT] = {0};
        if (!read_row(c, fields))
            return sgsi_fail(
                SGS_STATUS_FORMAT,
                "%s: byte %zu: vertex %zu of %zu is truncated or not a number; export it again",
                c->stream.path, c->stream.position, row, c->element->count);
        float *p = points + 3 * *count;
        for (int k = 0; k < 3; ++k) {
            p[k] = (float)fields[k];
            colors[3 * *count + (size_t)k] = color_byte(c, fields[RED + k]);
        }
        if (isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]))
            ++*count;
        else if (dropped++ == 0)
            first_dropped = row;
    }
    sgsi_point_cloud_warn_dropped(c->stream.path, "vertex", first_dropped, dropped);
    return SGS_STATUS_OK;
}

static sgs_status read_cloud(cloud *c, const char *path, size_t *count, float **points,
                             uint8_t **colors)
{
    sgs_status status = sgsi_ply_open(path, &c->stream);
    if (!status)
        status = sgsi_ply_read_header(&c->stream, &c->header);
    if (!status)
        status = find_vertices(c);
    if (status)
        return status;
    *points = sgsi_alloc(c->element->count, 3 * sizeof **points);
    *colors = sgsi_alloc(c->element->count, 3);
    if (!*points || !*colors)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory for %zu points", path,
                         c->element->count);
    return read_rows(c, count, *points, *colors);
}

sgs_status sgsi_point_cloud_read(const char *path, size_t *count, float **points, uint8_t **colors)
{
    *count = 0;
    *points = NULL;
    *colors = NULL;
    cloud *c = sgsi_calloc(1, sizeof *c);
    if (!c)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: not enough memory to read it", path);
    const sgsi_plain_numbers numbers = sgsi_plain_numbers_begin();
    const sgs_status status = read_cloud(c, path, count, points, colors);
    sgsi_plain_numbers_end(&numbers);
    sgsi_ply_close(&c->stream);
    sgsi_free(c);
    if (status) {
        sgsi_free(*points);
        sgsi_free(*colors);
        *points = NULL;
        *colors = NULL;
        *count = 0;
    }
    return status;
}
