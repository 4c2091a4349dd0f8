// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// A running viewer: source, connected pages, drawing thread and server.

#include "viewer/view_artist.h"
#include "viewer/view_server.h"

typedef struct view_session {
    view_source source;
    view_hub hub;
    view_artist artist;
    view_server *server;
    char token[TOKEN_MAXIMUM + 1]; // "" = none
    bool training;
    // Of a training, or NULL: its state, and what receives the actions of pages.
    json_t *(*progress)(void *context);
    void (*act)(void *context, run_action action);
    void *run_context;
} view_session;

typedef struct view_session_options {
    view_address address;
    const char *token; // NULL: random for an address other than the loopback, else none
    double share;      // see view_artist.h
    bool training;     // the model is replaced by view_source_offer
} view_session_options;

// Serves the opened session->source. False after printing the error; call view_session_stop in any
// case.
bool view_session_start(view_session *session, const view_session_options *options);
// Prints the URL as a line of stdout.
void view_session_print(const view_session *session);
void view_session_stop(view_session *session);
