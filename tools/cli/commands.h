// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The commands of the program. Each takes argv starting with its own name and returns the exit
// status.

struct option; // options/options.h

int command_train(int argc, char **argv);
int command_split(int argc, char **argv);
int command_merge(int argc, char **argv);
int command_eval(int argc, char **argv);
int command_render(int argc, char **argv);
int command_info(int argc, char **argv);
int command_reconstruct(int argc, char **argv);
int command_bench(int argc, char **argv);
int command_profile(int argc, char **argv);
int command_explain(int argc, char **argv);
int command_experiment(int argc, char **argv);
int command_report(int argc, char **argv);
int command_prune(int argc, char **argv);
int command_bd(int argc, char **argv);
int command_compress(int argc, char **argv);
int command_decompress(int argc, char **argv);
int command_convert(int argc, char **argv);
int command_view(int argc, char **argv);

// Parses and checks a command line of `train` without running it. Returns -1 if it is valid, else
// an exit status after printing the error.
// idle NULL: an option that has no effect without others is an error. Otherwise *idle receives the
// first such option, or NULL.
int command_train_check(int argc, char **argv, const char **idle);
// The row of an option of `train`, or NULL.
const struct option *command_train_option(const char *name);
