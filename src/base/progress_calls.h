// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Calls a caller's progress function from parallel loops: one call at a time, with an increasing
// count, and none after it cancelled.

#include <pthread.h>
#include <stdbool.h>

#include "sparegs/status.h"

typedef struct sgsi_progress {
    sgs_progress_fn call; // or NULL
    void *user;
    size_t done, total;
    bool cancelled;
    pthread_mutex_t lock;
} sgsi_progress;

void sgsi_progress_begin(sgsi_progress *progress, sgs_progress_fn call, void *user, size_t total);
void sgsi_progress_end(sgsi_progress *progress);

// Counts one completed step.
void sgsi_progress_advance(sgsi_progress *progress);
// True after the caller cancelled; remaining work can be skipped.
bool sgsi_progress_cancelled(sgsi_progress *progress);
