// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// sgs_ranks_collect on ranks that are threads of this process: blocks of any size arrive on rank 0
// in the order of the ranks, from some or all of them, and only their bytes are counted. A rank
// that fails, or has no memory, ends the call on all ranks with its message, also at the start.
// sgs_ranks_compare reports the difference in lines of any length. Broadcasts and flags reach all
// ranks.

#include <setjmp.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "base/core.h"
#include "support/ranks_support.h"

enum { MAX_RANKS = 5, MAX_BYTES = 5000, ROUNDS = 3 };

// Byte i of a rank in a round.
static unsigned char expected(int rank, int round, size_t i)
{
    return (unsigned char)(rank * 53 + round * 17 + (int)(i * 7 % 251));
}

typedef struct member {
    size_t size;
    int senders;
    int failing;            // this rank passes a failure, -1 = none
    int starving;           // when this rank begins, an allocation will fail; -1 = none
    size_t starving_at;     // allocation
    size_t wrong;           // bytes
    sgs_status status;      // of the last call
    sgs_ranks_traffic sent; // of all calls
    char message[256];
} member;

static void collect(member *m, sgs_ranks *ranks, int round, unsigned char *own, unsigned char *got)
{
    const int rank = sgs_ranks_rank(ranks);
    for (size_t i = 0; i < m->size; ++i)
        own[i] = expected(rank, round, i);
    memset(got, 0xee, MAX_RANKS * MAX_BYTES);
    const sgs_status status =
        rank == m->failing ? sgsi_fail(SGS_STATUS_IO, "frame %d is lost", round) : SGS_STATUS_OK;
    if (rank == m->starving)
        sgsi_fail_allocation(m->starving_at);
    m->status = sgs_ranks_collect(ranks, status, rank < m->senders ? own : NULL, m->size,
                                  m->senders, rank ? NULL : got);
    sgsi_fail_allocation(0);
    if (m->status)
        snprintf(m->message, sizeof m->message, "%s", sgs_last_error());
    for (int r = 0; r < MAX_RANKS && !rank && !m->status; ++r)
        for (size_t i = 0; i < m->size; ++i)
            m->wrong +=
                got[(size_t)r * m->size + i] != (r < m->senders ? expected(r, round, i) : 0xee);
}

static void run_rank(void *context, sgs_ranks *ranks)
{
    member *m = context;
    unsigned char *own = malloc(MAX_BYTES), *got = malloc(MAX_RANKS * MAX_BYTES);
    if (sgs_ranks_agree(ranks, SGS_STATUS_OK)) // the ranks exist, before an allocation fails
        abort();
    for (int round = 0; round < ROUNDS && !m->status; ++round)
        collect(m, ranks, round, own, got);
    m->sent = sgs_ranks_traffic_get(ranks, SGS_RANKS_OTHER);
    free(own);
    free(got);
}

static void run_ranks(const member *plan, int count, member *members)
{
    for (int r = 0; r < count; ++r)
        members[r] = *plan;
    ranks_run(count, members, sizeof *members, run_rank);
}

static void blocks_arrive_in_the_order_of_the_ranks(void **state)
{
    (void)state;
    static const size_t sizes[] = {1, 63, 64, 65, 4999};
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; ++k)
        for (int count = 1; count <= MAX_RANKS; ++count)
            for (int senders = 1; senders <= count; ++senders) {
                const member plan = {
                    .size = sizes[k], .senders = senders, .failing = -1, .starving = -1};
                member members[MAX_RANKS];
                run_ranks(&plan, count, members);
                for (int r = 0; r < count; ++r) {
                    assert_int_equal(members[r].status, SGS_STATUS_OK);
                    assert_int_equal(members[r].wrong, 0);
                    const size_t messages = r > 0 && r < senders ? ROUNDS : 0;
                    assert_int_equal(members[r].sent.messages, messages);
                    assert_int_equal(members[r].sent.bytes, messages * sgsi_ranks_padded(sizes[k]));
                }
            }
}

static void a_failure_ends_the_call_on_all_ranks(void **state)
{
    (void)state;
    for (int failing = 0; failing < 3; ++failing) {
        const member plan = {.size = 100, .senders = 2, .failing = failing, .starving = -1};
        member members[MAX_RANKS];
        char text[40];
        snprintf(text, sizeof text, "rank %d (", failing);
        run_ranks(&plan, 3, members);
        for (int r = 0; r < 3; ++r) {
            assert_int_equal(members[r].status, SGS_STATUS_IO);
            assert_int_equal(strncmp(members[r].message, text, strlen(text)), 0);
            assert_non_null(strstr(members[r].message, "frame 0 is lost"));
        }
    }
}

static void a_rank_without_memory_ends_the_call_on_all_ranks(void **state)
{
    (void)state;
    for (int starving = 0; starving < 3; ++starving)
        for (size_t at = 1; at <= 2; ++at) {
            const member plan = {
                .size = 100, .senders = 3, .failing = -1, .starving = starving, .starving_at = at};
            member members[MAX_RANKS];
            run_ranks(&plan, 3, members);
            for (int r = 0; r < 3; ++r) {
                assert_int_equal(members[r].status, SGS_STATUS_OUT_OF_MEMORY);
                assert_string_equal(members[r].message, members[0].message);
            }
        }
}

// Without ranks there is one block.
static void one_process_keeps_its_block(void **state)
{
    (void)state;
    unsigned char got[3] = {0};
    assert_int_equal(sgs_ranks_collect(NULL, SGS_STATUS_OK, "abc", 3, 1, got), SGS_STATUS_OK);
    assert_memory_equal(got, "abc", 3);
    assert_int_equal(sgs_ranks_collect(NULL, SGS_STATUS_IO, "xyz", 3, 1, got), SGS_STATUS_IO);
    assert_memory_equal(got, "abc", 3);
}

// Rank 1 has another text than the others.
typedef struct compared {
    const char *texts[2];
    sgs_status status;
    char message[1024];
} compared;

static void compare_texts(void *context, sgs_ranks *ranks)
{
    compared *c = context;
    c->status = sgs_ranks_compare(ranks, SGS_STATUS_OK, c->texts[sgs_ranks_rank(ranks) == 1]);
    snprintf(c->message, sizeof c->message, "%s", c->status ? sgs_last_error() : "");
}

static void the_difference_is_in_the_message(void **state)
{
    (void)state;
    char filler[2001], texts[2][2100];
    memset(filler, 'x', sizeof filler - 1);
    filler[sizeof filler - 1] = 0;
    // Values after `equal` common characters and before `rest` others.
    static const int cases[][2] = {{0, 0}, {10, 290}, {250, 0}, {500, 10}, {950, 1000}, {0, 1990}};
    static const char *const lines[] = {"a: 1\nsize: %.*s%s%.*s\nz: 1\n", "a: 1\nsize %.*s%s%.*s"};
    for (size_t k = 0; k < 2; ++k)
        for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
            for (int t = 0; t < 2; ++t)
                snprintf(texts[t], sizeof texts[t], lines[k], cases[i][0], filler,
                         t ? "largest" : "smallest", cases[i][1], filler);
            compared members[3];
            for (int r = 0; r < 3; ++r)
                members[r] = (compared){.texts = {texts[0], texts[1]}};
            ranks_run(3, members, sizeof *members, compare_texts);
            for (int r = 0; r < 3; ++r) {
                assert_int_equal(members[r].status, SGS_STATUS_INVALID_ARGUMENT);
                assert_int_equal(strncmp(members[r].message, "rank 1 (", 8), 0);
                const char *mine = strstr(members[r].message, "largest");
                assert_non_null(mine);
                assert_non_null(strstr(mine, k ? "but rank 0 has " : ", but "));
                assert_non_null(strstr(mine, "smallest"));
            }
        }
}

// The last line of rank 0 is the name of a value without the value.
static void the_difference_of_a_missing_value_is_in_the_message(void **state)
{
    (void)state;
    compared members[2];
    for (int r = 0; r < 2; ++r)
        members[r] = (compared){.texts = {"a: 1\nsize", "a: 1\nsize: 1"}};
    ranks_run(2, members, sizeof *members, compare_texts);
    for (int r = 0; r < 2; ++r)
        assert_non_null(strstr(members[r].message, "has 'size: 1', but rank 0 has 'size'"));
}

static void collect_unknown_senders(void *context, sgs_ranks *ranks)
{
    compared *c = context;
    char got[8];
    c->status = sgs_ranks_collect(ranks, SGS_STATUS_OK, "a", 1, c->texts[0] ? 3 : 0, got);
    snprintf(c->message, sizeof c->message, "%s", c->status ? sgs_last_error() : "");
}

static void more_senders_than_ranks_are_refused(void **state)
{
    (void)state;
    for (int k = 0; k < 2; ++k) {
        compared members[2] = {{.texts = {k ? "" : NULL}}, {.texts = {k ? "" : NULL}}};
        ranks_run(2, members, sizeof *members, collect_unknown_senders);
        for (int r = 0; r < 2; ++r) {
            assert_int_equal(members[r].status, SGS_STATUS_INVALID_ARGUMENT);
            assert_non_null(strstr(members[r].message, "senders of 2 ranks"));
        }
    }
}

// ---- Without memory ----

static void (*close_transport)(void *state);
static atomic_int closed;

static void count_close(void *state)
{
    ++closed;
    close_transport(state);
}

typedef struct starter {
    sgsi_transport transport;
    sgs_ranks *ranks;
    sgs_status status;
} starter;

static void *start_rank(void *context)
{
    starter *s = context;
    s->status = sgsi_ranks_create(&s->transport, &s->ranks);
    return NULL;
}

// Every n-th allocation of three ranks fails. One that had started alone would wait for the others.
static void a_rank_without_memory_at_the_start_ends_all(void **state)
{
    (void)state;
    enum { COUNT = 3 };
    for (size_t n = 1; n <= 9; ++n) {
        sgsi_transport transports[COUNT];
        starter starters[COUNT];
        pthread_t threads[COUNT];
        assert_true(sgsi_ranks_threads(COUNT, transports));
        close_transport = transports[0].close;
        closed = 0;
        sgsi_fail_allocation(n);
        for (int r = 0; r < COUNT; ++r) {
            starters[r] = (starter){.transport = transports[r]};
            starters[r].transport.close = count_close;
            assert_int_equal(pthread_create(&threads[r], NULL, start_rank, &starters[r]), 0);
        }
        for (int r = 0; r < COUNT; ++r)
            pthread_join(threads[r], NULL);
        sgsi_fail_allocation(0);
        for (int r = 0; r < COUNT; ++r) {
            assert_int_equal(starters[r].status, SGS_STATUS_OUT_OF_MEMORY);
            assert_null(starters[r].ranks);
        }
        assert_int_equal(closed, COUNT);
    }
}

// The linker replaces malloc and calloc of the library by these (tests/CMakeLists.txt).
static bool no_memory;

// NOLINTBEGIN(bugprone-reserved-identifier,cert-dcl*): names of the linker
void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);

void *__wrap_malloc(size_t size)
{
    return no_memory ? NULL : __real_malloc(size);
}

void *__wrap_calloc(size_t count, size_t size)
{
    return no_memory ? NULL : __real_calloc(count, size);
}
// NOLINTEND(bugprone-reserved-identifier,cert-dcl*)

// A transport to ranks that all send the same: rank 0 of many.
enum { MIRRORED = 200 };

static void mirror_gather(void *state, const void *send, size_t bytes, void *got)
{
    (void)state;
    for (size_t r = 0; r < MIRRORED; ++r)
        memcpy((char *)got + r * bytes, send, bytes);
}

static void mirror_gather_sizes(void *state, const void *send, const size_t *sizes, void *got)
{
    (void)state;
    char *to = got;
    for (size_t r = 0; r < MIRRORED; to += sizes[r++])
        memcpy(to, send, sizes[r]);
}

static void mirror_close(void *state)
{
    (void)state;
}

static void calls_agree_without_memory(void **state)
{
    (void)state;
    const sgsi_transport transport = {.count = MIRRORED,
                                      .gather = mirror_gather,
                                      .gather_sizes = mirror_gather_sizes,
                                      .close = mirror_close};
    sgs_ranks *ranks;
    assert_int_equal(sgsi_ranks_create(&transport, &ranks), SGS_STATUS_OK);
    const size_t before = sgsi_allocation_count();
    no_memory = true;
    const sgs_status good = sgs_ranks_agree(ranks, SGS_STATUS_OK),
                     bad = sgs_ranks_agree_text(ranks, SGS_STATUS_IO, "the disk is full");
    no_memory = false;
    assert_int_equal(sgsi_allocation_count(), before);
    assert_int_equal(good, SGS_STATUS_OK);
    assert_int_equal(bad, SGS_STATUS_IO);
    assert_int_equal(strncmp(sgs_last_error(), "rank 0 (", 8), 0);
    assert_non_null(strstr(sgs_last_error(), "): the disk is full"));
    sgs_ranks_close(ranks);
}

static void gather_too_much(void *context, sgs_ranks *ranks)
{
    compared *c = context;
    c->status = sgs_ranks_gather(ranks, SGS_STATUS_OK, NULL, ((size_t)1 << 30) + 1, NULL);
    snprintf(c->message, sizeof c->message, "%s", c->status ? sgs_last_error() : "");
}

static void more_bytes_than_a_message_can_have_are_refused(void **state)
{
    (void)state;
    compared members[2] = {{.status = SGS_STATUS_OK}};
    ranks_run(2, members, sizeof *members, gather_too_much);
    for (int r = 0; r < 2; ++r) {
        assert_int_equal(members[r].status, SGS_STATUS_LIMIT);
        assert_non_null(strstr(members[r].message, "1073741825 bytes of a rank exceed the limit"));
    }
}

static void gather_by_rank(void *context, sgs_ranks *ranks)
{
    compared *c = context;
    static const char bytes[16] = {0};
    char got[3 * sizeof bytes];
    const size_t size = sgs_ranks_rank(ranks) == 2 ? 9 : 8;
    c->status = sgs_ranks_gather(ranks, SGS_STATUS_OK, bytes, size, got);
    snprintf(c->message, sizeof c->message, "%s", c->status ? sgs_last_error() : "");
}

static void other_sizes_than_on_rank_0_are_refused(void **state)
{
    (void)state;
    compared members[3] = {{.status = SGS_STATUS_OK}};
    ranks_run(3, members, sizeof *members, gather_by_rank);
    for (int r = 0; r < 3; ++r) {
        assert_int_equal(members[r].status, SGS_STATUS_INVALID_ARGUMENT);
        assert_string_equal(members[r].message, "rank 2 gathers 9 bytes, but rank 0 8");
    }
}

// ---- Broadcasts and flags ----

static void one_process_keeps_its_bytes_and_no_flags(void **state)
{
    (void)state;
    char text[] = "bytes";
    void *bytes = text;
    size_t size = sizeof text;
    assert_int_equal(sgs_ranks_broadcast(NULL, SGS_STATUS_OK, &bytes, &size), SGS_STATUS_OK);
    assert_int_equal(sgs_ranks_broadcast(NULL, SGS_STATUS_IO, &bytes, &size), SGS_STATUS_IO);
    assert_true(bytes == text && size == sizeof text);
    sgs_ranks_raise(NULL, 5);
    assert_int_equal(sgs_ranks_agree(NULL, SGS_STATUS_OK), SGS_STATUS_OK);
    assert_int_equal(sgs_ranks_raised(NULL), 0);
    sgs_ranks_lower(NULL, 5);
    sgs_ranks_recover(NULL);
}

typedef struct told {
    int failing;       // this rank passes a failure, -1 = none
    size_t wrong;      // line of the first difference from what is documented, 0 = none
    sgs_status status; // of the broadcast, of a call after it, and after sgs_ranks_recover
    sgs_status again, recovered;
    char message[256];
} told;

#define EXPECT(condition) told->wrong = told->wrong || (condition) ? told->wrong : __LINE__

static void broadcast(void *context, sgs_ranks *ranks)
{
    told *told = context;
    char first[] = "of rank 0", other[] = "other";
    const bool leads = !sgs_ranks_rank(ranks);
    void *const own = leads ? first : other;
    void *bytes = own;
    size_t size = leads ? sizeof first - 1 : 0;
    const sgs_status status = sgs_ranks_rank(ranks) == told->failing
                                  ? sgsi_fail(SGS_STATUS_FORMAT, "line 3 is damaged")
                                  : SGS_STATUS_OK;
    told->status = sgs_ranks_broadcast(ranks, status, &bytes, &size);
    if (told->status) {
        snprintf(told->message, sizeof told->message, "%s", sgs_last_error());
        EXPECT(bytes == own);
    } else {
        EXPECT(size == 9 && !memcmp(bytes, "of rank 0", 9) && (bytes == own) == leads);
        EXPECT(!((char *)bytes)[9]); // a NUL after the last byte
    }
    told->again = sgs_ranks_agree(ranks, SGS_STATUS_OK);
    sgs_ranks_recover(ranks);
    told->recovered = sgs_ranks_agree(ranks, SGS_STATUS_OK);
    if (bytes != own)
        free(bytes);
}

static void a_broadcast_arrives_on_all_ranks_or_fails_on_all(void **state)
{
    (void)state;
    told members[3];
    for (int count = 1; count <= 3; ++count)
        for (int failing = -1; failing < count; ++failing) {
            char text[40];
            snprintf(text, sizeof text, "rank %d (", failing);
            for (int r = 0; r < count; ++r)
                members[r] = (told){.failing = failing};
            ranks_run(count, members, sizeof *members, broadcast);
            for (int r = 0; r < count; ++r) {
                const told *m = &members[r];
                if (m->wrong)
                    fail_msg("rank %d of %d: line %zu", r, count, m->wrong);
                assert_int_equal(m->status, failing < 0 ? SGS_STATUS_OK : SGS_STATUS_FORMAT);
                assert_int_equal(m->again, m->status);
                assert_int_equal(m->recovered, SGS_STATUS_OK);
                assert_true(failing < 0 || (!strncmp(m->message, text, strlen(text)) &&
                                            strstr(m->message, "line 3 is damaged")));
            }
        }
}

static void flag(void *context, sgs_ranks *ranks)
{
    told *told = context;
    const int rank = sgs_ranks_rank(ranks), last = sgs_ranks_count(ranks) - 1;
    const uint32_t sent = last ? 0x8001 : 1; // by rank 0 and, if there are several, by the last one
    if (rank == 0)
        sgs_ranks_raise(ranks, 1);
    if (rank && rank == last)
        sgs_ranks_raise(ranks, 0x8000);
    EXPECT(sgs_ranks_raised(ranks) == 0); // no call yet
    EXPECT(!sgs_ranks_agree(ranks, SGS_STATUS_OK) && sgs_ranks_raised(ranks) == sent);
    EXPECT(!sgs_ranks_agree(ranks, SGS_STATUS_OK) && sgs_ranks_raised(ranks) == sent);
    sgs_ranks_lower(ranks, 1);
    EXPECT(sgs_ranks_raised(ranks) == (sent & 0x8000));
    EXPECT(!sgs_ranks_agree(ranks, SGS_STATUS_OK) && sgs_ranks_raised(ranks) == (sent & 0x8000));
    // A failed call carries them, too.
    sgs_ranks_raise(ranks, rank == 0 ? 4 : 0);
    EXPECT(sgs_ranks_agree_text(ranks, SGS_STATUS_IO, "lost") == SGS_STATUS_IO);
    EXPECT(sgs_ranks_raised(ranks) == (4 | (sent & 0x8000)));
}

static void a_message_is_kept_without_ranks(void **state)
{
    (void)state;
    assert_int_equal(sgs_ranks_agree_text(NULL, SGS_STATUS_OK, "unused"), SGS_STATUS_OK);
    assert_int_equal(sgs_ranks_agree_text(NULL, SGS_STATUS_IO, "the disk is full"), SGS_STATUS_IO);
    assert_string_equal(sgs_last_error(), "the disk is full");
    assert_int_equal(sgs_ranks_agree_text(NULL, SGS_STATUS_LIMIT, NULL), SGS_STATUS_LIMIT);
    assert_string_equal(sgs_last_error(), "the disk is full");
}

static void flags_are_known_to_all_until_they_are_lowered(void **state)
{
    (void)state;
    for (int count = 1; count <= 3; count += 2) {
        told members[3] = {{.failing = -1}};
        ranks_run(count, members, sizeof *members, flag);
        for (int r = 0; r < count; ++r)
            if (members[r].wrong)
                fail_msg("rank %d of %d: line %zu", r, count, members[r].wrong);
    }
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(blocks_arrive_in_the_order_of_the_ranks),
        cmocka_unit_test(a_failure_ends_the_call_on_all_ranks),
        cmocka_unit_test(a_rank_without_memory_ends_the_call_on_all_ranks),
        cmocka_unit_test(one_process_keeps_its_block),
        cmocka_unit_test(the_difference_is_in_the_message),
        cmocka_unit_test(the_difference_of_a_missing_value_is_in_the_message),
        cmocka_unit_test(more_senders_than_ranks_are_refused),
        cmocka_unit_test(a_rank_without_memory_at_the_start_ends_all),
        cmocka_unit_test(calls_agree_without_memory),
        cmocka_unit_test(more_bytes_than_a_message_can_have_are_refused),
        cmocka_unit_test(other_sizes_than_on_rank_0_are_refused),
        cmocka_unit_test(one_process_keeps_its_bytes_and_no_flags),
        cmocka_unit_test(a_broadcast_arrives_on_all_ranks_or_fails_on_all),
        cmocka_unit_test(a_message_is_kept_without_ranks),
        cmocka_unit_test(flags_are_known_to_all_until_they_are_lowered)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
