// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Arrays whose groups several ranks own, as threads of this process: gathered on all ranks, passed
// in order to rank 0, and distributed from it, for numbers of groups and ranks that do not divide
// each other, incomplete groups, windows of several turns, and ranks without a group.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "cluster/row_streams.h"
#include "support/ranks_support.h"

enum { MAX_RANKS = 5 };

// Byte i of every array.
static unsigned char expected(size_t i)
{
    return (unsigned char)(i * 37 + i / 251);
}

typedef struct member {
    size_t group, total;
    size_t wrong;  // bytes
    size_t passed; // by rank 0
    unsigned char *collected;
} member;

static void take(void *context, void *bytes, size_t size)
{
    member *m = context;
    memcpy(m->collected + m->passed, bytes, size);
    m->passed += size;
}

static void give(void *context, void *bytes, size_t size)
{
    member *m = context;
    for (size_t i = 0; i < size; ++i)
        ((unsigned char *)bytes)[i] = expected(m->passed + i);
    m->passed += size;
}

// The bytes of the groups of a rank, one by one.
static size_t fill_own(const member *m, const sgs_ranks *ranks, unsigned char *own)
{
    size_t at = 0;
    for (size_t i = 0; i < m->total; ++i)
        if (i / m->group % (size_t)sgs_ranks_count(ranks) == (size_t)sgs_ranks_rank(ranks))
            own[at++] = expected(i);
    return at;
}

static void run_rank(void *context, sgs_ranks *ranks)
{
    member *m = context;
    const int rank = sgs_ranks_rank(ranks);
    unsigned char *own = calloc(m->total + 1, 1), *whole = calloc(m->total + 1, 1),
                  *got = calloc(m->total + 1, 1);
    m->collected = calloc(m->total + 1, 1);
    sgsi_row_array array = {own, m->group, m->total};
    const size_t bytes = fill_own(m, ranks, own);
    m->wrong += sgsi_row_array_bytes(&array, rank, sgs_ranks_count(ranks)) != bytes;
    if (sgsi_rows_gather(ranks, SGS_STATUS_OK, SGS_RANKS_OTHER, &array, whole) ||
        sgsi_rows_collect(ranks, SGS_STATUS_OK, &array, take, m))
        abort();
    for (size_t i = 0; i < m->total; ++i)
        m->wrong += whole[i] != expected(i);
    const size_t reached = rank ? 0 : m->total;
    m->wrong += m->passed != reached;
    for (size_t i = 0; i < reached; ++i)
        m->wrong += m->collected[i] != expected(i);
    m->passed = 0;
    array.own = got;
    if (sgsi_rows_distribute(ranks, SGS_STATUS_OK, &array, give, m))
        abort();
    m->wrong += memcmp(got, own, bytes) != 0 || got[bytes] != 0;
    free(own);
    free(whole);
    free(got);
    free(m->collected);
}

static void arrays_arrive_complete_and_in_order(void **state)
{
    (void)state;
    static const size_t cases[][2] = {{64, 0},     {64, 1},        {64, 64},     {64, 200},
                                      {100, 1999}, {1000, 999000}, {4096, 8191}, {60416, 9000001}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; ++k)
        for (int count = 1; count <= MAX_RANKS; ++count) {
            member members[MAX_RANKS];
            for (int r = 0; r < count; ++r)
                members[r] = (member){.group = cases[k][0], .total = cases[k][1]};
            ranks_run(count, members, sizeof *members, run_rank);
            for (int r = 0; r < count; ++r)
                if (members[r].wrong)
                    fail_msg("groups of %zu of %zu bytes: rank %d of %d has %zu wrong", cases[k][0],
                             cases[k][1], r, count, members[r].wrong);
        }
}

int main(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(arrays_arrive_complete_and_in_order)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
