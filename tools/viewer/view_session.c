// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "viewer/view_session.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "cli/progress.h"
#include "cli/standard_output.h"
#include "viewer/view_facts.h"

static json_t *hello(void *context)
{
    view_session *session = context;
    json_t *root = view_facts(&session->source, session->training);
    if (session->progress)
        json_object_set_new(root, "progress", session->progress(session->run_context));
    return root;
}

static json_t *history(void *context)
{
    return view_history(&((view_session *)context)->source);
}

static const char *token_or_variable(const char *token)
{
    const char *variable = getenv(VIEW_TOKEN_VARIABLE);
    return token ? token : variable && *variable ? variable : NULL;
}

static bool is_random(const char *token)
{
    return !strcmp(token, "random");
}

bool view_token_is_possible(const char *token)
{
    token = token_or_variable(token);
    return !token || is_random(token) || token_is_valid(token);
}

// False after printing the error.
static bool choose_token(view_session *session, const view_session_options *options)
{
    const char *token = token_or_variable(options->token);
    if (token && !is_random(token))
        snprintf(session->token, sizeof session->token, "%s", token);
    else if ((token || !view_address_is_loopback(&options->address)) &&
             !token_create(session->token)) {
        fail_run("the system provides no random numbers for a token; set one");
        return false;
    }
    return true;
}

bool view_session_start(view_session *session, const view_session_options *options)
{
    session->training = options->training;
    view_hub_open(&session->hub, &session->source.views);
    session->hub.greet = hello;
    session->hub.greet_context = session;
    session->hub.act = session->act;
    session->hub.act_context = session->run_context;
    session->hub.no_crop = options->training; // --max-memory reserves one model and its BVH
    session->render.hub = &session->hub;
    session->render.source = &session->source;
    session->render.history = history;
    session->render.context = session;
    session->render.is_live = options->training;
    atomic_store(&session->render.share, options->share);
    if (!choose_token(session, options))
        return false;
    const view_server_options server = {.address = options->address,
                                        .token = *session->token ? session->token : NULL,
                                        .hub = &session->hub,
                                        .source = &session->source,
                                        .share = &session->render.share};
    session->server = view_server_start(&server);
    return session->server && view_render_thread_start(&session->render);
}

const char *view_session_url(const view_session *session)
{
    return view_server_url(session->server);
}

void view_session_print(const view_session *session)
{
    printf("%s\n", view_session_url(session));
    stdout_flush();
}

void view_session_stop(view_session *session)
{
    if (!session->hub.views)
        return;
    view_hub_stop(&session->hub);
    view_render_thread_join(&session->render);
    view_server_stop(session->server);
    session->server = NULL;
    view_hub_close(&session->hub);
    session->hub.views = NULL;
}
