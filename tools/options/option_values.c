// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The value of an option from its argument: ranges, units, words.

#include "options/option_values.h"

#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "cli/usage_error.h"

bool word_at(const char *words, int k, char word[LONGEST_WORD + 1])
{
    const char *at = words;
    for (; k > 0; --k) {
        at += strcspn(at, "|,");
        if (!*at++)
            return false;
    }
    const size_t length = strcspn(at, "|,");
    snprintf(word, LONGEST_WORD + 1, "%.*s", (int)length, at);
    return length > 0;
}

int word_index(const char *words, const char *text, size_t length)
{
    char word[LONGEST_WORD + 1];
    for (int k = 0; word_at(words, k, word); ++k)
        if (strlen(word) == length && !strncmp(word, text, length))
            return k;
    return -1;
}

int find_word(const char *words, const char *word)
{
    return word ? word_index(words, word, strlen(word)) : -1;
}

const char *range_text(const option *row, char text[96])
{
    const int digits = row->kind == OPTION_REAL ? 6 : 17; // integers with all digits
    snprintf(text, 96, "%.*g to %.*g%s%s%s%s", digits, row->low, digits, row->high,
             row->unit ? " " : "", row->unit ? row->unit : "", row->word ? ", or " : "",
             row->word ? row->word : "");
    return text;
}

static bool fail_range(const option *row, const char *argument)
{
    char range[96];
    fail_usage("--%s: '%s' is not %s %s", row->name, argument,
               row->kind == OPTION_REAL ? "a number from" : "a whole number from",
               range_text(row, range));
    return false;
}

static bool is_word(const option *row, const char *argument)
{
    return row->word && !strcmp(argument, row->word);
}

static bool parse_integer(const option *row, const char *argument, int *value)
{
    char *end;
    if (is_word(row, argument)) {
        *value = (int)row->of_word;
        return true;
    }
    errno = 0;
    const long number = strtol(argument, &end, 10);
    if (errno || end == argument || *end || (double)number < row->low || (double)number > row->high)
        return fail_range(row, argument);
    *value = (int)number;
    return true;
}

static bool parse_count(const option *row, const char *argument, uint64_t *value)
{
    char *end;
    errno = 0;
    const unsigned long long number = strtoull(argument, &end, 10);
    if (errno || end == argument || *end || strchr(argument, '-') || (double)number < row->low ||
        (double)number > row->high)
        return fail_range(row, argument);
    *value = number;
    return true;
}

static bool parse_real(const option *row, const char *argument, double *value)
{
    char *end;
    const bool worded = is_word(row, argument);
    const double number = worded ? row->of_word : strtod(argument, &end);
    const bool whole = worded || (end != argument && !*end);
    const bool same = row->word && number == row->of_word;
    if (!whole || !(same || (number >= row->low && number <= row->high)))
        return fail_range(row, argument);
    *value = number;
    return true;
}

// A sum of numbers with units: 3h55m. A number without a unit is in seconds.
static bool parse_duration(const option *row, const char *argument, double *value)
{
    static const char units[] = "dhms";
    static const double seconds[] = {86400, 3600, 60, 1};
    double sum = 0;
    size_t least = 0; // units must be in descending order, each at most once
    for (const char *at = argument; *argument && *at;) {
        char *end = (char *)at;
        const double number = *at >= '0' && *at <= '9' ? strtod(at, &end) : -1;
        const char *unit = number < 0       ? NULL
                           : *end           ? strchr(units, *end)
                           : at == argument ? units + 3
                                            : NULL;
        if (!unit || (size_t)(unit - units) < least || unit - units > 3) {
            sum = -1;
            break;
        }
        least = (size_t)(unit - units) + 1;
        sum += number * seconds[unit - units];
        at = *end ? end + 1 : end;
    }
    if (!*argument || !(sum >= row->low && sum <= row->high)) {
        fail_usage("--%s: '%s' is not a duration; write for example 90s, 45m, 3h55m or 2d12h",
                   row->name, argument);
        return false;
    }
    *value = sum;
    return true;
}

static bool parse_bytes(const option *row, const char *argument, uint64_t *value)
{
    static const char units[] = "KMGT"; // powers of 1024, with or without "iB"
    char *end = (char *)argument;
    double number = *argument >= '0' && *argument <= '9' ? strtod(argument, &end) : -1;
    const char *unit = number >= 0 && *end ? strchr(units, toupper((unsigned char)*end)) : NULL;
    for (const char *u = units; unit && u <= unit; ++u)
        number *= 1024;
    end += unit != NULL;
    const bool ends = !*end || !strcasecmp(end, "B") || (unit && !strcasecmp(end, "iB"));
    if (number < 0 || !ends) {
        fail_usage("--%s: '%s' is not a size; write for example 500M or 4GiB", row->name, argument);
        return false;
    }
    if (!(number >= row->low && number <= row->high)) {
        fail_usage("--%s: '%s' is not a size from %.6g to %.6g bytes", row->name, argument,
                   row->low, row->high);
        return false;
    }
    *value = (uint64_t)number;
    return true;
}

static bool fail_word(const option *row, const char *argument)
{
    char storage[32][LONGEST_WORD + 1];
    const char *words[32];
    int count = 0;
    while (count < 32 && word_at(row->argument, count, storage[count])) {
        words[count] = storage[count];
        ++count;
    }
    char near[SUGGESTION_LENGTH];
    fail_usage("--%s: invalid value '%s'%s; choose from %s", row->name, argument,
               suggestion(near, "", argument, words, (size_t)count), row->argument);
    return false;
}

static bool parse_set(const option *row, const char *argument, unsigned *value)
{
    const char *bar = strrchr(row->argument, '|');
    const char *words = bar ? bar + 1 : row->argument;
    char word[LONGEST_WORD + 1];
    unsigned all = 0, bits = 0;
    for (int k = 0; word_at(words, k, word); ++k)
        all |= 1U << k;
    if (bar && row->argument[0] == 'o' && (!strcmp(argument, "on") || !strcmp(argument, "off"))) {
        *value = argument[1] == 'n' ? all : 0;
        return true;
    }
    if (bar && !strcmp(argument, "all") && !strncmp(row->argument, "all|", 4)) {
        *value = all;
        return true;
    }
    for (const char *at = argument;; ++at) {
        const size_t length = strcspn(at, ",");
        const int k = word_index(words, at, length);
        if (k < 0) {
            char unknown[LONGEST_WORD + 1];
            snprintf(unknown, sizeof unknown, "%.*s", (int)length, at);
            if (!bar || word_index(row->argument, at, length) < 0)
                return fail_word(row, unknown);
            fail_usage("--%s: '%s' cannot be combined with other words", row->name, unknown);
            return false;
        }
        bits |= 1U << k;
        at += length;
        if (!*at)
            break;
    }
    *value = bits;
    return true;
}

static bool parse_choice(const option *row, const char *argument, int *value)
{
    *value = find_word(row->argument, argument);
    if (*value >= 0)
        return true;
    const int unlisted = row->unlisted ? find_word(row->unlisted, argument) : -1;
    for (char word[LONGEST_WORD + 1]; unlisted >= 0 && word_at(row->argument, *value + 1, word);)
        ++*value;
    *value += unlisted + 1;
    return unlisted >= 0 || fail_word(row, argument);
}

static bool parse_integers(const option *row, const char *argument, integer_list *list)
{
    list->count = 0;
    for (const char *at = argument;; ++at) {
        const size_t length = strcspn(at, ",");
        char text[24];
        if (list->count == (int)(sizeof list->values / sizeof *list->values)) {
            fail_usage("--%s: too many numbers; at most %d are allowed", row->name, list->count);
            return false;
        }
        snprintf(text, sizeof text, "%.*s", (int)length, at);
        if (length >= sizeof text || !parse_integer(row, text, &list->values[list->count++]))
            return length >= sizeof text ? fail_range(row, argument) : false;
        at += length;
        if (!*at)
            return true;
    }
}

static bool parse_size(const option *row, const char *argument, size_t *value)
{
    uint64_t count = 0;
    const bool good = parse_count(row, argument, &count);
    if (good)
        *value = (size_t)count;
    return good;
}

static bool parse_color(const option *row, const char *argument, void *values)
{
    float *rgb = (void *)((char *)values + row->offset);
    const bool random = row->random_offset && !strcmp(argument, "random");
    if (row->random_offset)
        *(bool *)((char *)values + row->random_offset) = random;
    if (random)
        return true;
    const char *at = argument;
    for (int c = 0; c < 3; ++c) {
        char *end;
        rgb[c] = strtof(at, &end);
        if (end == at || *end != (c < 2 ? ',' : 0) || !(rgb[c] >= 0 && rgb[c] <= 1)) {
            fail_usage("--%s: '%s' is not R,G,B with values from 0 to 1%s", row->name, argument,
                       row->random_offset ? ", or 'random'" : "");
            return false;
        }
        at = end + 1;
    }
    return true;
}

void trim_slashes(char *path)
{
    for (size_t n = strlen(path); n > 1 && path[n - 1] == '/';)
        path[--n] = 0;
}

bool parse_value(const option *row, const char *argument, void *values)
{
    void *value = (char *)values + row->offset;
    switch (row->kind) {
    case OPTION_FLAG:
        *(bool *)value = true;
        return true;
    case OPTION_INTEGER:
        return parse_integer(row, argument, value);
    case OPTION_COUNT:
        return parse_count(row, argument, value);
    case OPTION_SIZE:
        return parse_size(row, argument, value);
    case OPTION_REAL:
        return parse_real(row, argument, value);
    case OPTION_FOLDER:
        trim_slashes((char *)argument);
        // fall through
    case OPTION_TEXT:
        *(const char **)value = argument;
        if (!*argument)
            fail_usage("--%s: %s must not be empty", row->name, row->argument);
        return *argument != 0;
    case OPTION_CHOICE:
        return parse_choice(row, argument, value);
    case OPTION_SET:
        return parse_set(row, argument, value);
    case OPTION_INTEGERS:
        return parse_integers(row, argument, value);
    case OPTION_DURATION:
        return parse_duration(row, argument, value);
    case OPTION_BYTES:
        return parse_bytes(row, argument, value);
    case OPTION_COLOR:
        return parse_color(row, argument, values);
    }
    return false;
}
