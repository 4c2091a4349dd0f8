// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Whether the times of runs can be compared: those of other numbers of threads or ranks, of another
// instruction set or of another version of the program cannot.

#include <jansson.h>
#include <stdbool.h>

enum { TIME_CONDITIONS = 4 };

typedef struct time_conditions {
    const json_t *values[TIME_CONDITIONS]; // of the first record that has them; borrowed
    unsigned differing;                    // bits of the conditions that differ; 0: comparable
} time_conditions;

// Adds a record with "threads", "ranks", "isa" and "commit", which must outlive *conditions. What
// it lacks does not differ.
void time_conditions_add(time_conditions *conditions, const json_t *record);

// Adds a run of results.json: the sessions in which it was trained if it has them, and what they
// lack of its summary, whose session may have evaluated only.
void time_conditions_add_run(time_conditions *conditions, const json_t *run);

// Appends the sentence that explains missing changes of time to the note of a table, if bits of
// any comparison are set.
void time_conditions_add_note(json_t *table, unsigned differing);
