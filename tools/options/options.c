// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The option parser. Every option is one row of a table. --help, range errors and parsing all read
// that row, so they cannot disagree: the defaults shown are the defaults parsed. Long names cannot
// be abbreviated, so that a new option with the same prefix breaks no script. The error for a
// mistyped name suggests the nearest known one.

#include "options/options.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "cli/json_result.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/resolved_path.h"
#include "cli/run_files.h"
#include "options/option_list.h"
#include "options/option_values.h"

enum { HELP_INDENT = 30, HELP_WIDTH = 100, MAX_NEEDS = 200 };

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

bool option_is_listed(const option_group *group, const option *row)
{
    return !group->unread || find_word(group->unread, row->name) < 0;
}

static void print_help(const command_line *line)
{
    printf("Usage: sparegs %s %s\n\n", line->command, line->synopsis);
    print_wrapped(line->description, 0);
    for (size_t g = 0; g < line->group_count; ++g) {
        printf("\n%s:\n", line->groups[g].title);
        for (size_t i = 0; i < line->groups[g].count; ++i)
            if (option_is_listed(&line->groups[g], &line->groups[g].options[i]))
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
    if (group->given & bit && row->kind == OPTION_FLAG)
        print_warning("--%s is given more than once", row->name);
    else if (group->given & bit)
        print_warning("--%s is given more than once; '%s' replaces the earlier value", row->name,
                      value);
    group->given |= bit;
    return parse_value(row, value, group->values) ? -1 : EXIT_USAGE;
}

static int set_defaults(command_line *line)
{
    for (size_t g = 0; g < line->group_count; ++g) {
        line->groups[g].given = line->groups[g].filled = 0;
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
                          char text[MAX_NEEDS])
{
    char name[MAX_NEEDS];
    snprintf(name, sizeof name, "%.*s", (int)length, condition);
    char *word = strchr(name, '=');
    if (word)
        *word++ = 0;
    const size_t used = strlen(text);
    if (snprintf(text + used, MAX_NEEDS - used, "%s--%s%s%s", used ? " or " : "", name,
                 word ? " " : "", word ? word : "") < 0)
        text[used] = 0;
    option_group *group = NULL;
    const option *row = find_row(line, name, strlen(name), &group);
    return word ? row && has_word(row, group->values, word) : option_set(line, name);
}

// The first part of option.needs that is not met goes to `text`.
static bool needs_met(const command_line *line, const char *needs, char text[MAX_NEEDS])
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

int command_line_check_needs(command_line *line)
{
    char text[MAX_NEEDS];
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

// True if `folder` holds a SOG model whose manifest is the file `info`.
static bool is_manifest(const struct stat *info, const char *folder)
{
    static const char *const names[] = {"meta.json", "lod-meta.json"};
    bool is = false;
    for (size_t k = 0; k < sizeof names / sizeof *names && !is; ++k) {
        char *path = format_text("%s/%s", folder, names[k]);
        struct stat manifest;
        is = !stat(path, &manifest) && same_inode(info, &manifest);
        free(path);
    }
    return is;
}

// True if `path` is or would be below the folder of a SOG model with levels of detail, `model`: its
// folder or its lod-meta.json. The files of the levels are there.
static bool is_part_of_levels(const char *path, const char *model)
{
    static const char name[] = "lod-meta.json";
    const char *slash = strrchr(model, '/'), *last = slash ? slash + 1 : model;
    const bool is_named = !strcmp(last, name);
    char *folder = !is_named ? format_text("%s", model)
                   : slash   ? format_text("%.*s", (int)(slash - model), model)
                             : format_text(".");
    char *manifest = format_text("%s/%s", folder, name);
    const bool is = file_exists(manifest) && path_is_below(path, folder);
    free(manifest);
    free(folder);
    return is;
}

bool same_file(const char *a, const char *b)
{
    struct stat first, second;
    if (!strcmp(a, b) || is_part_of_levels(a, b))
        return true;
    if (stat(a, &first) || stat(b, &second))
        return same_entry(a, b);
    if (S_ISDIR(second.st_mode))
        return S_ISREG(first.st_mode) && is_manifest(&first, b);
    return S_ISREG(first.st_mode) && same_inode(&first, &second);
}

int refuse_input(const char *name, const char *path)
{
    return fail_usage("--%s: %s is an input of this command; choose another file", name, path);
}

int refuse_file_of_run(const char *name, const char *path, const char *out)
{
    const char *owner = run_file_owner(path, out);
    return owner ? fail_usage("--%s: %s is a file of %s; choose another file", name, path, owner)
                 : -1;
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

const char *option_next_output(const command_line *line, size_t *at)
{
    enum { MAX_OPTIONS = 64 }; // options of a group
    const char *path = NULL;
    for (; !path && *at < line->group_count * MAX_OPTIONS; ++*at) {
        const option_group *group = &line->groups[*at / MAX_OPTIONS];
        const size_t i = *at % MAX_OPTIONS;
        if (i < group->count &&
            (group->options[i].path == PATH_OUTPUT || !strcmp(group->options[i].name, "output")))
            path = path_of(group, i);
    }
    return path;
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
            const option *output = &line->groups[g].options[i];
            const char *path = output_of(&line->groups[g], i);
            status = path ? check_apart(line, output, path) : -1;
            if (path && status < 0)
                status = refuse_file_of_run(output->name, path, NULL);
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
    const bool later = line->fills && option_given(line, line->fills);
    const int status = later ? -1 : command_line_check_needs(line);
    return status < 0 ? check_outputs_apart(line) : status;
}

const option *find_option(const command_line *line, const char *name)
{
    option_group *group = NULL;
    return find_row(line, name, strlen(name), &group);
}

// True if the option was on the command line, or was filled if `filled`.
static bool has_bit(const command_line *line, const char *name, bool filled)
{
    option_group *group = NULL;
    const option *row = find_row(line, name, strlen(name), &group);
    return row && ((group->given | (filled ? group->filled : 0)) >> (row - group->options) & 1);
}

bool option_given(const command_line *line, const char *name)
{
    return has_bit(line, name, false);
}

bool option_set(const command_line *line, const char *name)
{
    return has_bit(line, name, true);
}

bool option_fill(const command_line *line, const char *name, const char *text)
{
    option_group *group = NULL;
    const option *row = find_row(line, name, strlen(name), &group);
    if (!row || option_given(line, name))
        return true;
    if (row->kind == OPTION_FLAG && strcmp(text, "true") != 0) {
        fail_usage("--%s: '%s' is not true or false", name, text);
        return false;
    }
    group->filled |= UINT64_C(1) << (row - group->options);
    return parse_value(row, text, group->values);
}
