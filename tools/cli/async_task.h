// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// One task at a time that runs in a thread next to the caller's.

#include <pthread.h>
#include <stdbool.h>

// Zero-initialise before use.
typedef struct background {
    pthread_t thread;
    bool running, result;
    bool (*work)(void *);
    void *context;
} background;

// Calls work(context) in a new thread, or, if `beside` is false or no thread can be started,
// synchronously. Wait for the previous task first. `self` must not move until background_wait
// returns.
void background_start(background *self, bool beside, bool (*work)(void *), void *context);
// Waits for the task and returns its result; true if there was none.
bool background_wait(background *self);
