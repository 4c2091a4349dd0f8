// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Messages on stderr: warnings, notes, errors and training progress. Results go to stdout
// (output.h).

#include <stdbool.h>
#include <stddef.h>

// Prints the library's warnings to stderr as "sparegs: warning: ...", or drops them (the default).
void messages_hear_library(bool hear);

// Disables notes and progress, not warnings and errors.
void messages_set_quiet(bool quiet);

// The last error, without "sparegs: "; "" if there was none.
const char *last_error_text(void);
// For an error that was printed by other means.
void last_error_set(const char *text);

// Replaces control characters by '?': a message quotes files and arguments, and is one line.
void make_printable(char *text);

// While held, errors are not printed but kept for last_error_text(), which is empty at first: for a
// part of a command whose failure is only a warning.
void errors_hold(bool hold);

// Number of warnings so far, and the k-th one (only the first 100 are kept).
size_t warning_count(void);
const char *warning_text(size_t k);

void print_note(const char *format, ...) __attribute__((format(printf, 1, 2)));
void print_warning(const char *format, ...) __attribute__((format(printf, 1, 2)));

// Prints "sparegs: ..." to stderr and returns EXIT_FAILED.
int fail_run(const char *format, ...) __attribute__((format(printf, 1, 2)));
// fail_run with the library's message of the last failed call.
int fail_library(void);

// Seconds of a monotonic clock.
double clock_seconds(void);

typedef struct progress_state {
    int iteration, total;
    double loss, psnr;
    size_t gaussians;
} progress_state;

// Starts measuring the rate at `iteration`.
void progress_start(int iteration);
// On a terminal redraws the progress line, at most ten times per second; otherwise prints a line
// per 100 iterations.
void progress_step(const progress_state *state);
// Call repeatedly while the training is paused, which does not count for the rate. On a terminal
// the progress line then says "paused".
void progress_pause(const progress_state *state);
// Clears the progress line.
void progress_end(void);

// Shows "label i/n" on a terminal, for short loops. progress_end() clears it.
void progress_count(const char *label, size_t done, size_t total);

// The same for long loops, with the time left, at most ten times per second. The time is measured
// from the first call after progress_work_start().
void progress_work_start(void);
void progress_work(const char *label, size_t done, size_t total);
