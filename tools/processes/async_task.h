// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// One task at a time that runs in a thread next to the caller's.

#include <pthread.h>
#include <stdbool.h>

// Zero-initialise before use.
typedef struct async_task {
    pthread_t thread;
    bool running, result;
    bool (*work)(void *);
    void *context;
} async_task;

// Calls work(context) in a new thread, or, if `asynchronous` is false or no thread can be started,
// synchronously. Wait for the previous task first. `self` must not move until async_task_wait
// returns.
void async_task_start(async_task *self, bool asynchronous, bool (*work)(void *), void *context);
// Waits for the task and returns its result; true if there was none.
bool async_task_wait(async_task *self);
