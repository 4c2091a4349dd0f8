// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// `sparegs bd`: Bjontegaard deltas of two rate-distortion curves in CSV files.

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "cli/commands.h"
#include "cli/input_file.h"
#include "cli/json_result.h"
#include "cli/json_output.h"
#include "cli/output.h"
#include "cli/progress.h"
#include "cli/reported_files.h"
#include "arguments/shared_options.h"
#include "report/bd_doubt.h"
#include "sparegs/rate_distortion.h"

static const char description[] =
    "Compares the rate-distortion curve (size and PSNR) in TEST with that in ANCHOR: BD-rate is "
    "the mean change in size at equal PSNR, BD-PSNR the mean change in PSNR at equal size. Both "
    "files are CSV tables with a header that names the columns 'size', 'bytes' or 'MiB', and "
    "'psnr' (other columns are ignored), and three rows or more, in any order. 'size' has any "
    "unit, the same in both files; MiB if the other file has 'bytes' or 'MiB'. --select chooses "
    "the rows of one curve in a table of several, such as post.csv of an experiment. The curves "
    "are interpolated by monotone cubics (PCHIP) over ln(size).";

enum { COLUMNS = 2, MAX_POINTS = 100000, MAX_CONDITIONS = 16 };

typedef struct bd_values {
    const char *select, *select_test;
} bd_values;

static const option bd_options[] = {
    {.name = "select",
     .kind = OPTION_TEXT,
     .offset = offsetof(bd_values, select),
     .argument = "COLUMN=VALUE[,COLUMN=VALUE...]",
     .shown = "all rows",
     .help = "use only the rows that have these values"},
    {.name = "select-test",
     .kind = OPTION_TEXT,
     .offset = offsetof(bd_values, select_test),
     .argument = "COLUMN=VALUE[,COLUMN=VALUE...]",
     .shown = "as --select",
     .help = "use only the rows of TEST with these values; --select then applies to ANCHOR only"},
};

// The conditions of --select, and the columns of the table that is read.
typedef struct selection {
    const char *text; // as given, or NULL: all rows
    char *names;      // a copy, with '\0' after each name and value
    const char *columns[MAX_CONDITIONS], *values[MAX_CONDITIONS];
    int count;
} selection;

// Names of the column of the sizes, in the order in which they are looked for.
typedef enum size_unit { ANY_UNIT, BYTES, MIB, UNITS } size_unit;
static const char *const unit_columns[UNITS] = {"size", "bytes", "MiB"};

typedef struct curve {
    sgs_rd_point *points;
    size_t count;
    size_unit unit;
} curve;

// Length of the field that begins at `at`: up to the next comma outside of double quotes.
static size_t field_length(const char *at)
{
    size_t length = 0;
    for (bool quoted = false; at[length] && !strchr("\r\n", at[length]); ++length) {
        quoted ^= at[length] == '"';
        if (at[length] == ',' && !quoted)
            break;
    }
    return length;
}

// Splits a line at commas in place, without surrounding spaces and quotes. Returns the field
// `index`, or NULL.
static char *field_of(char *line, int index)
{
    char *at = line;
    for (int k = 0; k < index && at; ++k) {
        at += field_length(at);
        at = *at == ',' ? at + 1 : NULL;
    }
    if (!at)
        return NULL;
    size_t length = field_length(at);
    const size_t before = strspn(at, " \t\"");
    at += before < length ? before : length;
    length -= before < length ? before : length;
    while (length && strchr(" \t\"", at[length - 1]))
        --length;
    at[length] = '\0';
    return at;
}

// The index of a column of the header, or -1.
static int column_of(const char *header, const char *name)
{
    char *copy = format_text("%s", header);
    int column = -1, k = 0;
    for (char *at = copy; at && column < 0; ++k) {
        const size_t length = field_length(at);
        char *next = at[length] == ',' ? at + length + 1 : NULL;
        at[length] = '\0';
        const char *field = field_of(at, 0);
        column = !strcasecmp(field, name) ? k : -1;
        at = next;
    }
    free(copy);
    return column;
}

// Parses COLUMN=VALUE,... Returns -1 to continue, or an exit status.
static int selection_parse(const char *option_name, const char *text, selection *rows)
{
    *rows = (selection){.text = text, .names = text ? format_text("%s", text) : NULL};
    for (char *at = rows->names; at;) {
        char *next = strchr(at, ','), *equal = strchr(at, '=');
        if (next)
            *next++ = '\0';
        if (!equal || equal == at || (next && equal >= next) || rows->count == MAX_CONDITIONS)
            return fail_usage("--%s: '%s' is not COLUMN=VALUE[,COLUMN=VALUE...] with at most %d "
                              "columns",
                              option_name, text, MAX_CONDITIONS);
        *equal = '\0';
        rows->columns[rows->count] = at;
        rows->values[rows->count++] = equal + 1;
        at = next;
    }
    return -1;
}

// The columns of a table: of size and PSNR, and of the conditions.
typedef struct table_columns {
    int values[COLUMNS], conditions[MAX_CONDITIONS];
    size_unit unit;
} table_columns;

// False after printing the error if a column is missing.
static bool find_columns(const char *path, size_t row, const char *header, const selection *rows,
                         table_columns *found)
{
    found->values[0] = -1;
    for (int unit = UNITS - 1; unit >= 0; --unit) {
        const int column = column_of(header, unit_columns[unit]);
        found->values[0] = column >= 0 ? column : found->values[0];
        found->unit = column >= 0 ? (size_unit)unit : found->unit;
    }
    found->values[1] = column_of(header, "psnr");
    if (found->values[0] < 0 || found->values[1] < 0) {
        fail_run("%s: line %zu: the header has no column '%s'; the first line must name 'size', "
                 "'bytes' or 'MiB', and 'psnr'",
                 path, row, found->values[0] < 0 ? "size" : "psnr");
        return false;
    }
    for (int k = 0; k < rows->count; ++k) {
        found->conditions[k] = column_of(header, rows->columns[k]);
        if (found->conditions[k] < 0) {
            fail_run("%s: line %zu: the header has no column '%s' to select by", path, row,
                     rows->columns[k]);
            return false;
        }
    }
    return true;
}

static bool is_selected(const char *line, const selection *rows, const table_columns *columns)
{
    bool is = true;
    for (int k = 0; k < rows->count && is; ++k) {
        char *copy = format_text("%s", line);
        const char *field = field_of(copy, columns->conditions[k]);
        is = field && !strcmp(field, rows->values[k]);
        free(copy);
    }
    return is;
}

// The number in a column of a row. False after printing the error.
static bool number_of(const char *path, size_t row, const char *line, int column, const char *name,
                      double *value)
{
    char *copy = format_text("%s", line), *end = copy;
    const char *field = field_of(copy, column);
    *value = field ? strtod(field, &end) : NAN;
    const bool valid = field && *field && !*end && isfinite(*value);
    if (!valid)
        fail_run("%s: line %zu: %s is '%.40s'; a finite number is required", path, row, name,
                 field ? field : "");
    free(copy);
    return valid;
}

static bool curve_add(const char *path, size_t row, const char *line, const table_columns *columns,
                      curve *read)
{
    sgs_rd_point point;
    const char *size_name = unit_columns[columns->unit];
    if (!number_of(path, row, line, columns->values[0], size_name, &point.size) ||
        !number_of(path, row, line, columns->values[1], "psnr", &point.psnr))
        return false;
    if (!(point.size > 0)) {
        fail_run("%s: line %zu: %s is %g; it must be positive", path, row, size_name, point.size);
        return false;
    }
    if (read->count == MAX_POINTS) {
        fail_run("%s: more than %d rows", path, MAX_POINTS);
        return false;
    }
    sgs_rd_point *grown = realloc(read->points, (read->count + 1) * sizeof *grown);
    if (!grown) {
        fail_run("%s: not enough memory for %zu rows", path, read->count + 1);
        return false;
    }
    read->points = grown;
    read->points[read->count++] = point;
    return true;
}

static bool is_blank(const char *line)
{
    return !line[strspn(line, " \t\r\n")];
}

enum { MAX_LINE = 1 << 16 };

// The next line, with its end. False at the end of the file, or with *valid false after printing
// the error.
static bool read_line(const char *path, FILE *stream, size_t row, char line[MAX_LINE], bool *valid)
{
    size_t length = 0;
    int c = 0;
    while (length < MAX_LINE - 1 && c != '\n' && (c = getc(stream)) > 0)
        line[length++] = (char)c;
    line[length] = '\0';
    *valid = false;
    if (c == 0)
        fail_run("%s: line %zu: contains a NUL byte; a text file is required", path, row);
    else if (c == EOF && ferror(stream))
        fail_run("%s: %s", path, strerror(errno));
    else if (length == MAX_LINE - 1 && c != '\n')
        fail_run("%s: line %zu: is longer than %d bytes", path, row, MAX_LINE - 2);
    else
        *valid = true;
    return *valid && length;
}

#define BYTE_ORDER_MARK "\xef\xbb\xbf" // begins tables that spreadsheets export as UTF-8

static bool read_rows(const char *path, FILE *stream, const selection *rows, curve *read)
{
    table_columns columns = {0};
    char line[MAX_LINE];
    size_t row = 0;
    bool valid = true, header = true;
    while (valid && read_line(path, stream, ++row, line, &valid)) {
        if (row == 1 && !strncmp(line, BYTE_ORDER_MARK, strlen(BYTE_ORDER_MARK)))
            memmove(line, line + strlen(BYTE_ORDER_MARK),
                    strlen(line + strlen(BYTE_ORDER_MARK)) + 1);
        if (is_blank(line))
            continue;
        if (!header) {
            valid =
                !is_selected(line, rows, &columns) || curve_add(path, row, line, &columns, read);
            continue;
        }
        header = false;
        valid = find_columns(path, row, line, rows, &columns);
        read->unit = columns.unit;
    }
    return valid;
}

static bool curve_read(const char *path, const selection *rows, curve *read)
{
    const char *reason = NULL;
    FILE *stream = open_input(path, &reason);
    if (!stream) {
        fail_run("%s: %s", path, reason);
        return false;
    }
    bool valid = read_rows(path, stream, rows, read);
    fclose(stream);
    if (valid && read->count < 3) {
        fail_run("%s: %zu rows%s%s; at least 3 points of size and PSNR are required", path,
                 read->count, rows->text ? " with " : "", rows->text ? rows->text : "");
        valid = false;
    }
    return valid;
}

// Two tables with 'size' may have any unit, else all are bytes. The tables of `report` and of
// papers use MiB.
static void convert_to_bytes(const char *const paths[2], curve curves[2])
{
    for (int k = 0; k < 2; ++k) {
        if (curves[k].unit == BYTES || (curves[0].unit == ANY_UNIT && curves[1].unit == ANY_UNIT))
            continue;
        if (curves[k].unit == ANY_UNIT)
            print_note("%s: column 'size' is taken as MiB, because %s has '%s'", paths[k],
                       paths[1 - k], unit_columns[curves[1 - k].unit]);
        for (size_t i = 0; i < curves[k].count; ++i)
            curves[k].points[i].size *= 1024.0 * 1024.0;
        curves[k].unit = BYTES;
    }
}

static void warn_unreliable(const sgs_bd *bd)
{
    int k = 0;
    for (char *doubt; (doubt = bd_doubt(bd, k)); ++k) {
        print_warning("%s", doubt);
        free(doubt);
    }
}

static void print_figure(const char *name, double value, const char *unit, const char *reason)
{
    if (reason)
        printf("%-8s  N/A (%s)\n", name, reason);
    else
        printf("%-8s  %+.2f %s\n", name, value, unit);
}

static bool print_deltas(const sgs_bd *bd, bool json)
{
    if (!json) {
        print_figure("BD-rate", bd->rate_percent, "%", bd->rate_reason);
        print_figure("BD-PSNR", bd->psnr_db, "dB", bd->psnr_reason);
        return true;
    }
    json_t *root = json_result_new();
    json_object_set_new(root, "bd_rate_percent", json_number(bd->rate_percent));
    json_object_set_new(root, "bd_psnr_db", json_number(bd->psnr_db));
    json_object_set_new(root, "common_psnr_db", json_number(bd->common_psnr_db));
    json_object_set_new(root, "bd_rate_reason",
                        bd->rate_reason ? json_string(bd->rate_reason) : json_null());
    json_object_set_new(root, "bd_psnr_reason",
                        bd->psnr_reason ? json_string(bd->psnr_reason) : json_null());
    return print_json(root);
}

int command_bd(int argc, char **argv)
{
    command_call call;
    bd_values values = {0};
    const command_spec spec = {.name = "bd",
                               .synopsis = "ANCHOR.csv TEST.csv [options]",
                               .description = description,
                               .operand_minimum = 2,
                               .operand_maximum = 2,
                               .title = "Tables",
                               .options = bd_options,
                               .option_count = sizeof bd_options / sizeof *bd_options,
                               .values = &values};
    selection of_anchor = {0}, of_test = {0};
    int status = command_begin(&spec, argc, argv, &call);
    if (status < 0)
        status = selection_parse("select", values.select, &of_anchor);
    if (status < 0)
        status = values.select_test ? selection_parse("select-test", values.select_test, &of_test)
                                    : selection_parse("select", values.select, &of_test);
    curve curves[2] = {0};
    const char *const *paths = (const char *const *)call.line.operands;
    bool done = status < 0 && curve_read(paths[0], &of_anchor, &curves[0]) &&
                curve_read(paths[1], &of_test, &curves[1]);
    if (done) {
        sgs_bd bd;
        convert_to_bytes(paths, curves);
        done = !sgs_bd_compute(curves[0].points, curves[0].count, curves[1].points, curves[1].count,
                               &bd);
        if (!done)
            fail_library();
        else
            warn_unreliable(&bd);
        done = done && print_deltas(&bd, call.common.json);
    }
    free(of_anchor.names);
    free(of_test.names);
    free(curves[0].points);
    free(curves[1].points);
    return status >= 0 ? status : done ? EXIT_DONE : EXIT_FAILED;
}
