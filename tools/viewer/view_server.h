// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The HTTP and WebSocket server (CivetWeb). It serves the page at /, WebSockets at /stream, and the
// photos of the scene by number at /photo/N and /thumb/N; nothing else, and no file by name.
// Every request is checked by access_check.

#include "viewer/access_check.h"
#include "viewer/view_hub.h"
#include "viewer/view_source.h"

typedef struct view_server view_server;

typedef struct view_address {
    char host[64]; // numeric IPv4 address
    int port;      // 0 = any free port
} view_address;

// "[ADDRESS:]PORT" with a numeric IPv4 address or localhost; without ADDRESS 127.0.0.1. False if it
// is none of these.
bool view_address_parse(const char *text, view_address *address);
// Sets the host of an address; likewise.
bool view_address_host(const char *text, view_address *address);
bool view_address_is_loopback(const view_address *address);

// Binds a socket for a moment. False after printing the error: the port is in use, or the address
// is not one of this machine.
bool view_address_is_free(const view_address *address);

typedef struct view_server_options {
    view_address address;
    const char *token; // or NULL; an address other than the loopback requires one
    view_hub *hub;
    view_source *source;
    const _Atomic double *share; // see view_render_thread.h
} view_server_options;

// NULL after printing the error; see view_address_is_free.
view_server *view_server_start(const view_server_options *options);
// The URL to open, with the token; owned by the server.
const char *view_server_url(const view_server *server);
// Ends all connections. Call view_hub_stop before. Accepts NULL.
void view_server_stop(view_server *server);
