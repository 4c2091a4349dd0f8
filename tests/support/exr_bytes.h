// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// EXR files byte by byte, from "OpenEXR File Layout": scan lines of floats without compression, in
// any windows, with any attributes, in one or several parts. Not written by our writer.

#include <stdint.h>

#include "support/scene_support.h"

typedef struct exr_file {
    int data[4], display[4]; // xMin, yMin, xMax, yMax; all 0 = 0, 0, width - 1, height - 1
    int width, height;       // of the data window
    int count;               // channels, sorted by name
    const char *names[12];
    const float *planes[12];     // [height][width]
    const char *interop;         // colorInteropID, or NULL
    const float *chromaticities; // [8], or NULL
    const char *part;            // name, in a file of several parts
} exr_file;

static inline void exr_attribute(buffer *b, const char *name, const char *type, size_t size)
{
    put_bytes(b, name, strlen(name) + 1);
    put_bytes(b, type, strlen(type) + 1);
    put_integer(b, size, 4);
}

static inline void exr_window(buffer *b, const char *name, const int window[4], const exr_file *f)
{
    const int whole[4] = {0, 0, f->width - 1, f->height - 1};
    const bool given = window[0] || window[1] || window[2] || window[3];
    exr_attribute(b, name, "box2i", 16);
    for (int k = 0; k < 4; ++k)
        put_integer(b, (uint32_t)(given ? window : whole)[k], 4);
}

static inline void exr_channel_list(buffer *b, const exr_file *f)
{
    size_t size = 1;
    for (int c = 0; c < f->count; ++c)
        size += strlen(f->names[c]) + 1 + 16;
    exr_attribute(b, "channels", "chlist", size);
    for (int c = 0; c < f->count; ++c) {
        put_bytes(b, f->names[c], strlen(f->names[c]) + 1);
        put_integer(b, 2, 4); // float
        put_integer(b, 0, 4);
        put_integer(b, 1, 4);
        put_integer(b, 1, 4);
    }
    put_integer(b, 0, 1);
}

// Required attributes, with their usual values.
static inline void exr_fixed_attributes(buffer *b)
{
    exr_attribute(b, "lineOrder", "lineOrder", 1);
    put_integer(b, 0, 1);
    exr_attribute(b, "pixelAspectRatio", "float", 4);
    put_integer(b, 0x3f800000, 4);
    exr_attribute(b, "screenWindowCenter", "v2f", 8);
    put_integer(b, 0, 8);
    exr_attribute(b, "screenWindowWidth", "float", 4);
    put_integer(b, 0x3f800000, 4);
}

// Attributes of a part in a file of several parts.
static inline void exr_part_attributes(buffer *b, const exr_file *f)
{
    static const char type[] = "scanlineimage";
    exr_attribute(b, "chunkCount", "int", 4);
    put_integer(b, (uint64_t)f->height, 4);
    exr_attribute(b, "name", "string", strlen(f->part));
    put_bytes(b, f->part, strlen(f->part));
    exr_attribute(b, "type", "string", sizeof type - 1);
    put_bytes(b, type, sizeof type - 1);
}

static inline void exr_header(buffer *b, const exr_file *f)
{
    exr_channel_list(b, f);
    if (f->chromaticities) {
        exr_attribute(b, "chromaticities", "chromaticities", 32);
        put_bytes(b, f->chromaticities, 32);
    }
    if (f->interop) {
        exr_attribute(b, "colorInteropID", "string", strlen(f->interop));
        put_bytes(b, f->interop, strlen(f->interop));
    }
    exr_attribute(b, "compression", "compression", 1);
    put_integer(b, 0, 1);
    exr_window(b, "dataWindow", f->data, f);
    exr_window(b, "displayWindow", f->display, f);
    exr_fixed_attributes(b);
    if (f->part)
        exr_part_attributes(b, f);
    put_integer(b, 0, 1); // end of the header
}

static inline size_t exr_row_bytes(const exr_file *f)
{
    return (size_t)f->count * (size_t)f->width * sizeof(float);
}

// Several parts if they have names, else one.
static inline void exr_put_parts(const temp_folder *folder, const char *name, const exr_file *parts,
                                 int count)
{
    static buffer b;
    const size_t head = parts->part ? 12 : 8; // of a chunk
    b.size = 0;
    put_integer(&b, 0x01312f76, 4);
    put_integer(&b, parts->part ? 2 | 0x1000 : 2, 4);
    for (int k = 0; k < count; ++k)
        exr_header(&b, &parts[k]);
    if (parts->part)
        put_integer(&b, 0, 1); // end of the headers
    size_t chunk = b.size;
    for (int k = 0; k < count; ++k)
        chunk += 8 * (size_t)parts[k].height;
    for (int k = 0; k < count; ++k)
        for (int y = 0; y < parts[k].height; ++y) {
            put_integer(&b, chunk, 8);
            chunk += exr_row_bytes(&parts[k]) + head;
        }
    for (int k = 0; k < count; ++k)
        for (int y = 0; y < parts[k].height; ++y) {
            const exr_file *f = &parts[k];
            if (f->part)
                put_integer(&b, (uint64_t)k, 4);
            put_integer(&b, (uint32_t)(f->data[1] + y), 4);
            put_integer(&b, exr_row_bytes(f), 4);
            for (int c = 0; c < f->count; ++c)
                put_bytes(&b, f->planes[c] + (size_t)y * (size_t)f->width,
                          (size_t)f->width * sizeof(float));
        }
    tree_put(folder, name, b.data, b.size);
}

static inline void exr_put(const temp_folder *folder, const char *name, const exr_file *f)
{
    exr_put_parts(folder, name, f, 1);
}
