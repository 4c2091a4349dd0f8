// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Who may use the viewer's server: checks of the headers of one HTTP request. Pure functions
// without sockets.
//
// A page of another site can send requests to 127.0.0.1. It cannot change the headers Host and
// Origin, which name that site, also if its name resolves to 127.0.0.1 (DNS rebinding). Such a page
// knows no token, and browsers send the cookie only to the host that set it. So a request with the
// token may name any host, for example that of a reverse proxy; its origin must be that host, or
// the one that the proxy names in X-Forwarded-Host, which pages cannot set.

#include <stdbool.h>
#include <stddef.h>

enum {
    TOKEN_BYTES = 24,
    TOKEN_LENGTH = 32,
    TOKEN_MINIMUM = 8,
    TOKEN_MAXIMUM = 128,
    HOST_MAXIMUM = 255,
    COOKIE_MAXIMUM = 31 // length of its name
};

typedef struct access_rules {
    bool loopback;     // bound to 127.0.0.0/8: without a token, Host must name this machine
    const char *token; // or NULL
    int port;          // part of the name of the cookie
} access_rules;

// Headers of a request; NULL if absent. token: of the query, after decoding. forwarded: by
// forwarded_host.
typedef struct access_request {
    const char *host, *origin, *cookie, *token, *forwarded;
} access_request;

// 200, 401 (no or wrong token) or 403 (foreign Host or Origin).
int access_check(const access_rules *rules, const access_request *request);

// True for "localhost", "127.x.x.x" and "[::1]", with or without a port. The port is not compared:
// a tunnel may use another one.
bool host_is_loopback(const char *host);
// The first host of the header X-Forwarded-Host, which may be NULL; "" if it is malformed.
void forwarded_host(const char *header, char host[HOST_MAXIMUM + 1]);
// True if the origin is http:// or https:// followed by the host.
bool origin_is_host(const char *origin, const char *host);
// TOKEN_MINIMUM to TOKEN_MAXIMUM letters, digits, '-' and '_'.
bool token_is_valid(const char *token);
// A random token. False if the system provides no random bytes.
bool token_create(char token[TOKEN_LENGTH + 1]);
// The name of the cookie that holds the token: with a hash of the token, because browsers share the
// cookies of all ports of a host, and tunnels to several machines may lead to the same port.
void token_cookie_name(const access_rules *rules, char name[COOKIE_MAXIMUM + 1]);
