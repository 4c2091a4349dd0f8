// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// The table of AOVs: it has every plane of both kinds of frame, and frames are allocated from it.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <cmocka.h>

#include "sparegs/aov_descriptors.h"

static const sgs_aov *rows;
static size_t row_count;

static int get_table(void **state)
{
    (void)state;
    rows = sgs_aov_descriptors(&row_count);
    return 0;
}

// Both structs are two ints and pointers.
static void every_plane_has_a_row(void **state)
{
    (void)state;
    unsigned char traced[sizeof(sgs_frame)] = {0}, exact[sizeof(sgs_reference_frame)] = {0};
    const size_t header = 2 * sizeof(int), pointer = sizeof(void *);
    for (size_t i = 0; i < row_count; ++i)
        for (size_t k = 0; k < (size_t)rows[i].channels * pointer; ++k) {
            assert_int_equal(traced[rows[i].offset + k]++, 0);
            assert_int_equal(exact[rows[i].reference_offset + k]++, 0);
        }
    for (size_t k = 0; k < sizeof traced; ++k)
        assert_int_equal(traced[k], k >= header);
    for (size_t k = 0; k < sizeof exact; ++k)
        assert_int_equal(exact[k], k >= header);
}

static void bits_and_names_are_unique(void **state)
{
    (void)state;
    unsigned bits = 0;
    for (size_t i = 0; i < row_count; ++i) {
        assert_true(rows[i].help && (rows[i].channels == 1 || rows[i].channels == 3));
        assert_int_equal(bits & rows[i].bit, 0);
        bits |= rows[i].bit;
        assert_ptr_equal(sgs_aov_find(rows[i].name), &rows[i]);
    }
    assert_int_equal(bits, SGS_AOVS_ALL);
    assert_null(sgs_aov_find("no_such_aov"));
}

static void a_frame_has_what_was_requested(void **state)
{
    (void)state;
    for (unsigned request = 0; request <= SGS_AOVS_ALL; ++request) {
        sgs_frame frame;
        assert_int_equal(sgs_frame_create_with(3, 2, request, &frame), SGS_STATUS_OK);
        for (size_t i = 0; i < row_count; ++i)
            for (int c = 0; c < rows[i].channels; ++c)
                assert_int_equal(sgs_aov_plane(&rows[i], &frame, c) != NULL,
                                 !rows[i].bit || (request & rows[i].bit));
        assert_ptr_equal(sgs_aov_plane(sgs_aov_find("color"), &frame, 2), frame.color[2]);
        assert_ptr_equal(sgs_aov_plane(sgs_aov_find("normal"), &frame, 1), frame.normal[1]);
        assert_ptr_equal(sgs_aov_plane(sgs_aov_find("primitive"), &frame, 0), frame.primitive);
        sgs_frame_free(&frame);
        assert_null(frame.color[0]);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_plane_has_a_row),
        cmocka_unit_test(bits_and_names_are_unique),
        cmocka_unit_test(a_frame_has_what_was_requested),
    };
    return cmocka_run_group_tests(tests, get_table, NULL);
}
