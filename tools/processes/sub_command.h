// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Runs a command of this program in a new process, so that the steps of an experiment share neither
// memory, threads nor crashes. Unlike child_run (child_process.h) it does not collect stderr,
// and it forwards a request to stop and waits until the process has saved its state. Ctrl-Z
// suspends both.

// arguments: NULL-terminated, [0] is the command's name. output: file that receives stdout, or NULL
// to discard it. log: file to which stderr is appended; NULL: it is that of this process. Returns
// the exit status, minus the signal if a signal killed it, or EXIT_FAILED after printing the error.
int sub_command_run(const char *const *arguments, const char *output, const char *log);

// What such a status means, after the name of the command: "failed with status 1". Release with
// free().
char *sub_command_fault(int status);

// The log for commands of a run, FOLDER/log.txt, if this process is a rank whose stderr is
// discarded, else NULL. Release with free().
char *sub_command_log(const char *folder);
