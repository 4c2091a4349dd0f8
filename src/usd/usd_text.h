// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The words, strings and numbers of OpenUSD text. Does not know prims.

#include <locale.h>
#include <stdbool.h>
#include <stddef.h>

// Letters of a word that are kept. Names of attributes in use are shorter.
enum { SGSI_USD_NAME = 63, SGSI_USD_NUMBERS = 16 };

typedef struct sgsi_usd_text {
    const char *at, *end; // *end is NUL
    int line;             // of `at`, from 1
    locale_t c_locale;    // of numbers
    // The last string that was read, without its quotes, as written; not terminated.
    const char *string;
    size_t string_length;
} sgsi_usd_text;

// Continues after white space and comments.
void sgsi_usd_skip_space(sgsi_usd_text *text);

// The next word, or a single other character: '"' and '\'' stand for a string, which is skipped as
// a whole and stored in `string`, '@' for an asset, '<' for a path. False at the end of the text.
bool sgsi_usd_token(sgsi_usd_text *text, char word[SGSI_USD_NAME + 1]);

// True if the next word is `word`, which is then skipped.
bool sgsi_usd_accept(sgsi_usd_text *text, const char *word);

// The next number; may be infinite or NaN. False if there is none.
bool sgsi_usd_number(sgsi_usd_text *text, double *number);

// A number, or numbers in parentheses, which may be nested. Returns how many; 0 if it is anything
// else or more than SGSI_USD_NUMBERS.
int sgsi_usd_numbers(sgsi_usd_text *text, double numbers[SGSI_USD_NUMBERS]);
