// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "report/table_rows.h"

#include <math.h>
#include <stdio.h>

const char *json_member_text(const json_t *object, const char *member)
{
    const char *text = json_string_value(json_object_get(object, member));
    return text ? text : "";
}

json_t *table_new(const char *title, const char *note, const char *const columns[])
{
    json_t *list = json_array();
    for (size_t k = 0; columns[k]; ++k)
        json_array_append_new(list, json_string(columns[k]));
    return json_pack("{s:s,s:s,s:o,s:[]}", "title", title, "note", note, "columns", list, "rows");
}

void table_put_text(json_t *row, const char *text)
{
    json_array_append_new(row, json_string(text));
}

void table_put_number(json_t *row, const char *format, double value)
{
    char text[64];
    snprintf(text, sizeof text, format, value);
    table_put_text(row, isnan(value) ? "-" : text);
}

void table_put_spread(json_t *row, const char *format, double value, double deviation)
{
    char center[64], spread[64], text[136];
    if (isnan(value) || isnan(deviation)) {
        table_put_number(row, format, value);
        return;
    }
    snprintf(center, sizeof center, format, value);
    snprintf(spread, sizeof spread, format, deviation);
    snprintf(text, sizeof text, "%s ± %s", center, spread);
    table_put_text(row, text);
}

void table_end_row(json_t *table, json_t *row)
{
    json_array_append_new(json_object_get(table, "rows"), row);
}
