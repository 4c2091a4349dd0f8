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
#include "cli/shared_options.h"
#include "sparegs/rate_distortion.h"

static const char description[] =
    "Compares the rate-distortion curve (size and PSNR) in TEST with that in ANCHOR: BD-rate is "
    "the mean change in size at equal PSNR, BD-PSNR the mean change in PSNR at equal size. Both "
    "files are CSV tables with a header that names the columns 'size' and 'psnr' (other columns "
    "are ignored) and three rows or more, in any order. The curves are interpolated by monotone "
    "cubics (PCHIP) over ln(size).";

enum { COLUMNS = 2, MOST_POINTS = 100000 };

typedef struct curve {
    sgs_rd_point *points;
    size_t count;
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
    for (int k = 0;; ++k) {
        char *copy = format_text("%s", header); // field_of ends the field in it
        const char *field = field_of(copy, k);
        const bool ended = !field, same = field && !strcasecmp(field, name);
        free(copy);
        if (ended || same)
            return same ? k : -1;
    }
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

static bool curve_add(const char *path, size_t row, const char *line, const int columns[COLUMNS],
                      curve *read)
{
    sgs_rd_point point;
    if (!number_of(path, row, line, columns[0], "size", &point.size) ||
        !number_of(path, row, line, columns[1], "psnr", &point.psnr))
        return false;
    if (!(point.size > 0)) {
        fail_run("%s: line %zu: size is %g; it must be positive", path, row, point.size);
        return false;
    }
    if (read->count == MOST_POINTS) {
        fail_run("%s: more than %d rows", path, MOST_POINTS);
        return false;
    }
    sgs_rd_point *grown = realloc(read->points, (read->count + 1) * sizeof *grown);
    if (!grown) {
        fail_run("%s: no memory for %zu rows", path, read->count + 1);
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

#define BYTE_ORDER_MARK "\xef\xbb\xbf" // begins tables that spreadsheets export as UTF-8

static bool read_rows(const char *path, FILE *stream, curve *read)
{
    int columns[COLUMNS] = {-1, -1};
    char *line = NULL;
    size_t room = 0, row = 0;
    bool valid = true, header = true;
    while (valid && getline(&line, &room, stream) > 0) {
        if (++row == 1 && !strncmp(line, BYTE_ORDER_MARK, strlen(BYTE_ORDER_MARK)))
            memmove(line, line + strlen(BYTE_ORDER_MARK),
                    strlen(line + strlen(BYTE_ORDER_MARK)) + 1);
        if (is_blank(line))
            continue;
        if (!header) {
            valid = curve_add(path, row, line, columns, read);
            continue;
        }
        header = false;
        columns[0] = column_of(line, "size");
        columns[1] = column_of(line, "psnr");
        valid = columns[0] >= 0 && columns[1] >= 0;
        if (!valid)
            fail_run("%s: line %zu: the header has no column '%s'; the first line must name "
                     "'size' and 'psnr'",
                     path, row, columns[0] < 0 ? "size" : "psnr");
    }
    free(line);
    if (valid && ferror(stream)) {
        fail_run("%s: %s", path, strerror(errno));
        valid = false;
    }
    return valid;
}

static bool curve_read(const char *path, curve *read)
{
    const char *reason = NULL;
    FILE *stream = open_input(path, &reason);
    if (!stream) {
        fail_run("%s: %s", path, reason);
        return false;
    }
    bool valid = read_rows(path, stream, read);
    fclose(stream);
    if (valid && read->count < 3) {
        fail_run("%s: %zu rows; at least 3 points of size and PSNR are required", path,
                 read->count);
        valid = false;
    }
    return valid;
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
    json_object_set_new(root, "bd_rate_reason",
                        bd->rate_reason ? json_string(bd->rate_reason) : json_null());
    json_object_set_new(root, "bd_psnr_reason",
                        bd->psnr_reason ? json_string(bd->psnr_reason) : json_null());
    return print_json(root);
}

int command_bd(int argc, char **argv)
{
    command_call call;
    const command_spec spec = {.name = "bd",
                               .synopsis = "ANCHOR.csv TEST.csv [options]",
                               .description = description,
                               .operand_minimum = 2,
                               .operand_maximum = 2};
    const int status = command_begin(&spec, argc, argv, &call);
    if (status >= 0)
        return status;
    curve anchor = {0}, test = {0};
    bool done =
        curve_read(call.line.operands[0], &anchor) && curve_read(call.line.operands[1], &test);
    if (done) {
        sgs_bd bd;
        done = !sgs_bd_compute(anchor.points, anchor.count, test.points, test.count, &bd);
        if (!done)
            fail_library();
        else if (bd.ties)
            print_warning("%zu points have the PSNR or size of another point of their curve and "
                          "are moved by 1e-9",
                          bd.ties);
        done = done && print_deltas(&bd, call.common.json);
    }
    free(anchor.points);
    free(test.points);
    return done ? EXIT_DONE : EXIT_FAILED;
}
