// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Why a photo is not found although its file seems to be there: names that a copy between systems
// changed, or that begin in another folder. For messages only; photos are opened by their exact
// name.

#include <stdbool.h>

typedef enum sgsi_name_difference {
    SGSI_NAME_DIFFERS,  // another name, or the same
    SGSI_NAME_FOLDER,   // one has folders in front of the other
    SGSI_NAME_FORM,     // composed (Linux, Windows) and decomposed (macOS) letters of Unicode
    SGSI_NAME_ENCODING, // one is not UTF-8 but Latin-1
    SGSI_NAME_ACCENTS,  // one has others, or none
    SGSI_NAME_CASE
} sgsi_name_difference;

// Compares the names of two files, with '/' separators and at most 1024 bytes. Knows the letters of
// Latin-1 and Latin Extended-A. Cannot fail.
sgsi_name_difference sgsi_name_compare(const char *a, const char *b);

// True if one name is the other with folders in front of it.
bool sgsi_name_differs_by_folders(const char *a, const char *b);

// What differs, for "differ only in ..."; not for SGSI_NAME_DIFFERS and SGSI_NAME_FOLDER.
const char *sgsi_name_difference_text(sgsi_name_difference difference);
