// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The option parser. Every option is one row of a table. --help, range errors and parsing all read
// that row, so they cannot disagree: the defaults shown are the defaults parsed. Long names cannot
// be abbreviated, so that a new option with the same prefix breaks no script. The error for a
// mistyped name suggests the nearest known one.

#include "cli/options.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <strings.h>

#include "cli/json_result.h"
#include "cli/option_list.h"
#include "cli/output.h"
#include "cli/progress.h"

enum { HELP_INDENT = 30, HELP_WIDTH = 100, LONGEST_WORD = 63, NEEDS_MOST = 200 };

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
    fprintf(stderr, "sparegs: %s\n", text);
    last_error_set(text);
    json_result_error(text);
    return EXIT_USAGE;
}

void key_to_name(char *text)
{
    for (char *dash = text; (dash = strchr(dash, '_'));)
        *dash = '-';
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
    if (nearest)
        snprintf(storage, SUGGESTION_LENGTH, " (did you mean '%s%s'?)", prefix, nearest);
    return storage;
}

// Copies word k of "a|b|c" or "a,b,c". False if there are fewer words.
static bool word_at(const char *words, int k, char word[LONGEST_WORD + 1])
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

static int word_index(const char *words, const char *text, size_t length)
{
    char word[LONGEST_WORD + 1];
    for (int k = 0; word_at(words, k, word); ++k)
        if (strlen(word) == length && !strncmp(word, text, length))
            return k;
    return -1;
}

// For example "1 to 30000 iterations".
static const char *range_text(const option *row, char text[96])
{
    const int digits = row->kind == OPTION_REAL ? 6 : 17; // integers with all digits
    snprintf(text, 96, "%.*g to %.*g%s%s", digits, row->low, digits, row->high,
             row->unit ? " " : "", row->unit ? row->unit : "");
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

static bool parse_integer(const option *row, const char *argument, int *value)
{
    char *end;
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
    const double number = strtod(argument, &end);
    if (end == argument || *end || !(number >= row->low && number <= row->high))
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
    if (number < 0 || !ends || !(number >= row->low && number <= row->high)) {
        fail_usage("--%s: '%s' is not a size; write for example 500M or 4GiB", row->name, argument);
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

// Messages and configs contain the path: OUT/point_cloud, not OUT//point_cloud.
static void trim_slashes(char *path)
{
    for (size_t n = strlen(path); n > 1 && path[n - 1] == '/';)
        path[--n] = 0;
}

static bool parse_value(const option *row, const char *argument, void *values)
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
        *(int *)value = word_index(row->argument, argument, strlen(argument));
        return *(int *)value >= 0 || fail_word(row, argument);
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

// ---- Help ----

// Prints text wrapped at HELP_WIDTH, with further lines indented; the cursor is at column `indent`.
// A newline in the text starts a new line; spaces after it stay.
static void print_wrapped(const char *text, int indent)
{
    int column = indent;
    for (const char *at = text; *at;) {
        const int gap = (int)strspn(at, " "), length = (int)strcspn(at + gap, " \n");
        if (column > indent && column + gap + length > HELP_WIDTH) {
            printf("\n%*s%.*s", indent, "", length, at + gap);
            column = indent + length;
        } else {
            printf("%.*s", gap + length, at);
            column += gap + length;
        }
        at += gap + length;
        if (*at == '\n') {
            printf("\n%*s", at[1] ? indent : 0, "");
            column = indent;
            ++at;
        }
    }
    putchar('\n');
}

// Prints the name and argument of an option, broken after a comma where they are wider than the
// page. Returns the cursor's column.
static int print_left(const char *left)
{
    int length = (int)strlen(left), head = length < HELP_WIDTH ? length : HELP_WIDTH;
    while (head < length && head > 0 && left[head - 1] != ',')
        --head;
    printf("%.*s", head, left);
    if (head == length || head == 0)
        return printf("%s", left + head) + head;
    return printf("\n%*s%s", HELP_INDENT / 2, "", left + head) - 1;
}

static void print_option(const option *row)
{
    char left[160], right[768], range[96];
    const char letter[] = {'-', row->letter, ',', ' ', 0};
    snprintf(left, sizeof left, "  %s--%s%s%s", row->letter ? letter : "", row->name,
             row->argument ? " " : "", row->argument ? row->argument : "");
    const char *value = row->shown ? row->shown : row->initial;
    const bool ranged = row->kind == OPTION_INTEGER || row->kind == OPTION_COUNT ||
                        row->kind == OPTION_SIZE || row->kind == OPTION_REAL ||
                        row->kind == OPTION_INTEGERS;
    // The range ends with the unit; other values have the unit alone.
    const char *values = ranged ? range_text(row, range) : row->unit ? row->unit : "";
    const int length = snprintf(right, sizeof right, "%s", row->help);
    if (*values || value)
        snprintf(right + length, sizeof right - (size_t)length, " [%s%s%s%s]", values,
                 *values && value ? "; " : "", value ? "default: " : "", value ? value : "");
    int column = print_left(left);
    if (column + 2 > HELP_INDENT) {
        putchar('\n');
        column = 0;
    }
    printf("%*s", HELP_INDENT - column, "");
    print_wrapped(right, HELP_INDENT);
}

static void print_help(const command_line *line)
{
    printf("Usage: sparegs %s %s\n\n", line->command, line->synopsis);
    print_wrapped(line->description, 0);
    for (size_t g = 0; g < line->group_count; ++g) {
        printf("\n%s:\n", line->groups[g].title);
        for (size_t i = 0; i < line->groups[g].count; ++i)
            print_option(&line->groups[g].options[i]);
    }
    puts("  --help                      print this help and exit");
}

// ---- Parsing ----

static const option *find_row(const command_line *line, const char *name, size_t length,
                              option_group **group)
{
    for (size_t g = 0; g < line->group_count; ++g)
        for (size_t i = 0; i < line->groups[g].count; ++i) {
            const option *row = &line->groups[g].options[i];
            if (strlen(row->name) == length && !strncmp(row->name, name, length)) {
                *group = &line->groups[g];
                return row;
            }
        }
    return NULL;
}

static const option *find_letter(const command_line *line, char letter, option_group **group)
{
    for (size_t g = 0; g < line->group_count; ++g)
        for (size_t i = 0; i < line->groups[g].count; ++i)
            if (line->groups[g].options[i].letter == letter) {
                *group = &line->groups[g];
                return &line->groups[g].options[i];
            }
    return NULL;
}

static int fail_unknown(const command_line *line, const char *name, size_t length)
{
    const char *names[256];
    char text[LONGEST_WORD + 1], near[SUGGESTION_LENGTH];
    size_t count = 0;
    for (size_t g = 0; g < line->group_count; ++g)
        for (size_t i = 0; i < line->groups[g].count && count < 255; ++i)
            names[count++] = line->groups[g].options[i].name;
    names[count++] = "help";
    snprintf(text, sizeof text, "%.*s", (int)length, name);
    return fail_usage("unknown option '--%s'%s; 'sparegs help %s' lists all options", text,
                      suggestion(near, "--", text, names, count), line->command);
}

static bool is_known_long(const command_line *line, const char *argument)
{
    option_group *group;
    return !strncmp(argument, "--", 2) &&
           find_row(line, argument + 2, strcspn(argument + 2, "="), &group);
}

// Parses one option at argv[*at]. Returns -1 to continue, or an exit status.
static int parse_option(command_line *line, int argc, char **argv, int *at)
{
    const char *argument = argv[*at], *value = NULL;
    option_group *group = NULL;
    const option *row;
    if (argument[1] == '-') {
        const size_t length = strcspn(argument + 2, "=");
        row = find_row(line, argument + 2, length, &group);
        if (!row)
            return fail_unknown(line, argument + 2, length);
        value = argument[2 + length] ? argument + 3 + length : NULL;
    } else {
        row = find_letter(line, argument[1], &group);
        if (!row)
            return fail_usage("unknown option '-%c'; 'sparegs help %s' lists all options",
                              argument[1], line->command);
        value = argument[2] ? argument + 2 : NULL;
    }
    if (row->kind == OPTION_FLAG && value)
        return fail_usage("--%s takes no value", row->name);
    if (row->kind != OPTION_FLAG && !value) {
        if (*at + 1 >= argc || is_known_long(line, argv[*at + 1]))
            return fail_usage("--%s requires a value: %s", row->name, row->argument);
        value = argv[++*at];
    }
    const uint64_t bit = UINT64_C(1) << (row - group->options);
    if (group->given & bit && row->kind != OPTION_FLAG)
        print_warning("--%s is given more than once; '%s' replaces the earlier value", row->name,
                      value);
    group->given |= bit;
    return parse_value(row, value, group->values) ? -1 : EXIT_USAGE;
}

static int set_defaults(command_line *line)
{
    for (size_t g = 0; g < line->group_count; ++g) {
        line->groups[g].given = 0;
        for (size_t i = 0; i < line->groups[g].count; ++i) {
            const option *row = &line->groups[g].options[i];
            if (row->initial && !parse_value(row, row->initial, line->groups[g].values))
                return EXIT_USAGE;
        }
    }
    line->operand_count = 0;
    return -1;
}

// True if a CHOICE or SET has the word.
static bool has_word(const option *row, const void *values, const char *word)
{
    const void *value = (const char *)values + row->offset;
    const char *bar = row->kind == OPTION_SET ? strrchr(row->argument, '|') : NULL;
    const int k = word_index(bar ? bar + 1 : row->argument, word, strlen(word));
    return k >= 0 &&
           (row->kind == OPTION_SET ? *(const unsigned *)value >> k & 1 : *(const int *)value == k);
}

// One condition of option.needs: "name" or "name=word". Appends it to `text` as it is written on a
// command line.
static bool condition_met(const command_line *line, const char *condition, size_t length,
                          char text[NEEDS_MOST])
{
    char name[NEEDS_MOST];
    snprintf(name, sizeof name, "%.*s", (int)length, condition);
    char *word = strchr(name, '=');
    if (word)
        *word++ = 0;
    const size_t used = strlen(text);
    if (snprintf(text + used, NEEDS_MOST - used, "%s--%s%s%s", used ? " or " : "", name,
                 word ? " " : "", word ? word : "") < 0)
        text[used] = 0;
    option_group *group = NULL;
    const option *row = find_row(line, name, strlen(name), &group);
    return word ? row && has_word(row, group->values, word) : option_given(line, name);
}

// The first part of option.needs that is not met goes to `text`.
static bool needs_met(const command_line *line, const char *needs, char text[NEEDS_MOST])
{
    for (const char *part = needs; *part;) {
        const size_t length = strcspn(part, "&");
        bool met = false;
        *text = 0;
        for (const char *at = part; at < part + length; at += strcspn(at, "|&") + 1)
            met = condition_met(line, at, strcspn(at, "|&"), text) || met;
        if (!met)
            return false;
        part += length + (part[length] == '&');
    }
    return true;
}

// Rejects an option that has no effect without others. Returns -1 to continue, or EXIT_USAGE.
static int check_needs(command_line *line)
{
    char text[NEEDS_MOST];
    line->idle = NULL;
    for (size_t g = 0; g < line->group_count; ++g)
        for (size_t i = 0; i < line->groups[g].count; ++i) {
            const option *row = &line->groups[g].options[i];
            if (!row->needs || !option_given(line, row->name) || needs_met(line, row->needs, text))
                continue;
            if (!line->allow_idle)
                return fail_usage("--%s requires %s", row->name, text);
            line->idle = line->idle ? line->idle : row->name;
        }
    return -1;
}

int refuse_idle(const command_line *line, const char *names, const char *why)
{
    char name[LONGEST_WORD + 1];
    for (int k = 0; word_at(names, k, name); ++k)
        if (option_given(line, name))
            return fail_usage("--%s has no effect %s", name, why);
    return -1;
}

void warn_idle(const command_line *line, const char *names, const char *why)
{
    char name[LONGEST_WORD + 1];
    for (int k = 0; word_at(names, k, name); ++k)
        if (option_given(line, name))
            print_warning("--%s has no effect %s", name, why);
}

static bool same_inode(const struct stat *first, const struct stat *second)
{
    return first->st_dev == second->st_dev && first->st_ino == second->st_ino;
}

// True if two paths name the same file in the same folder, which need not contain it yet.
static bool same_entry(const char *a, const char *b)
{
    const char *names[2] = {a, b};
    struct stat folders[2];
    for (int k = 0; k < 2; ++k) {
        const char *path = names[k], *slash = strrchr(path, '/');
        char *folder = slash ? format_text("%.*s/", (int)(slash - path), path) : format_text(".");
        const bool exists = !stat(folder, &folders[k]);
        free(folder);
        if (!exists)
            return false;
        names[k] = slash ? slash + 1 : path;
    }
    return !strcmp(names[0], names[1]) && same_inode(&folders[0], &folders[1]);
}

bool same_file(const char *a, const char *b)
{
    struct stat first, second;
    if (!strcmp(a, b))
        return true;
    if (stat(a, &first) || stat(b, &second))
        return same_entry(a, b);
    return S_ISREG(first.st_mode) && same_inode(&first, &second);
}

int refuse_input(const char *name, const char *path)
{
    return fail_usage("--%s: %s is an input of this command; choose another file", name, path);
}

static const char *path_of(const option_group *group, size_t i)
{
    const option *row = &group->options[i];
    const bool is = (row->kind == OPTION_TEXT || row->kind == OPTION_FOLDER) &&
                    (row->path != PATH_NONE || !strcmp(row->name, "output"));
    return is && group->given >> i & 1 ? *(const char **)((char *)group->values + row->offset)
                                       : NULL;
}

// Rejects an output at `path` that would replace that of another option, or its input.
static int check_apart(const command_line *line, const option *output, const char *path)
{
    for (size_t g = 0; g < line->group_count; ++g)
        for (size_t i = 0; i < line->groups[g].count; ++i) {
            const option *row = &line->groups[g].options[i];
            const char *other = row == output ? NULL : path_of(&line->groups[g], i);
            if (other && same_file(path, other))
                return fail_usage("--%s and --%s are both %s; choose different files", output->name,
                                  row->name, path);
        }
    return -1;
}

// The path of an output option, or NULL.
static const char *output_of(const option_group *group, size_t i)
{
    return group->options[i].path == PATH_OUTPUT ? path_of(group, i) : NULL;
}

int refuse_outputs_at(const command_line *line, const char *input)
{
    for (size_t g = 0; g < line->group_count; ++g)
        for (size_t i = 0; i < line->groups[g].count; ++i) {
            const char *path = output_of(&line->groups[g], i);
            if (path && same_file(path, input))
                return refuse_input(line->groups[g].options[i].name, path);
        }
    return -1;
}

static int check_outputs_apart(const command_line *line)
{
    int status = -1;
    for (int k = 0; k < line->operand_count && status < 0; ++k)
        status = refuse_outputs_at(line, line->operands[k]);
    for (size_t g = 0; g < line->group_count; ++g)
        for (size_t i = 0; i < line->groups[g].count && status < 0; ++i) {
            const char *path = output_of(&line->groups[g], i);
            status = path ? check_apart(line, &line->groups[g].options[i], path) : -1;
        }
    return status;
}

int command_line_parse(command_line *line, int argc, char **argv)
{
    if (set_defaults(line) >= 0)
        return EXIT_USAGE;
    bool help = false, json = false;
    for (int i = 1; i < argc && strcmp(argv[i], "--"); ++i) {
        help = help || !strcmp(argv[i], "--help");
        json = json || !strcmp(argv[i], "--json");
    }
    if (help && json)
        json_result_set(option_list_json(line));
    else if (help)
        print_help(line);
    if (help)
        return EXIT_DONE;
    bool only_operands = false;
    for (int i = 1; i < argc; ++i) {
        if (!only_operands && !strcmp(argv[i], "--")) {
            only_operands = true;
        } else if (!only_operands && argv[i][0] == '-' && argv[i][1]) {
            const int status = parse_option(line, argc, argv, &i);
            if (status >= 0)
                return status;
        } else if (line->operand_count == line->operand_maximum) {
            return fail_usage("unexpected argument '%s'; usage: sparegs %s %s", argv[i],
                              line->command, line->synopsis);
        } else if (!*argv[i]) {
            return fail_usage("argument %d must not be empty; usage: sparegs %s %s",
                              line->operand_count + 1, line->command, line->synopsis);
        } else {
            trim_slashes(argv[i]);
            line->operands[line->operand_count++] = argv[i];
        }
    }
    if (line->operand_count < line->operand_minimum)
        return fail_usage("missing argument; usage: sparegs %s %s", line->command, line->synopsis);
    const int status = check_needs(line);
    return status < 0 ? check_outputs_apart(line) : status;
}

const option *find_option(const command_line *line, const char *name)
{
    option_group *group = NULL;
    return find_row(line, name, strlen(name), &group);
}

int find_word(const char *words, const char *word)
{
    return word ? word_index(words, word, strlen(word)) : -1;
}

bool option_given(const command_line *line, const char *name)
{
    option_group *group = NULL;
    const option *row = find_row(line, name, strlen(name), &group);
    return row && (group->given >> (row - group->options) & 1);
}
