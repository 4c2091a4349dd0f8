// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The program `sparegs`: dispatches to the command. Exit status: 0 success; 1 failure; 2 usage
// error; 129, 130 or 143 stopped by SIGHUP, SIGINT or SIGTERM after saving.

#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "arguments/shared_options.h"
#include "cli/commands.h"
#include "cli/json_result.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "cli/standard_output.h"
#include "options/options.h"
#include "processes/interrupt.h"
#include "processes/rank_group.h"
#include "sparegs/runtime.h"

typedef struct command {
    const char *name, *summary;
    int (*run)(int argc, char **argv);
    bool has_ranks; // runs on several processes of mpirun or srun
} command;

static const command commands[] = {
    {"train", "train a model on a data set", command_train, true},
    {"split", "divide a large scene into blocks", command_split, false},
    {"merge", "join the trained blocks of a scene", command_merge, false},
    {"eval", "compare renders of a model with the photos", command_eval, true},
    {"render", "render views as EXR, deep EXR, PNG or video", command_render, true},
    {"view", "show a model in the browser", command_view, false},
    {"info", "describe a model or a data set", command_info, false},
    {"compress", "compress a model", command_compress, false},
    {"decompress", "decompress a model to PLY or another format", command_decompress, false},
    {"convert", "convert, filter and transform a model", command_convert, false},
    {"reconstruct", "estimate the cameras of photos with COLMAP", command_reconstruct, false},
    {"explain", "report the SPARE-GS quota of each region", command_explain, false},
    {"experiment", "train the runs of a plan: scenes, pipelines, variants, seeds",
     command_experiment, true},
    {"report", "create tables and an HTML page of an experiment", command_report, false},
    {"prune", "remove the least important primitives of a model", command_prune, false},
    {"bd", "compare two rate-distortion curves: BD-rate and BD-PSNR", command_bd, false},
    {"bench", "time the phases of a training iteration against machine peaks", command_bench,
     false},
    {"profile", "profile the BVH of a model: trees, tests, hits, cost per tile", command_profile,
     false},
};

enum { COMMAND_COUNT = sizeof commands / sizeof *commands };

static void print_version(void)
{
    printf("sparegs %s (%s)\n%s\nISA: %s\n", sgs_version(), sgs_version_commit(),
           sgs_version_libraries(), sgs_isa_name(sgs_isa_get()));
}

static void print_commands(FILE *stream)
{
    fputs("Usage: sparegs COMMAND [options]\n\nTrains and renders 3D Gaussians on "
          "CPUs.\n\nCommands:\n",
          stream);
    for (int i = 0; i < COMMAND_COUNT; ++i)
        fprintf(stream, "  %-11s %s\n", commands[i].name, commands[i].summary);
    fputs(
        "  help        print this help, or that of a command: sparegs help COMMAND\n\n  --version  "
        " print the versions of the program and its libraries, and the instruction set\n\nExit "
        "status: 0 success; 1 failure; 2 usage error; 129, 130 or 143 stopped by SIGHUP, SIGINT or "
        "SIGTERM.\n",
        stream);
}

static const command *find_command(const char *name)
{
    for (int i = 0; i < COMMAND_COUNT; ++i)
        if (!strcmp(commands[i].name, name))
            return &commands[i];
    return NULL;
}

static int fail_command(const char *name)
{
    const char *words[COMMAND_COUNT + 2];
    char near[SUGGESTION_LENGTH];
    size_t count = 0;
    const bool is_option = name[0] == '-';
    for (int i = 0; i < COMMAND_COUNT && !is_option; ++i)
        words[count++] = commands[i].name;
    words[count++] = is_option ? "--help" : "help";
    if (is_option)
        words[count++] = "--version";
    return fail_usage("unknown %s '%s'%s; 'sparegs help' lists all commands",
                      is_option ? "option" : "command", name,
                      suggestion(near, "", name, words, count));
}

// The option tables of all commands.
static int print_option_lists(void)
{
    json_t *root = json_result_new(), *list = json_array();
    for (int i = 0; i < COMMAND_COUNT; ++i) {
        char help[] = "--help", json[] = "--json";
        char *arguments[] = {(char *)commands[i].name, help, json, NULL};
        if (commands[i].run(3, arguments) != EXIT_DONE)
            return EXIT_FAILED;
        json_t *entry = json_result_take();
        json_object_del(entry, "schema");
        json_object_set_new(entry, "summary", json_string(commands[i].summary));
        json_array_append_new(list, entry);
    }
    json_object_set_new(root, "commands", list);
    json_result_set(root);
    return EXIT_DONE;
}

static bool is_help(const char *name)
{
    return !strcmp(name, "help") || !strcmp(name, "--help") || !strcmp(name, "-h");
}

static int print_help_of(const char *name, bool json)
{
    if (is_help(name) && json)
        return print_option_lists();
    if (is_help(name)) {
        print_commands(stdout);
        return EXIT_DONE;
    }
    const command *found = find_command(name);
    if (!found)
        return fail_command(name);
    char help[] = "--help", as_json[] = "--json";
    char *arguments[] = {(char *)found->name, help, json ? as_json : NULL, NULL};
    return found->run(json ? 3 : 2, arguments);
}

static int run(int argc, char **argv)
{
    if (argc < 2) {
        print_commands(stderr);
        return EXIT_USAGE;
    }
    const char *name = argv[1];
    const bool helps = is_help(name);
    const bool json = helps && argc > 2 && !strcmp(argv[argc - 1], "--json");
    const int takes = !strcmp(name, "--version") ? 2 : helps ? 3 + (json && argc > 3) : argc;
    if (argc > takes)
        return fail_usage("unexpected argument '%s'; usage: sparegs %s%s", argv[takes], name,
                          helps ? " [COMMAND] [--json]" : "");
    if (!strcmp(name, "--version")) {
        print_version();
        return EXIT_DONE;
    }
    if (helps) {
        if (json && argc == 3)
            return print_option_lists();
        if (argc > 2)
            return print_help_of(argv[2], json);
        print_commands(stdout);
        return EXIT_DONE;
    }
    const command *found = find_command(name);
    if (!found)
        return fail_command(name);
    const int status = group_open(name, found->has_ranks);
    return status >= 0 ? status : group_close(found->run(argc - 1, argv + 1));
}

// True if the command line has the option --json; what follows "--" is no option.
static bool wants_json(int argc, char **argv)
{
    for (int i = 1; i < argc && strcmp(argv[i], "--"); ++i)
        if (!strcmp(argv[i], "--json"))
            return true;
    return false;
}

// A standard stream that the caller closed would be the next file that is opened.
static void open_standard_streams(void)
{
    for (int fd = open("/dev/null", O_RDWR); fd >= 0; fd = dup(fd))
        if (fd > STDERR_FILENO) {
            close(fd);
            break;
        }
}

int main(int argc, char **argv)
{
    open_standard_streams();
    signal(SIGCHLD, SIG_DFL); // if the caller ignores it, the status of a child would be lost
    stdout_buffer();
    group_silence();
    messages_hear_library(true);
    int status = run(argc, argv);
    group_let_lead_speak(status);
    if (status == EXIT_FAILED && interrupt_was_cancelled())
        status = interrupt_status();
    const bool printed = json_result_print(status, wants_json(argc, argv));
    // Standard output may hold the result, so a failed write (a full disk) is an error.
    return stdout_is_whole() && printed ? status : status == EXIT_DONE ? EXIT_FAILED : status;
}
