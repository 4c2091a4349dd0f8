// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Runs another program by argv, never through a shell. Its output goes line by line to a log and to
// a callback. A request to stop (interrupt.h) terminates it. Prints nothing itself.

#include <stdbool.h>
#include <sys/types.h>

enum {
    CHILD_MISSING = -1,
    CHILD_INTERRUPTED = -2,
    CHILD_UNSTARTED = -3,
    CHILD_LOST = -4,
    CHILD_TAIL = 3
};

typedef struct child_process {
    const char *const *arguments;                  // NULL-terminated; [0] is searched for in PATH
    const char *log_path;                          // receives stdout and stderr
    void (*line)(void *context, const char *text); // called per line, without newline; may be NULL
    void *context;
    // After the run: its last non-empty lines, oldest first.
    char tail[CHILD_TAIL][256];
    int signal; // the signal that terminated it, or 0
} child_process;

// Runs the program to its end. Returns the exit status (128 + signal if a signal terminated it),
// CHILD_MISSING if the program does not exist, CHILD_INTERRUPTED, CHILD_UNSTARTED, or CHILD_LOST if
// its status is unknown, as in a process that ignores SIGCHLD. The last two set errno.
int child_run(child_process *child);

// The last lines joined by " | ". Release with free().
char *child_tail(const child_process *child);

// In a new process, before exec: `signal_number` ends it, and what it executes, if its parent is
// killed. parent: the parent's getpid() before the fork. Linux only; no effect elsewhere.
void child_end_with_parent(pid_t parent, int signal_number);
