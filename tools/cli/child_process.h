// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Running another program: by argv, never through a shell; its output line by line into a log and
// to a listener; ended when the user asks to stop (interrupt.h). Prints nothing itself.

#include <stdbool.h>

enum { CHILD_MISSING = -1, CHILD_INTERRUPTED = -2, CHILD_UNSTARTED = -3, CHILD_TAIL = 3 };

typedef struct child_process {
    const char *const *arguments;                  // NULL-terminated; [0] is looked up in PATH
    const char *log_path;                          // receives stdout and stderr
    void (*line)(void *context, const char *text); // every line, without its newline; may be NULL
    void *context;
    // After the run: its last lines that say anything, oldest first.
    char tail[CHILD_TAIL][256];
    int signal; // that ended it, or 0
} child_process;

// Waits for the end. Returns the exit status (128 + signal when one ended it), or CHILD_MISSING
// when there is no such program, CHILD_INTERRUPTED, CHILD_UNSTARTED (see errno).
int child_run(child_process *child);

// The last lines in one, separated by " | ". Release with free().
char *child_tail(const child_process *child);
