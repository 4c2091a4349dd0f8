// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

// Requests of other sites, wrong tokens and malformed headers are refused.

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "viewer/access_check.h"

static void only_names_of_this_machine_are_loopback(void **state)
{
    (void)state;
    static const char *const good[] = {"localhost", "LocalHost:8080", "127.0.0.1",  "127.0.0.1:1",
                                       "127.1.2.3", "[::1]",          "[::1]:65535"};
    static const char *const bad[] = {"evil.example",
                                      "localhost.evil.example",
                                      "127.0.0.1.evil",
                                      "evil:127",
                                      "127.0.0.1:",
                                      "127.0.0.1:80a",
                                      "localhost:8x",
                                      "[::1",
                                      "[::1]8080",
                                      "128.0.0.1",
                                      "127.0.0",
                                      "1270.0.0.1",
                                      "127..0.1",
                                      "127.0.0.1.1",
                                      "",
                                      "localhost:1234567",
                                      "x[::1]",
                                      "0127.0.0.1"};
    for (size_t i = 0; i < sizeof good / sizeof *good; ++i)
        assert_true(host_is_loopback(good[i]));
    for (size_t i = 0; i < sizeof bad / sizeof *bad; ++i)
        if (host_is_loopback(bad[i]))
            fail_msg("%s is accepted", bad[i]);
    assert_false(host_is_loopback(NULL));
}

static void an_origin_is_exactly_the_host(void **state)
{
    (void)state;
    assert_true(origin_is_host("http://localhost:8080", "localhost:8080"));
    assert_true(origin_is_host("https://view.example", "view.example"));
    assert_false(origin_is_host("http://evil.example", "localhost:8080"));
    assert_false(origin_is_host("http://localhost:8081", "localhost:8080"));
    assert_false(origin_is_host("http://localhost:8080.evil.example", "localhost:8080"));
    assert_false(origin_is_host("null", "localhost:8080"));
    assert_false(origin_is_host("file://", ""));
    assert_false(origin_is_host("ftp://localhost:8080", "localhost:8080"));
}

static void foreign_hosts_and_origins_are_forbidden(void **state)
{
    (void)state;
    const access_rules local = {.loopback = true, .port = 8080};
    assert_int_equal(access_check(&local, &(access_request){.host = "127.0.0.1:8080"}), 200);
    assert_int_equal(access_check(&local, &(access_request){.host = "localhost:9000"}), 200);
    assert_int_equal(access_check(&local, &(access_request){.host = "evil.example"}), 403);
    assert_int_equal(access_check(&local, &(access_request){0}), 403);
    assert_int_equal(access_check(&local, &(access_request){.host = "127.0.0.1:8080",
                                                            .origin = "http://evil.example"}),
                     403);
    assert_int_equal(access_check(&local, &(access_request){.host = "evil.example",
                                                            .origin = "http://evil.example"}),
                     403);
}

static void a_token_is_required_from_query_or_cookie(void **state)
{
    (void)state;
    const access_rules rules = {.token = "abcdefgh12345678", .port = 8080};
    const struct {
        const char *token, *cookie;
        int status;
    } cases[] = {{NULL, NULL, 401},
                 {"", NULL, 401},
                 {"abcdefgh12345679", NULL, 401},
                 {"abcdefgh1234567", NULL, 401},
                 {"abcdefgh123456780", NULL, 401},
                 {"abcdefgh12345678", NULL, 200},
                 {NULL, "sparegs_view_8080=abcdefgh12345678", 200},
                 {NULL, "a=b; sparegs_view_8080=abcdefgh12345678; c=d", 200},
                 {NULL, "sparegs_view_8081=abcdefgh12345678", 401},
                 {NULL, "sparegs_view_8080=", 401},
                 {NULL, "sparegs_view_8080", 401},
                 {NULL, ";;;=;sparegs_view_8080=wrong", 401},
                 {NULL, "xsparegs_view_8080=abcdefgh12345678", 401}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        const access_request request = {
            .host = "192.0.2.1:8080", .token = cases[i].token, .cookie = cases[i].cookie};
        if (access_check(&rules, &request) != cases[i].status)
            fail_msg("case %zu", i);
    }
}

static void a_long_cookie_is_not_copied(void **state)
{
    (void)state;
    const access_rules rules = {.token = "abcdefgh12345678", .port = 1};
    char cookie[4096] = "sparegs_view_1=";
    memset(cookie + strlen(cookie), 'a', sizeof cookie - strlen(cookie) - 1);
    cookie[sizeof cookie - 1] = 0;
    assert_int_equal(access_check(&rules, &(access_request){.host = "a", .cookie = cookie}), 401);
}

static void random_tokens_are_valid_and_differ(void **state)
{
    (void)state;
    char a[TOKEN_LENGTH + 1], b[TOKEN_LENGTH + 1];
    assert_true(token_create(a) && token_create(b));
    assert_int_equal(strlen(a), TOKEN_LENGTH);
    assert_true(token_is_valid(a) && token_is_valid(b));
    assert_string_not_equal(a, b);
    assert_false(token_is_valid("short"));
    assert_false(token_is_valid("with space 12345"));
    assert_false(token_is_valid("semicolon;12345"));
}

int main(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(only_names_of_this_machine_are_loopback),
        cmocka_unit_test(an_origin_is_exactly_the_host),
        cmocka_unit_test(foreign_hosts_and_origins_are_forbidden),
        cmocka_unit_test(a_token_is_required_from_query_or_cookie),
        cmocka_unit_test(a_long_cookie_is_not_copied),
        cmocka_unit_test(random_tokens_are_valid_and_differ),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
