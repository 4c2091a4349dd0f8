// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "image/icc_profile.h"

#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "base/big_endian.h"

enum { HEADER = 128, TAG = 12, RECORD = 12 };

// The element with the description; NULL if there is none.
static const uint8_t *find_description(const uint8_t *profile, size_t bytes, size_t *size)
{
    if (bytes < HEADER + 4)
        return NULL;
    const size_t fit = (bytes - HEADER - 4) / TAG;
    size_t count = sgsi_big_endian32(profile + HEADER);
    count = count < fit ? count : fit;
    for (size_t i = 0; i < count; ++i) {
        const uint8_t *tag = profile + HEADER + 4 + i * TAG;
        const size_t offset = sgsi_big_endian32(tag + 4);
        *size = sgsi_big_endian32(tag + 8);
        if (!memcmp(tag, "desc", 4))
            return offset <= bytes && *size <= bytes - offset && *size >= 12 ? profile + offset
                                                                             : NULL;
    }
    return NULL;
}

static void put(unsigned code, char *name, size_t size, size_t *used)
{
    char text[3];
    size_t count = 0;
    if (code < 0x20 || (code >= 0x7f && code < 0xa0) || (code >= 0xd800 && code < 0xe000))
        code = '?';
    if (code < 0x80) {
        text[count++] = (char)code;
    } else if (code < 0x800) {
        text[count++] = (char)(0xc0 | code >> 6);
        text[count++] = (char)(0x80 | (code & 0x3f));
    } else {
        text[count++] = (char)(0xe0 | code >> 12);
        text[count++] = (char)(0x80 | (code >> 6 & 0x3f));
        text[count++] = (char)(0x80 | (code & 0x3f));
    }
    if (*used + count >= size)
        return;
    memcpy(name + *used, text, count);
    *used += count;
    name[*used] = 0;
}

// Version 2: ASCII.
static void read_ascii(const uint8_t *element, size_t bytes, char *name, size_t size)
{
    size_t used = 0, count = sgsi_big_endian32(element + 8);
    count = count < bytes - 12 ? count : bytes - 12;
    for (size_t i = 0; i < count && element[12 + i]; ++i)
        put(element[12 + i] < 0x80 ? element[12 + i] : '?', name, size, &used);
}

// Version 4: UTF-16, in several languages.
static void read_unicode(const uint8_t *element, size_t bytes, char *name, size_t size)
{
    const uint8_t *chosen = NULL;
    if (bytes < 16)
        return;
    const size_t fit = (bytes - 16) / RECORD;
    size_t used = 0, count = sgsi_big_endian32(element + 8);
    count = count < fit ? count : fit;
    for (size_t i = 0; i < count; ++i) {
        const uint8_t *record = element + 16 + i * RECORD;
        if (!chosen || !memcmp(record, "en", 2))
            chosen = record;
    }
    if (!chosen)
        return;
    const size_t length = sgsi_big_endian32(chosen + 4), offset = sgsi_big_endian32(chosen + 8);
    if (offset > bytes || length > bytes - offset)
        return;
    const uint8_t *text = element + offset;
    for (size_t i = 0; i + 1 < length && (text[i] || text[i + 1]); i += 2)
        put((unsigned)text[i] << 8 | text[i + 1], name, size, &used);
}

void sgsi_icc_name(const uint8_t *profile, size_t bytes, char *name, size_t size)
{
    size_t length = 0;
    const uint8_t *element = find_description(profile, bytes, &length);
    name[0] = 0;
    if (element && !memcmp(element, "desc", 4))
        read_ascii(element, length, name, size);
    else if (element && !memcmp(element, "mluc", 4))
        read_unicode(element, length, name, size);
}

static bool is_srgb(const char *name)
{
    for (; *name; ++name)
        if (!strncasecmp(name, "sRGB", 4))
            return true;
    return false;
}

void sgsi_icc_note(const void *profile, size_t bytes, char *note, size_t size)
{
    char name[64];
    note[0] = 0;
    sgsi_icc_name(profile, bytes, name, sizeof name);
    if (!is_srgb(name))
        snprintf(note, size,
                 "its ICC profile %s%s%s is not applied; convert the image to sRGB, or name its "
                 "colour space with option colorspace",
                 *name ? "'" : "", *name ? name : "(without a name)", *name ? "'" : "");
}
