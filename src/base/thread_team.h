// SPDX-FileCopyrightText: 2026 The sparegs authors
// SPDX-License-Identifier: Apache-2.0
#pragma once

// The threads behind the loops of threads.h. A team belongs to the thread that runs loops on it and
// ends with that thread. Its members wait for the next loop awake for some microseconds, then
// asleep. A loop ends when all items are done: a member that did not get a processor in time takes
// no part in it, and nobody waits for one that has nothing to do. That is what OpenMP's loops
// cannot do: there every thread has to arrive at the end of each of them, so a single other busy
// process holds all of them up.

#include <stdbool.h>

#include "base/threads.h"

// Runs the items as sgsi_parallel_for does, on `threads` >= 2 threads with the calling one (fewer
// when the system has no more). Returns the sum over the threads of when each was done, in seconds
// after `start` (of sgsi_seconds); 0 for one that took no part. Not from inside of an item.
double sgsi_team_run(int threads, size_t count, size_t chunk, sgsi_item_fn body, void *context,
                     double start);

// True while the calling thread runs an item.
bool sgsi_team_is_inside(void);
