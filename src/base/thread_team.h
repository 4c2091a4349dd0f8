// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// Thread team behind the loops of threads.h. A team belongs to the thread that runs loops on it and
// ends with that thread. Its members spin for some microseconds between loops, then sleep. A loop
// ends when all items are done and every member that took part has left; a member that was not
// scheduled in time is not waited for. OpenMP loops require every thread to arrive at the end of
// each loop, so that one other busy process delays all of them.

#include <stdbool.h>

#include "base/threads.h"

// Runs the items like sgsi_parallel_for on `threads` >= 2 threads including the caller (fewer if
// the system refuses more). Returns the sum over the participating threads of their finishing
// times, in seconds after `start` (of sgsi_seconds). Must not be called from inside an item.
double sgsi_team_run(int threads, size_t count, size_t chunk, sgsi_item_fn body, void *context,
                     double start);

// True while the calling thread runs an item.
bool sgsi_team_is_inside(void);
