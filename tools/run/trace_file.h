// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A file in the trace format of Chrome (chrome://tracing, ui.perfetto.dev): one row of phases per
// iteration and counters beside it. Functions that return bool have printed their error when they
// return false.

#include <stdbool.h>

#include "sparegs/trainer.h"

typedef struct trace_file trace_file;

// Nothing appears under the path before trace_close. NULL after printing the error.
trace_file *trace_open(const char *path);

// One iteration that began `start` seconds after the clock's zero and took `seconds`: its phases
// are the differences of the trainer's times. They are drawn one after the other in the order in
// which they begin; gather and forward take turns bin by bin.
void trace_iteration(trace_file *trace, int iteration, double start, double seconds,
                     const sgs_train_seconds *before, const sgs_train_seconds *after);
// Something else that took time.
void trace_span(trace_file *trace, const char *name, double start, double seconds);
// A number that changes with time.
void trace_count(trace_file *trace, const char *name, double time, double value);

// Completes the file, or with `keep` false drops it. Accepts NULL.
bool trace_close(trace_file *trace, bool keep);
