// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The tables of an experiment's report, from results.json: means over scenes and seeds, and the
// changes due to SPARE-GS.

#include <jansson.h>

// A list of {"title", "note", "columns": [text], "rows": [[text]]}. `results` is the parsed
// results.json.
json_t *report_tables(const json_t *results);

// The tables as Markdown. Release with free().
char *report_markdown(const json_t *results, const json_t *tables);
