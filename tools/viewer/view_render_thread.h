// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The render thread: decides which page gets the next picture and at which size, draws it and
// hands it to the hub.
//
// While a camera moves, the size follows the measured cost so that pictures take about
// MOVING_SECONDS. At rest the same view is drawn larger step by step up to full size, then without
// loss: the bits of `render --format png`.

#include "viewer/view_hub.h"
#include "viewer/view_painter.h"

typedef struct view_render_thread {
    view_hub *hub;
    view_source *source;
    pthread_t thread;
    bool running;
    // A reply to MESSAGE_HISTORY; a new reference.
    json_t *(*history)(void *context);
    void *context;
    // Share of the time that drawing may take, (0, 1]; below 1 beside a training run.
    _Atomic double share;
    bool is_live; // the model is replaced from time to time

    // Of the render thread.
    view_painter painter;
    double copied;    // time of the last copy of the model
    uint64_t version; // of the model drawn last
    bool exact;       // the share was 1
    double slice;     // start of the current stretch of work
    double owed;      // seconds to sleep for the share
    double slept;     // seconds, for the share
} view_render_thread;

// Set hub, source, history, share and is_live first. False after printing the error.
bool view_render_thread_start(view_render_thread *render);
// Waits for the thread; call view_hub_stop before.
void view_render_thread_join(view_render_thread *render);
