// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0

#include "base/progress_calls.h"

void sgsi_progress_begin(sgsi_progress *progress, sgs_progress_fn call, void *user, size_t total)
{
    *progress =
        (sgsi_progress){.call = call, .user = user, .total = total, .mode = sgsi_float_mode_get()};
    pthread_mutex_init(&progress->lock, NULL);
}

void sgsi_progress_end(sgsi_progress *progress)
{
    pthread_mutex_destroy(&progress->lock);
}

bool sgsi_progress_call(sgs_progress_fn call, void *user, size_t done, size_t total,
                        sgsi_float_mode mode)
{
    const sgsi_float_mode own = sgsi_float_mode_get();
    sgsi_float_mode_set(mode);
    const bool proceeds = call(user, done, total);
    sgsi_float_mode_set(own);
    return proceeds;
}

void sgsi_progress_advance(sgsi_progress *progress)
{
    if (!progress->call)
        return;
    pthread_mutex_lock(&progress->lock);
    ++progress->done;
    if (!progress->cancelled)
        progress->cancelled = !sgsi_progress_call(progress->call, progress->user, progress->done,
                                                  progress->total, progress->mode);
    pthread_mutex_unlock(&progress->lock);
}

bool sgsi_progress_cancelled(sgsi_progress *progress)
{
    if (!progress->call)
        return false;
    pthread_mutex_lock(&progress->lock);
    const bool cancelled = progress->cancelled;
    pthread_mutex_unlock(&progress->lock);
    return cancelled;
}
