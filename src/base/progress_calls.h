// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Calls a caller's progress function, in the caller's floating-point mode; from parallel loops one
// call at a time, with an increasing count, and none after it cancelled.

#include <pthread.h>
#include <stdbool.h>

#include "base/float_mode.h"
#include "sparegs/status.h"

typedef struct sgsi_progress {
    sgs_progress_fn call; // or NULL
    void *user;
    size_t done, total;
    sgsi_float_mode mode; // of the thread that began
    bool cancelled;
    pthread_mutex_t lock;
} sgsi_progress;

void sgsi_progress_begin(sgsi_progress *progress, sgs_progress_fn call, void *user, size_t total);
void sgsi_progress_end(sgsi_progress *progress);

// One call in `mode`. False if the caller cancelled.
bool sgsi_progress_call(sgs_progress_fn call, void *user, size_t done, size_t total,
                        sgsi_float_mode mode);

// Counts one completed step.
void sgsi_progress_advance(sgsi_progress *progress);
// True after the caller cancelled; remaining work can be skipped.
bool sgsi_progress_cancelled(sgsi_progress *progress);
