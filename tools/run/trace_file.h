// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A trace file for chrome://tracing and ui.perfetto.dev: the phases of each iteration, and
// counters. Functions that return bool print their error before they return false.

#include <stdbool.h>

#include "sparegs/trainer.h"

typedef struct trace_file trace_file;

// The file appears under `path` at trace_close. NULL after printing the error.
trace_file *trace_open(const char *path);

// Adds an iteration that began at `start` (clock seconds) and took `seconds`. The phases are the
// differences between the trainer's times, laid out one after the other; gather and forward
// actually alternate per macrotile.
void trace_iteration(trace_file *trace, int iteration, double start, double seconds,
                     const sgs_train_seconds *before, const sgs_train_seconds *after);
// Adds another timed event.
void trace_span(trace_file *trace, const char *name, double start, double seconds);

// Completes the file, or discards it if `keep` is false. Accepts NULL.
bool trace_close(trace_file *trace, bool keep);

// Records the phases and counters of the trainer's last step, which began at `start`; before: its
// seconds until then.
void trace_step(trace_file *trace, const sgs_trainer *trainer, double start,
                const sgs_train_seconds *before, const sgs_step_info *info);
