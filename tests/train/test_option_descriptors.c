// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The table of training options: complete, consistent with its own defaults and ranges, and every
// value out of range is refused by the name of its field.

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <cmocka.h>

#include "sparegs/option_descriptors.h"
#include "support/locale_support.h"
#include "support/skip_support.h"

static const sgs_train_option *rows;
static size_t row_count;

static int get_table(void **state)
{
    (void)state;
    rows = sgs_train_option_descriptors(&row_count);
    return row_count < 30;
}

// Marks the bytes of all rows; fails if rows overlap.
static void cover(unsigned char covered[sizeof(sgs_train_options)])
{
    memset(covered, 0, sizeof(sgs_train_options));
    memset(covered, 1, sizeof((sgs_train_options *)0)->struct_size); // no option
    memset(covered + offsetof(sgs_train_options, progress), 1,
           sizeof(sgs_train_options) - offsetof(sgs_train_options, progress)); // a callback
    for (size_t i = 0; i < row_count; ++i) {
        assert_true(rows[i].offset + rows[i].size <= sizeof(sgs_train_options));
        for (size_t k = 0; k < rows[i].size; ++k)
            if (covered[rows[i].offset + k]++)
                fail_msg("%s overlaps another row", rows[i].name);
        if (rows[i].random_offset)
            assert_int_equal(covered[rows[i].random_offset]++, 0);
    }
}

#ifndef __has_builtin
#define __has_builtin(name) 0
#endif

static void every_field_has_a_row(void **state)
{
    (void)state;
    unsigned char covered[sizeof(sgs_train_options)], field[sizeof(sgs_train_options)];
    cover(covered);
#if __has_builtin(__builtin_clear_padding)
    sgs_train_options options;
    memset(&options, 0xFF, sizeof options);
    __builtin_clear_padding(&options);
    memcpy(field, &options, sizeof options);
    for (size_t i = 0; i < sizeof options; ++i)
        if ((field[i] != 0) != covered[i])
            fail_msg("byte %zu of sgs_train_options %s", i,
                     covered[i] ? "is padding, but a row names it" : "is in no row of the table");
#else
    // Without the builtin: no gap is large enough for a double.
    (void)field;
    size_t gap = 0;
    for (size_t i = 0; i < sizeof covered; ++i) {
        gap = covered[i] ? 0 : gap + 1;
        assert_true(gap < 8);
    }
#endif
}

static void rows_are_well_formed(void **state)
{
    (void)state;
    static const size_t sizes[] = {
        [SGS_OPTION_BOOL] = sizeof(bool),     [SGS_OPTION_INT] = sizeof(int),
        [SGS_OPTION_SIZE] = sizeof(size_t),   [SGS_OPTION_UINT64] = sizeof(uint64_t),
        [SGS_OPTION_DOUBLE] = sizeof(double), [SGS_OPTION_CHOICE] = sizeof(int),
        [SGS_OPTION_SET] = sizeof(unsigned),  [SGS_OPTION_COLOR] = 3 * sizeof(float),
        [SGS_OPTION_MODEL] = sizeof(void *),  [SGS_OPTION_BOX] = sizeof(sgs_box)};
    for (size_t i = 0; i < row_count; ++i) {
        const sgs_train_option *row = &rows[i];
        const bool ranged = row->type == SGS_OPTION_INT || row->type == SGS_OPTION_SIZE ||
                            row->type == SGS_OPTION_DOUBLE || row->type == SGS_OPTION_COLOR;
        if (row->size != sizes[row->type] || !row->help || !row->group || !row->pipelines ||
            row->pipelines >> SGS_PIPELINE_COUNT || strlen(row->name) > 30 ||
            row->name[strspn(row->name, "abcdefghijklmnopqrstuvwxyz0123456789_")] ||
            (row->type != SGS_OPTION_BOOL && !row->values) ||
            (ranged && !(row->low <= row->initial && row->initial <= row->high)))
            fail_msg("the row of %s is not well-formed", row->name);
        assert_ptr_equal(sgs_train_option_find(row->name), row);
        for (size_t k = 0; k < i; ++k)
            assert_string_not_equal(rows[k].name, row->name);
    }
    assert_null(sgs_train_option_find("no_such_option"));
}

static void refused(const sgs_train_options *options, const char *words)
{
    if (sgs_train_options_check(options) != SGS_STATUS_INVALID_ARGUMENT ||
        strncmp(sgs_last_error(), words, strlen(words)))
        fail_msg("expected '%s', got '%s'", words, sgs_last_error());
}

static void values_out_of_range_are_refused_by_field(void **state)
{
    (void)state;
    sgs_train_options options = sgs_train_options_default();
    assert_int_equal(sgs_train_options_check(&options), SGS_STATUS_OK);
    for (size_t i = 0; i < row_count; ++i) {
        const sgs_train_option *row = &rows[i];
        char words[80];
        snprintf(words, sizeof words, "%s must ", row->name);
        for (int side = 0; side < 3; ++side) {
            options = sgs_train_options_default();
            void *field = (char *)&options + row->offset;
            const double value = side == 0 ? row->low - 1 : side == 1 ? row->high + 1 : NAN;
            if (row->type == SGS_OPTION_INT && side < 2)
                *(int *)field = (int)value;
            else if (row->type == SGS_OPTION_SIZE && side < 2 && value >= 0)
                *(size_t *)field = (size_t)value;
            else if (row->type == SGS_OPTION_DOUBLE)
                *(double *)field = value;
            else if (row->type == SGS_OPTION_COLOR)
                ((float *)field)[side] = (float)value;
            else if (row->type == SGS_OPTION_CHOICE && side < 2)
                *(int *)field = side ? 100 : -1;
            else if (row->type == SGS_OPTION_SET && side == 0 && row->low > 0)
                *(unsigned *)field = 0;
            else
                continue;
            refused(&options, words);
        }
    }
    options = sgs_train_options_default();
    options.spare = 8;
    refused(&options, "spare may have the bits of bmd,rap,edt only");
    options = sgs_train_options_default();
    options.iterations = 0;
    refused(&options, "iterations must be between 1 and 10000000");
    options = sgs_train_options_default();
    options.pipeline = SGS_PIPELINE_TAMING;
    options.pipeline_options.taming_opacity = SGS_TAMING_LINEAR;
    options.filter = SGS_FILTER_MIP;
    refused(&options, "taming_opacity linear and filter mip exclude each other");
    options = sgs_train_options_default();
    options.region.low[1] = options.region.high[1] = 2;
    refused(&options, "region must have a lower bound below the upper one on each axis");
    options.region.low[1] = NAN;
    refused(&options, "region must have a lower bound below the upper one on each axis");
    options.region.low[1] = 1;
    assert_int_equal(sgs_train_options_check(&options), SGS_STATUS_OK);
    options.pipeline = SGS_PIPELINE_TAMING;
    options.pipeline_options.taming_opacity = SGS_TAMING_LINEAR;
    refused(&options, "taming_opacity linear and region exclude each other");
    options = sgs_train_options_default();
    options.opaque = true;
    refused(&options, "opaque requires alpha_loss above 0");
    options.alpha_loss = SGS_TRAIN_OPAQUE_WEIGHT;
    assert_int_equal(sgs_train_options_check(&options), SGS_STATUS_OK);
}

static void values_have_a_text(void **state)
{
    (void)state;
    sgs_train_options options = sgs_train_options_default();
    options.spare_tau_alpha = 0.1;
    options.spare_eps_loss = 1.0 / 3.0;
    options.spare = SGS_SPARE_BMD | SGS_SPARE_EDT;
    options.spare_phi = SGS_PHI_PRODUCT;
    options.background[1] = 0.5f;
    options.exposure = true;
    options.seed = UINT64_MAX;
    const struct {
        const char *name, *text;
    } cases[] = {
        {"iterations", "30000"},   {"pipeline", "3dgs"},      {"spare_tau_alpha", "0.1"},
        {"spare", "bmd,edt"},      {"spare_demand", "h,v,c"}, {"spare_phi", "product"},
        {"background", "0,0.5,0"}, {"exposure", "true"},      {"init", "none"},
        {"region", "none"},        {"max_gaussians", "0"},    {"seed", "18446744073709551615"}};
    char text[64];
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k) {
        const size_t length = sgs_train_option_text(sgs_train_option_find(cases[k].name), &options,
                                                    text, sizeof text);
        assert_string_equal(text, cases[k].text);
        assert_int_equal(length, strlen(text));
    }
    sgs_train_option_text(sgs_train_option_find("spare_eps_loss"), &options, text, sizeof text);
    assert_true(strtod(text, NULL) == 1.0 / 3.0);
    options.background_random = true;
    sgs_train_option_text(sgs_train_option_find("background"), &options, text, sizeof text);
    assert_string_equal(text, "random");
    options.region = (sgs_box){{-INFINITY, 0.1f, -2}, {3, INFINITY, INFINITY}};
    sgs_train_option_text(sgs_train_option_find("region"), &options, text, sizeof text);
    assert_string_equal(text, "-inf,0.100000001,-2,3,inf,inf");
    options.spare = 0;
    assert_int_equal(
        sgs_train_option_text(sgs_train_option_find("spare"), &options, text, sizeof text), 3);
    assert_string_equal(text, "off");
    assert_int_equal(
        sgs_train_option_text(sgs_train_option_find("spare_demand"), &options, text, 4), 5);
    assert_string_equal(text, "h,v");
}

// Checkpoints hold these texts: a program with a decimal comma must be able to resume them.
static void values_have_the_same_text_in_any_language(void **state)
{
    (void)state;
    sgs_train_options options = sgs_train_options_default();
    options.background[1] = 0.5f;
    options.region.low[1] = 0.25f;
    if (!decimal_comma_set())
        skip_because("the system cannot make a locale");
    const struct {
        const char *name, *text;
    } cases[] = {{"spare_tau_alpha", "0.05"},
                 {"background", "0,0.5,0"},
                 {"region", "-inf,0.25,-inf,inf,inf,inf"}};
    char texts[3][64];
    for (size_t k = 0; k < 3; ++k)
        sgs_train_option_text(sgs_train_option_find(cases[k].name), &options, texts[k],
                              sizeof texts[k]);
    const double comma = strtod("0,5", NULL);
    decimal_comma_unset();
    assert_true(comma == 0.5);
    for (size_t k = 0; k < 3; ++k)
        assert_string_equal(texts[k], cases[k].text);
}

static void options_of_an_earlier_version_are_filled_up(void **state)
{
    (void)state;
    sgs_train_options options = sgs_train_options_default();
    assert_int_equal(sgs_train_options_check(&options), SGS_STATUS_OK);
    assert_int_equal(sgs_train_options_check(NULL), SGS_STATUS_OK); // the defaults
    options.spare_grid = -5;
    assert_int_equal(sgs_train_options_check(&options), SGS_STATUS_INVALID_ARGUMENT);
    options.struct_size = offsetof(sgs_train_options, spare_grid); // a struct without the field
    assert_int_equal(sgs_train_options_check(&options), SGS_STATUS_OK);
    options.spare = 0; // beyond the end of an even shorter struct, whose parts are all on
    options.schedule = SGS_SCHEDULE_PAPER;
    options.struct_size = offsetof(sgs_train_options, schedule);
    const sgs_train_options *const given[] = {&options, NULL};
    for (int k = 0; k < 2; ++k) {
        char text[64];
        assert_true(sgs_train_option_is_read(sgs_train_option_find("spare_grid"), given[k]));
        for (size_t i = 0; i < row_count; ++i)
            if (rows[i].resume == SGS_RESUME_FREE_PAPER)
                assert_false(sgs_train_option_may_change(&rows[i], given[k]));
        sgs_train_option_text(sgs_train_option_find("schedule"), given[k], text, sizeof text);
        assert_string_equal(text, "scaled");
    }
    for (int k = 0; k < 2; ++k) {
        options.struct_size = k ? sizeof options + 1 : 0;
        assert_int_equal(sgs_train_options_check(&options), SGS_STATUS_INVALID_ARGUMENT);
        assert_non_null(strstr(sgs_last_error(), "sgs_train_options.struct_size"));
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_field_has_a_row),
        cmocka_unit_test(rows_are_well_formed),
        cmocka_unit_test(values_out_of_range_are_refused_by_field),
        cmocka_unit_test(values_have_a_text),
        cmocka_unit_test(values_have_the_same_text_in_any_language),
        cmocka_unit_test(options_of_an_earlier_version_are_filled_up),
    };
    return cmocka_run_group_tests(tests, get_table, NULL);
}
