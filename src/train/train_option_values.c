// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Values of training options: their ranges, and their text.

#include "sparegs/option_descriptors.h"

#include <inttypes.h>
#include <stdlib.h>
#include <string.h>

#include "base/core.h"
#include "base/plain_numbers.h"
#include "density/pipeline.h"

// A caller's options, which may be those of an earlier header or NULL; the defaults if their size
// is unknown.
static sgs_train_options whole_options(const sgs_train_options *given)
{
    sgs_train_options own = sgs_train_options_default();
    (void)sgsi_options_read(given, "sgs_train_options", &own, sizeof own);
    return own;
}

// ---- ranges ----

static sgs_status check_number(const sgs_train_option *row, double value)
{
    if (value >= row->low && value <= row->high) // false for NaN
        return SGS_STATUS_OK;
    const int digits = row->type == SGS_OPTION_DOUBLE ? 6 : 17;
    return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s must be between %.*g and %.*g", row->name,
                     digits, row->low, digits, row->high);
}

static unsigned word_count(const char *words)
{
    unsigned count = 1;
    for (const char *at = words; (at = strpbrk(at, "|,")); ++at)
        ++count;
    return count;
}

static sgs_status check_box(const sgs_train_option *row, const sgs_box *box)
{
    for (int k = 0; k < 3; ++k)
        if (!(box->low[k] < box->high[k])) // true for NaN
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                             "%s must have a lower bound below the upper one on each axis",
                             row->name);
    return SGS_STATUS_OK;
}

static sgs_status check_field(const sgs_train_option *row, const sgs_train_options *options)
{
    const void *field = (const char *)options + row->offset;
    sgs_status status = SGS_STATUS_OK;
    switch (row->type) {
    case SGS_OPTION_INT:
        return check_number(row, *(const int *)field);
    case SGS_OPTION_SIZE:
        return check_number(row, (double)*(const size_t *)field);
    case SGS_OPTION_DOUBLE:
        return check_number(row, *(const double *)field);
    case SGS_OPTION_CHOICE:
        if (*(const unsigned *)field >= word_count(row->values))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s must be one of %s", row->name,
                             row->values);
        return SGS_STATUS_OK;
    case SGS_OPTION_SET:
        if (row->low > 0 && !*(const unsigned *)field)
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s must have at least one of %s",
                             row->name, row->values);
        if (*(const unsigned *)field >> word_count(row->values))
            return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "%s may have the bits of %s only",
                             row->name, row->values);
        return SGS_STATUS_OK;
    case SGS_OPTION_COLOR:
        for (int c = 0; c < 3 && !status; ++c)
            status = check_number(row, (double)((const float *)field)[c]);
        return status;
    case SGS_OPTION_BOX:
        return check_box(row, field);
    case SGS_OPTION_BOOL:
    case SGS_OPTION_UINT64:
    case SGS_OPTION_MODEL:
        break; // any value
    }
    return SGS_STATUS_OK;
}

sgs_status sgs_train_options_check(const sgs_train_options *given)
{
    sgs_train_options own = sgs_train_options_default();
    const sgs_status read = sgsi_options_read(given, "sgs_train_options", &own, sizeof own);
    if (read)
        return read;
    const sgs_train_options *options = &own;
    size_t count;
    const sgs_train_option *table = sgs_train_option_descriptors(&count);
    for (size_t i = 0; i < count; ++i) {
        const sgs_status status = check_field(&table[i], options);
        if (status)
            return status;
    }
    const double noise = options->pipeline_options.mcmc_noise;
    if (noise < 0.0 && noise != -1.0)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "mcmc_noise must be -1 or at least 0");
    const sgsi_pipeline *pipeline = sgsi_pipeline_get(options->pipeline);
    if (options->filter == SGS_FILTER_MIP && pipeline->late_opacity &&
        pipeline->late_opacity(options) == SGSI_LATE_OPACITY_LINEAR)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "taming_opacity linear and filter mip exclude each other");
    if (!sgs_box_is_infinite(&options->region) && pipeline->late_opacity &&
        pipeline->late_opacity(options) == SGSI_LATE_OPACITY_LINEAR)
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT,
                         "taming_opacity linear and region exclude each other");
    if (options->opaque && !(options->alpha_loss > 0))
        return sgsi_fail(SGS_STATUS_INVALID_ARGUMENT, "opaque requires alpha_loss above 0");
    return SGS_STATUS_OK;
}

// ---- text ----

static size_t put_double(char *text, size_t bytes, double value)
{
    char number[32];
    int digits = 15;
    do
        snprintf(number, sizeof number, "%.*g", digits, value);
    while (strtod(number, NULL) != value && ++digits <= 17);
    return (size_t)snprintf(text, bytes, "%s", number);
}

static size_t put_word(char *text, size_t bytes, const char *words, unsigned index)
{
    for (; index > 0; --index) {
        words = strpbrk(words, "|,");
        if (!words)
            return (size_t)snprintf(text, bytes, "?");
        ++words;
    }
    return (size_t)snprintf(text, bytes, "%.*s", (int)strcspn(words, "|,"), words);
}

static size_t put_set(char *text, size_t bytes, const char *words, unsigned bits)
{
    size_t used = 0;
    for (unsigned k = 0; k < word_count(words); ++k) {
        if (!(bits >> k & 1))
            continue;
        if (used)
            used += (size_t)snprintf(text + (used < bytes ? used : bytes),
                                     used < bytes ? bytes - used : 0, ",");
        used += put_word(text + (used < bytes ? used : bytes), used < bytes ? bytes - used : 0,
                         words, k);
    }
    return used ? used : (size_t)snprintf(text, bytes, "off");
}

static size_t put_box(char *text, size_t bytes, const sgs_box *box)
{
    const float *low = box->low, *high = box->high;
    if (sgs_box_is_infinite(box))
        return (size_t)snprintf(text, bytes, "none");
    return (size_t)snprintf(text, bytes, "%.9g,%.9g,%.9g,%.9g,%.9g,%.9g", (double)low[0],
                            (double)low[1], (double)low[2], (double)high[0], (double)high[1],
                            (double)high[2]);
}

static size_t put_value(char *text, size_t bytes, const sgs_train_option *option,
                        const sgs_train_options *options)
{
    const void *field = (const char *)options + option->offset;
    switch (option->type) {
    case SGS_OPTION_BOOL:
        return (size_t)snprintf(text, bytes, "%s", *(const bool *)field ? "true" : "false");
    case SGS_OPTION_INT:
        return (size_t)snprintf(text, bytes, "%d", *(const int *)field);
    case SGS_OPTION_SIZE:
        return (size_t)snprintf(text, bytes, "%zu", *(const size_t *)field);
    case SGS_OPTION_UINT64:
        return (size_t)snprintf(text, bytes, "%" PRIu64, *(const uint64_t *)field);
    case SGS_OPTION_DOUBLE:
        return put_double(text, bytes, *(const double *)field);
    case SGS_OPTION_CHOICE:
        return put_word(text, bytes, option->values, *(const unsigned *)field);
    case SGS_OPTION_SET:
        return put_set(text, bytes, option->values, *(const unsigned *)field);
    case SGS_OPTION_COLOR: {
        const float *c = field;
        if (*(const bool *)((const char *)options + option->random_offset))
            return (size_t)snprintf(text, bytes, "random");
        return (size_t)snprintf(text, bytes, "%.9g,%.9g,%.9g", (double)c[0], (double)c[1],
                                (double)c[2]);
    }
    case SGS_OPTION_BOX:
        return put_box(text, bytes, field);
    case SGS_OPTION_MODEL:
        return (size_t)snprintf(text, bytes, "%s", *(const void *const *)field ? "model" : "none");
    }
    return 0;
}

// Checkpoints hold these texts, so they do not depend on the locale of the calling program.
size_t sgs_train_option_text(const sgs_train_option *option, const sgs_train_options *options,
                             char *text, size_t bytes)
{
    const sgs_train_options whole = whole_options(options);
    const sgsi_plain_numbers plain = sgsi_plain_numbers_begin();
    const size_t length = put_value(text, bytes, option, &whole);
    sgsi_plain_numbers_end(&plain);
    return length;
}

// ---- resuming ----

bool sgs_train_option_is_read(const sgs_train_option *option, const sgs_train_options *options)
{
    return !option->spare || (option->spare & whole_options(options).spare);
}

bool sgs_train_option_may_change(const sgs_train_option *option, const sgs_train_options *options)
{
    const sgs_train_options whole = whole_options(options);
    return option->resume == SGS_RESUME_FREE ||
           (option->resume == SGS_RESUME_FREE_PAPER && whole.schedule == SGS_SCHEDULE_PAPER) ||
           (option->resume == SGS_RESUME_FREE_WHOLE && sgs_box_is_infinite(&whole.region)) ||
           !sgs_train_option_is_read(option, &whole);
}
