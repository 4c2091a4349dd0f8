// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// What a person reads on stderr while a command works: warnings, notes, errors and the progress of
// a training. Results never pass through here.

#include <stdbool.h>
#include <stddef.h>

// Routes the library's warnings to stderr as "sparegs: warning: ...", or drops them, as at first.
void messages_hear_library(bool hear);

// Silences notes and progress (not warnings, not errors).
void messages_set_quiet(bool quiet);

// Number of warnings so far, and the k-th one (the first 100 are kept).
size_t warning_count(void);
const char *warning_text(size_t k);

void print_note(const char *format, ...) __attribute__((format(printf, 1, 2)));
void print_warning(const char *format, ...) __attribute__((format(printf, 1, 2)));

// "sparegs: ..." on stderr; returns EXIT_FAILED.
int fail_run(const char *format, ...) __attribute__((format(printf, 1, 2)));
// The same with the library's sentence of the last failed call.
int fail_library(void);

// Seconds of a monotonic clock.
double clock_seconds(void);

typedef struct progress_state {
    int iteration, total;
    double loss, psnr;
    size_t gaussians;
} progress_state;

// Starts the clock of the rate at `iteration`.
void progress_start(int iteration);
// On a terminal redraws the live line (at most ten times a second); elsewhere prints a line per 100
// iterations.
void progress_step(const progress_state *state);
// Ends the live line.
void progress_end(void);

// A live "label i/n" for short loops on a terminal; nothing elsewhere. progress_end() clears it.
void progress_count(const char *label, size_t done, size_t total);
