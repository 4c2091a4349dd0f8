// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// A run must be resumed with its own options, because the result would otherwise belong to neither
// set of options. Exceptions (sgs_resume_rule) are options whose new value is meaningful from then
// on: the cap and the parts of SPARE-GS from the next structural update, tolerances from the next
// check, and the length of a run with the paper's schedule.
//
// A record is essential if its option differs from the default. A version of the program that does
// not have the option can ignore a default, because it had no effect.

#include "train/checkpoint_options.h"

#include <string.h>

#include "base/core.h"
#include "sparegs/option_descriptors.h"

enum { TEXT_CAPACITY = 128, MAX_ROWS = 64 };

static bool is_recorded(const sgs_train_option *row)
{
    return row->resume != SGS_RESUME_START;
}

void sgsi_options_write(sgsi_field_list *list, const sgs_train_options *options)
{
    const sgs_train_options initial = sgs_train_options_default();
    char text[TEXT_CAPACITY], initial_text[TEXT_CAPACITY];
    size_t count;
    const sgs_train_option *rows = sgs_train_option_descriptors(&count);
    for (size_t i = 0; i < count; ++i) {
        if (!is_recorded(&rows[i]))
            continue;
        const size_t length = sgs_train_option_text(&rows[i], options, text, sizeof text);
        sgs_train_option_text(&rows[i], &initial, initial_text, sizeof initial_text);
        sgsi_fields_put(list, rows[i].name, SGSI_FIELD_TEXT, strcmp(text, initial_text) != 0, text,
                        length);
    }
}

// The file and what its options are compared with.
typedef struct comparison {
    const char *path;
    const sgs_train_options *now;
    int iteration;
    bool spare_changed;
} comparison;

static sgs_status compare(comparison *c, const sgs_train_option *row, const char *before)
{
    const char *path = c->path;
    char value[TEXT_CAPACITY];
    sgs_train_option_text(row, c->now, value, sizeof value);
    if (!strcmp(value, before) || !sgs_train_option_is_read(row, c->now))
        return SGS_STATUS_OK;
    if (sgs_train_option_may_change(row, c->now)) {
        c->spare_changed = c->spare_changed || !strncmp(row->name, "spare", 5);
        sgsi_warn("%s: option %s was %s and is %s from iteration %d on", path, row->name, before,
                  value, c->iteration + 1);
        return SGS_STATUS_OK;
    }
    return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                     "%s: option %s was %s when the run started and is %s now; resume with the "
                     "same options, or start a new run",
                     path, row->name, before, value);
}

static sgs_status compare_record(comparison *c, const sgsi_field_record *record,
                                 bool seen[MAX_ROWS])
{
    const char *path = c->path;
    size_t count;
    const sgs_train_option *rows = sgs_train_option_descriptors(&count);
    if (record->type != SGSI_FIELD_TEXT || record->bytes >= TEXT_CAPACITY)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: option %s is not a valid string", path,
                         record->name);
    char before[TEXT_CAPACITY] = "";
    memcpy(before, record->value, record->bytes);
    for (size_t i = 0; i < count && i < MAX_ROWS; ++i) {
        if (strcmp(rows[i].name, record->name) || !is_recorded(&rows[i]))
            continue;
        if (seen[i])
            return sgsi_fail(SGS_STATUS_FORMAT, "%s: option %s appears twice", path, record->name);
        seen[i] = true;
        return compare(c, &rows[i], before);
    }
    if (!record->essential)
        return SGS_STATUS_OK;
    return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                     "%s: the run uses option %s (%s), which this program does not know; resume "
                     "with the program that wrote the file",
                     path, record->name, before);
}

sgs_status sgsi_options_compare(const char *path, const uint8_t *bytes, size_t size,
                                const sgs_train_options *now, int iteration, bool *spare_changed)
{
    comparison c = {path, now, iteration, false};
    const sgs_train_options initial = sgs_train_options_default();
    bool seen[MAX_ROWS] = {false}, damaged = false;
    sgsi_field_record record;
    sgs_status status = SGS_STATUS_OK;
    const uint8_t *at = bytes, *end = bytes + size;
    while (!status && sgsi_fields_next(&at, end, &record, &damaged))
        status = compare_record(&c, &record, seen);
    if (!status && damaged)
        return sgsi_fail(SGS_STATUS_FORMAT,
                         "%s: section 'options': a field is truncated or damaged", path);
    size_t count;
    const sgs_train_option *rows = sgs_train_option_descriptors(&count);
    for (size_t i = 0; i < count && i < MAX_ROWS && !status; ++i) {
        char before[TEXT_CAPACITY];
        sgs_train_option_text(&rows[i], &initial, before, sizeof before);
        if (!seen[i] && is_recorded(&rows[i]))
            status = compare(&c, &rows[i], before);
    }
    *spare_changed = c.spare_changed;
    return status;
}
