// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Builds the tables of a report (report_tables.h) cell by cell.

#include <jansson.h>

// The text of a member, "" if it is missing or no text.
const char *json_member_text(const json_t *object, const char *member);

// A table without rows. `columns` ends with NULL.
json_t *table_new(const char *title, const char *note, const char *const columns[]);

// Appends a cell to a row, a list. NaN is "-".
void table_put_text(json_t *row, const char *text);
void table_put_number(json_t *row, const char *format, double value);

// The same as "VALUE ± DEVIATION"; a NaN deviation is omitted.
void table_put_spread(json_t *row, const char *format, double value, double deviation);

// Appends the row to the table. Steals the reference to `row`.
void table_end_row(json_t *table, json_t *row);
