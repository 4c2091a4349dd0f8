// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "options/option_text.h"

#include <inttypes.h>
#include <string.h>

// The word of a CHOICE, or its index if it has none.
static void write_word(FILE *out, const char *words, int index)
{
    for (int k = 0; k < index && words; ++k) {
        words = strchr(words, '|');
        words += words != NULL;
    }
    if (words && index >= 0)
        fprintf(out, "%.*s", (int)strcspn(words, "|"), words);
    else
        fprintf(out, "%d", index);
}

// The words of a SET, separated by commas.
static void write_words(FILE *out, const char *words, unsigned set)
{
    const char *bar = strrchr(words, '|'), *before = "";
    words = bar ? bar + 1 : words;
    for (unsigned left = set; left && *words; left >>= 1) {
        const int length = (int)strcspn(words, ",");
        if (left & 1) {
            fprintf(out, "%s%.*s", before, length, words);
            before = ",";
        }
        words += length + (words[length] == ',');
    }
    if (!set)
        fputs("none", out);
}

static void write_integers(FILE *out, const integer_list *list)
{
    for (int k = 0; k < list->count; ++k)
        fprintf(out, "%s%d", k ? "," : "", list->values[k]);
}

static void write_value(FILE *out, const option *row, const char *values)
{
    const void *at = values + row->offset;
    const float *color = at;
    const char *text;
    switch (row->kind) {
    case OPTION_FLAG:
        fputs(*(const bool *)at ? "on" : "off", out);
        break;
    case OPTION_INTEGER:
        fprintf(out, "%d", *(const int *)at);
        break;
    case OPTION_CHOICE:
        write_word(out, row->argument, *(const int *)at);
        break;
    case OPTION_SET:
        write_words(out, row->argument, *(const unsigned *)at);
        break;
    case OPTION_COUNT:
    case OPTION_BYTES:
        fprintf(out, "%" PRIu64, *(const uint64_t *)at);
        break;
    case OPTION_SIZE:
        fprintf(out, "%zu", *(const size_t *)at);
        break;
    case OPTION_REAL:
    case OPTION_DURATION:
        fprintf(out, "%.17g", *(const double *)at);
        break;
    case OPTION_TEXT:
    case OPTION_FOLDER:
        text = *(const char *const *)at;
        fputs(text ? text : "none", out);
        break;
    case OPTION_INTEGERS:
        write_integers(out, at);
        break;
    case OPTION_COLOR:
        fprintf(out, "%.9g,%.9g,%.9g", (double)color[0], (double)color[1], (double)color[2]);
        if (row->random_offset)
            fputs(*(const bool *)(const void *)(values + row->random_offset) ? " random" : "", out);
        break;
    }
}

// The options in "a|b|c", or all others.
static void describe(FILE *out, const command_line *line, const char *names, bool listed)
{
    for (size_t g = 0; g < line->group_count; ++g)
        for (size_t k = 0; k < line->groups[g].count; ++k) {
            const option *row = &line->groups[g].options[k];
            if ((find_word(names, row->name) >= 0) != listed)
                continue;
            fprintf(out, "--%s: ", row->name);
            write_value(out, row, line->groups[g].values);
            fputc('\n', out);
        }
}

void options_describe(FILE *out, const command_line *line, const char *except)
{
    describe(out, line, except, false);
}

void options_describe_only(FILE *out, const command_line *line, const char *names)
{
    describe(out, line, names, true);
}
