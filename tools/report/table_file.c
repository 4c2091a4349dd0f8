// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "report/table_file.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli/input_file.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "cli/progress.h"

static size_t column_count(const char *line)
{
    size_t count = 1;
    for (; *line; ++line)
        count += *line == ',';
    return count;
}

// The numbers of a line without line end, or NULL if it is none of `columns` numbers.
static json_t *numbers(const char *line, size_t columns)
{
    json_t *row = json_array();
    const char *at = line;
    for (size_t c = 0; c < columns; ++c) {
        char *end;
        json_array_append_new(row, json_number(strtod(at, &end)));
        if (end == at || *end != (c + 1 < columns ? ',' : 0)) {
            json_decref(row);
            return NULL;
        }
        at = end + 1;
    }
    return row;
}

// Appends the rows of an open table. Returns what is wrong, or NULL; release with free().
static char *read_rows(FILE *stream, json_t *rows)
{
    static const char start[] = "iteration,";
    char *line = NULL, *fault = NULL;
    size_t room = 0, columns = 0, number = 0;
    ssize_t length;
    while (!fault && (length = getline(&line, &room, stream)) > 0 && line[length - 1] == '\n') {
        line[length - 1] = 0;
        ++number;
        json_t *row = number > 1 ? numbers(line, columns) : NULL;
        if (row)
            json_array_append_new(rows, row);
        else if (number > 1)
            fault = format_text("line %zu: is not %zu numbers", number, columns);
        else if (strncmp(line, start, sizeof start - 1))
            fault = format_text("line 1: is not the header of a table");
        columns = number > 1 ? columns : column_count(line);
    }
    if (!fault && ferror(stream))
        fault = format_text("cannot be read: %s", strerror(errno));
    else if (!fault && !number)
        fault = format_text("has no header");
    free(line);
    return fault;
}

json_t *table_file_rows(const char *folder, const char *name, const char *effect)
{
    char *path = format_text("%s/%s", folder, name), *fault = NULL;
    const char *reason = NULL;
    json_t *rows = json_array();
    FILE *stream = open_input(path, &reason);
    if (stream) {
        fault = read_rows(stream, rows);
        fclose(stream);
    } else if (errno != ENOENT) {
        fault = format_text("cannot be read: %s", reason);
    }
    if (fault) {
        json_array_clear(rows);
        print_warning("%s: %s; %s", path, fault, effect);
    }
    free(fault);
    free(path);
    return rows;
}
