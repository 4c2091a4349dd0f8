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

// A reverse proxy forwards the Host of the browser, or its own and X-Forwarded-Host.
static void a_request_with_the_token_may_name_the_host_of_a_proxy(void **state)
{
    (void)state;
    static const char token[] = "abcdefgh12345678", proxy[] = "view.example:8443";
    static const char own[] = "https://view.example:8443", other[] = "https://evil.example";
    const access_rules rules = {.loopback = true, .token = token, .port = 8080};
    const struct {
        const char *host, *origin, *forwarded, *token;
        int status;
    } cases[] = {{proxy, NULL, "", token, 200},
                 {proxy, own, "", token, 200},
                 {proxy, other, "", token, 403},
                 {proxy, own, "", NULL, 401}, // a name that resolves to 127.0.0.1
                 {proxy, own, proxy, NULL, 401},
                 {proxy, own, proxy, "wrong-token-12345", 401},
                 {"127.0.0.1:8080", own, proxy, token, 200},
                 {"127.0.0.1:8080", own, "", token, 403},
                 {"127.0.0.1:8080", other, proxy, token, 403},
                 {"127.0.0.1:8080", "http://127.0.0.1:8081", "", token, 403}, // the cookie's site
                 {"127.0.0.1:8080", "null", "null", token, 403},
                 {"127.0.0.1:8080", "https://", "", token, 403},
                 {"view.example;x", NULL, "", token, 403},
                 {"view.example x", NULL, "", token, 403}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        const access_request request = {.host = cases[i].host,
                                        .origin = cases[i].origin,
                                        .forwarded = cases[i].forwarded,
                                        .token = cases[i].token};
        if (access_check(&rules, &request) != cases[i].status)
            fail_msg("case %zu", i);
    }
    const access_rules open = {.loopback = true, .port = 8080}; // without a token, no proxy
    const access_request foreign = {.host = proxy, .origin = own, .forwarded = proxy},
                         forwarded = {.host = "127.0.0.1:8080", .origin = own, .forwarded = proxy};
    assert_int_equal(access_check(&open, &foreign), 403);
    assert_int_equal(access_check(&open, &forwarded), 403);
}

static void the_first_forwarded_host_counts(void **state)
{
    (void)state;
    char host[HOST_MAXIMUM + 1], longest[2 * HOST_MAXIMUM];
    static const char *const cases[][2] = {{NULL, ""},
                                           {"", ""},
                                           {"a.example", "a.example"},
                                           {" a.example:8443 , b.example", "a.example:8443"},
                                           {"a.example,b.example", "a.example"},
                                           {"[::1]:80", "[::1]:80"},
                                           {"a;b", ""},
                                           {"a'b", ""},
                                           {"a:b", ""}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        forwarded_host(cases[i][0], host);
        assert_string_equal(host, cases[i][1]);
    }
    memset(longest, 'a', sizeof longest);
    longest[sizeof longest - 1] = 0;
    forwarded_host(longest, host);
    assert_string_equal(host, "");
    longest[HOST_MAXIMUM] = 0;
    forwarded_host(longest, host);
    assert_string_equal(host, longest);
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
                 {NULL, "sparegs_view_8080_ba242725=abcdefgh12345678", 200},
                 {NULL, "a=b; sparegs_view_8080_ba242725=abcdefgh12345678; c=d", 200},
                 {NULL, "sparegs_view_8081_ba242725=abcdefgh12345678", 401},
                 {NULL, "sparegs_view_8080=abcdefgh12345678", 401},
                 {NULL, "sparegs_view_8080_ba242725=", 401},
                 {NULL, "sparegs_view_8080_ba242725", 401},
                 {NULL, ";;;=;sparegs_view_8080_ba242725=wrong", 401},
                 {NULL, "xsparegs_view_8080_ba242725=abcdefgh12345678", 401}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; ++i) {
        const access_request request = {
            .host = "192.0.2.1:8080", .token = cases[i].token, .cookie = cases[i].cookie};
        if (access_check(&rules, &request) != cases[i].status)
            fail_msg("case %zu", i);
    }
}

// Tunnels to two machines may lead to the same port of 127.0.0.1, whose cookies a browser shares.
static void cookies_of_two_tokens_have_different_names(void **state)
{
    (void)state;
    const access_rules one = {.token = "foobar", .port = 8080}, // vectors of draft-eastlake-fnv
        other = {.token = "a", .port = 65535};
    char name[COOKIE_MAXIMUM + 1];
    token_cookie_name(&one, name);
    assert_string_equal(name, "sparegs_view_8080_bf9cf968");
    token_cookie_name(&other, name);
    assert_string_equal(name, "sparegs_view_65535_e40c292c");
}

static void a_long_cookie_is_not_copied(void **state)
{
    (void)state;
    const access_rules rules = {.token = "abcdefgh12345678", .port = 1};
    char cookie[4096] = "sparegs_view_1_ba242725=";
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
        cmocka_unit_test(a_request_with_the_token_may_name_the_host_of_a_proxy),
        cmocka_unit_test(the_first_forwarded_host_counts),
        cmocka_unit_test(a_token_is_required_from_query_or_cookie),
        cmocka_unit_test(cookies_of_two_tokens_have_different_names),
        cmocka_unit_test(a_long_cookie_is_not_copied),
        cmocka_unit_test(random_tokens_are_valid_and_differ),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
