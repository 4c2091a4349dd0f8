// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// One piece of work at a time beside the caller's own.

#include <pthread.h>
#include <stdbool.h>

// Zero at first.
typedef struct background {
    pthread_t thread;
    bool running, result;
    bool (*work)(void *);
    void *context;
} background;

// Calls work(context) in a thread of its own; where none can be started, or unless `beside`, before
// it returns. The work before must have been waited for. It must not move meanwhile.
void background_start(background *self, bool beside, bool (*work)(void *), void *context);
// Waits for the end of the work. Returns its result; true when there was none.
bool background_wait(background *self);
