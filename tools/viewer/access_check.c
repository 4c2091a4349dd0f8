// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "viewer/access_check.h"

#include <ctype.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/random.h>

// Length of the name in "name[:port]", or 0 if the port is not a number or another character is
// in it.
static size_t name_length(const char *host)
{
    if (host[strspn(host, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789.-_:[]")])
        return 0;
    const char *const bracket = *host == '[' ? strchr(host, ']') : NULL;
    const char *const end = bracket ? bracket + 1 : host + strcspn(host, ":");
    if (*host == '[' && !bracket)
        return 0;
    if (!*end)
        return (size_t)(end - host);
    const size_t digits = strspn(end + 1, "0123456789");
    return *end == ':' && digits >= 1 && digits <= 5 && !end[1 + digits] ? (size_t)(end - host) : 0;
}

// "127." and three numbers of one to three digits.
static bool is_loopback_number(const char *name, size_t length)
{
    size_t at = 0;
    for (int part = 0; part < 4; ++part) {
        size_t digits = 0;
        while (at + digits < length && isdigit((unsigned char)name[at + digits]))
            ++digits;
        if (digits < 1 || digits > 3 || (part == 0 && (digits != 3 || memcmp(name, "127", 3) != 0)))
            return false;
        at += digits;
        if (part < 3 && (at >= length || name[at++] != '.'))
            return false;
    }
    return at == length;
}

bool host_is_loopback(const char *host)
{
    const size_t length = host ? name_length(host) : 0;
    return (length == 9 && !strncasecmp(host, "localhost", 9)) ||
           (length == 5 && !memcmp(host, "[::1]", 5)) ||
           is_loopback_number(host ? host : "", length);
}

void forwarded_host(const char *header, char host[HOST_MAXIMUM + 1])
{
    const char *const start = header ? header + strspn(header, " \t") : "";
    const size_t length = strcspn(start, ", \t");
    *host = 0;
    if (length > HOST_MAXIMUM)
        return;
    memcpy(host, start, length);
    host[length] = 0;
    if (!name_length(host))
        *host = 0;
}

bool origin_is_host(const char *origin, const char *host)
{
    const size_t scheme = !strncasecmp(origin, "http://", 7)    ? 7
                          : !strncasecmp(origin, "https://", 8) ? 8
                                                                : 0;
    return scheme && host && *host && !strcasecmp(origin + scheme, host);
}

// Takes the same time wherever the texts differ.
static bool token_equals(const char *given, const char *token)
{
    const size_t length = strlen(token), given_length = given ? strlen(given) : 0;
    volatile unsigned char difference = (unsigned char)(given_length != length);
    for (size_t i = 0; i < length; ++i)
        difference |= (unsigned char)(token[i] ^ (given_length ? given[i % given_length] : 0));
    return !difference;
}

bool token_is_valid(const char *token)
{
    const size_t length = strlen(token);
    for (size_t i = 0; i < length; ++i)
        if (!isalnum((unsigned char)token[i]) && token[i] != '-' && token[i] != '_')
            return false;
    return length >= TOKEN_MINIMUM && length <= TOKEN_MAXIMUM;
}

bool token_create(char token[TOKEN_LENGTH + 1])
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_";
    uint8_t bytes[TOKEN_BYTES];
    if (getrandom(bytes, sizeof bytes, 0) != (ssize_t)sizeof bytes)
        return false;
    for (int i = 0; i < TOKEN_BYTES / 3; ++i) {
        const uint32_t group = (uint32_t)bytes[3 * i] << 16 | (uint32_t)bytes[3 * i + 1] << 8 |
                               (uint32_t)bytes[3 * i + 2];
        for (int k = 0; k < 4; ++k)
            token[4 * i + k] = digits[group >> (18 - 6 * k) & 63];
    }
    token[TOKEN_LENGTH] = 0;
    return true;
}

// FNV-1a of 32 bits.
void token_cookie_name(const access_rules *rules, char name[COOKIE_MAXIMUM + 1])
{
    uint32_t hash = 2166136261U;
    for (const char *at = rules->token; *at; ++at)
        hash = (hash ^ (unsigned char)*at) * 16777619U;
    snprintf(name, COOKIE_MAXIMUM + 1, "sparegs_view_%d_%08x", rules->port, (unsigned)hash);
}

// True if the cookie header has the token under the right name.
static bool cookie_has(const access_rules *rules, const char *cookie)
{
    char name[COOKIE_MAXIMUM + 1], value[TOKEN_MAXIMUM + 2];
    token_cookie_name(rules, name);
    const size_t length = strlen(name);
    for (const char *at = cookie; at && *at; at = strchr(at, ';') ? strchr(at, ';') + 1 : NULL) {
        at += strspn(at, " ");
        if (strncmp(at, name, length) != 0 || at[length] != '=')
            continue;
        const size_t held = strcspn(at + length + 1, "; ");
        if (held >= sizeof value)
            continue;
        memcpy(value, at + length + 1, held);
        value[held] = 0;
        if (token_equals(value, rules->token))
            return true;
    }
    return false;
}

int access_check(const access_rules *rules, const access_request *request)
{
    if (!request->host || !name_length(request->host))
        return 403;
    if (rules->token && !cookie_has(rules, request->cookie) &&
        !token_equals(request->token, rules->token))
        return 401;
    if (rules->loopback && !rules->token && !host_is_loopback(request->host))
        return 403;
    const bool own = !request->origin || origin_is_host(request->origin, request->host);
    return own || (rules->token && origin_is_host(request->origin, request->forwarded)) ? 200 : 403;
}
