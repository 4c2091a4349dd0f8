// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A running viewer: source, connected pages, render thread and server.

#include "viewer/view_render_thread.h"
#include "viewer/view_server.h"

typedef struct view_session {
    view_source source;
    view_hub hub;
    view_render_thread render;
    view_server *server;
    char token[TOKEN_MAXIMUM + 1]; // "" = none
    bool training;
    // Of a training run, or NULL: its state, and what receives the actions of pages.
    json_t *(*progress)(void *context);
    void (*act)(void *context, run_action action);
    void *run_context;
} view_session;

typedef struct view_session_options {
    view_address address;
    // Valid or "random"; NULL: that of SPAREGS_TOKEN, without it random for an address other than
    // the loopback, else none.
    const char *token;
    double share;  // see view_render_thread.h
    bool training; // the model is replaced by view_source_offer
} view_session_options;

// The environment variable with the token: unlike a command line, other users cannot read it.
#define VIEW_TOKEN_VARIABLE "SPAREGS_TOKEN"
#define VIEW_TOKEN_SYNTAX "must be random, or 8 to 128 letters, digits, '-' or '_'"
// True if the token of the options, or that of the variable without one, has this syntax or is
// absent.
bool view_token_is_possible(const char *token);

// Serves the opened session->source. False after printing the error; call view_session_stop in any
// case.
bool view_session_start(view_session *session, const view_session_options *options);
// The URL, owned by the session.
const char *view_session_url(const view_session *session);
// Prints the URL as a line of stdout.
void view_session_print(const view_session *session);
void view_session_stop(view_session *session);
