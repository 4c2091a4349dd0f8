// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "report/time_conditions.h"

#include <stdlib.h>

#include "cli/output.h"
#include "report/table_rows.h"

static const char *const names[TIME_CONDITIONS] = {"threads", "ranks", "isa", "commit"};

static void add(time_conditions *conditions, int k, const json_t *value)
{
    if (!conditions->values[k])
        conditions->values[k] = value;
    else if (value && !json_equal(value, conditions->values[k]))
        conditions->differing |= 1u << k;
}

void time_conditions_add(time_conditions *conditions, const json_t *record)
{
    for (int k = 0; k < TIME_CONDITIONS; ++k)
        add(conditions, k, json_object_get(record, names[k]));
}

void time_conditions_add_run(time_conditions *conditions, const json_t *run)
{
    const json_t *summary = json_object_get(run, "summary"),
                 *sessions = json_object_get(run, "sessions");
    for (int k = 0; k < TIME_CONDITIONS; ++k) {
        const json_t *session;
        size_t i;
        bool recorded = false;
        json_array_foreach(sessions, i, session)
        {
            const json_t *value = json_object_get(session, names[k]);
            recorded = recorded || value;
            add(conditions, k, value);
        }
        if (!recorded)
            add(conditions, k, json_object_get(summary, names[k]));
    }
}

void time_conditions_add_note(json_t *table, unsigned differing)
{
    if (!differing)
        return;
    char *list = format_text("%s", "");
    for (int k = 0; k < TIME_CONDITIONS; ++k) {
        if (!(differing >> k & 1))
            continue;
        char *longer = format_text("%s%s%s", list, *list ? ", " : "", names[k]);
        free(list);
        list = longer;
    }
    char *note = format_text("%s Δ time is \"-\" where the compared runs differ in: %s.",
                             json_member_text(table, "note"), list);
    json_object_set_new(table, "note", json_string(note));
    free(note);
    free(list);
}
