// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "usd/usd_text.h"

#include <stdlib.h>
#include <string.h>

// After the first quote.
static void skip_string(sgsi_usd_text *text, char quote)
{
    const bool triple = text->at[0] == quote && text->at[1] == quote;
    text->at += triple ? 2 : 0;
    text->string = text->at;
    while (text->at < text->end) {
        if (*text->at == '\n')
            ++text->line;
        if (*text->at == '\\' && text->at + 1 < text->end) {
            text->at += 2;
            continue;
        }
        if (*text->at == quote && (!triple || (text->at[1] == quote && text->at[2] == quote))) {
            text->string_length = (size_t)(text->at - text->string);
            text->at += triple ? 3 : 1;
            return;
        }
        ++text->at;
    }
    text->string_length = (size_t)(text->at - text->string);
}

// Continues after the next `mark`, or at the end of the text.
static void skip_past(sgsi_usd_text *text, const char *mark)
{
    const size_t length = strlen(mark);
    for (; text->at < text->end && strncmp(text->at, mark, length); ++text->at)
        text->line += *text->at == '\n';
    text->at += text->at < text->end ? length : 0;
}

// After its first '@'.
static void skip_asset(sgsi_usd_text *text)
{
    const bool triple = text->at[0] == '@' && text->at[1] == '@';
    text->at += triple ? 2 : 0;
    skip_past(text, triple ? "@@@" : "@");
}

void sgsi_usd_skip_space(sgsi_usd_text *text)
{
    while (text->at < text->end) {
        if (*text->at == '#' || (*text->at == '/' && text->at[1] == '/')) {
            while (text->at < text->end && *text->at != '\n')
                ++text->at;
        } else if (*text->at == '/' && text->at[1] == '*') {
            text->at += 2;
            skip_past(text, "*/");
        } else if (*text->at == '\n') {
            ++text->line;
            ++text->at;
        } else if (*text->at == ' ' || *text->at == '\t' || *text->at == '\r') {
            ++text->at;
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

bool sgsi_usd_token(sgsi_usd_text *text, char word[SGSI_USD_NAME + 1])
{
    size_t length = 0;
    sgsi_usd_skip_space(text);
    if (text->at >= text->end)
        return false;
    if (!is_word(*text->at)) {
        word[0] = *text->at++;
        word[1] = 0;
        if (*word == '"' || *word == '\'')
            skip_string(text, *word);
        else if (*word == '@')
            skip_asset(text);
        else if (*word == '<')
            skip_past(text, ">"); // a path
        return true;
    }
    for (; text->at < text->end && is_word(*text->at); ++text->at)
        if (length < SGSI_USD_NAME)
            word[length++] = *text->at;
    word[length] = 0;
    return true;
}

bool sgsi_usd_accept(sgsi_usd_text *text, const char *word)
{
    const size_t length = strlen(word);
    sgsi_usd_skip_space(text);
    if (strncmp(text->at, word, length) || (is_word(*word) && is_word(text->at[length])))
        return false;
    text->at += length;
    return true;
}

bool sgsi_usd_number(sgsi_usd_text *text, double *number)
{
    char *end;
    sgsi_usd_skip_space(text);
    *number = strtod_l(text->at, &end, text->c_locale);
    if (end == text->at)
        return false;
    text->at = end;
    return true;
}

int sgsi_usd_numbers(sgsi_usd_text *text, double numbers[SGSI_USD_NUMBERS])
{
    int count = 0;
    size_t open = 0;
    do {
        double number;
        if (sgsi_usd_accept(text, "(")) {
            ++open;
        } else if (open && sgsi_usd_accept(text, ")")) {
            --open;
        } else if (!(open && sgsi_usd_accept(text, ","))) {
            if (count == SGSI_USD_NUMBERS || !sgsi_usd_number(text, &number))
                return 0;
            numbers[count++] = number;
        }
    } while (open);
    return count;
}
