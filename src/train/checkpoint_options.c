// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// One row per option that shapes the result. A run continued with other values would be neither of
// the two runs, so a difference is refused, except where a later value is meaningful by itself: a
// new cap holds from the next structural update on, new tolerances from the next check on, and the
// paper's schedule is the same for any length.

#include "train/checkpoint_options.h"

#include <inttypes.h>
#include <string.h>

#include "base/core.h"

typedef enum value_kind {
    VALUE_INT,
    VALUE_UNSIGNED,
    VALUE_SIZE,
    VALUE_U64,
    VALUE_BOOL,
    VALUE_DOUBLE,
    VALUE_COLOR
} value_kind;
typedef enum value_rule { FIXED, MAY_CHANGE, MAY_CHANGE_UNDER_PAPER } value_rule;

typedef struct option_row {
    const char *name; // of the command line
    size_t offset;
    value_kind kind;
    value_rule rule;
} option_row;

#define ROW(name, member, kind, rule)                                                              \
    {                                                                                              \
        name, offsetof(sgs_train_options, member), kind, rule                                      \
    }
static const option_row rows[] = {
    ROW("iterations", iterations, VALUE_INT, MAY_CHANGE_UNDER_PAPER),
    ROW("schedule", schedule, VALUE_INT, FIXED),
    ROW("pipeline", pipeline, VALUE_INT, FIXED),
    ROW("filter", filter, VALUE_INT, FIXED),
    ROW("optimizer", optimizer, VALUE_INT, FIXED),
    ROW("sh-degree", sh_degree, VALUE_INT, FIXED),
    ROW("compact-box", compact_box, VALUE_DOUBLE, FIXED),
    ROW("background", background, VALUE_COLOR, FIXED),
    ROW("background-random", background_random, VALUE_BOOL, FIXED),
    ROW("max-gaussians", max_gaussians, VALUE_SIZE, MAY_CHANGE),
    ROW("seed", seed, VALUE_U64, FIXED),
    ROW("spare", spare, VALUE_UNSIGNED, FIXED),
    ROW("spare-grid", spare_grid, VALUE_INT, FIXED),
    ROW("spare-tau-alpha", spare_tau_alpha, VALUE_DOUBLE, FIXED),
    ROW("spare-eps-loss", spare_eps_loss, VALUE_DOUBLE, MAY_CHANGE),
    ROW("spare-eps-count", spare_eps_count, VALUE_DOUBLE, MAY_CHANGE),
    ROW("spare-patience", spare_patience, VALUE_INT, MAY_CHANGE),
    ROW("spare-interval", spare_interval, VALUE_INT, FIXED),
    ROW("exposure", exposure, VALUE_BOOL, FIXED),
    ROW("alpha-loss", alpha_loss, VALUE_DOUBLE, FIXED),
    ROW("spare-demand", spare_demand, VALUE_UNSIGNED, FIXED),
    ROW("spare-phi", spare_phi, VALUE_INT, FIXED),
    ROW("spare-budget", spare_budget, VALUE_DOUBLE, FIXED),
    ROW("spare-target", spare_target, VALUE_INT, FIXED),
    ROW("taming-multiplier", pipeline_options.taming_multiplier, VALUE_DOUBLE, FIXED),
    ROW("taming-count", pipeline_options.taming_count, VALUE_SIZE, FIXED),
    ROW("taming-opacity", pipeline_options.taming_opacity, VALUE_INT, FIXED),
    ROW("dash-count", pipeline_options.dash_count, VALUE_SIZE, FIXED),
    ROW("fastgs-loss", pipeline_options.fastgs_loss, VALUE_DOUBLE, FIXED),
    ROW("fastgs-gradient", pipeline_options.fastgs_gradient, VALUE_DOUBLE, FIXED),
    ROW("fastgs-dense", pipeline_options.fastgs_dense, VALUE_DOUBLE, FIXED),
};
enum { ROWS = sizeof rows / sizeof *rows, TEXT_CAPACITY = 96 };

// init and random_points shape the first model only, which the checkpoint replaces.
_Static_assert(
    sizeof(void *) != 8 || sizeof(sgs_train_options) == 216,
    "sgs_train_options has changed: give the new option a row above, then correct the size here");

static void value_text(const option_row *row, const sgs_train_options *options,
                       char text[TEXT_CAPACITY])
{
    const void *value = (const char *)options + row->offset;
    switch (row->kind) {
    case VALUE_INT:
        snprintf(text, TEXT_CAPACITY, "%d", *(const int *)value);
        break;
    case VALUE_UNSIGNED:
        snprintf(text, TEXT_CAPACITY, "%u", *(const unsigned *)value);
        break;
    case VALUE_SIZE:
        snprintf(text, TEXT_CAPACITY, "%zu", *(const size_t *)value);
        break;
    case VALUE_U64:
        snprintf(text, TEXT_CAPACITY, "%" PRIu64, *(const uint64_t *)value);
        break;
    case VALUE_BOOL:
        snprintf(text, TEXT_CAPACITY, "%d", *(const bool *)value);
        break;
    case VALUE_DOUBLE:
        snprintf(text, TEXT_CAPACITY, "%.17g", *(const double *)value);
        break;
    case VALUE_COLOR: {
        const float *c = value;
        snprintf(text, TEXT_CAPACITY, "%.9g,%.9g,%.9g", (double)c[0], (double)c[1], (double)c[2]);
    }
    }
}

char *sgsi_options_text(const sgs_train_options *options)
{
    char text[ROWS * (TEXT_CAPACITY + 32)], value[TEXT_CAPACITY];
    size_t used = 0;
    for (size_t i = 0; i < ROWS; ++i) {
        value_text(&rows[i], options, value);
        used += (size_t)snprintf(text + used, sizeof text - used, "%s=%s\n", rows[i].name, value);
    }
    return sgsi_strdup(text);
}

static sgs_status compare(const char *path, const option_row *row, const char *before,
                          const sgs_train_options *now, int iteration)
{
    char value[TEXT_CAPACITY];
    value_text(row, now, value);
    if (!strcmp(value, before))
        return SGS_STATUS_OK;
    if (row->rule == MAY_CHANGE ||
        (row->rule == MAY_CHANGE_UNDER_PAPER && now->schedule == SGS_SCHEDULE_PAPER)) {
        sgsi_warn("%s: --%s was %s and is %s from iteration %d on", path, row->name, before, value,
                  iteration + 1);
        return SGS_STATUS_OK;
    }
    return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                     "%s: --%s was %s when this run was started and is %s now; resume with the "
                     "same options, or train into "
                     "another folder",
                     path, row->name, before, value);
}

static sgs_status compare_line(const char *path, char *line, const sgs_train_options *now,
                               int iteration, bool seen[ROWS])
{
    char *equals = strchr(line, '=');
    if (!equals)
        return sgsi_fail(SGS_STATUS_FORMAT, "%s: its options are not readable", path);
    *equals = 0;
    for (size_t i = 0; i < ROWS; ++i) {
        if (strcmp(rows[i].name, line))
            continue;
        seen[i] = true;
        return compare(path, &rows[i], equals + 1, now, iteration);
    }
    return sgsi_fail(SGS_STATUS_UNSUPPORTED,
                     "%s: was made with the option --%.64s, which this program does not know", path,
                     line);
}

sgs_status sgsi_options_agree(const char *path, const char *text, size_t bytes,
                              const sgs_train_options *now, int iteration)
{
    char *copy = sgsi_alloc(bytes + 1, 1), *rest = NULL;
    if (!copy)
        return sgsi_fail(SGS_STATUS_OUT_OF_MEMORY, "%s: no memory to read it", path);
    memcpy(copy, text, bytes);
    copy[bytes] = 0;
    bool seen[ROWS] = {false};
    sgs_status status = SGS_STATUS_OK;
    for (char *line = strtok_r(copy, "\n", &rest); line && !status;
         line = strtok_r(NULL, "\n", &rest))
        status = compare_line(path, line, now, iteration, seen);
    for (size_t i = 0; i < ROWS && !status; ++i)
        if (!seen[i])
            status = sgsi_fail(SGS_STATUS_FORMAT, "%s: does not record the option --%s", path,
                               rows[i].name);
    sgsi_free(copy);
    return status;
}
