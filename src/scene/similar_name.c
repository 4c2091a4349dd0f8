// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "scene/similar_name.h"

#include <stdbool.h>
#include <stddef.h>
#include <string.h>
#include <strings.h>

// Two bytes for each of 1024 of Latin-1.
enum { FOLDED = 2 * 1024 + 1 };

// Base letters of U+00C0 to U+017F by their canonical decomposition; '.': it has none.
static const char base_letters[] =
    "AAAAAA.CEEEEIIII.NOOOOO..UUUUY..aaaaaa.ceeeeiiii.nooooo..uuuuy.y"
    "AaAaAaCcCcCcCcDd..EeEeEeEeEeGgGgGgGgHh..IiIiIiIiI...JjKk.LlLlLl."
    "...NnNnNn...OoOoOo..RrRrRrSsSsSsSsTtTt..UuUuUuUuUuUuWwYyYZzZzZz.";

typedef struct folded {
    char text[FOLDED];
    bool is_ascii, is_utf8, has_marks; // marks: combining accents
} folded;

// Code point and length of a UTF-8 sequence of two to four bytes; false for other bytes.
static bool decode(const unsigned char *at, unsigned *code, size_t *length)
{
    *length = (at[0] & 0xe0) == 0xc0   ? 2
              : (at[0] & 0xf0) == 0xe0 ? 3
              : (at[0] & 0xf8) == 0xf0 ? 4
                                       : 0;
    *code = at[0] & (0x7fu >> *length);
    for (size_t i = 1; i < *length; ++i) {
        if ((at[i] & 0xc0) != 0x80)
            return false;
        *code = *code << 6 | (at[i] & 0x3fu);
    }
    return *length > 0;
}

// Replaces letters with accents by their base letters and drops combining accents.
static void fold(const char *name, folded *f)
{
    size_t used = 0;
    *f = (folded){.is_ascii = true, .is_utf8 = true};
    for (const unsigned char *at = (const unsigned char *)name; *at && used + 4 < FOLDED;) {
        unsigned code = *at;
        size_t length = 1;
        f->is_ascii = f->is_ascii && *at < 0x80;
        if (*at >= 0x80 && !decode(at, &code, &length)) {
            f->is_utf8 = false; // Latin-1: the byte is the code point
            code = *at;
            length = 1;
        }
        const bool has_base = code >= 0xc0 && code < 0x180 && base_letters[code - 0xc0] != '.';
        const bool is_combining = length == 2 && code >= 0x300 && code < 0x370;
        f->has_marks = f->has_marks || is_combining;
        if (has_base) {
            f->text[used++] = base_letters[code - 0xc0];
        } else if (length == 1 && *at >= 0x80) {
            f->text[used++] = (char)(0xc0 | code >> 6);
            f->text[used++] = (char)(0x80 | (code & 0x3f));
        } else if (!is_combining) {
            memcpy(f->text + used, at, length);
            used += length;
        }
        at += length;
    }
}

bool sgsi_name_differs_by_folders(const char *a, const char *b)
{
    const size_t length_a = strlen(a), length_b = strlen(b);
    const char *longer = length_a > length_b ? a : b, *shorter = length_a > length_b ? b : a;
    const size_t extra = length_a > length_b ? length_a - length_b : length_b - length_a;
    return extra && longer[extra - 1] == '/' && !strcmp(longer + extra, shorter);
}

sgsi_name_difference sgsi_name_compare(const char *a, const char *b)
{
    if (sgsi_name_differs_by_folders(a, b))
        return SGSI_NAME_FOLDER;
    folded x, y;
    fold(a, &x);
    fold(b, &y);
    if (!strcmp(a, b) || strcasecmp(x.text, y.text) != 0)
        return SGSI_NAME_DIFFERS;
    if (x.is_ascii != y.is_ascii)
        return SGSI_NAME_ACCENTS;
    if (strcmp(x.text, y.text) != 0)
        return SGSI_NAME_CASE;
    if (!x.is_utf8 || !y.is_utf8)
        return SGSI_NAME_ENCODING;
    return x.has_marks != y.has_marks ? SGSI_NAME_FORM : SGSI_NAME_ACCENTS;
}

const char *sgsi_name_difference_text(sgsi_name_difference difference)
{
    return difference == SGSI_NAME_FORM ? "the Unicode form of letters (composed or decomposed)"
           : difference == SGSI_NAME_ENCODING ? "the encoding (UTF-8 or Latin-1)"
           : difference == SGSI_NAME_ACCENTS  ? "the accents of letters"
                                              : "upper and lower case";
}
