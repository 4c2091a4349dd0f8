// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Comparison of the ranks before they divide views or runs: program, options, model, and what a
// command adds. Otherwise a stale copy on one machine would change a part of the results.

#include <jansson.h>
#include <stdbool.h>
#include <stdio.h>

#include "arguments/shared_options.h"
#include "options/options.h"
#include "sparegs/gaussians.h"

typedef struct rank_work {
    const command_line *line;   // resolved values; operands may differ
    const sgs_gaussians *model; // or NULL
    // Writes further lines "what: value"; false after printing the error.
    bool (*describe)(FILE *out, const void *context);
    const void *context;
} rank_work;

// True on all ranks if they agree, or without ranks. Otherwise false on all; rank 0 has printed the
// first difference. Collective.
bool rank_work_agrees(const rank_work *work);

// For `describe`: the values that come from the run's config or the scene and not from an option.
void rank_work_write_drawing(FILE *out, const drawing_values *drawing);

// For `describe`: one line per value in an object or array, "WHAT.KEY[INDEX]: value", by ascending
// keys. False after printing the error.
bool rank_work_write_json(FILE *out, const char *what, const json_t *value);
