// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// GNU long options from a table: one row defines an option's name, argument, range, unit, default
// and help. Parsing, range errors and --help all use that row. Independent of any command.

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "cli/option_key.h"
#include "cli/usage_error.h"

// The argument of an option, and the type of its value.
typedef enum option_kind {
    OPTION_FLAG,    // no argument; bool
    OPTION_INTEGER, // int
    OPTION_COUNT,   // uint64_t
    OPTION_SIZE,    // size_t
    OPTION_REAL,    // double
    OPTION_TEXT,    // const char *, points into argv
    OPTION_FOLDER,  // const char *, a path whose trailing slashes are removed in argv
    OPTION_CHOICE,  // int, index into the words of `argument`: "exr|png"
    OPTION_SET, // unsigned, bit k for word k of `argument`: "h,v,c"; "on|off|h,v,c" accepts on and
                // off too, "all|h,v,c" all
    OPTION_INTEGERS, // integer_list
    OPTION_DURATION, // double, seconds: 90, 45s, 3h55m, 2d12h
    OPTION_BYTES,    // uint64_t: 8G, 500M; K, M, G, T are powers of 1024
    OPTION_COLOR     // float[3]: R,G,B in [0,1]; or the word random, a bool at random_offset
} option_kind;

// What a TEXT is as a path, for programs that fill in the options from a file: a path is relative
// to that file.
typedef enum option_path {
    PATH_NONE,   // no path, or a name inside the scene
    PATH_INPUT,  // a file or folder that exists
    PATH_OUTPUT, // a file to write; a usage error if it is an input, another output, or a file of a
                 // run or an experiment
    PATH_BLOCK   // PATH:K, a file that exists and a number; a text without ':' is no path
} option_path;

typedef struct integer_list {
    int count;
    int values[64];
} integer_list;

typedef struct option {
    const char *name; // without the dashes
    char letter;      // short form, 0 = none
    option_kind kind;
    option_path path;
    size_t offset;        // of the value inside the group's struct
    size_t random_offset; // COLOR: of the bool that the word random sets; 0 refuses the word
    // Range, both ends included, of INTEGER, COUNT, SIZE, REAL, INTEGERS, DURATION, BYTES.
    double low, high;
    const char *argument; // name in the help; the words of CHOICE and SET
    const char *unlisted; // words of CHOICE after those that the help does not name, or NULL
    const char *word;    // INTEGER, REAL: auto or all, which stands for the number `of_word`, which
    double of_word;      // may be out of the range; NULL = none
    const char *initial; // default, parsed as an argument; NULL leaves the struct's own value
    const char *shown;   // default as shown in the help; NULL = `initial`
    const char *unit;    // or NULL
    // What this option requires to have an effect: "orbit|spiral", one of these options;
    // "format=exr", a CHOICE or SET that has this word, by default too; "format=exr&output", both.
    // NULL = nothing. An option that is given without is a usage error.
    const char *needs;
    const char *help;
} option;

// Options that share a heading in --help and a struct of values. At most 64.
typedef struct option_group {
    const char *title;
    const option *options;
    size_t count;
    void *values;
    const char *unread; // "a|b|c": accepted, but not in the help: the command does not read them
    uint64_t given;     // bit k: options[k] was on the command line
    uint64_t filled;    // bit k: it was not, and option_fill has set it
} option_group;

// The command line of one command.
typedef struct command_line {
    const char *command;     // "train"
    const char *synopsis;    // "SCENE -o OUT [options]"
    const char *description; // for --help, which wraps it; "\n" ends a line
    option_group *groups;
    size_t group_count;
    int operand_minimum, operand_maximum; // at most 8
    const char *operands[8];              // out
    int operand_count;                    // out
    const char *fills; // a flag with which option_fill completes the values, or NULL: the caller
                       // then calls command_line_check_needs
    bool allow_idle;   // options without effect are not an error; then
    const char *idle;  // out: the name of the first of them, or NULL
} command_line;

// Sets the values to their defaults and then parses argv[1...]. Returns -1 to continue, or an exit
// status: EXIT_DONE after printing --help to stdout, EXIT_USAGE after printing the error to stderr.
int command_line_parse(command_line *line, int argc, char **argv);

// Sets an option that is not on the command line, as the argument `text` there would; ignores one
// that is. A FLAG is set by "true". `text` outlives the values. False after printing the error.
bool option_fill(const command_line *line, const char *name, const char *text);

// Rejects an option that has no effect without others (option.needs). Returns -1 to continue, or
// EXIT_USAGE. For a line with `fills`, where the parser leaves it to the caller.
int command_line_check_needs(command_line *line);

// True if --help lists the option.
bool option_is_listed(const option_group *group, const option *row);

// The row of an option; NULL if the command has no such option.
const option *find_option(const command_line *line, const char *name);

// The index of a word in "a|b|c"; -1 if it is NULL or not in the list.
int find_word(const char *words, const char *word);

// True if the option was on the command line.
bool option_given(const command_line *line, const char *name);
// True if it was, or if option_fill has set it.
bool option_set(const command_line *line, const char *name);

// For options whose effect depends on more than `needs`; names is "a|b|c". The first that was given
// is a usage error, or each gets a warning: "--a has no effect WHY". refuse_idle returns -1 to
// continue, or EXIT_USAGE.
int refuse_idle(const command_line *line, const char *names, const char *why);
void warn_idle(const command_line *line, const char *names, const char *why);
// True if both are the same name, the same existing file, or the same name in the same folder, or
// if `a` is the manifest of the SOG model in the folder `b`, or anything in the folder of the SOG
// model with levels of detail `b`.
bool same_file(const char *a, const char *b);
// Refuses output options that name `input`, such as the model in a run folder: returns -1 to
// continue, or EXIT_USAGE. The parser has checked them against the operands.
int refuse_outputs_at(const command_line *line, const char *input);
// The next path of an output option that was given, a file or a folder; NULL after the last. *at
// counts from 0.
const char *option_next_output(const command_line *line, size_t *at);
// Refuses the output --name, which would replace an input; returns EXIT_USAGE.
int refuse_input(const char *name, const char *path);
// Refuses the output --name, which would replace a file of a run or an experiment (run_files.h):
// returns -1 to continue, or EXIT_USAGE. The parser has checked the options with PATH_OUTPUT.
int refuse_file_of_run(const char *name, const char *path, const char *out);
