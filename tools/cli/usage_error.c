// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Messages of a wrong command line, with a suggestion for a mistyped word.

#include "cli/usage_error.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "cli/json_result.h"
#include "cli/progress.h"

enum { LONGEST_WORD = 63 };

static const char *usage_context;

void fail_usage_within(const char *context)
{
    usage_context = context;
}

int fail_usage(const char *format, ...)
{
    char text[2048];
    va_list args;
    va_start(args, format);
    const int length = snprintf(text, sizeof text, "%s%s", usage_context ? usage_context : "",
                                usage_context ? ": " : "");
    if (length >= 0 && length < (int)sizeof text)
        vsnprintf(text + length, sizeof text - (size_t)length, format, args);
    va_end(args);
    make_printable(text); // it quotes command lines and plans
    fprintf(stderr, "sparegs: %s\n", text);
    last_error_set(text);
    json_result_error(text);
    return EXIT_USAGE;
}

// Damerau-Levenshtein distance (optimal string alignment): insert, delete, replace, swap
// neighbours.
static size_t edit_distance(const char *a, const char *b)
{
    size_t rows[3][LONGEST_WORD + 1];
    const size_t length_a = strnlen(a, LONGEST_WORD), length_b = strnlen(b, LONGEST_WORD);
    for (size_t j = 0; j <= length_b; ++j)
        rows[0][j] = j;
    for (size_t i = 1; i <= length_a; ++i) {
        size_t *now = rows[i % 3];
        const size_t *before = rows[(i + 2) % 3], *earlier = rows[(i + 1) % 3];
        now[0] = i;
        for (size_t j = 1; j <= length_b; ++j) {
            size_t best = before[j - 1] + (a[i - 1] != b[j - 1]);
            if (before[j] + 1 < best)
                best = before[j] + 1;
            if (now[j - 1] + 1 < best)
                best = now[j - 1] + 1;
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] &&
                earlier[j - 2] + 1 < best)
                best = earlier[j - 2] + 1;
            now[j] = best;
        }
    }
    return rows[length_a % 3][length_b];
}

// The word that `text` abbreviates, else the nearest by edit distance if it is similar. NULL if
// there is none.
static const char *nearest_word(const char *text, const char *const *words, size_t count)
{
    const char *nearest = NULL;
    const size_t length = strlen(text);
    size_t least = length < 2 ? 0 : length < 6 ? 1 : length / 3; // at most this many edits
    for (size_t i = 0; i < count; ++i) {
        if (length && !strncmp(words[i], text, length))
            return words[i];
        const size_t distance = edit_distance(text, words[i]);
        if (distance < least + !nearest) {
            least = distance;
            nearest = words[i];
        }
    }
    return nearest;
}

const char *suggestion(char storage[SUGGESTION_LENGTH], const char *prefix, const char *text,
                       const char *const *words, size_t count)
{
    const char *nearest = nearest_word(text, words, count);
    *storage = 0;
    if (nearest && strcmp(nearest, text) != 0) // a known word in the wrong place
        snprintf(storage, SUGGESTION_LENGTH, " (did you mean '%s%s'?)", prefix, nearest);
    return storage;
}
