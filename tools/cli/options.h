// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// GNU long options from a table: one row names an option, its argument, range, unit, default and
// help; parsing, range errors and --help all come from that row. Knows no command and no training.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { EXIT_DONE = 0, EXIT_FAILED = 1, EXIT_USAGE = 2 };

// What an option takes, and the type of its value.
typedef enum option_kind {
    OPTION_FLAG,    // nothing; bool
    OPTION_INTEGER, // int
    OPTION_COUNT,   // uint64_t
    OPTION_REAL,    // double
    OPTION_TEXT,    // const char *, points into argv
    OPTION_CHOICE,  // int, index into the words of `argument`: "exr|png"
    OPTION_SET, // unsigned, bit k for word k of `argument`: "h,v,c"; "on|off|h,v,c" accepts on and
                // off too, "all|h,v,c" all
    OPTION_INTEGERS, // integer_list
    OPTION_DURATION, // double, seconds: 90, 45s, 3h55m, 2d12h
    OPTION_BYTES,    // uint64_t: 8G, 500M; K, M, G, T are powers of 1024
    OPTION_COLOR     // color_value: R,G,B in [0,1] or the word random
} option_kind;

typedef struct integer_list {
    int count;
    int values[64];
} integer_list;

typedef struct color_value {
    float rgb[3];
    bool random;
} color_value;

typedef struct option {
    const char *name; // without the dashes
    char letter;      // short form, 0 = none
    option_kind kind;
    size_t offset; // of the value inside the group's struct
    // Range, both ends included, of INTEGER, COUNT, REAL, INTEGERS, DURATION, BYTES.
    double low, high;
    const char *argument; // what the help calls it; the words of CHOICE and SET
    const char *initial;  // default, parsed as an argument; NULL leaves the struct's own value
    const char *shown;    // default as the help prints it; NULL = `initial`
    const char *unit;     // or NULL
    // Options of the same line without which this one has no effect: "orbit|spiral", one of them is
    // required; NULL = it always has an effect. Given without them it is a usage error.
    const char *needs;
    const char *help;
} option;

// Options that are described and parsed together into one struct. At most 64.
typedef struct option_group {
    const char *title;
    const option *options;
    size_t count;
    void *values;
    uint64_t given; // bit k: options[k] was on the command line
} option_group;

// One command's whole line.
typedef struct command_line {
    const char *command;     // "train"
    const char *synopsis;    // "SCENE -o OUT [options]"
    const char *description; // paragraphs for --help
    option_group *groups;
    size_t group_count;
    int operand_minimum, operand_maximum; // at most 8
    const char *operands[8];              // out
    int operand_count;                    // out
} command_line;

// Fills the values with the defaults and then with argv[1...]. Returns -1 to go on, or an exit
// status: EXIT_DONE after printing --help to stdout, EXIT_USAGE after naming the mistake on stderr.
int command_line_parse(command_line *line, int argc, char **argv);

// True if the option was on the command line.
bool option_given(const command_line *line, const char *name);

// The word nearest to `text`: one that begins with it, else the least edit distance. NULL if count
// is 0.
const char *nearest_word(const char *text, const char *const *words, size_t count);

// One line on stderr, "sparegs: ...", and EXIT_USAGE.
int fail_usage(const char *format, ...) __attribute__((format(printf, 1, 2)));
// What to name before each such message, as the file that the options are from; NULL for nothing.
void fail_usage_within(const char *context);
